use super::collision::{check_area, collision};
use crate::term::prelude::*;

/// −1 while touching anything but the landing zone, else +1 (`NoCollisionReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct NoCollision {
    /// What one unit is worth.
    pub weight: f64,
    /// Where touching is free: its x and y ranges.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allowed: Option<AreaConfig>,
}

impl Term for NoCollision {
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
        let (one, two) = (R::one(), R::from_f64(2.0));
        each(values, |i| worth * (one - two * collision(view, self.allowed.as_ref(), i)));
    }
}
