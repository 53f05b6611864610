use crate::term::prelude::*;

/// How far the velocity is from the wanted one, as `√(1 + |Δ|²) − 1` with Δ in m/s: about half its square below, a metre per
/// second less than its length above. Wanted is to fly straight to the goal at the cruise speed, slower within a distance of it.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Cruise {
    /// What one unit is worth.
    pub weight: f64,
    /// The cruise speed.
    pub speed_m_per_s: f64,
    /// From this distance on the wanted speed falls in proportion to what is left.
    pub slow_within_m: f64,
}

impl Term for Cruise {
    const PAID: Paid = Paid::PerSecond;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("speed_m_per_s").number(self.speed_m_per_s, &SPEED)?;
        field.at("slow_within_m").number(self.slow_within_m, &LENGTH).map(drop)
    }

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let (speed, slow) = (R::from_f32(self.speed_m_per_s as f32), R::from_f32(self.slow_within_m as f32));
        let (goal, place, velocity) = (view.goal, &view.swarm.position, &view.swarm.velocity);
        each(values, |i| {
            let per_second = speed / view.distances[i].at_least(slow);
            let square = [0, 1, 2].iter().fold(R::one(), |sum, axis| {
                let error = velocity[*axis][i] - (goal[*axis][i] - place[*axis][i]) * per_second;
                sum + error * error
            });
            worth * (square.sqrt() - R::one())
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{Trial, assert_near};

    #[test]
    fn the_wanted_velocity_leads_to_the_goal_and_falls_before_it() {
        // The goal of trials is the origin.
        let mut trial = Trial::of("cruise: { weight: -48, speed_m_per_s: 3, slow_within_m: 1.5 }");
        trial.distance = 5.0;
        for (velocity, error) in [([-2.4, -1.8, 0.0], 0.0_f64), ([0.0; 3], 3.0), ([-2.4, -1.8, 4.0], 4.0)] {
            trial.moving(velocity);
            assert_near(trial.at(4.0, 3.0, 0.0), -((1.0 + error * error).sqrt() - 1.0));
        }
        trial.distance = 0.5;
        trial.moving([-1.0, 0.0, 0.0]);
        assert_near(trial.at(0.5, 0.0, 0.0), 0.0);
    }
}
