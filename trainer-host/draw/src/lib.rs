//! Pictures: the [`curve`] of a training, [`plan`]s of aviaries, flights as an [`animation`] or a [`film`], and the
//! [`viewer`]. Nothing here knows how a flight came about.

pub mod animation;
pub mod curve;
pub mod drawing;
pub mod film;
pub mod picture;
pub mod plan;
#[cfg(test)]
pub(crate) mod testing;
pub mod viewer;
