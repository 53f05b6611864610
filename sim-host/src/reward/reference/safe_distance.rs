use crate::term::prelude::*;

/// `max(0, 1 − (d / reach)^0.4)` of the distance to the landing zone (`SafeDistanceReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct SafeDistance {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Distance from which it is zero.
    #[serde(default = "reach_m")]
    pub reach_m: f64,
}

impl Term for SafeDistance {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("landing_zone_m").place(self.landing_zone_m)?;
        field.at("reach_m").number(self.reach_m, &LENGTH)?;
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
            let share = distance(view.swarm, &target, i) / R::from_f64(self.reach_m);
            worth * (one - (R::from_f64(0.4) * share.ln()).exp()).limited(zero, one)
        });
    }
}

fn reach_m() -> f64 {
    20.0
}
