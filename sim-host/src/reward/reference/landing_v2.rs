use crate::term::prelude::*;

/// Level and within 9.9 cm of the pad's middle: 1 at the height h, less above (`LandingRewardV2`). h is the height
/// of a drone that rests on a pad whose middle is the landing zone and which stands on the floor. As published it is
/// that of a drone inside the pad.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct LandingV2 {
    /// What one unit is worth.
    pub weight: f64,
    /// The landing zone: `[x, y, z]`.
    pub landing_zone_m: [f64; 3],
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for LandingV2 {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("landing_zone_m").place(self.landing_zone_m)?;
        Ok(())
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let zone = Vector3::from(self.landing_zone_m);
        let top = if self.as_published { zone.z } else { 2.0 * zone.z };
        let (limit, height) = (RollPitchLimit::new(LEVEL), R::from_f64(top + REST_HEIGHT));
        let span = R::one() - height;
        for lane in 0..LANES {
            let z = view.swarm.position[2][lane];
            let above = planar_distance(view.swarm, &zone, lane) < R::from_f64(0.099);
            let there = (z - height).abs() < R::from_f64(0.01) * height;
            let value = if there { R::one() } else { (span - (z - height)) / span };
            values[lane] = worth * if above & limit.holds(view.swarm, lane) { value } else { R::zero() };
        }
    }
}
