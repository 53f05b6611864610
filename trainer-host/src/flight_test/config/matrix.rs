//! What differs between flights of the same script.

use std::path::Path;

use kestrel_shim::autopilot::ALTITUDES_M;
use kestrel_sim::config::{ConfigError, Field, Limits};
use kestrel_sim::seed::Seed;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Height of a take-off where none is given \[m\].
const HEIGHT_M: f64 = 1.0;

/// Most flights of one script.
const VARIANT_LIMIT: usize = 10_000;

/// What differs between flights of the same script: one flight for every combination.
#[derive(Clone, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(super) struct MatrixConfig {
    /// Who flies, instead of the file's pilot.
    pilots: Vec<String>,
    /// Episodes of the task whose drone and wind are flown; left out: a nominal drone in still air.
    seeds: Vec<u64>,
    /// Heights of take-offs and points that leave theirs open; left out: 1 m.
    heights_m: Vec<f64>,
    /// Constant wind, world, beside that of the episode; left out: none.
    winds_m_per_s: Vec<[f64; 3]>,
}

/// One combination.
pub(super) struct Variant<'a> {
    /// Name or file of who flies.
    pub(super) pilot: &'a str,
    /// The episode whose drone and wind are flown.
    pub(super) seed: Option<Seed>,
    /// \[m\].
    pub(super) height_m: f32,
    /// \[m/s, world\].
    pub(super) wind: Vector3<f64>,
    /// What follows the name of the flight: what of it differs.
    pub(super) suffix: String,
    /// Which of the pilots; none for the file's.
    pilot_index: Option<usize>,
}

impl MatrixConfig {
    /// All combinations, the last list going fastest.
    pub(super) fn variants<'a>(&'a self, pilot: &'a str) -> Vec<Variant<'a>> {
        (0..self.flights()).map(|number| self.variant(number, pilot)).collect()
    }

    /// How many combinations there are.
    fn flights(&self) -> usize {
        let lengths = [self.pilots.len(), self.seeds.len(), self.heights_m.len(), self.winds_m_per_s.len()];
        lengths.into_iter().fold(1, |flights, length| flights.saturating_mul(length.max(1)))
    }

    fn variant<'a>(&'a self, number: usize, pilot: &'a str) -> Variant<'a> {
        let mut left = number;
        let mut chosen = |length: usize| {
            let index = left % length.max(1);
            left /= length.max(1);
            (length > 0).then_some(index)
        };
        let wind = chosen(self.winds_m_per_s.len()).map(|index| self.winds_m_per_s[index]);
        let height_m = chosen(self.heights_m.len()).map(|index| self.heights_m[index]);
        let seed = chosen(self.seeds.len()).map(|index| self.seeds[index]);
        let pilot_index = chosen(self.pilots.len());
        let pilot = pilot_index.map_or(pilot, |index| &self.pilots[index]);
        let differing = [
            pilot_index.map(|_| short(pilot).to_owned()),
            seed.map(|seed| format!("seed {seed}")),
            height_m.map(|height_m| format!("{height_m} m")),
            wind.map(|[x, y, z]| format!("wind {x} {y} {z}")),
        ];
        let differing: Vec<String> = differing.into_iter().flatten().collect();
        Variant {
            pilot,
            seed: seed.map(Seed),
            height_m: height_m.unwrap_or(HEIGHT_M) as f32,
            wind: wind.unwrap_or_default().into(),
            suffix: if differing.is_empty() { String::new() } else { format!(" [{}]", differing.join(", ")) },
            pilot_index,
        }
    }

    /// Refuses numbers out of range, and too many flights.
    pub(super) fn check(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        let heights = Limits::from(f64::from(*ALTITUDES_M.start()), f64::from(*ALTITUDES_M.end()), "m");
        for (index, height_m) in self.heights_m.iter().enumerate() {
            field.at("heights_m").at(index).number(*height_m, &heights)?;
        }
        for (index, wind) in self.winds_m_per_s.iter().enumerate() {
            super::wind(*wind, &field.at("winds_m_per_s").at(index))?;
        }
        let flights = self.flights();
        if flights > VARIANT_LIMIT {
            return Err(field.reject(format!("{flights} flights"), format!("at most {VARIANT_LIMIT}")));
        }
        Ok(())
    }
}

impl Variant<'_> {
    /// Where its pilot is written, in a file or in a flight of it.
    pub(super) fn field_of_pilot<'f>(&self, root: &Field<'f>, flight: &Field<'f>) -> Field<'f> {
        match self.pilot_index {
            Some(index) => flight.at("matrix").at("pilots").at(index),
            None => root.at("pilot"),
        }
    }
}

/// A name, or that of a file without its folders and ending.
fn short(pilot: &str) -> &str {
    Path::new(pilot).file_stem().and_then(|stem| stem.to_str()).unwrap_or(pilot)
}
