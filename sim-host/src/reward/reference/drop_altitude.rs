use crate::term::prelude::*;

/// Near the landing zone +1 for not rising, −1 for rising (`DropAltitudeReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct DropAltitude {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Horizontal distance that is near.
    pub start_distance_m: f64,
}

impl Term for DropAltitude {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("landing_zone_m").place(self.landing_zone_m)?;
        field.at("start_distance_m").number(self.start_distance_m, &LENGTH)?;
        Ok(())
    }

    fn memory(&self) -> Memory {
        Memory { columns: 2, start: f64::NAN, lasts: false }
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
        let before = &mut memory[0];
        for lane in 0..LANES {
            let height = view.swarm.position[2][lane];
            if planar_distance(view.swarm, &target, lane) < R::from_f64(self.start_distance_m) {
                let rising = before[lane] + R::from_f64(1e-6) < height;
                values[lane] = worth * if rising { -R::one() } else { R::one() };
                before[lane] = height;
            } else {
                values[lane] = worth * R::zero();
                before[lane] = R::from_f64(f64::NAN);
            }
        }
    }
}
