use crate::term::prelude::*;

/// −1 per squared metre between drones i and N − 1 − i (meetup aviary).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Meeting {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Meeting {
    const PAID: Paid = Paid::PerStep;

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let other = &view.team[view.team.len() - 1 - view.agent];
        each(values, |i| {
            let way = vector(other, i) - vector(&view.swarm.position, i);
            worth * -((way.x * way.x + way.y * way.y) + way.z * way.z)
        });
    }
}
