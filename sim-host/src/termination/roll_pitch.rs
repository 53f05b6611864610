use crate::term::prelude::*;

/// Roll or pitch reaches the limit (`OrientationTerm`, with 1 rad).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct RollPitch {
    /// Greatest magnitude of each, below 90 degrees.
    pub limit_deg: f64,
    /// Whether it cuts off rather than fails.
    #[serde(default)]
    pub truncates: bool,
}

impl Rule for RollPitch {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("limit_deg").number(self.limit_deg, &Limits::between(0.0, 90.0, "degrees"))?;
        Ok(())
    }

    fn ending(&self) -> Ending {
        Ending::Tilt
    }

    fn truncates(&self) -> bool {
        self.truncates
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let limit = RollPitchLimit::new(self.limit_deg.to_radians());
        mark(codes, code, |lane| limit.holds(view.swarm, lane));
    }
}
