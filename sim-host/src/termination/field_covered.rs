use crate::term::prelude::*;

/// Every cell of the field was entered: success.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct FieldCovered {
    /// Cells of one metre along each side of the field.
    pub cells: u64,
    /// Whether a metre beyond the low borders counts, too.
    #[serde(default)]
    pub as_published: bool,
}

impl Rule for FieldCovered {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        Cells::check(self.cells, field)
    }

    fn ending(&self) -> Ending {
        Ending::Success
    }

    fn memory(&self) -> Memory {
        Memory::zeros(Cells::count(self.cells))
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let (cells, half) = (Cells::new(self.cells, self.as_published), R::from_f64(0.5));
        for lane in 0..LANES {
            cells.visit(view.swarm, lane, memory);
        }
        mark(codes, code, |lane| memory.iter().any(|cell| cell[lane] < half));
    }
}
