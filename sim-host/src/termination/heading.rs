use crate::term::prelude::*;

/// The drone's heading is too far from the one that is asked for, or its nose points straight up or down.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Heading {
    /// Greatest angle between the two, below 180 degrees.
    pub limit_deg: f64,
    /// The heading that is asked for, counter-clockwise from +x.
    #[serde(default)]
    pub heading_deg: f64,
}

impl Rule for Heading {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("limit_deg").number(self.limit_deg, &Limits::between(0.0, 180.0, "degrees"))?;
        field.at("heading_deg").number(self.heading_deg, &Limits::from(-360.0, 360.0, "degrees")).map(drop)
    }

    fn ending(&self) -> Ending {
        Ending::Limit
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let [limit, heading] = [self.limit_deg, self.heading_deg].map(f64::to_radians);
        let least = R::from_f64(libm::cos(limit));
        let (sine, cosine) = (R::from_f64(libm::sin(heading)), R::from_f64(libm::cos(heading)));
        mark(codes, code, |lane| {
            let nose = view.swarm.forward(lane);
            least * planar_length(&nose) < cosine * nose.x + sine * nose.y
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::episode_end::trial::{PITCH, Trial, YAW};
    use crate::outcome::Ending;

    #[test]
    fn the_heading_ends_by_the_angle_from_the_one_asked_for() {
        let mut trial = Trial::of("heading: { limit_deg: 120, heading_deg: 170 }");
        for (turned_deg, ending) in
            [(51.0, None), (49.0, Some(Ending::Limit)), (-71.0, None), (-69.0, Some(Ending::Limit))]
        {
            assert_eq!(trial.turned(YAW, f64::to_radians(turned_deg)), ending, "{turned_deg}");
        }
        let mut ahead = Trial::of("heading: { limit_deg: 60 }");
        assert_eq!(ahead.turned(PITCH, -1.5), None);
        assert_eq!(ahead.turned(PITCH, -2.0), Some(Ending::Limit));
    }
}
