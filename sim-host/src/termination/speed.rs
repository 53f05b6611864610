use crate::term::prelude::*;

/// The drone is faster than the limit.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Speed {
    /// Greatest speed.
    pub limit_m_per_s: f64,
}

impl Rule for Speed {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("limit_m_per_s").number(self.limit_m_per_s, &Limits::above(0.0, 100.0, "m/s")).map(drop)
    }

    fn ending(&self) -> Ending {
        Ending::Limit
    }

    fn start_limit(&self) -> StartLimit {
        StartLimit::Speed(self.limit_m_per_s as f32)
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let limit = R::from_f64(self.limit_m_per_s * self.limit_m_per_s);
        mark(codes, code, |lane| squared_length(&view.swarm.velocity, lane) <= limit);
    }
}

#[cfg(test)]
mod tests {
    use crate::episode_end::trial::Trial;
    use crate::outcome::Ending;

    #[test]
    fn only_what_is_faster_ends() {
        let mut trial = Trial::of("speed: { limit_m_per_s: 5 }");
        for (velocity, ending) in [([3.0, 0.0, -4.0], None), ([3.0, 0.1, -4.0], Some(Ending::Limit))] {
            trial.swarm.velocity = velocity.map(|value| [value]);
            assert_eq!(trial.step(), ending);
        }
    }
}
