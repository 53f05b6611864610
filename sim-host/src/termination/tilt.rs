use crate::term::prelude::*;

/// The tilt exceeds the limit.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Tilt {
    /// Greatest tilt.
    pub limit_deg: f64,
}

impl Rule for Tilt {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("limit_deg").number(self.limit_deg, &Limits::above(0.0, 180.0, "degrees"))?;
        Ok(())
    }

    fn ending(&self) -> Ending {
        Ending::Tilt
    }

    fn start_limit(&self) -> StartLimit {
        StartLimit::Tilt((self.limit_deg as f32).to_radians())
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let least = R::from_f32(libm::cosf((self.limit_deg as f32).to_radians()));
        mark(codes, code, |lane| least < view.swarm.state(lane).world_from_body.up_cosine());
    }
}
