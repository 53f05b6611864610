use crate::term::prelude::*;

/// −1 when faster than the limit (`SpeedReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Speed {
    /// What one unit is worth.
    pub weight: f64,
    /// The limit.
    pub limit_m_per_s: f64,
}

impl Term for Speed {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("limit_m_per_s").number(self.limit_m_per_s, &Limits::above(0.0, 100.0, "m/s"))?;
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
        let limit = R::from_f64(self.limit_m_per_s);
        each(values, |i| worth * limit.where_less(length(&vector(&view.swarm.velocity, i)), -R::one(), R::zero()));
    }
}
