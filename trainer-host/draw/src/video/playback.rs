//! The recorded flight at the rate of the video.

use crate::recorded_flight::{DroneFlight, FlightRecording, Placement};

/// Time between two pictures \[s\]: 25 per second, a whole number of the hundredths that GIF counts in.
pub(crate) const PICTURE_SECS: f32 = 0.04;

/// What one picture shows.
#[derive(Clone, Debug)]
pub(crate) struct Moment {
    /// Time since the first frame \[s\].
    pub(crate) elapsed_secs: f32,
    /// The drones, between two frames of the recording.
    pub(crate) drones: Vec<DroneMoment>,
    /// Where the moving solids are.
    pub(crate) movables: Vec<Placement>,
}

/// One drone in one picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DroneMoment {
    /// Between two frames of the recording.
    pub(crate) placement: Placement,
    /// Distance to the goal \[m\], if there is one.
    pub(crate) distance: Option<f32>,
    /// Speed \[m/s\].
    pub(crate) speed: f32,
}

/// A time between two frames: the one before it, counted from zero, and the share of the way to the next.
#[derive(Clone, Copy)]
struct Instant {
    before: usize,
    share: f32,
}

/// One moment per picture, from the one of number `first` to the last frame of the longest flight.
pub(crate) fn moments(recording: &FlightRecording, first: usize) -> impl Iterator<Item = Moment> {
    let length_secs = recording.periods() as f32 * recording.control_secs;
    let last = (length_secs / PICTURE_SECS + 1e-3) as usize;
    (first..=last).map(|index| moment(recording, index as f32 * PICTURE_SECS))
}

/// The flight at any time since its first frame \[s\].
pub(crate) fn moment(recording: &FlightRecording, elapsed_secs: f32) -> Moment {
    let place = elapsed_secs / recording.control_secs;
    let now = Instant { before: place as usize, share: place - (place as usize) as f32 };
    let drone = |flight| drone_moment(flight, now, recording.control_secs);
    Moment {
        elapsed_secs,
        drones: recording.drones.iter().map(drone).collect(),
        movables: recording.movables.iter().map(|frames| now.placement(frames)).collect(),
    }
}

fn drone_moment(flight: &DroneFlight, now: Instant, control_secs: f32) -> DroneMoment {
    let frames = &flight.frames;
    let placement = now.placement(frames);
    // In the last picture there is no way to go; its speed is that of the way there.
    let last = (now.before + 1).min(frames.len() - 1);
    let moved = frames[last].position - frames[last.saturating_sub(1)].position;
    let landed = now.before >= frames.len();
    DroneMoment {
        placement,
        distance: flight.goal.map(|goal| (placement.position - goal).norm()),
        speed: if landed { 0.0 } else { moved.norm() / control_secs },
    }
}

impl Instant {
    /// Between the frames on either side; beyond the end it is the last.
    fn placement(self, frames: &[Placement]) -> Placement {
        let [before, after] = [self.before, self.before + 1].map(|index| &frames[index.min(frames.len() - 1)]);
        before.towards(after, self.share)
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::attitude::Attitude;
    use nalgebra::Vector3;

    use super::*;

    fn flight(control_secs: f32, lengths: &[usize]) -> FlightRecording {
        let frame = |index: usize| Placement {
            position: Vector3::new(0.1 * index as f32, 0.0, 1.0),
            attitude: Attitude { w: 0.8, x: 0.0, y: 0.6, z: 0.0 },
        };
        let drone = |length: &usize| DroneFlight {
            goal: Some(Vector3::z()),
            frames: (0..*length).map(frame).collect(),
            rewards: Vec::new(),
            ending: String::new(),
            success: false,
        };
        let drones = lengths.iter().map(drone).collect();
        FlightRecording { title: "flight".to_owned(), control_secs, drones, movables: Vec::new() }
    }

    #[test]
    fn a_video_lasts_as_long_as_its_longest_flight_and_drones_stay_where_they_ended() {
        let flight = flight(0.01, &[81, 41]);
        let moments: Vec<Moment> = moments(&flight, 0).collect();
        assert_eq!(moments.len(), 21);
        let [during, after] = [5, 15].map(|picture: usize| moments[picture].drones[1]);
        assert!((during.speed - 10.0).abs() < 1e-3 && after.speed == 0.0);
        assert_eq!(after.placement.position, flight.drones[1].frames[40].position);
    }

    #[test]
    fn between_two_frames_lies_their_middle() {
        let flight = flight(0.08, &[3]);
        let middle = moments(&flight, 1).next().unwrap().drones[0];
        assert!((middle.placement.position - Vector3::new(0.05, 0.0, 1.0)).norm() < 1e-6);
        assert!((middle.speed - 0.1 / 0.08).abs() < 1e-4);
    }

    #[test]
    fn a_quaternion_that_changes_sign_turns_nothing() {
        let mut flight = flight(0.08, &[3]);
        flight.drones[0].frames[1].attitude = Attitude { w: -0.8, x: 0.0, y: -0.6, z: 0.0 };
        let middle = moments(&flight, 1).next().unwrap().drones[0].placement.attitude;
        assert!((middle.w - 0.8).abs() < 1e-6 && (middle.y - 0.6).abs() < 1e-6);
    }
}
