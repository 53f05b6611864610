use crate::term::prelude::*;

/// Near the landing zone `1 − √(|v_xy| / 5)` (`SlowdownReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Slowdown {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Distance that is near.
    pub slowdown_distance_m: f64,
}

impl Term for Slowdown {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("landing_zone_m").place(self.landing_zone_m)?;
        field.at("slowdown_distance_m").number(self.slowdown_distance_m, &LENGTH)?;
        Ok(())
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let target = Vector3::from(self.landing_zone_m);
        let (zero, one) = (R::zero(), R::one());
        each(values, |i| {
            let near = distance(view.swarm, &target, i) < R::from_f64(self.slowdown_distance_m);
            let speed = planar_length(&vector(&view.swarm.velocity, i));
            worth * if near { (one - (speed / R::from_f64(5.0)).sqrt()).at_most(one) } else { zero }
        });
    }
}
