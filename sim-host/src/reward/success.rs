use crate::term::prelude::*;

/// One, once, when the episode ends in success.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Success {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Success {
    const PAID: Paid = Paid::PerStep;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        each(values, |i| worth * view.ends.success[i]);
    }
}
