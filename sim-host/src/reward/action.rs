use crate::term::prelude::*;

/// Squared action.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Action {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Action {
    const PAID: Paid = Paid::PerSecond;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        sum_squares(values, worth, view.actions.iter().map(|action| move |i: usize| action[i]));
    }
}
