use crate::term::prelude::*;

/// The drone comes to the landing zone faster than the limit. What counts is the greater of its speeds at the end of the
/// control period of the touch and of the one before: one that bounces off has lost its speed already. It stands
/// before `landing` in the list.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Impact {
    /// Greatest speed of a touch.
    pub speed_limit_m_per_s: f64,
}

impl Rule for Impact {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("speed_limit_m_per_s").number(self.speed_limit_m_per_s, &SPEED).map(drop)
    }

    fn ending(&self) -> Ending {
        Ending::Limit
    }

    /// The squared speed of the period before.
    fn memory(&self) -> Memory {
        Memory::zeros(1)
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let limit = R::from_f64(self.speed_limit_m_per_s * self.speed_limit_m_per_s);
        let half = R::from_f64(0.5);
        let before = memory[0];
        memory[0] = std::array::from_fn(|lane| squared_length(&view.swarm.velocity, lane));
        let now = memory[0];
        mark(codes, code, |lane| {
            (view.touches[1][lane] < half) | ((before[lane] <= limit) & (now[lane] <= limit))
        });
    }
}

#[cfg(test)]
mod tests {
    use crate::episode_end::trial::Trial;
    use crate::outcome::Ending;

    /// A touch after periods at these speeds along x \[m/s\].
    fn touch_after(speeds: &[f64]) -> Option<Ending> {
        let mut trial = Trial::of("impact: { speed_limit_m_per_s: 0.5 }, landing");
        let (last, before) = speeds.split_last().unwrap();
        for speed in before {
            trial.swarm.velocity = [[*speed], [0.0], [0.0]];
            assert_eq!(trial.step(), None);
        }
        trial.swarm.velocity = [[*last], [0.0], [0.0]];
        trial.touches = [[0.0], [1.0]];
        trial.step()
    }

    #[test]
    fn a_slow_touch_lands_and_a_fast_one_breaks() {
        assert_eq!(touch_after(&[0.4]), Some(Ending::Success));
        assert_eq!(touch_after(&[0.6]), Some(Ending::Limit));
        assert_eq!(touch_after(&[0.5, -0.3]), Some(Ending::Success));
        assert_eq!(touch_after(&[0.9, -0.3]), Some(Ending::Limit), "it has bounced off");
        assert_eq!(touch_after(&[0.9, 0.4, 0.4]), Some(Ending::Success), "it has slowed down");
    }
}
