//! Gates to fly through.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::course::Gate;

/// Widths and heights of openings.
const OPENINGS: Limits = Limits::from(0.2, 10.0, "m");

/// Width of a frame's bars where a file says nothing.
const BAR_M: f64 = 0.1;

/// An upright frame to fly through, four bars around an opening.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct GateConfig {
    /// Middle of its opening: `[x, y, z]`.
    pub at_m: [f64; 3],
    /// Which way it is flown through: 0 along +x, 90 along +y.
    #[serde(default)]
    pub heading_deg: f64,
    /// Width and height of its opening.
    #[serde(default = "opening")]
    pub opening_m: [f64; 2],
    /// Width of its bars.
    #[serde(default = "bar")]
    pub bar_m: f64,
}

fn opening() -> [f64; 2] {
    [0.8; 2]
}

fn bar() -> f64 {
    BAR_M
}

impl GateConfig {
    /// The gate, and the width of its bars \[m\].
    ///
    /// # Errors
    /// When a number is out of range.
    pub(crate) fn check(self, field: &Field<'_>) -> Result<(Gate, f64), ConfigError> {
        let heading = field.at("heading_deg").real(self.heading_deg, &Limits::from(-360.0, 360.0, "degrees"))?;
        let opening = field.at("opening_m");
        let [width, height] = self.opening_m;
        let gate = Gate {
            center: field.at("at_m").place(self.at_m)?,
            heading: heading.to_radians(),
            opening: [opening.at(0).real(width, &OPENINGS)?, opening.at(1).real(height, &OPENINGS)?],
        };
        Ok((gate, field.at("bar_m").real(self.bar_m, &Limits::from(0.01, 1.0, "m"))?))
    }
}
