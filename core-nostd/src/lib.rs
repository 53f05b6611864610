#![cfg_attr(not(any(feature = "std", test)), no_std)]
//! The part of Kestrel that flies on hosts and microcontrollers alike: no allocation, no operating system.
//!
//! Read in the order of the data: an [`airframe`] becomes a [`vehicle`], whose [`dynamics`] advance its state, in air
//! that may carry the [`downwash`] of others; an [`observation`] of the state goes through a policy, read from a
//! [`policy_file`] and computed as an [`mlp`] or in [`fixed`] point, whose [`action`] becomes rotor targets again. The
//! [`pilot`] is all of that in one call. An [`instrument`] is what simulated sensors make of the truth.
//!
//! | feature | holds |
//! |---|---|
//! | (none) | all of the above: the quadrotor's physics, neural-network inference in float and fixed point, the pilot |
//! | `encoder` | vision policies: the CNN encoder in front of the network (`encoder`) |
//! | `learning` | continual learning on board: the regulariser (`anchor`), an output layer that learns |
//! | `reference` | what only compares with gym-pybullet-drones: its physics, controllers, actions and observations |
//! | `std` | square roots of the standard library, which vectorise; the bits are the same |
//! | `smlad`, `assembly` | 16-bit products by ARM's DSP extension, and the loop around them in assembly |

pub mod action;
pub mod activation;
pub mod airframe;
#[cfg(feature = "learning")]
pub mod anchor;
pub mod attitude;
pub mod crc32;
pub mod downwash;
pub mod dynamics;
mod elementary;
#[cfg(feature = "encoder")]
pub mod encoder;
pub mod fixed;
pub mod instrument;
mod limits;
pub mod mlp;
pub mod observation;
pub mod outcome;
pub mod philox;
pub mod pilot;
mod policy_error;
pub mod policy_file;
pub mod processor_in_the_loop;
pub mod real;
#[cfg(feature = "reference")]
pub mod reference;
pub mod seed;
mod setpoint;
pub mod vehicle;
#[cfg(not(feature = "reference"))]
mod without_reference;
