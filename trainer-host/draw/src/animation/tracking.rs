//! Where the camera goes: with the drones, but calmly, and closer as they come closer to their goals.

use nalgebra::Vector3;

use super::FlightRecording;
use super::camera::Camera;
use super::playback::{DroneMoment, Moment};

/// Farthest that the camera looks ahead of the drone, towards the goal \[m\].
const LOOK_AHEAD: f32 = 0.4;

/// Least and greatest radius of what must be in the picture around one drone \[m\].
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
    let goals: Vec<_> = recording.drones.iter().map(|flight| flight.goal).collect();
    let wanted: Vec<_> = moments.iter().map(|moment| around_all(&moment.drones, &goals)).collect();
    let heading = heading(recording);
    let camera = |index: usize| {
        let [x, y, z, radius] = calm(&wanted, index, CALMNESS);
        let share = index as f32 / moments.len() as f32;
        let from = direction(heading + BESIDE + CIRCLING * (0.5 - share));
        let focus = Vector3::new(x, y, z);
        Camera::looking_at(focus + from * Camera::distance_for(radius), focus)
    };
    (0..moments.len()).map(camera).collect()
}

/// Where to look and how much must be seen, as `[x, y, z, radius]`: a ball around what each drone alone needs.
fn around_all(drones: &[DroneMoment], goals: &[Vector3<f32>]) -> [f32; 4] {
    let balls: Vec<_> = drones.iter().zip(goals).map(|(drone, goal)| around_one(drone, *goal)).collect();
    let nothing = (Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
    let (low, high) = balls.iter().fold(nothing, |(low, high), (focus, _)| (low.inf(focus), high.sup(focus)));
    let focus = low + (high - low) * 0.5;
    let reach = |(ball, radius): &(Vector3<f32>, f32)| (ball - focus).norm() + radius;
    let radius = balls.iter().map(reach).fold(0.0, f32::max);
    [focus.x, focus.y, focus.z, radius]
}

fn around_one(drone: &DroneMoment, goal: Vector3<f32>) -> (Vector3<f32>, f32) {
    let share = (LOOK_AHEAD / drone.distance.max(1e-6)).min(0.5);
    let focus = drone.frame.placement.position.lerp(&goal, share);
    (focus, (0.5 * drone.distance + AROUND).clamp(RADII[0], RADII[1]))
}

/// Weighted mean of so many pictures on either side, later ones included: the camera knows the film.
pub(crate) fn calm<const N: usize>(wanted: &[[f32; N]], index: usize, calmness: usize) -> [f32; N] {
    let (mut sum, mut weights) = ([0.0; N], 0.0);
    for offset in 0..=2 * calmness {
        let neighbour = (index + offset).saturating_sub(calmness).min(wanted.len() - 1);
        let deviations = (offset as f32 - calmness as f32) * (3.0 / calmness as f32);
        let weight = libm::expf(-0.5 * deviations * deviations);
        weights += weight;
        sum.iter_mut().zip(wanted[neighbour]).for_each(|(sum, value)| *sum += weight * value);
    }
    sum.map(|sum| sum / weights)
}

/// Direction of the ways from start to goal, all together \[rad\]; if that is straight up, or none, along x.
fn heading(recording: &FlightRecording) -> f32 {
    let ways = recording.drones.iter().map(|flight| flight.goal - flight.frames[0].placement.position);
    let way = ways.sum::<Vector3<f32>>() / recording.drones.len() as f32;
    if way.xy().norm() < 0.05 { 0.0 } else { libm::atan2f(way.y, way.x) }
}

/// From what is seen to the camera.
fn direction(azimuth: f32) -> Vector3<f32> {
    let ((sine, cosine), (up, level)) = (libm::sincosf(azimuth), libm::sincosf(ELEVATION));
    Vector3::new(-level * cosine, -level * sine, up)
}
