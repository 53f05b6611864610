//! The sensor `way`: the way to the goal that a drone finds by itself.

use kestrel_core::planner::{NODE_LIMIT, NodeGrid};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::area::BoxConfig;
use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::sensor::Way;

/// A map that a drone makes of what it meets, and the shortest path in it.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WayConfig {
    /// What is mapped, and what no path leaves. Where nothing has been met, one can fly.
    pub map: BoxConfig,
    /// Between two nodes of the map; 65,024 nodes at most.
    #[serde(default = "tenth")]
    pub spacing_m: f64,
    /// How often the path is looked for anew, in whole control periods.
    #[serde(default = "ten")]
    pub rate_hz: f64,
    /// How far along the path the point is that is seen.
    #[serde(default = "three_tenths")]
    pub lookahead_m: f64,
    /// What a metre right beside something counts more than one in the open: what is not met yet is where something else was.
    #[serde(default = "twelve")]
    pub nearness_cost: f64,
    /// What is met farther away is not mapped: there the zones of a ranger are wide, and noise is large.
    #[serde(default = "hundred")]
    pub mapped_within_m: f64,
    /// How many metres one counts where no zone or beam has looked through; 1 is no difference.
    #[serde(default = "one")]
    pub unseen_cost: f64,
    /// Whether three more values show which way is away from the nearest thing on the map: a vector of length 1 at the thing
    /// itself, 0 from 38 cm on.
    #[serde(default)]
    pub shows_nearest: bool,
}

const fn tenth() -> f64 {
    0.1
}

const fn ten() -> f64 {
    10.0
}

const fn three_tenths() -> f64 {
    0.3
}

const fn twelve() -> f64 {
    12.0
}

const fn one() -> f64 {
    1.0
}

const fn hundred() -> f64 {
    100.0
}

impl WayConfig {
    pub(super) fn check(&self, control_secs: f64, field: &Field<'_>) -> Result<Way, ConfigError> {
        let bounds = self.map.check(&field.at("map"))?;
        let spacing = field.at("spacing_m").number(self.spacing_m, &Limits::from(0.02, 10.0, "m"))?;
        let rate = field.at("rate_hz").real(self.rate_hz, &Limits::from(0.1, 1000.0, "Hz"))?;
        let Some(grid) = NodeGrid::new(bounds.low.into(), bounds.high.into(), spacing) else {
            let expected = format!("2 along each edge at least, and {NODE_LIMIT} at most");
            return Err(field.reject(format!("nodes {spacing} m apart in this `map`"), expected));
        };
        Ok(Way {
            grid,
            periods: libm::round(1.0 / (rate * control_secs)).max(1.0) as u32,
            lookahead_m: field.at("lookahead_m").number(self.lookahead_m, &Limits::from(0.05, 10.0, "m"))?,
            nearness_cost: field.at("nearness_cost").number(self.nearness_cost, &Limits::from(0.0, 30.0, ""))?,
            mapped_within_m: field
                .at("mapped_within_m")
                .number(self.mapped_within_m, &Limits::from(0.1, 100.0, "m"))?,
            unseen_cost: field.at("unseen_cost").number(self.unseen_cost, &Limits::from(1.0, 10.0, ""))?,
            shows_nearest: self.shows_nearest,
        })
    }
}
