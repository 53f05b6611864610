#![cfg_attr(not(any(feature = "std", test)), no_std)]
//! The part of Kestrel that flies on hosts and microcontrollers alike: no allocation, no operating system.
//!
//! Read in the order of the data: an [`airframe`] becomes a [`vehicle`], whose [`dynamics`] advance its state, in air
//! that may carry the [`downwash`] of others; an [`observation`] of the state goes through a policy, read from a
//! [`policy_file`] and computed as an [`mlp`] or in [`fixed`] point, behind an [`encoder`] if it is a vision policy, whose [`action`] becomes rotor targets again. The
//! [`pilot`] is all of that in one call. Beside them stand the reference system's physics, [`bullet`], and its
//! [`controller`]s, and an [`anchor`] that keeps what a policy knows while it learns something else.

pub mod action;
pub mod activation;
pub mod airframe;
pub mod anchor;
pub mod attitude;
pub mod bullet;
pub mod controller;
pub mod crc32;
pub mod downwash;
pub mod dynamics;
mod elementary;
pub mod encoder;
pub mod euler;
pub mod fixed;
pub mod mlp;
pub mod observation;
pub mod philox;
pub mod pilot;
pub mod policy_file;
pub mod processor_in_the_loop;
pub mod real;
mod vector;
pub mod vehicle;
