//! A MAVLink 2 vehicle that flies exported policies in software in the loop.
//!
//! Read in the order of the data: datagrams come in through a [`link`], are cut into checked [`frame`]s and become
//! requests ([`message`]); the [`vehicle`] has its [`autopilot`] obey them. Every control period the autopilot moves
//! the [`goal`] and asks the policy for rotor targets, [`telemetry`] says what is due to be told, and the [`plant`]
//! steps: that is [`lockstep`]. Clients of a Crazyflie fly the same autopilot by [`crtp`].
//!
//! Only [`link`], [`crtp::link`] and [`lockstep`] know sockets and clocks; everything before them is free of both and of
//! allocation, so that a microcontroller can run it. Not there yet: parameters, missions, signing, global positions,
//! other transports than UDP.

pub mod autopilot;
pub mod crtp;
pub mod frame;
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
pub mod true_state;
pub mod vehicle;
