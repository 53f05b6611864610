use crate::term::prelude::*;

/// +1 within 10 cm of the landing zone or when nearer than in the step before, else −1; horizontal
/// (`DeltaDistanceReward`). As published only an approach of more than 1 cm a step counts, so that flying slower than
/// 0.48 m/s towards it is punished.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct DeltaDistance {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for DeltaDistance {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
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
        let target = Vector3::from(self.landing_zone_m);
        for lane in 0..LANES {
            let distance = planar_distance(view.swarm, &target, lane);
            values[lane] = worth * approach(distance, &mut memory[0][lane], 0.1, self.as_published);
        }
    }
}

/// Least approach per step that the reference rewards \[m\].
const PUBLISHED_APPROACH: f64 = 0.01;

/// +1 within the radius \[m\], which is not remembered, or when nearer than before, else −1; nothing in the first step.
pub(super) fn approach<R: Real>(distance: R, before: &mut R, radius: f64, as_published: bool) -> R {
    let one = R::one();
    if distance < R::from_f64(radius) {
        return one;
    }
    let least = R::from_f64(if as_published { PUBLISHED_APPROACH } else { 0.0 });
    let last = core::mem::replace(before, distance);
    match (is_unset(last), distance - last < -least) {
        (true, _) => R::zero(),
        (false, true) => one,
        (false, false) => -one,
    }
}
