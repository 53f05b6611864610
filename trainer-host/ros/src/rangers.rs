//! What ideal rangers along a drone's axes measure: those of a Multi-ranger deck and a Z-ranger.

use std::sync::Arc;

use kestrel_core::attitude::Attitude;
use kestrel_sim::contact::{Arena, ContactReport};
use kestrel_sim::nalgebra::Vector3;
use kestrel_sim::scenario::Scenario;

/// They see so far \[m\].
pub const LIMIT_M: f64 = 4.0;

/// Their names and directions, in the drone's axes: x forward, y left, z up.
pub const RANGERS: [(&str, [f64; 3]); 6] = [
    ("front", [1.0, 0.0, 0.0]),
    ("back", [-1.0, 0.0, 0.0]),
    ("left", [0.0, 1.0, 0.0]),
    ("right", [0.0, -1.0, 0.0]),
    ("up", [0.0, 0.0, 1.0]),
    ("down", [0.0, 0.0, -1.0]),
];

/// The rangers of a drone in the world of a task; they see what never moves.
pub struct Rangers {
    arena: Arc<Arena>,
}

impl Rangers {
    /// In the world of a task.
    pub fn new(scenario: &Scenario) -> Self {
        Self { arena: Arena::shared(&scenario.aviary.world, &scenario.airframe, ContactReport::Touch, None) }
    }

    /// Distances \[m\] in the order of [`RANGERS`], of a drone at `position` \[m, world\]; none where nothing is near.
    pub fn measure(&self, position: Vector3<f64>, world_from_body: &Attitude<f64>) -> [Option<f64>; 6] {
        RANGERS
            .map(|(_, direction)| self.arena.raycast(position, world_from_body.rotate(direction.into()), LIMIT_M))
    }
}
