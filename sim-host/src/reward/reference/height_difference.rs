use crate::term::prelude::*;

/// −1 per squared metre of height between the drone and another (leader-follower and flock aviaries).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct HeightDifference {
    /// What one unit is worth.
    pub weight: f64,
    /// Whose height.
    pub to: Neighbour,
    /// Multiplied by this; the leader-follower aviary has one over the number of drones.
    #[serde(default = "one")]
    pub factor: f64,
    /// Which drones are paid.
    #[serde(default)]
    pub agents: AgentSet,
}

impl Term for HeightDifference {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("factor").number(self.factor, &Limits::above(0.0, 1000.0, ""))?;
        Ok(())
    }

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
        let factor = R::from_f64(self.factor);
        let other = match self.to {
            Neighbour::First => &view.team[0],
            Neighbour::Previous => &view.team[view.agent.saturating_sub(1)],
        };
        each(values, |i| {
            let difference = other[2][i] - view.swarm.position[2][i];
            worth * (-factor * difference * difference)
        });
    }
}

/// Another drone of the environment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Neighbour {
    /// The first.
    First,
    /// The one before.
    Previous,
}

fn one() -> f64 {
    1.0
}
