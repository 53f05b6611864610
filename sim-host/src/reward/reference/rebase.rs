use crate::term::prelude::*;

/// Every interval +1 within 12.5 cm of the landing zone, else −1 (`RebaseReward`). As published it counts control
/// periods as if there were 240 in a second.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Rebase {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Time between two judgements.
    pub interval_secs: f64,
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for Rebase {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("interval_secs").number(self.interval_secs, &INTERVAL)?;
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
        let periods = counted_periods(self.interval_secs, view.control_rate_hz, self.as_published);
        each(values, |i| {
            let due = (view.steps[i].to_f64() as u64).is_multiple_of(u64::from(periods));
            let near = distance(view.swarm, &target, i) < R::from_f64(0.125);
            let value = match (due, near) {
                (true, true) => R::one(),
                (true, false) => -R::one(),
                (false, _) => R::zero(),
            };
            worth * value
        });
    }
}
