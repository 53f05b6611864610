use crate::term::prelude::*;

/// `max(0, 2 − d⁴)` of the distance to the goal (upstream's hover aviary).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct QuarticDistance {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for QuarticDistance {
    const PAID: Paid = Paid::PerStep;

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        each(values, |i| {
            let square = view.distances[i] * view.distances[i];
            worth * (R::from_f64(2.0) - square * square).at_least(R::zero())
        });
    }
}
