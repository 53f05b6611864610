//! What a vehicle carries on board, on a microcontroller as in software in the loop: the autopilot, and the MAVLink that commands it.
//!
//! No allocation, no clock, no socket, and no panic that can be reached. Read in the order of the data: bytes from a peer are
//! cut into checked [`frame`]s, whose checksums need the seeds of the [`dialect`]; a [`signature`] says who sent them, the
//! [`endpoint`] who is heard, and a [`request`] what is asked for, which is an [`order`] to the [`autopilot`] and gets an
//! [`acknowledgement`]. It obeys, watches for what can go wrong ([`failsafe`], [`fence`], [`battery`]), moves the [`goal`] and
//! has the policy of a [`policy_backend`] or the cascade of controllers ([`steering`]) fly there ([`controller`]). All of that together
//! is a [`flight_controller`]. The [`plant`] is a simulation to fly in where there is no drone.

#![cfg_attr(not(any(test, feature = "testing")), no_std)]

pub mod acknowledgement;
pub mod autopilot;
pub mod axes;
pub mod battery;
pub mod checksum;
pub mod controller;
pub mod dialect;
pub mod endpoint;
pub mod excerpt;
pub mod failsafe;
pub mod fence;
pub mod flight_controller;
pub mod flight_mode;
pub mod frame;
pub mod geodesy;
pub mod goal;
pub mod order;
pub mod plant;
pub mod policy_backend;
pub mod request;
pub mod settings;
pub mod sha256;
pub mod signature;
pub mod signature_guard;
pub mod steering;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
