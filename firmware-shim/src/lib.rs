//! A MAVLink 2 vehicle that flies exported policies in software in the loop.
//!
//! Read in the order of the data: datagrams come in through a [`link`], are cut into checked [`frame`]s ([`kestrel_onboard`]) and become
//! requests ([`message`]); the [`vehicle`] has its [`autopilot`] obey them. Every control period the autopilot moves
//! the [`goal`] and asks the policy for rotor targets, [`telemetry`] says what is due to be told, and the [`plant`]
//! steps: that is [`lockstep`].
//!
//! A [`bridge`] lends the plant to another autopilot (PX4, ArduPilot, Betaflight), or the vehicle to another simulator.
//!
//! Only [`link`], [`lockstep`] and the bridge's servers and clients know sockets and clocks; everything before them is free of both and of
//! allocation, so that a microcontroller can run it. Not there yet: parameters, missions, global positions, other
//! transports than UDP.

pub mod autopilot;
pub mod bridge;
pub mod goal;
pub mod link;
pub mod lockstep;
pub mod message;
pub mod plant;
pub mod policy_bytes;
pub mod processor;
pub mod session;
pub mod telemetry;
#[cfg(test)]
mod testing;
pub mod vehicle;

pub use kestrel_onboard::frame;
