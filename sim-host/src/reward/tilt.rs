use crate::term::prelude::*;

/// One minus the cosine of the tilt.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Tilt {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Tilt {
    const PAID: Paid = Paid::PerSecond;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        each(values, |i| worth * (R::one() - view.swarm.state(i).world_from_body.up_cosine()));
    }
}
