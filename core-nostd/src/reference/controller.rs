//! The reference system's controllers: from a set point to rotor speeds, without a policy.
//!
//! [`DslPid`] flies the Crazyflies, [`SimplePid`] the Hummingbird; [`command`] turns the reference's actions into
//! set points, wrenches and rotor speeds; [`Allocation`] turns wrenches into rotor speeds. A controller is constant;
//! what it remembers is a plain struct of the caller's. A new one per episode is what the controllers were meant to
//! have; the reference's learning environments keep one for ever.

mod allocation;
pub mod command;
mod dsl_pid;
mod simple_pid;

use nalgebra::Vector3;

pub use allocation::{Allocation, Wrench};
pub use dsl_pid::{DslPid, DslPidMemory};
pub use simple_pid::{SimplePid, SimplePidMemory};

use crate::real::Real;

/// What a controller commands, and how far it is off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command<R> {
    /// \[rad/s\].
    pub rotor_speeds: [R; 4],
    /// From the drone to the set point \[m\], world.
    pub position_error: Vector3<R>,
    /// From the drone's yaw to the wanted one \[rad\], not wrapped.
    pub yaw_error: R,
}

/// Gains of a cascade of a position and an attitude controller, per world axis and per body axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PidGains<R> {
    /// Force per position error \[N/m\].
    pub position_proportional: Vector3<R>,
    /// Force per integrated position error \[N/(m s)\].
    pub position_integral: Vector3<R>,
    /// Force per velocity error \[N s/m\].
    pub position_derivative: Vector3<R>,
    /// Torque, in the controller's own unit, per attitude error \[1/rad\].
    pub attitude_proportional: Vector3<R>,
    /// Torque per integrated attitude error \[1/(rad s)\].
    pub attitude_integral: Vector3<R>,
    /// Torque per rate error \[s/rad\].
    pub attitude_derivative: Vector3<R>,
}

impl<R: Real> PidGains<R> {
    /// The reference's action TUN: each of the six gains (position P, I, D, attitude P, I, D) times one plus its
    /// action.
    #[must_use]
    pub fn tuned(&self, action: &[R; 6]) -> Self {
        let [pp, pi, pd, ap, ai, ad] = action.map(|value| value + R::one());
        Self {
            position_proportional: self.position_proportional * pp,
            position_integral: self.position_integral * pi,
            position_derivative: self.position_derivative * pd,
            attitude_proportional: self.attitude_proportional * ap,
            attitude_integral: self.attitude_integral * ai,
            attitude_derivative: self.attitude_derivative * ad,
        }
    }
}

fn vector<R: Real>(values: [f64; 3]) -> Vector3<R> {
    Vector3::from(values.map(R::from_f64))
}
