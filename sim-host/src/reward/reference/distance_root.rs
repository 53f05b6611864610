use crate::term::prelude::*;

/// `1 − √(d / 5)` of the horizontal distance to the landing zone (`DistanceReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct DistanceRoot {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
}

impl Term for DistanceRoot {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("landing_zone_m").place(self.landing_zone_m)?;
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
        each(values, |i| {
            let share = planar_distance(view.swarm, &target, i) / R::from_f64(5.0);
            worth * (R::one() - share.sqrt()).at_most(R::one())
        });
    }
}
