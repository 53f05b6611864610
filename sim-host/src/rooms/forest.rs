//! A forest as it is drawn: upright trunks between a clearing where flights start and the goal behind the last of them.

use nalgebra::{Vector3, vector};

use super::CLEARANCE_M;
use super::furnishing::{WALL_M, walls};
use crate::contact::Passage;
use crate::seed::Stream;
use crate::world::{Cuboid, Floor, Pose, Shape, Solid, World};

/// Corners of the hall \[m\].
pub(super) const HALL: Cuboid = Cuboid { low: vector![-1.0, -3.0, 0.0], high: vector![19.0, 3.0, 2.5] };

/// Where trunks stand, along the hall \[m\]: before lies the clearing, behind the goals.
const TRUNKS_X_M: [f32; 2] = [1.0, 16.5];

/// Where goals are \[m\].
const GOAL_X_M: f32 = 17.8;
const GOAL_Y_M: f32 = 2.0;
const GOAL_HEIGHT_M: f32 = 1.2;

/// The middle of the starts of a way that has to be free \[m\].
const START: Vector3<f32> = vector![-0.3, 0.0, GOAL_HEIGHT_M];

/// Ways are looked for so far above and below the height of the goal \[m\]: trunks are the same at all heights, and this is
/// twice what a way keeps from the borders.
const SLICE_M: f32 = 0.4;

/// Red, green and blue.
const TRUNK_COLOUR: [f32; 3] = [0.45, 0.3, 0.2];

/// What forests are made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forest {
    /// Trunks per square metre.
    pub density: f32,
    /// Least and greatest of their radii \[m\].
    pub radii: [f32; 2],
}

impl Forest {
    /// How many trunks stand in one.
    pub(super) fn trunks(&self) -> u32 {
        let area = (TRUNKS_X_M[1] - TRUNKS_X_M[0]) * (HALL.high.y - HALL.low.y);
        (self.density * area).round() as u32
    }

    /// Where goals can be \[m\].
    pub(super) fn goals() -> Cuboid {
        Cuboid {
            low: Vector3::new(GOAL_X_M, -GOAL_Y_M, GOAL_HEIGHT_M),
            high: Vector3::new(GOAL_X_M, GOAL_Y_M, GOAL_HEIGHT_M),
        }
    }

    /// The clearing \[m\].
    pub(super) fn kept_free() -> Cuboid {
        let high = Vector3::new(TRUNKS_X_M[0], HALL.high.y, HALL.high.z);
        Cuboid { low: HALL.low, high }
    }

    /// The hall without a trunk.
    pub(super) fn bare() -> World {
        World { floor: Floor::Solid, solids: walls(&HALL), ..World::empty() }
    }

    /// A forest of so many trunks and its goal, if this draw has a free way.
    pub(super) fn draw(&self, trunks: u32, stream: &mut Stream) -> Option<(World, Vector3<f32>)> {
        let goal = Vector3::new(GOAL_X_M, stream.between(-GOAL_Y_M, GOAL_Y_M), GOAL_HEIGHT_M);
        let mut world = Self::bare();
        world.solids.extend((0..trunks).map(|_| self.trunk(stream)));
        let passage = Passage {
            world: &world,
            bounds: Cuboid {
                low: Vector3::new(HALL.low.x, HALL.low.y, GOAL_HEIGHT_M - SLICE_M),
                high: Vector3::new(HALL.high.x, HALL.high.y, GOAL_HEIGHT_M + SLICE_M),
            },
            starts: Cuboid { low: START, high: START },
            goal,
            clearance_m: CLEARANCE_M,
        };
        passage.is_free().then_some((world, goal))
    }

    /// A trunk anywhere between the walls, from the floor to the ceiling; two may have grown together.
    fn trunk(&self, stream: &mut Stream) -> Solid {
        let [least, most] = self.radii;
        let radius = stream.between(least, most);
        let wall = WALL_M as f32 + radius;
        let x = stream.between(TRUNKS_X_M[0] + radius, TRUNKS_X_M[1] - radius);
        let y = stream.between(HALL.low.y + wall, HALL.high.y - wall);
        let half_height = f64::from(HALL.high.z) / 2.0;
        let blank = Solid::block("trunk", Vector3::zeros(), Vector3::zeros());
        let pose = Pose::at(Vector3::new(f64::from(x), f64::from(y), half_height));
        let shape = Shape::Cylinder { radius: f64::from(radius), half_height };
        Solid { shape, pose, colour: TRUNK_COLOUR, ..blank }
    }
}
