//! What stands in a world, as users write it.

mod furniture;
mod look;
mod mesh;
mod outline;
mod room;
mod solid;
mod superellipsoid;
#[cfg(test)]
mod tests;

pub use furniture::FurnitureConfig;
pub use look::LookConfig;
pub use mesh::MeshConfig;
pub use room::RoomConfig;
pub use solid::{ConeConfig, CylinderConfig, HullConfig, MovableConfig, RoleConfig, SolidConfig, TurnedBoxConfig};
pub use superellipsoid::SuperellipsoidConfig;

pub(crate) use solid::pillar;
