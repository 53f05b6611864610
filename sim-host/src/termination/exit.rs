use crate::term::prelude::*;

/// The drone is at the exit: success. As published the quaternion's x has to be nearly zero, too.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Exit {
    /// The exit.
    pub region: BoxConfig,
    /// Whether to keep the defect.
    #[serde(default)]
    pub as_published: bool,
}

impl Rule for Exit {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        self.region.check(&field.at("region")).map(drop)
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
        let exit = LevelWithin::new(&self.region, self.as_published);
        mark(codes, code, |lane| !exit.holds(view.swarm, lane));
    }
}
