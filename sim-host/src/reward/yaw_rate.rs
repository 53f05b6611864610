use crate::term::prelude::*;

/// How fast the drone turns about its own z axis in rad/s, either way round. Not squared: slow turning, which `body_rates`
/// all but forgives, costs its share.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct YawRate {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for YawRate {
    const PAID: Paid = Paid::PerSecond;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let [_, _, about_z] = &view.swarm.body_rates;
        each(values, |i| worth * about_z[i].abs());
    }
}
