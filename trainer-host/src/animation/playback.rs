//! The recording at the pace of the film.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use super::{FlightFrame, FlightRecording};

/// Time between two pictures \[s\]: 25 per second, a whole number of the hundredths that GIF counts in.
pub(super) const PICTURE_SECS: f32 = 0.04;

/// What one picture shows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    /// Time since the first frame \[s\].
    pub(super) elapsed_secs: f32,
    /// The drone, between two frames of the recording.
    pub(super) frame: FlightFrame,
    /// Distance to the goal \[m\].
    pub(super) distance: f32,
    /// Speed \[m/s\].
    pub(super) speed: f32,
}

/// One moment per picture, from the first frame of the recording to the last.
pub(super) fn moments(recording: &FlightRecording) -> Vec<Moment> {
    let length_secs = (recording.frames.len() - 1) as f32 * recording.control_secs;
    let count = (length_secs / PICTURE_SECS + 1e-3) as usize + 1;
    (0..count).map(|index| moment(recording, index as f32 * PICTURE_SECS)).collect()
}

fn moment(recording: &FlightRecording, elapsed_secs: f32) -> Moment {
    let frames = &recording.frames;
    let place = elapsed_secs / recording.control_secs;
    let before = (place as usize).min(frames.len() - 1);
    let after = (before + 1).min(frames.len() - 1);
    let frame = between(&frames[before], &frames[after], (place - before as f32).clamp(0.0, 1.0));
    let (first, last) = (after.saturating_sub(1), after);
    let moved: Vector3<f32> = frames[last].position - frames[first].position;
    Moment {
        elapsed_secs,
        frame,
        distance: (frame.position - recording.goal).norm(),
        speed: moved.norm() / recording.control_secs,
    }
}

fn between(before: &FlightFrame, after: &FlightFrame, share: f32) -> FlightFrame {
    let mix = |from: f32, to: f32| from + (to - from) * share;
    let (from, to) = (before.attitude, nearest_sign(&before.attitude, after.attitude));
    let attitude =
        Attitude { w: mix(from.w, to.w), x: mix(from.x, to.x), y: mix(from.y, to.y), z: mix(from.z, to.z) };
    let rotor_fractions =
        std::array::from_fn(|rotor| mix(before.rotor_fractions[rotor], after.rotor_fractions[rotor]));
    FlightFrame {
        position: before.position.lerp(&after.position, share),
        attitude: attitude.normalized(),
        rotor_fractions,
    }
}

/// Of the two quaternions of one attitude, the one on the near side.
fn nearest_sign(near: &Attitude<f32>, attitude: Attitude<f32>) -> Attitude<f32> {
    let Attitude { w, x, y, z } = attitude;
    let product = near.w * w + near.x * x + near.y * y + near.z * z;
    if product < 0.0 { Attitude { w: -w, x: -x, y: -y, z: -z } } else { attitude }
}
