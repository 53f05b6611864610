use crate::term::prelude::*;

/// `1 / (1 + (d / scale)²)` of the distance d to the goal.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Proximity {
    /// What one unit is worth.
    pub weight: f64,
    /// Distance at which it is one half.
    pub scale_m: f64,
    /// Which drones are paid.
    #[serde(default)]
    pub agents: AgentSet,
}

impl Term for Proximity {
    const PAID: Paid = Paid::PerSecond;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("scale_m").number(self.scale_m, &LENGTH)?;
        Ok(())
    }

    fn agents(&self) -> AgentSet {
        self.agents
    }

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let scale = self.scale_m as f32;
        let per_square = R::one() / R::from_f32(scale * scale);
        let one = R::one();
        each(values, |i| worth / (one + view.distances[i] * view.distances[i] * per_square));
    }
}
