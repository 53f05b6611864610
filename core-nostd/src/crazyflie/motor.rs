//! How the firmware makes up for the battery: the voltage that a motor needs for a thrust.

use super::{FULL_COUNTS, MOTOR_THRUST_LIMIT_N};
use crate::real::Real;

/// Steps of Newton's method from three volts; five suffice from there to any voltage of the battery.
const STEPS: usize = 6;

/// Which propellers a firmware was built for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Propellers {
    /// Those of the 2.1+; what a build has by default.
    Plus,
    /// Those before.
    Legacy,
}

/// The motor voltage of a thrust, by Bitcraze's cubic of the thrust over the voltage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorVoltage {
    /// Thrust \[N\] per power of the voltage \[V\], none first.
    coefficients: [f64; 4],
    /// Least thrust for which the motor turns \[N\].
    least: f64,
}

impl MotorVoltage {
    /// Of motors with these propellers.
    pub const fn new(propellers: Propellers) -> Self {
        let coefficients = match propellers {
            Propellers::Plus => [-0.024_765_379, 0.065_237_935, -0.026_792_505, 0.006_776_789],
            Propellers::Legacy => [-0.014_830_745, 0.047_244_652, -0.018_473_644, 0.005_960_924],
        };
        Self { coefficients, least: 0.012_817_578 }
    }

    /// Share of the full duty that these counts become at a battery voltage \[V\], in \[0, 1\].
    pub fn duty<R: Real>(&self, counts: R, battery_volts: R) -> R {
        let thrust = counts * R::from_f64(MOTOR_THRUST_LIMIT_N / FULL_COUNTS);
        let turning = (self.volts(thrust) / battery_volts).limited(R::zero(), R::one());
        thrust.where_less(R::from_f64(self.least), R::zero(), turning)
    }

    fn volts<R: Real>(&self, thrust: R) -> R {
        let [a, b, c, d] = self.coefficients.map(R::from_f64);
        let (two, three) = (R::from_f64(2.0), R::from_f64(3.0));
        (0..STEPS).fold(three, |volts, _| {
            let excess = a + volts * (b + volts * (c + volts * d)) - thrust;
            volts - excess / (b + volts * (two * c + volts * (three * d)))
        })
    }
}
