use crate::rooms::Ways;
use crate::term::prelude::*;

/// Metres by which the shortest free way to the goal became shorter in this step. Ways lead around what stands in the
/// way and keep off it: a metre right beside something counts as three. Before an obstacle `progress` pays for
/// flying into it, and this for flying around it.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct GeodesicProgress {
    /// What one unit is worth.
    pub weight: f64,
    /// To the goal of the task.
    #[serde(skip)]
    ways: Option<Ways>,
}

impl Term for GeodesicProgress {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, task: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        task.needs_ways("`advance`", "`progress`", field)
    }

    fn prepared(self, task: &RewardTask) -> Self {
        Self { ways: Some(task.ways.clone()), ..self }
    }

    fn ways(&self) -> Option<&Ways> {
        self.ways.as_ref()
    }

    fn along(self, ways: Ways) -> Self {
        Self { ways: Some(ways), ..self }
    }

    fn memory(&self) -> Memory {
        Memory { columns: 1, start: f64::NAN, lasts: false }
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let Some(ways) = &self.ways else {
            values.fill(R::zero());
            return;
        };
        let before = &mut memory[0];
        let places = view.swarm.position.each_ref().map(|axis| axis.map(Real::to_f32));
        let lengths = ways.lengths(view.rooms, &places);
        for lane in 0..LANES {
            let length = R::from_f32(lengths[lane]);
            // None in the first step, before which it is not known.
            let gained = if is_unset(before[lane]) { R::zero() } else { before[lane] - length };
            values[lane] = worth * gained;
            before[lane] = length;
        }
    }
}

impl GeodesicProgress {
    /// The term with the ways that it pays for.
    pub fn new(weight: f64, ways: Ways) -> Self {
        Self { weight, ways: Some(ways) }
    }
}
