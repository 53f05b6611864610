use crate::term::prelude::*;

/// −1 outside a box, whose surface is inside (`BoundsReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Bounds {
    /// What one unit is worth.
    pub weight: f64,
    /// The box.
    pub bounds: BoxConfig,
    /// Whether the penalty of step k is 1 − 1/√k.
    #[serde(default)]
    pub grows_with_steps: bool,
}

impl Term for Bounds {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        self.bounds.check(&field.at("bounds"))?;
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
        let bounds = self.bounds.cuboid();
        let (low, high) = (bounds.low.map(R::from_f32), bounds.high.map(R::from_f32));
        let one = R::one();
        each(values, |i| {
            let position = vector(&view.swarm.position, i);
            let outside = (0..3).any(|axis| (high[axis] < position[axis]) | (position[axis] < low[axis]));
            let factor = if self.grows_with_steps { one - one / view.steps[i].sqrt() } else { one };
            worth * if outside { -factor } else { R::zero() }
        });
    }
}
