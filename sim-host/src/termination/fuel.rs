use crate::term::prelude::*;

/// The station was not visited for too long (`FieldCoverageTerm`). As published control periods are counted as if
/// there were 240 in a second.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Fuel {
    /// How long a full tank lasts.
    pub interval_secs: f64,
    /// Where it is refilled, within 12 cm.
    pub station_m: [f64; 3],
    /// Whether to keep the defect.
    #[serde(default)]
    pub as_published: bool,
}

impl Rule for Fuel {
    fn check(&self, _: &RuleTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("interval_secs").number(self.interval_secs, &INTERVAL)?;
        field.at("station_m").place(self.station_m).map(drop)
    }

    fn ending(&self) -> Ending {
        Ending::OutOfFuel
    }

    fn memory(&self) -> Memory {
        Memory::unset(1)
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let periods = counted_periods(self.interval_secs, view.control_rate_hz, self.as_published);
        let (full, radius) = (R::from_f64(f64::from(periods)), R::from_f64(0.12));
        // As published the station is the place of a drone on a box whose middle is given.
        let station = doubled(self.station_m, self.as_published);
        let fuel = &mut memory[0];
        for lane in 0..LANES {
            let left = if is_unset(fuel[lane]) { full } else { fuel[lane] };
            fuel[lane] = distance(view.swarm, &station, lane).where_less(radius, full, left - R::one());
        }
        mark(codes, code, |lane| R::zero() < fuel[lane]);
    }
}
