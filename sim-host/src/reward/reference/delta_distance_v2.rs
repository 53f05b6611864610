use super::delta_distance::approach;
use crate::term::prelude::*;

/// The same in three dimensions, within 9.9 cm (`DeltaDistanceRewardV2`). As published, besides, the target is at
/// twice the landing zone's height plus 1.347 cm.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct DeltaDistanceV2 {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for DeltaDistanceV2 {
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
        let target = doubled(self.landing_zone_m, self.as_published);
        for lane in 0..LANES {
            let distance = distance(view.swarm, &target, lane);
            values[lane] = worth * approach(distance, &mut memory[0][lane], 0.099, self.as_published);
        }
    }
}
