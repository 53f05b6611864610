//! A forest as it is drawn: upright trunks between a clearing where flights start and the goal behind the last of them.

use nalgebra::{Vector3, vector};

use super::CLEARANCE_M;
use super::furnishing::{WALL_M, walls};
use crate::contact::{Passage, nearest_obstacle};
use crate::seed::Stream;
use crate::world::{Cuboid, Drive, Floor, Movable, Pose, Shape, Solid, Walk, World};

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
const PERSON_COLOUR: [f32; 3] = [0.2, 0.35, 0.6];

/// A person as a cylinder \[m\].
const PERSON_RADIUS_M: f64 = 0.25;
const PERSON_HEIGHT_M: f64 = 1.75;

/// Least and greatest distance between the ends of a walk \[m\].
const WALK_M: [f32; 2] = [1.5, 5.0];

/// Walks that are drawn for a person before its forest is given up.
const WALKS: u32 = 200;

/// From one place at which a walk is looked at to the next \[m\].
const WALK_STEP_M: f64 = 0.1;

/// What forests are made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Forest {
    /// Trunks per square metre.
    pub density: f32,
    /// Least and greatest of their radii \[m\].
    pub radii: [f32; 2],
    /// How many people walk there.
    pub people: u32,
    /// How fast they do \[m/s\].
    pub walking_speed: f32,
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

    /// The air behind the trunks, a drone's width from the walls \[m\].
    pub(crate) fn kept_free_for_goals() -> Cuboid {
        Cuboid { low: Vector3::new(17.0, -2.7, 0.3), high: Vector3::new(18.7, 2.7, 2.2) }
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
        if !passage.is_free() {
            return None;
        }
        for _ in 0..self.people {
            let person = (0..WALKS).find_map(|_| self.person(&world.solids, stream))?;
            world.movables.push(person);
        }
        Some((world, goal))
    }

    /// Somebody who walks to and fro between trunks, if this draw is one of a free walk; people walk through each other.
    fn person(&self, solids: &[Solid], stream: &mut Stream) -> Option<Movable> {
        let radius = PERSON_RADIUS_M as f32;
        let mut end = || {
            let x = stream.between(TRUNKS_X_M[0] + radius, TRUNKS_X_M[1] - radius);
            let y = stream.between(HALL.low.y + WALL_M as f32 + radius, HALL.high.y - WALL_M as f32 - radius);
            Vector3::new(f64::from(x), f64::from(y), PERSON_HEIGHT_M / 2.0)
        };
        let ends = [end(), end()];
        let (share, way) = (f64::from(stream.uniform()), if stream.uniform() < 0.5 { -1.0 } else { 1.0 });
        let line = ends[1] - ends[0];
        let length = line.norm();
        let free = |step: u32| {
            let place = ends[0] + line * (f64::from(step) * WALK_STEP_M / length).min(1.0);
            nearest_obstacle(solids, &place).is_none_or(|(_, distance)| distance >= PERSON_RADIUS_M)
        };
        if !(f64::from(WALK_M[0])..=f64::from(WALK_M[1])).contains(&length)
            || !(0..=(length / WALK_STEP_M).ceil() as u32).all(free)
        {
            return None;
        }
        let blank = Solid::block("person", Vector3::zeros(), Vector3::zeros());
        let shape = Shape::Cylinder { radius: PERSON_RADIUS_M, half_height: PERSON_HEIGHT_M / 2.0 };
        let solid = Solid { shape, pose: Pose::at(ends[0] + line * share), colour: PERSON_COLOUR, ..blank };
        let velocity = line * (way * f64::from(self.walking_speed) / length);
        Some(Movable { solid, drive: Drive::Walking(Walk { ends, velocity }) })
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
