//! The recording at the pace of the film.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use super::{DroneFlight, FlightFrame, FlightRecording, MovingSolid, Placement};

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
    pub(crate) frame: FlightFrame,
    /// Distance to the goal \[m\].
    pub(crate) distance: f32,
    /// Speed \[m/s\].
    pub(crate) speed: f32,
    /// Pictures since its start, up to its end: after that its blades stand still.
    pub(crate) flown: usize,
}

/// A time between two frames: the one before it, counted from zero, and the share of the way to the next.
#[derive(Clone, Copy)]
struct Instant {
    before: usize,
    share: f32,
}

/// One moment per picture, from the first frame of the recording to the last of the longest flight.
pub(crate) fn moments(recording: &FlightRecording) -> Vec<Moment> {
    let frames = recording.drones.iter().map(|flight| flight.frames.len()).max().unwrap_or(1);
    (0..pictures(frames, recording.control_secs))
        .map(|index| moment(recording, index as f32 * PICTURE_SECS))
        .collect()
}

/// Pictures that show a number of frames.
fn pictures(frames: usize, control_secs: f32) -> usize {
    let length_secs = (frames - 1) as f32 * control_secs;
    (length_secs / PICTURE_SECS + 1e-3) as usize + 1
}

/// The flight at any time since its first frame \[s\].
pub(crate) fn moment(recording: &FlightRecording, elapsed_secs: f32) -> Moment {
    let index = (elapsed_secs / PICTURE_SECS).round() as usize;
    let place = elapsed_secs / recording.control_secs;
    let now = Instant { before: place as usize, share: place - (place as usize) as f32 };
    let drone = |flight| drone_moment(flight, now, index, recording.control_secs);
    Moment {
        elapsed_secs,
        drones: recording.drones.iter().map(drone).collect(),
        movables: recording.movables.iter().map(|solid| placement(solid, now)).collect(),
    }
}

fn drone_moment(flight: &DroneFlight, now: Instant, index: usize, control_secs: f32) -> DroneMoment {
    let frames = &flight.frames;
    let [before, after] = now.neighbours(frames);
    let frame = FlightFrame {
        placement: between(&before.placement, &after.placement, now.share),
        rotor_fractions: std::array::from_fn(|rotor| {
            mix(before.rotor_fractions[rotor], after.rotor_fractions[rotor], now.share)
        }),
    };
    // In the last picture there is no way to go; its speed is that of the way there.
    let last = (now.before + 1).min(frames.len() - 1);
    let moved = frames[last].placement.position - frames[last.saturating_sub(1)].placement.position;
    let landed = now.before >= frames.len();
    DroneMoment {
        frame,
        distance: (frame.placement.position - flight.goal).norm(),
        speed: if landed { 0.0 } else { moved.norm() / control_secs },
        flown: index.min(pictures(frames.len(), control_secs)),
    }
}

fn placement(solid: &MovingSolid, now: Instant) -> Placement {
    let [before, after] = now.neighbours(&solid.placements);
    between(before, after, now.share)
}

impl Instant {
    /// The items on either side; beyond the end both are the last.
    fn neighbours<T>(self, items: &[T]) -> [&T; 2] {
        [self.before, self.before + 1].map(|index| &items[index.min(items.len() - 1)])
    }
}

fn between(before: &Placement, after: &Placement, share: f32) -> Placement {
    let (from, to) = (before.attitude, nearest_sign(&before.attitude, after.attitude));
    let attitude = Attitude {
        w: mix(from.w, to.w, share),
        x: mix(from.x, to.x, share),
        y: mix(from.y, to.y, share),
        z: mix(from.z, to.z, share),
    };
    let position: Vector3<f32> = before.position.lerp(&after.position, share);
    Placement { position, attitude: attitude.normalized() }
}

fn mix(from: f32, to: f32, share: f32) -> f32 {
    from + (to - from) * share
}

/// Of the two quaternions of one attitude, the one on the near side.
fn nearest_sign(near: &Attitude<f32>, attitude: Attitude<f32>) -> Attitude<f32> {
    let Attitude { w, x, y, z } = attitude;
    let product = near.w * w + near.x * x + near.y * y + near.z * z;
    if product < 0.0 { Attitude { w: -w, x: -x, y: -y, z: -z } } else { attitude }
}
