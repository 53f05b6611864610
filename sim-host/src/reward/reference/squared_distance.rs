use crate::term::prelude::*;

/// −1 per squared metre to the goal (hover, gate and tuning aviaries).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct SquaredDistance {
    /// What one unit is worth.
    pub weight: f64,
    /// Which drones are paid.
    #[serde(default)]
    pub agents: AgentSet,
}

impl Term for SquaredDistance {
    const PAID: Paid = Paid::PerStep;

    fn agents(&self) -> AgentSet {
        self.agents
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        each(values, |i| worth * (-view.distances[i] * view.distances[i]));
    }
}
