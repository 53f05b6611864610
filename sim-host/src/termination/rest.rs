use crate::term::prelude::*;

/// At rest on the landing zone without a break: touching it, slow, upright: success. It takes contacts that are
/// solved, or drones fall through.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Rest {
    /// Greatest speed that counts.
    pub speed_limit_m_per_s: f64,
    /// Greatest tilt that counts.
    pub tilt_limit_deg: f64,
    /// For how long.
    pub rest_secs: f64,
}

impl Rule for Rest {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("tilt_limit_deg").number(self.tilt_limit_deg, &Limits::above(0.0, 90.0, "degrees"))?;
        field.at("rest_secs").number(self.rest_secs, &INTERVAL)?;
        field.at("speed_limit_m_per_s").number(self.speed_limit_m_per_s, &SPEED)?;
        Ok(())
    }

    fn ending(&self) -> Ending {
        Ending::Success
    }

    fn contacts(&self) -> Option<Contacts> {
        Some(Contacts::Solved)
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
        let tilt = (self.tilt_limit_deg as f32).to_radians();
        let (limit, least, half) = (R::from_f32(speed * speed), R::from_f32(libm::cosf(tilt)), R::from_f64(0.5));
        for lane in 0..LANES {
            let velocity = vector(&view.swarm.velocity, lane);
            let slow = velocity.x * velocity.x + velocity.y * velocity.y + velocity.z * velocity.z < limit;
            let upright = least < view.swarm.state(lane).world_from_body.up_cosine();
            let rests = slow & upright & (half < view.touches[1][lane]);
            memory[0][lane] = if rests { memory[0][lane] + R::one() } else { R::zero() };
        }
        let periods = counted_periods(self.rest_secs, view.control_rate_hz, false);
        let enough = R::from_f64(f64::from(periods) - 0.5);
        mark(codes, code, |lane| memory[0][lane] < enough);
    }
}
