use crate::term::prelude::*;

/// Metres that the drone came closer to the goal in this step.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Progress {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Progress {
    const PAID: Paid = Paid::PerStep;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        each(values, |i| worth * (view.previous_distances[i] - view.distances[i]));
    }
}
