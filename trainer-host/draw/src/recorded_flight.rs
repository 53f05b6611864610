//! A flight of one or several drones, as it was flown.

use kestrel_core::attitude::Attitude;
use kestrel_sim::world::Pose;
use nalgebra::Vector3;

/// One flight.
#[derive(Clone, Debug)]
pub struct FlightRecording {
    /// Shown in the picture.
    pub title: String,
    /// Time between two frames \[s\].
    pub control_secs: f32,
    /// The drones, at least one; they begin together.
    pub drones: Vec<DroneFlight>,
    /// Where each movable body of the world is, one per control period, at least one; after the last it stays there.
    pub movables: Vec<Vec<Placement>>,
}

/// What one drone did.
#[derive(Clone, Debug)]
pub struct DroneFlight {
    /// Where it should go \[m, world\]; nothing in a flight that is no episode of a task.
    pub goal: Option<Vector3<f32>>,
    /// Where it was, one per control period, at least one; after the last the drone is shown where it ended.
    pub frames: Vec<Placement>,
    /// Sum of the rewards of each control period.
    pub rewards: Vec<f64>,
    /// How it ended, as in reports; empty when it has not.
    pub ending: String,
    /// Whether that was a success.
    pub success: bool,
}

/// One more control period of a flight that goes on.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Where each drone is then.
    pub drones: Vec<Placement>,
    /// Where each movable body is.
    pub movables: Vec<Placement>,
    /// What the period paid each drone; nothing in a flight that is no episode of a task.
    pub rewards: Vec<f64>,
}

/// A position and an orientation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// \[m, world\].
    pub position: Vector3<f32>,
    /// `world_from_body`.
    pub attitude: Attitude<f32>,
}

/// Why a flight cannot be shown.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum FlightError {
    /// Nothing was recorded.
    #[error("the recording of the flight holds no frames: expected at least one")]
    Empty,
    /// The time between frames is no positive number.
    #[error("the recording of the flight has a control period of {0} s: expected a positive number")]
    ControlPeriod(f32),
    /// A number that is none.
    #[error("frame {frame} of drone {drone} holds NaN or infinite numbers: expected finite ones")]
    NotFinite {
        /// Counted from zero.
        drone: usize,
        /// Counted from zero.
        frame: usize,
    },
}

impl FlightRecording {
    /// Control periods from the first frame to the last of the longest flight.
    pub(crate) fn periods(&self) -> usize {
        self.drones.iter().map(|drone| drone.frames.len()).max().unwrap_or(1) - 1
    }

    /// Adds a control period.
    pub(crate) fn push(&mut self, frame: Frame) {
        for (drone, placement) in self.drones.iter_mut().zip(frame.drones) {
            drone.frames.push(placement);
        }
        for (drone, reward) in self.drones.iter_mut().zip(frame.rewards) {
            drone.rewards.push(reward);
        }
        for (places, placement) in self.movables.iter_mut().zip(frame.movables) {
            places.push(placement);
        }
    }

    /// Begins so many control periods later.
    pub(crate) fn forget(&mut self, periods: usize) {
        let frames = self.drones.iter_mut().map(|drone| &mut drone.frames);
        for places in frames.chain(&mut self.movables) {
            places.drain(..periods.min(places.len() - 1));
        }
    }

    /// Refuses what cannot be shown.
    pub(crate) fn check(&self) -> Result<(), FlightError> {
        if self.drones.is_empty() || self.drones.iter().any(|flight| flight.frames.is_empty()) {
            return Err(FlightError::Empty);
        }
        if !(self.control_secs.is_finite() && self.control_secs > 0.0) {
            return Err(FlightError::ControlPeriod(self.control_secs));
        }
        for (drone, flight) in self.drones.iter().enumerate() {
            if let Some(frame) = flight.frames.iter().position(|placement| !placement.is_finite()) {
                return Err(FlightError::NotFinite { drone, frame });
            }
        }
        Ok(())
    }
}

impl DroneFlight {
    /// At its beginning.
    pub fn beginning(goal: Option<Vector3<f32>>, start: Placement) -> Self {
        Self { goal, frames: vec![start], rewards: Vec::new(), ending: String::new(), success: false }
    }
}

impl Placement {
    /// A share in \[0, 1\] of the way to another one.
    #[must_use]
    pub fn towards(&self, after: &Self, share: f32) -> Self {
        let (from, to) = (self.attitude, nearest_sign(&self.attitude, after.attitude));
        let attitude = Attitude {
            w: mix(from.w, to.w, share),
            x: mix(from.x, to.x, share),
            y: mix(from.y, to.y, share),
            z: mix(from.z, to.z, share),
        };
        let position: Vector3<f32> = self.position.lerp(&after.position, share);
        Self { position, attitude: attitude.normalized() }
    }

    /// The pose of the simulator, in single precision.
    pub fn of(pose: &Pose) -> Self {
        Self { position: pose.position.cast(), attitude: pose.world_from_body.map(|part| part as f32) }
    }

    /// As a pose of the simulator.
    pub fn pose(&self) -> Pose {
        Pose { position: self.position.cast(), world_from_body: self.attitude.map(f64::from) }
    }

    fn is_finite(&self) -> bool {
        let Attitude { w, x, y, z } = self.attitude;
        [w, x, y, z].into_iter().chain(self.position.iter().copied()).all(f32::is_finite)
    }
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
