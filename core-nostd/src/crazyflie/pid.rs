//! One loop of a cascade.

use crate::real::Real;

/// What a loop weighs, and its bounds; a bound of zero is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gains {
    pub(super) proportional: f32,
    pub(super) integral: f32,
    pub(super) derivative: f32,
    pub(super) integral_limit: f32,
    pub(super) output_limit: f32,
}

/// What a loop remembers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pid<R> {
    integral: R,
    measured: R,
}

impl<R: Real> Pid<R> {
    /// Begins where this is measured.
    pub(super) fn begun(measured: R) -> Self {
        Self { integral: R::zero(), measured }
    }

    /// The output `secs` after the last one; the derivative is that of the measurement, so that a set-point that jumps
    /// does not kick.
    pub(super) fn output(&mut self, gains: &Gains, error: R, measured: R, secs: R) -> R {
        let real = R::from_f32;
        let falling = (self.measured - measured) / secs;
        self.measured = measured;
        self.integral = bounded(self.integral + error * secs, gains.integral_limit);
        let output = real(gains.proportional) * error
            + real(gains.derivative) * falling
            + real(gains.integral) * self.integral;
        bounded(output, gains.output_limit)
    }

    /// What was measured last.
    pub(super) fn measured(&self) -> R {
        self.measured
    }
}

fn bounded<R: Real>(value: R, limit: f32) -> R {
    if limit == 0.0 {
        return value;
    }
    let limit = R::from_f32(limit);
    value.limited(-limit, limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GAINS: Gains =
        Gains { proportional: 2.0, integral: 3.0, derivative: 0.5, integral_limit: 0.4, output_limit: 5.0 };

    #[test]
    fn each_part_counts_and_is_bounded() {
        let mut pid = Pid::begun(1.0_f64);
        // 2 · 0.5, 3 · 0.5 · 0.1, and 0.5 · (1 - 1.2) / 0.1.
        assert!((pid.output(&GAINS, 0.5, 1.2, 0.1) - (1.0 + 0.15 - 1.0)).abs() < 1e-6);
        assert!((pid.output(&GAINS, 100.0, 1.2, 0.1) - 5.0).abs() < 1e-6);
        assert!((pid.output(&GAINS, 0.0, 1.2, 0.1) - 3.0 * 0.4).abs() < 1e-6);
    }
}
