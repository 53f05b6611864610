//! What is identified: the airframe, how its motors answer a command, and what differs from flight to flight.

use kestrel_core::airframe::{Airframe, CF2X, GRAVITY};
use nalgebra::Vector3;

/// A drone with its motors and battery.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drone {
    /// What flies.
    pub airframe: Airframe,
    /// From command to rotor speed.
    pub thrust_curve: ThrustCurve,
}

/// From the share of the greatest command to the rotor speed that it asks for: a straight line, since a brushed motor's
/// speed follows its voltage but for the load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThrustCurve {
    /// Share of the greatest rotor speed at which the line starts, for the smallest command.
    pub idle_share: f64,
    /// Battery voltage at which the greatest command gives the airframe's greatest rotor speed \[V\].
    pub full_volts: f64,
    /// Time from a command's time stamp until the motors follow \[s\], less that of the measurements.
    pub delay_secs: f64,
}

impl ThrustCurve {
    /// Proportional, at the voltage of a full lithium polymer cell, without delay.
    pub const IDEAL: Self = Self { idle_share: 0.0, full_volts: 4.2, delay_secs: 0.0 };

    /// Share of the greatest rotor speed that a command at a share of the full voltage asks for; zero switches off.
    pub fn speed_share(&self, command: f64, voltage_share: f64) -> f64 {
        if command > 0.0 {
            (self.idle_share + (1.0 - self.idle_share) * command * voltage_share).max(0.0)
        } else {
            0.0
        }
    }
}

/// What belongs to one flight: how the battery was charged, how markers and weight were placed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trim {
    /// Angular acceleration while hovering \[rad/s²\], body: unequal motors, weight beside the centre.
    pub torque: Vector3<f64>,
    /// Rotation from the measured body axes to the true ones about x and y \[rad\].
    pub tilt: [f64; 2],
    /// Natural logarithm of the voltage share at the start, of flights without a voltage.
    pub charge: f64,
    /// What a second of all motors at the greatest command takes from that share \[1/s\].
    pub discharge_per_sec: f64,
}

/// What is known of a drone before its flights are read.
pub fn drone_of(airframe: &Airframe) -> Drone {
    Drone { airframe: *airframe, thrust_curve: ThrustCurve::IDEAL }
}

/// A typical value of an effect that `airframe` lacks, scaled from the Crazyflie: where a search may begin.
pub(crate) fn typical(airframe: &Airframe, per_inertia: f64) -> f64 {
    let [x, y, _] = airframe.inertia;
    per_inertia * 0.5 * (x + y)
}

/// Summed rotor speed while hovering \[rad/s\].
pub(crate) fn summed_hover_speed(airframe: &Airframe) -> f64 {
    4.0 * (airframe.mass * GRAVITY / (4.0 * airframe.thrust_coefficient)).sqrt()
}

/// Drag that begins a search where an airframe states none: the Crazyflie's deceleration \[1/s\].
pub(crate) fn typical_drag(airframe: &Airframe) -> f64 {
    let rate = CF2X.drag_coefficients.planar * summed_hover_speed(&CF2X) / CF2X.mass;
    rate * airframe.mass / summed_hover_speed(airframe)
}
