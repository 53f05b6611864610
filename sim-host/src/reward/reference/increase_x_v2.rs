use crate::term::prelude::*;

/// +1 when x exceeds its greatest value so far by `delta_m` (`IncreaseXRewardV2`). As published the greatest value
/// starts at −1000 m, so that the first step pays.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct IncreaseXV2 {
    /// What one unit is worth.
    pub weight: f64,
    /// Advance that pays.
    #[serde(default = "delta_m")]
    pub delta_m: f64,
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for IncreaseXV2 {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("delta_m").number(self.delta_m, &LENGTH)?;
        Ok(())
    }

    fn memory(&self) -> Memory {
        Memory { columns: 1, start: if self.as_published { -1000.0 } else { f64::NAN }, lasts: false }
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let (delta, greatest) = (R::from_f64(self.delta_m), &mut memory[0]);
        for lane in 0..LANES {
            let x = view.swarm.position[0][lane];
            let farther = greatest[lane] + delta < x;
            let unset = !self.as_published & is_unset(greatest[lane]);
            values[lane] = worth * if farther { R::one() } else { R::zero() };
            greatest[lane] = if farther | unset { x } else { greatest[lane] };
        }
    }
}

fn delta_m() -> f64 {
    0.2
}
