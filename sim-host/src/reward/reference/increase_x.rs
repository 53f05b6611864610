use crate::term::prelude::*;

/// A tenth of a positive x (`IncreaseXReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct IncreaseX {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for IncreaseX {
    const PAID: Paid = Paid::PerStep;

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let zero = R::zero();
        each(values, |i| {
            let x = view.swarm.position[0][i];
            worth * zero.where_less(x, x / R::from_f64(10.0), zero)
        });
    }
}
