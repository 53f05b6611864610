//! Where the camera goes: with the drone, but calmly, and closer as the drone comes closer to its goal.

use nalgebra::Vector3;

use super::FlightRecording;
use super::camera::Camera;
use super::playback::Moment;

/// Farthest that the camera looks ahead of the drone, towards the goal \[m\].
const LOOK_AHEAD: f32 = 0.4;

/// Least and greatest radius of what must be in the picture \[m\].
const RADII: [f32; 2] = [0.2, 0.6];

/// Space around drone and goal \[m\].
const AROUND: f32 = 0.15;

/// Height of the camera over what it looks at \[rad\].
const ELEVATION: f32 = 0.52;

/// Angle between the way to the goal and the view, so that the drone is seen from behind and beside \[rad\].
const BESIDE: f32 = 0.75;

/// Angle by which the camera circles during the flight \[rad\].
const CIRCLING: f32 = 0.35;

/// Pictures over which the camera's movement is averaged, on either side; one standard deviation is a third.
const CALMNESS: usize = 36;

/// The cameras of all pictures.
pub(super) fn cameras(recording: &FlightRecording, moments: &[Moment]) -> Vec<Camera> {
    let wanted: Vec<_> = moments.iter().map(|moment| focus_and_radius(moment, recording.goal)).collect();
    let heading = heading(recording);
    let camera = |index: usize| {
        let [x, y, z, radius] = calm(&wanted, index);
        let share = index as f32 / moments.len() as f32;
        let from = direction(heading + BESIDE + CIRCLING * (0.5 - share));
        let focus = Vector3::new(x, y, z);
        Camera::looking_at(focus + from * Camera::distance_for(radius), focus)
    };
    (0..moments.len()).map(camera).collect()
}

/// Where to look and how much must be seen, as `[x, y, z, radius]`.
fn focus_and_radius(moment: &Moment, goal: Vector3<f32>) -> [f32; 4] {
    let share = (LOOK_AHEAD / moment.distance.max(1e-6)).min(0.5);
    let focus = moment.frame.position.lerp(&goal, share);
    let radius = (0.5 * moment.distance + AROUND).clamp(RADII[0], RADII[1]);
    [focus.x, focus.y, focus.z, radius]
}

/// Weighted mean of the neighbourhood, later pictures included: the camera knows the film.
fn calm(wanted: &[[f32; 4]], index: usize) -> [f32; 4] {
    let (mut sum, mut weights) = ([0.0; 4], 0.0);
    for offset in 0..=2 * CALMNESS {
        let neighbour = (index + offset).saturating_sub(CALMNESS).min(wanted.len() - 1);
        let deviations = (offset as f32 - CALMNESS as f32) * (3.0 / CALMNESS as f32);
        let weight = libm::expf(-0.5 * deviations * deviations);
        weights += weight;
        sum.iter_mut().zip(wanted[neighbour]).for_each(|(sum, value)| *sum += weight * value);
    }
    sum.map(|sum| sum / weights)
}

/// Direction of the way from start to goal \[rad\]; a way straight up has none and counts as along x.
fn heading(recording: &FlightRecording) -> f32 {
    let way = recording.goal - recording.frames[0].position;
    if way.xy().norm() < 0.05 { 0.0 } else { libm::atan2f(way.y, way.x) }
}

/// From what is seen to the camera.
fn direction(azimuth: f32) -> Vector3<f32> {
    let ((sine, cosine), (up, level)) = (libm::sincosf(azimuth), libm::sincosf(ELEVATION));
    Vector3::new(-level * cosine, -level * sine, up)
}
