//! Where cameras are: behind a drone, around it, on board.

use kestrel_sim::camera::{Camera, Scene, View};
use nalgebra::Vector3;

use super::recorded_scene::RecordedScene;
use crate::recorded_flight::Placement;

/// How far behind the drone the camera is, per length of the airframe's arm; half a metre for a Crazyflie.
const DISTANCE_ARMS: f64 = 12.5;

/// Angle of view across of the camera behind a drone \[rad\]: 60°, for whatever eyes the drone has.
pub(crate) const VIEW_ANGLE: f64 = core::f64::consts::FRAC_PI_3;

/// Angle by which it is above the drone \[rad\].
const ELEVATION: f64 = 0.52;

/// Least share of its distance to which walls push the camera, and the share that it keeps from them.
const LEAST_SHARE: f32 = 0.2;
const WALL_SHARE: f32 = 0.1;

/// Pictures on either side over which its place is averaged: the drone stays near the middle.
const PLACE_CALMNESS: usize = 9;

/// Pictures on either side over which its direction and its distance are averaged.
const TURN_CALMNESS: usize = 48;

/// How much the way to the goal counts beside the velocity \[m/s\], and the direction of the whole flight.
const GOAL_SPEED: f32 = 0.15;
const FLIGHT_SPEED: f32 = 0.03;

/// A camera that follows a drone calmly through a flight and stays on its side of the walls.
#[derive(Clone, Debug)]
pub(crate) struct Chase {
    /// Eye and what it looks at \[m\], one a picture.
    places: Vec<[Vector3<f64>; 2]>,
}

impl Chase {
    pub(crate) fn of(recorded: &RecordedScene, drone: usize) -> Self {
        let distance = distance(recorded.arm_m);
        let moments = recorded.moments();
        let places: Vec<[f32; 3]> =
            moments.iter().map(|moment| moment.drones[drone].placement.position.into()).collect();
        let wanted = directions(&places, recorded.flight.drones[drone].goal.into());
        let directions: Vec<Vector3<f64>> = (0..wanted.len())
            .map(|index| {
                let [x, y] = calm(&wanted, index, TURN_CALMNESS).map(f64::from);
                behind(libm::atan2(y, x), ELEVATION)
            })
            .collect();
        let free = places.iter().zip(&directions).map(|(place, direction)| {
            let place = Vector3::from(*place).cast();
            free_share(recorded.still(), place, place + direction * distance)
        });
        let free: Vec<f32> = free.collect();
        let near =
            |index: usize| index.saturating_sub(TURN_CALMNESS / 2)..free.len().min(index + TURN_CALMNESS / 2);
        // The camera has come nearer by the time at which it must.
        let shares: Vec<[f32; 1]> =
            (0..free.len()).map(|index| [free[near(index)].iter().copied().fold(1.0, f32::min)]).collect();
        let place = |index: usize| {
            let focus = Vector3::from(calm(&places, index, PLACE_CALMNESS)).cast();
            let [share] = calm(&shares, index, TURN_CALMNESS / 2);
            [focus + directions[index] * (distance * f64::from(share)), focus]
        };
        Self { places: (0..places.len()).map(place).collect() }
    }

    /// At a time since the start, in pictures.
    pub(crate) fn view(&self, pictures: f32) -> View {
        let last = self.places.len() - 1;
        let index = (pictures as usize).min(last);
        let share = f64::from((pictures - index as f32).clamp(0.0, 1.0));
        let [from, to] = [self.places[index], self.places[(index + 1).min(last)]];
        let [eye, focus] = [0, 1].map(|part| from[part].lerp(&to[part], share));
        View::towards(eye, focus, Vector3::z())
    }
}

/// How far a camera is from the drone that it follows, whose arms are so long \[m\].
pub(crate) fn distance(arm_m: f64) -> f64 {
    DISTANCE_ARMS * arm_m
}

/// Around a drone: from a heading \[rad\] and an elevation \[rad\], so far away \[m\].
pub(crate) fn orbit(focus: Vector3<f64>, heading: f64, elevation: f64, distance: f64) -> View {
    View::towards(focus + behind(heading, elevation) * distance, focus, Vector3::z())
}

/// What a drone's camera sees: as the reference mounts it, an arm above the centre, along the drone's x axis, the image's
/// top up. A drone whose nose points straight up or down is looked along as it lies.
pub(crate) fn on_board(recorded: &RecordedScene, placement: &Placement) -> View {
    let drone = placement.pose();
    let ahead = drone.world_from_body.rotate(Vector3::x());
    if ahead.xy().norm() > 1e-6 {
        return View::paper(&drone, recorded.arm_m);
    }
    let eye = drone.position + recorded.arm_m * Vector3::z();
    View::towards(eye, eye + ahead, drone.world_from_body.rotate(Vector3::z()))
}

/// Weighted mean of so many pictures on either side, later ones included: the camera knows the video. One standard
/// deviation is a third of them.
fn calm<const N: usize>(wanted: &[[f32; N]], index: usize, calmness: usize) -> [f32; N] {
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

/// From a drone to the camera behind it.
pub(crate) fn behind(heading: f64, elevation: f64) -> Vector3<f64> {
    let ((sine, cosine), (up, level)) = (libm::sincos(heading), libm::sincos(elevation));
    Vector3::new(-level * cosine, -level * sine, up)
}

/// Where each picture's drone is going, level: its velocity, and a little of the ways to the goal.
fn directions(places: &[[f32; 3]], goal: [f32; 3]) -> Vec<[f32; 2]> {
    let level = |from: [f32; 3], to: [f32; 3]| [to[0] - from[0], to[1] - from[1]];
    let limited = |[x, y]: [f32; 2], limit: f32| {
        // Far ways count `limit`, near ones less.
        let length = (x * x + y * y).sqrt().max(limit);
        [x / length * limit, y / length * limit]
    };
    let mut flight = limited(level(places[0], goal), FLIGHT_SPEED);
    if flight == [0.0; 2] {
        flight = [FLIGHT_SPEED, 0.0];
    }
    let last = places.len() - 1;
    let direction = |index: usize| {
        let moved = level(places[index.saturating_sub(1)], places[(index + 1).min(last)]);
        let secs = 2.0 * crate::video::playback::PICTURE_SECS;
        let to_goal = limited(level(places[index], goal), GOAL_SPEED);
        [0, 1].map(|axis| moved[axis] / secs + to_goal[axis] + flight[axis])
    };
    (0..places.len()).map(direction).collect()
}

/// Share of the way from a place to an eye that nothing stands in, less what a camera keeps from walls.
pub(crate) fn free_share(scene: &Scene, place: Vector3<f64>, eye: Vector3<f64>) -> f32 {
    let distance = (eye - place).norm();
    let camera =
        Camera { columns: 3, rows: 3, tangents: [0.15; 2], sample: [0.5; 2], near_m: 0.01, far_m: distance };
    let image = scene.render(&camera, &View::towards(place, eye, Vector3::z()));
    let free = image.depths.into_iter().fold(distance as f32, f32::min) / distance as f32;
    if free < 1.0 { (free - WALL_SHARE).max(LEAST_SHARE) } else { 1.0 }
}
