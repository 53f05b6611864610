#![cfg_attr(not(any(feature = "std", test)), no_std)]
//! The part of Kestrel that flies on hosts and microcontrollers alike: no allocation, no operating system.
//!
//! Read in the order of the data: an [`airframe`] becomes a [`vehicle`], whose [`dynamics`] advance its state, in air
//! that may carry the [`downwash`] of others; an [`observation`] of the state goes through a policy, read from a
//! [`policy_file`] and computed as an [`mlp`] or in [`fixed`] point, whose [`action`] becomes rotor targets again. The
//! [`pilot`] is all of that in one call; where the drone is no longer the one that it was, an [`effectiveness`] of the
//! rotors that is learned in flight makes up for it. An [`instrument`] is what simulated sensors make of the truth,
//! a [`scan`] what beams see of a map, a [`planner`] finds a way among what they have met.
//!
//! ```
//! use kestrel_core::airframe::CF2X;
//! use kestrel_core::attitude::Attitude;
//! use kestrel_core::dynamics::Integrator;
//! use kestrel_core::nalgebra::Vector3;
//! use kestrel_core::pilot::Pilot;
//! use kestrel_core::policy_file::{Aligned, PolicyError, PolicyFile};
//! use kestrel_core::vehicle::{Air, State, Vehicle};
//!
//! # fn main() -> Result<(), PolicyError> {
//! let policy = Aligned(*include_bytes!("../../assets/pilots/hover.kestrel"));
//! let mut pilot = Pilot::new(PolicyFile::parse(&policy.0)?);
//! pilot.self_test()?;
//! let (crazyflie, goal) = (Vehicle::<f32>::new(&CF2X), Vector3::new(0.0, 0.0, 1.0));
//! let mut drone = State {
//!     position: Vector3::new(0.3, -0.2, 0.8),
//!     world_from_body: Attitude::level(),
//!     velocity: Vector3::zeros(),
//!     body_rates: Vector3::zeros(),
//!     rotor_speeds: [CF2X.hover_rotor_speed() as f32; 4],
//! };
//! let secs = pilot.policy().metadata().control_period_secs;
//! for _ in 0..(5.0 / secs) as usize {
//!     let rotor_targets = pilot.tick(&drone, &goal);
//!     drone = Integrator::SemiImplicitEuler.advance(&crazyflie, &drone, &rotor_targets, &Air::still(), secs);
//! }
//! assert!((drone.position - goal).norm() < 0.1);
//! # Ok(())
//! # }
//! ```
//!
//! | feature | holds |
//! |---|---|
//! | (none) | all of the above: the quadrotor's physics, neural-network inference in fixed point, the pilot |
//! | `float` | the same in float; on unless default features are switched off |
//! | `encoder` | vision policies: the CNN encoder in front of the network, and of a memory (`encoder`); includes `recurrent` |
//! | `learning` | continual learning on board: the regulariser (`anchor`), an output layer that learns |
//! | `px4` | what flies in PX4's neural control: rectifiers, the observation `px4_neural`, the actions `rotor_thrusts` |
//! | `recurrent` | policies with a memory: a gated recurrent unit in front of the network (`gru`) |
//! | `reference` | what only compares with gym-pybullet-drones: its physics, controllers, actions and observations |
//! | `std` | square roots of the standard library, which vectorise; the bits are the same |
//! | `smlad`, `assembly` | 16-bit products by ARM's DSP extension, and the loop around them in assembly |

pub use nalgebra;

pub mod action;
pub mod activation;
pub mod airframe;
#[cfg(feature = "learning")]
pub mod anchor;
mod arithmetic;
pub mod attitude;
pub mod crazyflie;
pub mod crc32;
pub mod downwash;
pub mod dynamics;
pub mod effectiveness;
mod elementary;
#[cfg(feature = "encoder")]
pub mod encoder;
pub mod fixed;
#[cfg(feature = "recurrent")]
pub mod gru;
pub mod instrument;
mod limits;
pub mod mlp;
pub mod observation;
pub mod outcome;
mod persistence;
pub mod philox;
pub mod pilot;
pub mod planner;
mod policy_error;
pub mod policy_file;
pub mod processor_in_the_loop;
pub mod rate_loop;
pub mod real;
#[cfg(feature = "reference")]
pub mod reference;
pub mod scan;
pub mod seed;
pub mod setpoint;
pub mod vehicle;
#[cfg(not(feature = "px4"))]
mod without_px4;
#[cfg(not(feature = "reference"))]
mod without_reference;
