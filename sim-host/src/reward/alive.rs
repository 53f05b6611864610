use crate::term::prelude::*;

/// One for being in the air.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Alive {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Alive {
    const PAID: Paid = Paid::PerSecond;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        _: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        values.fill(worth);
    }
}
