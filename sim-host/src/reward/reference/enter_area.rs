use crate::term::prelude::*;

/// +1 inside an area (`EnterAreaReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct EnterArea {
    /// What one unit is worth.
    pub weight: f64,
    /// Its x and y ranges.
    pub area: AreaConfig,
}

impl Term for EnterArea {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        self.area.check(&field.at("area"))
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        each(values, |i| worth * if self.area.contains(view.swarm, i) { R::one() } else { R::zero() });
    }
}
