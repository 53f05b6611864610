use crate::term::prelude::*;

/// The same in three dimensions (`DistanceRewardV2`). As published the target is at twice the landing zone's
/// height plus 1.347 cm.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct DistanceRootV2 {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for DistanceRootV2 {
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
        let target = doubled(self.landing_zone_m, self.as_published);
        each(values, |i| {
            let share = distance(view.swarm, &target, i) / R::from_f64(5.0);
            worth * (R::one() - share.sqrt()).at_most(R::one())
        });
    }
}
