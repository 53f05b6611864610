use super::out_of_bounds::{OutOfBounds, check_around_goal};
use crate::term::prelude::*;

/// The same as a cut-off: the future still has worth.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[schemars(inline)]
pub struct CutOutOfBounds(pub BoxConfig);

impl Rule for CutOutOfBounds {
    fn check(&self, task: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        check_around_goal(&self.0, task, field)
    }

    fn ending(&self) -> Ending {
        Ending::OutOfBounds
    }

    fn truncates(&self) -> bool {
        true
    }

    fn start_limit(&self) -> StartLimit {
        StartLimit::Outside(self.0.cuboid())
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        OutOfBounds(self.0).mark(view, memory, code, codes);
    }
}
