//! Four walls.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::surface::{Surface, SurfaceKeys};
use crate::config::area::BoxConfig;
use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::config::geometry::holds;
use crate::world::{Pose, Shape, Solid};

/// Four walls around an interior.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoomConfig {
    /// Corner of the interior with the smallest coordinates.
    pub low_m: [f64; 3],
    /// Corner of the interior with the greatest coordinates; the walls end at its z.
    pub high_m: [f64; 3],
    /// Thickness of the walls, which stand outside the interior.
    #[serde(default = "wall_m")]
    pub wall_m: f64,
    /// Coulomb friction of the walls; 0.5 unless it is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f64>,
    /// Gap at which the reference reports contact with them; only `bullet` physics uses it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_gap_m: Option<f64>,
    /// Red, green and blue from 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<[f64; 3]>,
}

/// Thicker than the way of a drone in one control period at 10 m/s and 50 Hz.
fn wall_m() -> f64 {
    0.2
}

impl RoomConfig {
    /// The walls: back, front, right and left; the first two close the corners.
    ///
    /// # Errors
    /// When the interior is inside out or without the `goal`, or a number is out of range.
    pub(crate) fn check(self, goal: Option<&Vector3<f64>>, field: &Field<'_>) -> Result<[Solid; 4], ConfigError> {
        let (low, high) = BoxConfig { low_m: self.low_m, high_m: self.high_m }.corners(field)?;
        let wall = field.at("wall_m").real(self.wall_m, &Limits::from(0.01, 10.0, "m"))?;
        let Self { friction, contact_gap_m, colour, .. } = self;
        let keys = SurfaceKeys { role: None, friction, contact_gap_m, colour };
        let surface = Surface::default().with(keys, field)?;
        let block = |name: &str, low: Vector3<f64>, high: Vector3<f64>| {
            surface.around(name, Shape::Cuboid((high - low) / 2.0), Pose::at((low + high) / 2.0))
        };
        if goal.is_some_and(|goal| !holds(&block("interior", low, high), goal)) {
            return Err(field.reject("a room without the goal", "one with `goal_m` inside"));
        }
        let side = |name: &str, low_x, low_y, high_x, high_y| {
            block(name, Vector3::new(low_x, low_y, low.z), Vector3::new(high_x, high_y, high.z))
        };
        Ok([
            side("back wall", low.x - wall, low.y - wall, low.x, high.y + wall),
            side("front wall", high.x, low.y - wall, high.x + wall, high.y + wall),
            side("right wall", low.x, low.y - wall, high.x, low.y),
            side("left wall", low.x, high.y, high.x, high.y + wall),
        ])
    }
}
