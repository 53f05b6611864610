use crate::term::prelude::*;

/// The drone is near the goal: success.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Arrival {
    /// How near.
    pub radius_m: f64,
}

impl Rule for Arrival {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("radius_m").number(self.radius_m, &LENGTH)?;
        Ok(())
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
        let radius = R::from_f32(self.radius_m as f32);
        mark(codes, code, |lane| radius <= view.distances[lane]);
    }
}
