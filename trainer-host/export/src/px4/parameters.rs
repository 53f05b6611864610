//! What PX4 must know of the motors.

use kestrel_core::action::RotorThrusts;

use super::{Px4Error, rpm};

/// The module divides `MC_NN_THRST_COEF` by this.
const COEFFICIENT_SCALE: f64 = 1e5;

/// Greatest `MC_NN_THRST_COEF` that PX4's parameter allows, and the steps in which it is written.
const COEFFICIENT_LIMIT: f64 = 5.0;
const COEFFICIENT_STEPS: f64 = 1e4;

/// Least `MC_NN_THRST_COEF` of that parameter.
const LEAST_COEFFICIENT: f64 = 0.01;

/// Greatest `MC_NN_MAX_RPM`.
const RPM_LIMIT: f64 = 80_000.0;

/// The module's curve from the share of the motor's range to its command, which PX4's output stage takes back.
const THRUST_MODEL_FACTOR: f64 = 0.8;

/// Outputs of the network span this.
const OUTPUT_SPAN: f64 = 2.0;

/// PX4's parameters for the motors of an action space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MotorParameters {
    /// `MC_NN_THRST_COEF`: output plus one per squared rotor speed \[s²\], times 10⁵.
    coefficient: f64,
    min_rpm: i32,
    max_rpm: i32,
}

impl MotorParameters {
    /// The greatest coefficient with which the greatest rotor speed is an output, so that the outputs span as much of
    /// \[-1, 1\] as PX4 allows.
    pub(super) fn new(space: &RotorThrusts) -> Result<Self, Px4Error> {
        let greatest = rpm(space.rotor_speed_limit) / 60.0;
        let fitting = OUTPUT_SPAN / (greatest * greatest) * COEFFICIENT_SCALE;
        let coefficient = (fitting.min(COEFFICIENT_LIMIT) * COEFFICIENT_STEPS).floor() / COEFFICIENT_STEPS;
        let (found, expected) = (60.0 * greatest, RPM_LIMIT);
        if coefficient < LEAST_COEFFICIENT || found > expected {
            return Err(Px4Error::FastRotors { found, expected });
        }
        let motors = Self {
            coefficient,
            min_rpm: rpm(space.idle_rotor_speed).round() as i32,
            // Never below the greatest speed, which would become a command beyond 1.
            max_rpm: rpm(space.rotor_speed_limit).ceil() as i32,
        };
        let (found, expected) = (rpm(space.lowest_rotor_speed), motors.min_rpm);
        if found > f64::from(expected) { Ok(motors) } else { Err(Px4Error::Stopping { found, expected }) }
    }

    /// The output that PX4 reads as a rotor speed \[rad/s\].
    pub(super) fn output_of(&self, rotor_speed: f32) -> f64 {
        let per_sec = rpm(rotor_speed) / 60.0;
        self.coefficient / COEFFICIENT_SCALE * per_sec * per_sec - 1.0
    }

    /// A file that QGroundControl loads.
    pub(super) fn file(&self, name: &str, control_period_secs: f32) -> String {
        let Self { coefficient, min_rpm, max_rpm } = self;
        format!(
            "# Parameters with which PX4's neural control flies the policy \"{name}\": load them in QGroundControl, or
# `param set` each. Trained for a call every {control_period_secs} s; more often does no harm.
#
# MC_NN_*: thrust of an output and range of the motors. THR_MDL_FAC: takes back the curve of the module's commands, which
# makes them shares of the range of rotor speeds; it counts in all other flight modes too.
#
# Vehicle-Id Component-Id Name Value Type
1\t1\tMC_NN_EN\t1\t6
1\t1\tMC_NN_MIN_RPM\t{min_rpm}\t6
1\t1\tMC_NN_MAX_RPM\t{max_rpm}\t6
1\t1\tMC_NN_THRST_COEF\t{coefficient:.4}\t9
1\t1\tTHR_MDL_FAC\t{THRUST_MODEL_FACTOR}\t9
"
        )
    }
}
