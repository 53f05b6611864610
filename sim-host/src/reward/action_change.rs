use crate::term::prelude::*;

/// Squared change of the action since the last step.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct ActionChange {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for ActionChange {
    const PAID: Paid = Paid::PerSecond;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let changes = view.actions.iter().zip(view.previous_actions);
        sum_squares(values, worth, changes.map(|(now, before)| move |i: usize| now[i] - before[i]));
    }
}
