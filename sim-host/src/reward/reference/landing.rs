use crate::term::prelude::*;

/// Within 15 cm of the pad's middle `1 − |z − h|`, and 10 from the tenth step there (`LandingReward`). h is the height
/// of a resting drone. As published it is 10 cm below the pad's middle, and steps count across episodes.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Landing {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for Landing {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("landing_zone_m").place(self.landing_zone_m)?;
        Ok(())
    }

    fn memory(&self) -> Memory {
        Memory { columns: 1, start: 0.0, lasts: self.as_published }
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let zone = Vector3::from(self.landing_zone_m);
        let height = if self.as_published { zone.z - 0.1 } else { 2.0 * zone.z + REST_HEIGHT };
        let (one, frames) = (R::one(), &mut memory[0]);
        for lane in 0..LANES {
            let above = planar_distance(view.swarm, &zone, lane) < R::from_f64(0.15);
            frames[lane] += if above { one } else { R::zero() };
            let off = (view.swarm.position[2][lane] - R::from_f64(height)).abs();
            let landed = frames[lane] >= R::from_f64(10.0);
            values[lane] = worth
                * match (above, landed) {
                    (true, true) => R::from_f64(10.0),
                    (true, false) => one - off,
                    (false, _) => R::zero(),
                };
        }
    }
}
