use crate::agent::LOOK_AROUND_M;
use crate::term::prelude::*;

/// Speed in m/s at which the drone's centre comes nearer to the surface of the nearest obstacle that never moves, times
/// `(1 - d / reach)²` of its distance d: nothing where it goes away or d is beyond the reach, more than the speed inside.
///
/// With `ahead_secs` it is the whole speed, and d the distance from where the drone would be by then: who flies at a post learns
/// on which side it is out of the way, and not only that it comes too near.
///
/// Gradients through the physics know it: the plane that touches the surface there is taken for the surface.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Avoidance {
    /// What one unit is worth.
    pub weight: f64,
    /// Distance from which on it is nothing.
    pub reach_m: f64,
    /// How far ahead it looks: as if the velocity stayed. The same in all terms of a task.
    #[serde(default)]
    pub ahead_secs: f64,
}

/// Farther away nothing is looked for.
const REACH: Limits = Limits::above(0.0, LOOK_AROUND_M as f64, "m");

const AHEAD: Limits = Limits::from(0.0, 10.0, "s");

/// Speed \[m/s\] below which it counts by its square, so that it has a derivative at rest.
const STILL: f32 = 1e-3;

impl Term for Avoidance {
    const PAID: Paid = Paid::PerSecond;

    fn check(&self, task: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("reach_m").number(self.reach_m, &REACH)?;
        field.at("ahead_secs").number(self.ahead_secs, &AHEAD)?;
        task.needs_contacts("avoidance", field)
    }

    fn looks_around_secs(&self) -> Option<f32> {
        Some(self.ahead_secs as f32)
    }

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let Some([x, y, z, offset]) = view.nearest else {
            values.fill(R::zero());
            return;
        };
        let per_reach = R::one() / R::from_f32(self.reach_m as f32);
        let ([px, py, pz], [vx, vy, vz]) = (&view.swarm.position, &view.swarm.velocity);
        let distance = |i: usize| ((x[i] * px[i] + y[i] * py[i]) + z[i] * pz[i]) + offset[i];
        let leaving = |i: usize| (x[i] * vx[i] + y[i] * vy[i]) + z[i] * vz[i];
        let near = |distance: R| (R::one() - distance * per_reach).at_least(R::zero());
        if self.ahead_secs > 0.0 {
            let (ahead, still) = (R::from_f32(self.ahead_secs as f32), R::from_f32(STILL));
            each(values, |i| {
                let speed = (((vx[i] * vx[i] + vy[i] * vy[i]) + vz[i] * vz[i]) + still * still).sqrt();
                let near = near(distance(i) + leaving(i) * ahead);
                worth * speed * (near * near)
            });
        } else {
            each(values, |i| {
                let near = near(distance(i));
                worth * (-leaving(i)).at_least(R::zero()) * (near * near)
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{Trial, assert_near};

    #[test]
    fn it_counts_who_comes_nearer_and_the_more_so_the_nearer() {
        let mut trial = Trial::of("avoidance: { weight: -48, reach_m: 0.5 }");
        // A wall that fills x > 1.
        trial.nearest = Some([[-1.0], [0.0], [0.0], [1.0]]);
        for (x, velocity, expected) in [
            (0.6, [2.0, 0.0, 0.0], -2.0 * 0.04),
            (0.9, [2.0, 3.0, -1.0], -2.0 * 0.64),
            (1.1, [2.0, 0.0, 0.0], -2.0 * 1.44),
            (0.9, [-2.0, 0.0, 0.0], 0.0),
            (0.4, [2.0, 0.0, 0.0], 0.0),
        ] {
            trial.moving(velocity);
            assert_near(trial.at(x, 5.0, 1.0), expected);
        }
        trial.nearest = None;
        assert_near(trial.at(0.9, 0.0, 1.0), 0.0);
    }

    #[test]
    fn ahead_it_counts_who_would_be_near() {
        let mut trial = Trial::of("avoidance: { weight: -48, reach_m: 0.5, ahead_secs: 0.25 }");
        trial.nearest = Some([[-1.0], [0.0], [0.0], [1.0]]);
        for (x, velocity, expected) in [
            (0.5, [1.2, 1.6, 0.0], -2.0 * 0.36),
            (0.9, [-1.2, 0.0, 1.6], -2.0 * 0.04),
            (0.9, [-2.0, 0.0, 0.0], 0.0),
            (0.2, [1.2, 0.0, 0.0], 0.0),
        ] {
            trial.moving(velocity);
            let found = trial.at(x, 5.0, 1.0);
            assert!((found - expected).abs() < 1e-5, "at {x}: {found} for {expected}");
        }
    }
}
