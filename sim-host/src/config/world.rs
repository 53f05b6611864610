//! What stands in a world, as users write it.

mod furniture;
mod gate;
mod mesh;
mod outline;
mod room;
mod shape;
mod solid;
mod superellipsoid;
mod surface;
#[cfg(test)]
mod tests;
mod visual;

pub use furniture::FurnitureConfig;
pub use gate::GateConfig;
pub use mesh::MeshConfig;
pub use room::RoomConfig;
pub use shape::{ConeConfig, CylinderConfig, HullConfig, TurnedBoxConfig};
pub use solid::{MovableConfig, SolidConfig};
pub use superellipsoid::SuperellipsoidConfig;
pub use visual::VisualConfig;

pub(crate) use furniture::{Placement, SCALES};
pub(crate) use shape::turned;
pub(crate) use solid::{pillar, pillar_around};
