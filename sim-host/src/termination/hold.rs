use crate::term::prelude::*;

/// Near the goal and slow for long enough: success.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Hold {
    /// How near.
    pub radius_m: f64,
    /// How slow.
    pub speed_limit_m_per_s: f64,
    /// For how many control periods.
    pub periods: u64,
}

impl Rule for Hold {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("radius_m").number(self.radius_m, &LENGTH)?;
        field.at("speed_limit_m_per_s").number(self.speed_limit_m_per_s, &SPEED)?;
        field.at("periods").whole(self.periods, 1..=100_000)?;
        Ok(())
    }

    fn ending(&self) -> Ending {
        Ending::Success
    }

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
        let speed = self.speed_limit_m_per_s as f32;
        let (radius, limit) = (R::from_f32(self.radius_m as f32), R::from_f32(speed * speed));
        for lane in 0..LANES {
            let velocity = vector(&view.swarm.velocity, lane);
            let slow = velocity.x * velocity.x + velocity.y * velocity.y + velocity.z * velocity.z < limit;
            let held = slow & (view.distances[lane] < radius);
            memory[0][lane] += if held { R::one() } else { R::zero() };
        }
        let enough = R::from_f64(self.periods as f64 - 0.5);
        mark(codes, code, |lane| memory[0][lane] < enough);
    }
}
