//! A MAVLink 2 vehicle that flies exported policies in software in the loop.
//!
//! Read in the order of the data: datagrams come in through a [`link`], are cut into checked [`frame`]s and become requests
//! ([`request`]); the [`vehicle`] has its [`autopilot`] execute them. Every control period the autopilot moves the [`goal`] and
//! asks the policy for rotor targets, [`telemetry`] schedules which [`message`]s are published, and the [`plant`] steps:
//! that is [`lockstep`], for one vehicle or several. A [`flight_log`] holds every frame. What a microcontroller carries, too,
//! comes from [`kestrel_onboard`].
//! Clients of a Crazyflie fly the same autopilot by [`crtp`]; tests of flights do by a [`ground_station`] in the same process.
//!
//! A simulator [`bridge`] has another autopilot (PX4, ArduPilot, Betaflight) fly the plant, or another simulator fly the
//! vehicle.
//!
//! Only [`link`], [`crtp::link`], [`video`], [`ai_deck`], [`flight_log`], [`true_state`], [`lockstep`] and the bridge's servers
//! and clients know sockets, files and clocks; everything else is free of all three. Frames are not forwarded from one link to
//! another.

pub mod ai_deck;
pub mod bridge;
pub mod crtp;
pub mod files;
pub mod flight_log;
pub mod ground_station;
pub mod link;
pub mod lockstep;
pub mod message;
pub mod mission;
pub mod parameter;
pub mod persistent_store;
pub mod personality;
pub mod policy_bytes;
pub mod session;
pub mod signing;
pub mod telemetry;
#[cfg(test)]
mod testing;
pub mod true_state;
pub mod vehicle;
pub mod video;

pub use kestrel_onboard::{
    autopilot, battery, controller, endpoint, failsafe, flight_mode, frame, geodesy, goal, plant, policy_backend,
    request, settings, steering,
};
