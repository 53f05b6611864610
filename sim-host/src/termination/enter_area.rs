use crate::term::prelude::*;

/// The drone is inside an area: success (`EnterAreaTerm`). As published it counts its own calls instead of looking,
/// and fails the episode in the eleventh step.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct EnterArea {
    /// The area.
    pub area: AreaConfig,
    /// Whether to keep the defect.
    #[serde(default)]
    pub as_published: bool,
}

impl Rule for EnterArea {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        self.area.check(&field.at("area"))
    }

    fn ending(&self) -> Ending {
        if self.as_published { Ending::Overdue } else { Ending::Success }
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        if self.as_published {
            mark(codes, code, |lane| view.steps[lane] < R::from_f64(10.5));
        } else {
            mark(codes, code, |lane| !self.area.contains(view.swarm, lane));
        }
    }
}
