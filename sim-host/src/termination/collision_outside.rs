use crate::term::prelude::*;

/// The same, except inside an area (`CollisionTerm` with an area).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct CollisionOutside {
    /// Where touching is allowed.
    pub allowed: AreaConfig,
}

impl Rule for CollisionOutside {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        self.allowed.check(&field.at("allowed"))
    }

    fn ending(&self) -> Ending {
        Ending::Collision
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let half = R::from_f64(0.5);
        mark(codes, code, |lane| (view.touches[0][lane] < half) | self.allowed.contains(view.swarm, lane));
    }
}
