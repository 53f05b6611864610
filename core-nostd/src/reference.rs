//! What only compares with the reference system, gym-pybullet-drones: its physics on Bullet, its controllers, its
//! action spaces and its observations.
//!
//! A firmware that flies a policy of ours needs none of it: the feature `reference` is off by default. Without it the
//! core refuses policies with a reference action space or observation layout
//! ([`PolicyError::MissingFeature`](crate::policy_file::PolicyError::MissingFeature)).

pub mod action;
pub mod bullet;
pub mod controller;
pub mod euler;
mod kinematic_layout;
mod paper_layout;
mod vector;

pub use kinematic_layout::KinematicLayout;
pub use paper_layout::{REFERENCE_LEN, ReferenceLayout};
