use crate::term::prelude::*;

/// +1 within 9.9 cm of the landing zone or when `delta_m` nearer than at the last payment
/// (`SafeDeltaDistanceReward`). As published the target is at twice the landing zone's height plus 1.347 cm, and
/// `delta_m` is ignored for 0.2 m.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct SafeDeltaDistance {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Approach that pays.
    #[serde(default = "delta_m")]
    pub delta_m: f64,
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for SafeDeltaDistance {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("delta_m").number(self.delta_m, &LENGTH)?;
        field.at("landing_zone_m").place(self.landing_zone_m)?;
        Ok(())
    }

    fn memory(&self) -> Memory {
        Memory { columns: 1, start: f64::NAN, lasts: false }
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let target = doubled(self.landing_zone_m, self.as_published);
        let delta = R::from_f64(if self.as_published { delta_m() } else { self.delta_m });
        let (arrived, reference) = (R::from_f64(0.099), &mut memory[0]);
        for lane in 0..LANES {
            let distance = distance(view.swarm, &target, lane);
            let unset = is_unset(reference[lane]);
            let nearer = delta < reference[lane] - distance;
            let there = distance < arrived;
            values[lane] = worth * if there | nearer { R::one() } else { R::zero() };
            reference[lane] = if (unset | nearer) & !there { distance } else { reference[lane] };
        }
    }
}

/// What the reference's `SafeDeltaDistanceReward` takes it for, whatever it is told.
fn delta_m() -> f64 {
    0.2
}
