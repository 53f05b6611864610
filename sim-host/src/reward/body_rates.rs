use crate::term::prelude::*;

/// Squared angular velocity in rad²/s².
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct BodyRates {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for BodyRates {
    const PAID: Paid = Paid::PerSecond;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        each(values, |i| worth * squared_length(&view.swarm.body_rates, i));
    }
}
