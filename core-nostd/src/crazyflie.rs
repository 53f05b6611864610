//! The controllers that Bitcraze ships with the Crazyflie, written anew from their documentation: as baselines, and for
//! comparison with flights that they flew.
//!
//! Gains, limits and rates are the defaults of the brushed Crazyflie 2.1 (crazyflie-firmware,
//! `platform_defaults_cf2.h`, `position_controller_pid.c`, `attitude_pid_controller.c`, `controller_mellinger.c`). They
//! are kept in the firmware's own units, so that they can be compared: degrees, and counts of 65535 for the greatest
//! thrust of a motor.

mod cascade;
mod mellinger;
mod motor;
mod pid;
mod stock;
#[cfg(test)]
mod tests;

pub use cascade::Cascade;
pub use mellinger::Mellinger;
pub use motor::{MotorVoltage, Propellers};
pub use stock::{StockController, StockPilot};

use crate::attitude::Attitude;
use crate::real::Real;

/// Period of attitude and rate loops \[s\].
pub const STABILISER_SECS: f64 = 0.002;

/// Greatest command.
pub const FULL_COUNTS: f64 = 65535.0;

/// Greatest thrust of a motor \[N\], which [`FULL_COUNTS`] stand for.
pub const MOTOR_THRUST_LIMIT_N: f64 = 0.12;

/// Mass that the firmware believes in \[kg\], with a deck.
pub const FIRMWARE_MASS_KG: f64 = 0.029;

/// Degrees per radian.
const DEGREES: f64 = 180.0 / core::f64::consts::PI;

/// Thrust and turning in counts, as they are mixed: the thrust of each motor, and what roll, pitch and yaw (about body
/// x, y, z) add to the motors on one side and take from those on the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mix<R> {
    thrust: R,
    turning: [R; 3],
}

impl<R: Real> Mix<R> {
    /// Thrust of each motor that the counts stand for \[N\], in the order of [`Self::motor_counts`].
    pub fn motor_thrusts(&self) -> [R; 4] {
        let full = R::from_f64(FULL_COUNTS);
        self.motor_counts().map(|counts| counts.at_most(full) * R::from_f64(MOTOR_THRUST_LIMIT_N / FULL_COUNTS))
    }

    /// Counts of each motor before the battery is compensated, not limited above: front right, rear right, rear left,
    /// front left.
    pub fn motor_counts(&self) -> [R; 4] {
        let half = R::from_f64(0.5);
        let [roll, pitch, yaw] = self.turning;
        let (roll, pitch) = (roll * half, pitch * half);
        [
            self.thrust - roll - pitch - yaw,
            self.thrust - roll + pitch + yaw,
            self.thrust + roll + pitch - yaw,
            self.thrust + roll - pitch + yaw,
        ]
        .map(|counts| counts.at_least(R::zero()))
    }
}

/// Roll, pitch and yaw \[°\] of the z-y-x convention.
fn degrees_of<R: Real>(attitude: &Attitude<R>) -> [R; 3] {
    let Attitude { w, x, y, z } = *attitude;
    let (one, two) = (R::one(), R::from_f64(2.0));
    let roll = (two * (w * x + y * z)).atan2(one - two * (x * x + y * y));
    let pitch = (two * (w * y - x * z)).limited(-one, one).asin();
    let yaw = (two * (w * z + x * y)).atan2(one - two * (y * y + z * z));
    [roll, pitch, yaw].map(|angle| angle * R::from_f64(DEGREES))
}

/// The same angle within half a turn of zero \[°\], of one within three halves.
fn wrapped<R: Real>(degrees: R) -> R {
    let (half, whole) = (R::from_f64(180.0), R::from_f64(360.0));
    let above = half.where_less(degrees, degrees - whole, degrees);
    above.where_less(-half, above + whole, above)
}
