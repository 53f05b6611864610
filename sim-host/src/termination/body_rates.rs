use crate::term::prelude::*;

/// The drone turns faster than the limit about any axis. Gyroscopes measure up to 35 rad/s (2,000 degrees per second).
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct BodyRates {
    /// Greatest body rate.
    pub limit_rad_per_s: f64,
}

impl Rule for BodyRates {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("limit_rad_per_s").number(self.limit_rad_per_s, &Limits::above(0.0, 1_000.0, "rad/s")).map(drop)
    }

    fn ending(&self) -> Ending {
        Ending::Limit
    }

    fn start_limit(&self) -> StartLimit {
        StartLimit::BodyRates(self.limit_rad_per_s as f32)
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let limit = R::from_f64(self.limit_rad_per_s);
        for rates in &view.swarm.body_rates {
            mark(codes, code, |lane| rates[lane] <= limit && rates[lane] >= -limit);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::episode_end::trial::Trial;
    use crate::outcome::Ending;

    #[test]
    fn what_turns_faster_ends() {
        let mut trial = Trial::of("body_rates: { limit_rad_per_s: 35 }");
        let cases = [([34.0, -34.0, 0.0], None), ([0.0, 0.0, -36.0], Some(Ending::Limit))];
        for (body_rates, ending) in cases {
            trial.swarm.body_rates = body_rates.map(|value| [value]);
            assert_eq!(trial.step(), ending);
        }
    }
}
