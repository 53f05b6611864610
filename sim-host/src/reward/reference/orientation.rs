use crate::term::prelude::*;

/// +1 while roll and pitch are within ±1 rad, else −1 (`OrientationReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Orientation {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Orientation {
    const PAID: Paid = Paid::PerStep;

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let (limit, one) = (RollPitchLimit::new(LEVEL), R::one());
        each(values, |i| worth * if limit.holds(view.swarm, i) { one } else { -one });
    }
}
