use crate::term::prelude::*;

/// −1 while touching anything but the landing zone (`CollisionReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Collision {
    /// What one unit is worth.
    pub weight: f64,
    /// Where touching is free: its x and y ranges.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allowed: Option<AreaConfig>,
}

impl Term for Collision {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        check_area(self.allowed.as_ref(), field)?;
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
        each(values, |i| worth * -collision(view, self.allowed.as_ref(), i));
    }
}

/// Refuses an area that is none.
pub(super) fn check_area(allowed: Option<&AreaConfig>, field: &Field<'_>) -> Result<(), ConfigError> {
    allowed.map_or(Ok(()), |area| area.check(&field.at("allowed")))
}

/// One in contact outside the area where contact is allowed.
#[inline(always)]
pub(super) fn collision<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    allowed: Option<&AreaConfig>,
    lane: usize,
) -> R {
    match allowed {
        Some(area) if area.contains(view.swarm, lane) => R::zero(),
        Some(_) | None => view.touches[0][lane],
    }
}
