//! The sensor `tof`: a multizone time-of-flight ranger.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Part;
use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::sensor::{Tof, TofParts};

/// A square of zones ahead, each of which measures the distance to the nearest thing in it. Defaults are those of a VL53L5CX in
/// its mode of 8 by 8 zones (DS13754).
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TofConfig {
    /// Zones along each side: 4 or 8.
    pub zones: u64,
    /// Across a side (data sheet: 45, 63 from corner to corner).
    pub field_of_view_deg: f64,
    /// Of the middle below the body's nose.
    pub pitch_deg: f64,
    /// Farther things read as nothing (data sheet: 4; dark things are not seen so far).
    pub limit_m: f64,
    /// Standard deviation of the white noise right at the sensor (an assumption).
    pub noise_m: f64,
    /// What each metre adds to it (an assumption).
    pub noise_per_metre: f64,
    /// Measurements per second (data sheet: at most 15, 60 of 4 by 4 zones).
    pub rate_hz: f64,
    /// Age of a measurement when it arrives, less than what passes between two (an assumption: half of that, and its transfer).
    pub latency_secs: f64,
    /// Share of zones that measure nothing.
    pub drop_out: f64,
}

impl Default for TofConfig {
    fn default() -> Self {
        Self {
            zones: 8,
            field_of_view_deg: 45.0,
            pitch_deg: 0.0,
            limit_m: 4.0,
            noise_m: 0.005,
            noise_per_metre: 0.02,
            rate_hz: 15.0,
            latency_secs: 0.04,
            drop_out: 0.02,
        }
    }
}

impl TofConfig {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<Tof, ConfigError> {
        let part = Part(field);
        if ![4, 8].contains(&self.zones) {
            return Err(field.at("zones").reject(format!("{}", self.zones), "4 or 8"));
        }
        let sampling = part.sampling(self.rate_hz, self.latency_secs, self.drop_out)?;
        if self.latency_secs * self.rate_hz >= 1.0 {
            let expected =
                format!("less than {:.4} s, what passes from one measurement to the next", 1.0 / self.rate_hz);
            return Err(field.at("latency_secs").reject(format!("{} s", self.latency_secs), expected));
        }
        let angle =
            |key: &str, value: f64, limits: Limits| field.at(key).real(value, &limits).map(f64::to_radians);
        let error = |key: &str, value| part.error(key, value).map(|value| value as f32);
        Ok(Tof::new(&TofParts {
            side: self.zones as usize,
            field_of_view: angle(
                "field_of_view_deg",
                self.field_of_view_deg,
                Limits::from(5.0, 120.0, "degrees"),
            )?,
            pitch: angle("pitch_deg", self.pitch_deg, Limits::from(-90.0, 90.0, "degrees"))?,
            limit: field.at("limit_m").number(self.limit_m, &Limits::from(0.1, 100.0, "m"))?,
            noise: [error("noise_m", self.noise_m)?, error("noise_per_metre", self.noise_per_metre)?],
            sampling,
        }))
    }
}
