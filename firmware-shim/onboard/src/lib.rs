//! What a vehicle carries on board of the MAVLink protocol, on a microcontroller as in software in the loop.
//!
//! No allocation, no clock, no socket. Bytes from a peer are cut into checked [`frame`]s, whose checksums need the seeds of
//! the [`dialect`]; a [`signature`] says who sent them. What a message means is not known here.

#![no_std]

#[cfg(test)]
extern crate std;

pub mod checksum;
pub mod dialect;
pub mod frame;
pub mod sha256;
pub mod signature;
