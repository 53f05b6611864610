//! The sensor `scan`: an ideal lidar.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::sensor::{BEAM_LIMIT, Scan, ScanRing};

/// Beams that keep their directions in the world, without noise or delay.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ScanConfig {
    /// The beams, in the order of their values; 64 at most in all.
    pub rings: Vec<ScanRingConfig>,
    /// Nothing farther is seen.
    pub limit_m: f64,
    /// With a scale `s` a beam reads `(1 - d / limit) s / (s + d)` for an obstacle `d` metres away: finer within about that
    /// distance, coarser beyond. Without one it reads `1 - d / limit`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near_scale_m: Option<f64>,
    /// The beams of a ring turn, rise and sink a little from one control period to the next: in eight of them they look
    /// everywhere between two beams, and 9 degrees up and down.
    #[serde(skip_serializing_if = "core::ops::Not::not")]
    pub sweeps: bool,
}

/// Beams of one elevation, evenly spaced from +x on, counter-clockwise.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScanRingConfig {
    /// Above the horizon: 90 is up, -90 down.
    #[serde(default)]
    pub elevation_deg: f64,
    /// How many.
    pub beams: u64,
}

impl Default for ScanConfig {
    /// Sixteen level beams, which see two metres far: a pillar of 18 cm cannot hide between them within 46 cm.
    fn default() -> Self {
        Self {
            rings: vec![ScanRingConfig { elevation_deg: 0.0, beams: 16 }],
            limit_m: 2.0,
            near_scale_m: None,
            sweeps: false,
        }
    }
}

impl ScanConfig {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<Scan, ConfigError> {
        let rings = field.at("rings");
        let beams = self.rings.iter().fold(0, |sum: u64, ring| sum.saturating_add(ring.beams));
        if !(1..=BEAM_LIMIT as u64).contains(&beams) {
            return Err(rings.reject(format!("{beams} beams"), format!("1 to {BEAM_LIMIT}")));
        }
        let ring = |(index, ring): (usize, &ScanRingConfig)| ring.check(&rings.at(index));
        Ok(Scan {
            rings: self.rings.iter().enumerate().map(ring).collect::<Result<_, _>>()?,
            limit: field.at("limit_m").number(self.limit_m, &Limits::from(0.1, 1000.0, "m"))?,
            near_scale: self
                .near_scale_m
                .map(|scale| field.at("near_scale_m").number(scale, &Limits::from(0.01, 1000.0, "m")))
                .transpose()?,
            sweeps: self.sweeps,
        })
    }
}

impl ScanRingConfig {
    fn check(&self, field: &Field<'_>) -> Result<ScanRing, ConfigError> {
        let elevation = Limits::from(-90.0, 90.0, "degrees");
        Ok(ScanRing {
            elevation: field.at("elevation_deg").real(self.elevation_deg, &elevation)?.to_radians(),
            beams: field.at("beams").whole(self.beams, 1..=BEAM_LIMIT as u64)? as usize,
        })
    }
}
