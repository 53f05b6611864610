use crate::term::prelude::*;

/// +1 for every cell of the field entered for the first time (`FieldCoverageReward`). As published a metre beyond
/// the field's low borders counts as its first cells.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct FieldCoverage {
    /// What one unit is worth.
    pub weight: f64,
    /// Cells of one metre along each side of the field, which is centred on the origin.
    #[serde(default = "cells")]
    pub cells: u64,
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for FieldCoverage {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        Cells::check(self.cells, field)?;
        Ok(())
    }

    fn memory(&self) -> Memory {
        Memory { columns: Cells::count(self.cells), start: 0.0, lasts: false }
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let cells = Cells::new(self.cells, self.as_published);
        for lane in 0..LANES {
            values[lane] = worth * cells.visit(view.swarm, lane, memory);
        }
    }
}

fn cells() -> u64 {
    5
}
