//! Kestrel's simulator: many drones in their aviaries, stepped together, the same bits every time.
//!
//! Read in the order of the data: a [`config`] file becomes a [`scenario`], which says what is simulated, and a
//! [`seed`] what is random; a [`simulation`] steps its environments and reports each [`outcome`]. A [`flight`] is one
//! drone for software in the loop.

mod agent;
mod block;
pub mod camera;
pub mod config;
pub mod contact;
pub mod flight;
pub mod outcome;
pub mod outline;
mod reset;
mod reward;
pub mod scenario;
pub use kestrel_core::seed;
pub mod sensor;
pub mod simulation;
pub mod swarm;
mod termination;
#[cfg(test)]
mod testing;
pub mod world;

pub use agent::PRIVILEGED_LEN;
