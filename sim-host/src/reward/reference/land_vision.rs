use crate::term::prelude::*;

/// The land-vision aviary's staircase: 2240 or 80 when near and slow, about 2 within a metre, −240 when the episode
/// fails, else the reciprocal distance.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct LandVision {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
}

impl Term for LandVision {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("landing_zone_m").place(self.landing_zone_m)?;
        Ok(())
    }

    fn memory(&self) -> Memory {
        Memory { columns: 1, start: 0.0, lasts: false }
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let target = Vector3::from(self.landing_zone_m);
        let (real, one) = (R::from_f64, R::one());
        for lane in 0..LANES {
            let distance = distance(view.swarm, &target, lane);
            let speed = length(&vector(&view.swarm.velocity, lane));
            let lost = real(0.5) < view.ends.failure[lane] + view.ends.time_up[lane];
            let value = if (distance < real(0.1)) & (speed < real(0.1)) {
                memory[0][lane] += one;
                if memory[0][lane] >= real(10.0) { real(2240.0) } else { real(80.0) }
            } else if distance < one {
                let pace = if speed < one { real(2.0) - speed } else { one / speed };
                real(2.0) - real(0.15) * pace
            } else if lost {
                real(-240.0)
            } else {
                one / distance
            };
            values[lane] = worth * value;
        }
    }
}
