use crate::term::prelude::*;

/// Potential-based shaping by the distance to the goal in metres: `d − discount · d′` (Ng, Harada & Russell 1999). It
/// changes no optimal policy.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Shaping {
    /// What one unit is worth.
    pub weight: f64,
    /// The learner's discount per step.
    pub discount: f64,
}

impl Term for Shaping {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("discount").number(self.discount, &Limits::from(0.0, 1.0, ""))?;
        Ok(())
    }

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let discount = R::from_f32(self.discount as f32);
        each(values, |i| worth * (view.previous_distances[i] - discount * view.distances[i]));
    }
}
