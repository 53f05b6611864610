use crate::term::prelude::*;

/// The drone is too far from the goal.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Distance {
    /// Greatest distance.
    pub limit_m: f64,
}

impl Rule for Distance {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("limit_m").number(self.limit_m, &LENGTH)?;
        Ok(())
    }

    fn ending(&self) -> Ending {
        Ending::Distance
    }

    fn start_limit(&self) -> StartLimit {
        StartLimit::Distance(self.limit_m as f32)
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let limit = R::from_f32(self.limit_m as f32);
        mark(codes, code, |lane| view.distances[lane] < limit);
    }
}
