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
        each(values, |i| {
            let square = view.actions.iter().zip(view.previous_actions).fold(R::zero(), |sum, (now, before)| {
                let change = now[i] - before[i];
                sum + change * change
            });
            worth * square
        });
    }
}
