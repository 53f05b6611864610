use crate::term::prelude::*;

/// −5 below 2 cm, else `−1 / (10 z)` (take-off aviary).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Climb {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Climb {
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
            let z = view.swarm.position[2][i];
            worth * z.where_less(R::from_f64(0.02), R::from_f64(-5.0), -R::one() / (R::from_f64(10.0) * z))
        });
    }
}
