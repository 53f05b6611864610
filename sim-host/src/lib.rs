//! Kestrel's simulator: many drones in their aviaries, stepped together, the same bits every time.
//!
//! Read in the order of the data: a [`scenario`] is what the configuration becomes; a [`seed`] decides what is
//! random.

pub mod config;
pub mod scenario;
pub mod seed;
