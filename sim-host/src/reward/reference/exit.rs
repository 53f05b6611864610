use crate::term::prelude::*;

/// +1000 at the exit, else −1 (maze aviary). As published the roll has to be nearly zero there, because a quaternion
/// is compared with a fourth coordinate.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Exit {
    /// What one unit is worth.
    pub weight: f64,
    /// The exit.
    pub region: BoxConfig,
    /// Whether to keep the defect of the reference that is described above.
    #[serde(default)]
    pub as_published: bool,
}

impl Term for Exit {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        self.region.check(&field.at("region"))?;
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
        let exit = LevelWithin::new(&self.region, self.as_published);
        each(values, |i| worth * if exit.holds(view.swarm, i) { R::from_f64(1000.0) } else { -R::one() });
    }
}
