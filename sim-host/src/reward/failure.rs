use crate::term::prelude::*;

/// One, once, when a termination ends the episode.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Failure {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Failure {
    const PAID: Paid = Paid::PerStep;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        each(values, |i| worth * view.ends.failure[i]);
    }
}
