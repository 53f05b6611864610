use crate::term::prelude::*;

/// All gates were passed in their order: success. For tasks whose goals are `gates`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Finish;

impl Rule for Finish {
    fn check(&self, task: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        if task.is_race {
            return Ok(());
        }
        Err(field.reject("`finish` without a course", "`gates` under `goals`"))
    }

    fn ending(&self) -> Ending {
        Ending::Success
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let Some(left) = view.gates_left else { return };
        mark(codes, code, |lane| R::from_f64(0.5) < left[lane]);
    }
}
