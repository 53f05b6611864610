use crate::term::prelude::*;

/// +1 while touching the landing zone (`TouchLandingZoneReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct TouchLandingZone {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for TouchLandingZone {
    const PAID: Paid = Paid::PerStep;

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        each(values, |i| worth * view.touches[1][i]);
    }
}
