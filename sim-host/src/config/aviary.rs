//! The place: goal, floor, walls and obstacles.

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use super::geometry::contains;
use crate::scenario::{Aviary, Cuboid};
use crate::world::{Floor, Solid, World};

/// Most solids; every one is tested in every step.
const SOLIDS_LIMIT: usize = 256;

const AXES: [char; 3] = ['x', 'y', 'z'];

/// One place with obstacles; x forward, y left, z up, metres.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AviaryConfig {
    /// Where the drone shall go: `[x, y, z]`.
    pub goal_m: [f64; 3],
    /// Whether z = 0 is solid.
    #[serde(default = "floor")]
    pub floor: bool,
    /// Four walls around the place; open above.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub room: Option<RoomConfig>,
    /// Obstacles.
    #[serde(default)]
    pub solids: Vec<BoxConfig>,
}

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
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxConfig {
    /// Corner with the smallest coordinates: `[x, y, z]`.
    pub low_m: [f64; 3],
    /// Corner with the greatest coordinates: `[x, y, z]`.
    pub high_m: [f64; 3],
}

fn floor() -> bool {
    true
}

/// Thicker than the way of a drone in one control period at 10 m/s and 50 Hz.
fn wall_m() -> f64 {
    0.2
}

impl AviaryConfig {
    /// The place, with the room's walls first among its solids.
    ///
    /// # Errors
    /// When a box is inside out, or a drone of `airframe` cannot be at the goal.
    pub fn check(&self, airframe: &Airframe, field: &Field<'_>) -> Result<Aviary, ConfigError> {
        let goal = field.at("goal_m").point(self.goal_m)?;
        let room = self.room.map(|room| room.check(&goal, &field.at("room"))).transpose()?;
        let mut solids = room.map_or_else(Vec::new, Vec::from);
        if self.solids.len() > SOLIDS_LIMIT {
            return Err(field.at("solids").refuse("", format!("a list of at most {SOLIDS_LIMIT}")));
        }
        for (index, solid) in self.solids.iter().enumerate() {
            let field_of_solid = field.at("solids").at(index);
            let solid = solid.check(&field_of_solid)?;
            if contains(&solid, &goal) {
                return Err(field_of_solid.reject("a solid around the goal", "one that leaves `goal_m` free"));
            }
            solids.push(solid);
        }
        let lowest = airframe.collision_height / 2.0;
        if self.floor && self.goal_m[2] < lowest {
            let expected =
                format!("at least {lowest} m, half the drone's height, because there is a floor at z = 0");
            return Err(field.at("goal_m").at(2).refuse(self.goal_m[2], expected));
        }
        let floor = if self.floor { Floor::Solid } else { Floor::Absent };
        let block = |solid: &Cuboid| Solid::block("solid", solid.low.cast(), solid.high.cast());
        let solids = solids.iter().map(block).collect();
        Ok(Aviary { goal, world: World { floor, solids, movables: Vec::new() } })
    }
}

impl RoomConfig {
    fn check(self, goal: &Vector3<f32>, field: &Field<'_>) -> Result<[Cuboid; 4], ConfigError> {
        let interior = BoxConfig { low_m: self.low_m, high_m: self.high_m }.check(field)?;
        let wall = field.at("wall_m").number(self.wall_m, &Limits::from(0.01, 10.0, "m"))?;
        if !contains(&interior, goal) {
            return Err(field.reject("a room without the goal", "one with `goal_m` inside"));
        }
        Ok(walls(&interior, wall))
    }
}

/// Back, front, right and left wall; the first two close the corners.
fn walls(interior: &Cuboid, thickness: f32) -> [Cuboid; 4] {
    let Cuboid { low, high } = *interior;
    let side = |low_x, low_y, high_x, high_y| Cuboid {
        low: Vector3::new(low_x, low_y, low.z),
        high: Vector3::new(high_x, high_y, high.z),
    };
    [
        side(low.x - thickness, low.y - thickness, low.x, high.y + thickness),
        side(high.x, low.y - thickness, high.x + thickness, high.y + thickness),
        side(low.x, low.y - thickness, high.x, low.y),
        side(low.x, high.y, high.x, high.y + thickness),
    ]
}

impl BoxConfig {
    /// The box.
    ///
    /// # Errors
    /// When a coordinate is out of range or `low_m` is not below `high_m`.
    pub fn check(&self, field: &Field<'_>) -> Result<Cuboid, ConfigError> {
        let low = field.at("low_m").point(self.low_m)?;
        let high = field.at("high_m").point(self.high_m)?;
        match (0..3).find(|axis| low[*axis] >= high[*axis]) {
            None => Ok(Cuboid { low, high }),
            Some(axis) => {
                let expected = format!("more than {}, the {} of `low_m`", self.low_m[axis], AXES[axis]);
                Err(field.at("high_m").at(axis).refuse(self.high_m[axis], expected))
            }
        }
    }
}
