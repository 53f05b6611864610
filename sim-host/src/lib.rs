//! Kestrel's simulator: many quadrotors in their aviaries, stepped together, bit-exact for any number of threads.
//!
//! Read in the order of the data: a [`config`] file becomes a [`scenario`], which says what is simulated, and a
//! [`seed`] what is random (domain randomisation included); a [`simulation`] steps its environments and reports each
//! [`outcome`]. A [`flight`] is one drone for software in the loop, and a [`gradient`] differentiates a step.
//!
//! ```
//! use kestrel_sim::kestrel_core::airframe::CF2X;
//! use kestrel_sim::kestrel_core::dynamics::Integrator;
//! use kestrel_sim::scenario::{Physics, Scenario};
//! use kestrel_sim::seed::Seed;
//! use kestrel_sim::simulation::Simulation;
//!
//! // Sixty-four Crazyflies that shall hover a metre above the floor, at 100 Hz.
//! let scenario = Scenario::hover(&CF2X, Physics::clean(Integrator::SemiImplicitEuler, 2, 100.0));
//! let mut simulation: Simulation = Simulation::new(&scenario, Seed(7), 0, 64);
//! let actions = vec![0.0; scenario.action.len() * simulation.rows()];
//! for _ in 0..100 {
//!     simulation.step(&actions);
//! }
//! assert_eq!(simulation.observations().len(), 64 * simulation.observation_len());
//! // With all rotors at hover speed and nothing in the way, each is still where it began.
//! let distance = (simulation.state(0).position - simulation.goal(0)).norm();
//! assert!(distance < 0.6, "{distance} m");
//! ```

mod agent;
pub mod airframe_family;
mod block;
pub mod camera;
pub mod config;
pub mod contact;
pub mod course;
mod episode_end;
pub mod estimate;
pub mod flight;
pub mod gradient;
pub mod latency;
pub mod outcome;
pub mod outline;
pub mod physics;
mod rate_loop;
mod reset;
pub mod reward;
pub mod rooms;
pub mod scenario;
pub use kestrel_core::seed;
pub mod sensor;
mod simd;
pub mod simulation;
mod stage;
pub mod swarm;
mod term;
pub mod termination;
#[cfg(test)]
mod testing;
pub mod trajectory;
pub mod world;

pub use agent::PRIVILEGED_LEN;
pub use {kestrel_core, nalgebra};
