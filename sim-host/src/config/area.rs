//! Upright areas.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use crate::scenario::Area;

/// An upright rectangle, its border excluded, at any height.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AreaConfig {
    /// Least and greatest x.
    pub x_m: [f64; 2],
    /// Least and greatest y.
    pub y_m: [f64; 2],
}

impl AreaConfig {
    /// The area.
    ///
    /// # Errors
    /// When a coordinate is out of range or the least is not below the greatest.
    pub fn check(&self, field: &Field<'_>) -> Result<Area, ConfigError> {
        Ok(Area { x: range(self.x_m, &field.at("x_m"))?, y: range(self.y_m, &field.at("y_m"))? })
    }
}

fn range([low, high]: [f64; 2], field: &Field<'_>) -> Result<[f32; 2], ConfigError> {
    let coordinate = Limits::from(-1000.0, 1000.0, "m");
    let least = field.at(0).number(low, &coordinate)?;
    let greatest = field.at(1).number(high, &coordinate)?;
    if high <= low {
        return Err(field.at(1).refuse(high, format!("more than {low}, the least")));
    }
    Ok([least, greatest])
}
