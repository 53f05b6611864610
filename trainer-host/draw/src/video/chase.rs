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

/// Pictures on either side over which its direction is averaged: it follows a drone that turns within a second.
const TURN_CALMNESS: usize = 16;

/// Pictures on either side that what stands in its way is seen before, and remembered for.
const WAY_CALMNESS: usize = 24;

/// A camera that follows a drone calmly through a flight, looks where it looks and stays on its side of the walls. What
/// follows is for each picture.
#[derive(Clone, Debug, Default)]
pub(crate) struct Chase {
    /// Where the drone is \[m\].
    drone: Vec<[f32; 3]>,
    /// Where its nose points, level.
    noses: Vec<[f32; 2]>,
    /// Direction from the drone to the camera, and the free share of its distance.
    directions: Vec<Vector3<f64>>,
    free: Vec<f32>,
    /// Eye and what it looks at \[m\].
    places: Vec<[Vector3<f64>; 2]>,
}

impl Chase {
    pub(crate) fn of(recorded: &RecordedScene, drone: usize) -> Self {
        let mut chase = Self::default();
        chase.extend(recorded, drone);
        chase
    }

    /// Follows what has been added to the flight: pictures of the last seconds before it change, too.
    pub(crate) fn extend(&mut self, recorded: &RecordedScene, drone: usize) {
        let known = self.drone.len();
        for moment in &recorded.moments()[known..] {
            let placement = &moment.drones[drone].placement;
            self.drone.push(placement.position.into());
            self.noses.push(placement.attitude.rotate(Vector3::x()).xy().into());
        }
        let pictures = self.drone.len();
        let turned = known.saturating_sub(TURN_CALMNESS);
        self.directions.truncate(turned);
        self.free.truncate(turned);
        for index in turned..pictures {
            let [x, y] = calm(&self.noses, index, TURN_CALMNESS).map(f64::from);
            let direction = behind(libm::atan2(y, x), ELEVATION);
            let place = Vector3::from(self.drone[index]).cast();
            self.free.push(free_share(recorded.still(), place, place + direction * distance(recorded.arm_m)));
            self.directions.push(direction);
        }
        let moved = turned.saturating_sub(2 * WAY_CALMNESS);
        self.places.truncate(moved);
        let first = moved.saturating_sub(WAY_CALMNESS);
        // The camera has come nearer by the time at which it must.
        let shares: Vec<[f32; 1]> = (first..pictures).map(|index| [self.nearest(index)]).collect();
        for index in moved..pictures {
            let focus = Vector3::from(calm(&self.drone, index, PLACE_CALMNESS)).cast();
            let [share] = calm(&shares, index - first, WAY_CALMNESS);
            self.places
                .push([focus + self.directions[index] * (distance(recorded.arm_m) * f64::from(share)), focus]);
        }
    }

    /// Forgets so many pictures, the first ones.
    pub(crate) fn forget(&mut self, pictures: usize) {
        let pictures = pictures.min(self.drone.len());
        self.drone.drain(..pictures);
        self.noses.drain(..pictures);
        self.directions.drain(..pictures);
        self.free.drain(..pictures);
        self.places.drain(..pictures);
    }

    /// Least free share around a picture.
    fn nearest(&self, index: usize) -> f32 {
        let near = index.saturating_sub(WAY_CALMNESS)..self.free.len().min(index + WAY_CALMNESS);
        self.free[near].iter().copied().fold(1.0, f32::min)
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

/// Weighted mean of so many pictures on either side, later ones included: the camera knows the flight. One standard
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

/// Share of the way from a place to an eye that nothing stands in, less what a camera keeps from walls.
pub(crate) fn free_share(scene: &Scene, place: Vector3<f64>, eye: Vector3<f64>) -> f32 {
    let distance = (eye - place).norm();
    let camera =
        Camera { columns: 3, rows: 3, tangents: [0.15; 2], sample: [0.5; 2], near_m: 0.01, far_m: distance };
    let image = scene.render(&camera, &View::towards(place, eye, Vector3::z()));
    let free = image.depths.into_iter().fold(distance as f32, f32::min) / distance as f32;
    if free < 1.0 { (free - WALL_SHARE).max(LEAST_SHARE) } else { 1.0 }
}
