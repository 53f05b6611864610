use crate::term::prelude::*;

/// Squared jerk in (m/s³)²: how much the acceleration changed since the last control period, per second. Nothing in the
/// first two control periods of an episode.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Jerk {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Jerk {
    const PAID: Paid = Paid::PerSecond;

    /// The last velocity and the last acceleration.
    fn memory(&self) -> Memory {
        Memory::unset(6)
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let rate = R::from_f64(view.control_rate_hz);
        let (velocities, accelerations) = memory.split_at_mut(3);
        for lane in 0..LANES {
            let mut square = R::zero();
            for axis in 0..3 {
                let velocity = view.swarm.velocity[axis][lane];
                let acceleration = (velocity - velocities[axis][lane]) * rate;
                square += ((acceleration - accelerations[axis][lane]) * rate).squared();
                velocities[axis][lane] = velocity;
                accelerations[axis][lane] = acceleration;
            }
            values[lane] = worth * if is_unset(square) { R::zero() } else { square };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{RATE_HZ, Trial};

    #[test]
    fn a_parabola_of_velocity_has_constant_jerk() {
        let mut trial = Trial::of("jerk: { weight: 48 }");
        // Half a j t² with j = (2, 0, −1) m/s³.
        let velocity = |step: i32| {
            let square = (f64::from(step) / RATE_HZ).powi(2);
            [square, 0.0, -0.5 * square]
        };
        let paid: Vec<f64> = (0..6).map(|step| trial.moving(velocity(step))).collect();
        assert_eq!(paid[..2], [0.0; 2]);
        assert!(paid[2..].iter().all(|square| (square - 5.0).abs() < 1e-9), "{paid:?}");
        let steady: Vec<f64> = (0..3).map(|_| trial.moving(velocity(5))).collect();
        assert!(steady[2].abs() < 1e-9, "{steady:?}");
    }
}
