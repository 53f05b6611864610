use crate::config::geometry::surrounds;
use crate::term::prelude::*;

/// The centre of mass leaves the box (`BoundsTerm`).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[schemars(inline)]
pub struct OutOfBounds(pub BoxConfig);

impl Rule for OutOfBounds {
    fn check(&self, task: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        check_around_goal(&self.0, task, field)
    }

    fn ending(&self) -> Ending {
        Ending::OutOfBounds
    }

    fn start_limit(&self) -> StartLimit {
        StartLimit::Outside(self.0.cuboid())
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let bounds = self.0.cuboid();
        mark(codes, code, |lane| stays_in(&bounds, view.swarm, lane));
    }
}

/// Refuses bounds that have no inside, or not the goal in it.
pub(super) fn check_around_goal(
    bounds: &BoxConfig,
    task: &RuleTask,
    field: &Field<'_>,
) -> Result<(), ConfigError> {
    if surrounds(&bounds.check(field)?, &task.goals) {
        return Ok(());
    }
    Err(field.reject("bounds without the goal", "bounds with `goal_m` inside"))
}
