//! Pictures: [`chart`]s, such as the [`curve`] of a training and the [`horizon`] of predictions, [`plan`]s of aviaries,
//! [`recorded_flight`]s as [`video`]s, and the [`viewer`]; a world as it is flown, [`live`]. Nothing here knows how a flight came about.

pub mod chart;
pub mod curve;
pub mod drawing;
mod font;
pub mod horizon;
pub mod live;
pub mod picture;
pub mod plan;
pub mod recorded_flight;
#[cfg(test)]
pub(crate) mod testing;
pub mod video;
pub mod viewer;
