#![no_std]
//! Kestrel's core.

pub mod airframe;
pub mod attitude;
pub mod dynamics;
pub mod lanes;
pub mod real;
pub mod vehicle;
