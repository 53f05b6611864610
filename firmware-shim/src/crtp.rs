//! CRTP over UDP: the protocol of a Crazyflie, so that `cflib`, `cfclient` and what is built on them can fly the
//! vehicle. One [`packet`] a datagram.
//!
//! ```text
//! link ──packets──► server ─┬─► platform     handshake, versions, echo, no memories
//!  ▲                        ├─► parameter    table and values
//!  │                        ├─► logging      table (variable), blocks that are sent again and again
//!  └──answers, log blocks───┤
//!                           ├─► set_point ─┬─► commander ──velocities of the goal──► autopilot
//!                           ├─► maneuver ──┘   (plan)
//!                           └─► supervisor   arming, emergency stop, what can fly
//! ```
//!
//! Only [`link`] knows sockets and the wall clock. The protocol is that of Bitcraze's firmware in its version 12; the
//! names, types and units of parameters and log variables are the firmware's, too.
//!
//! What is different from a Crazyflie: a policy chooses attitude and heading itself, so that set-points of attitudes
//! are refused, and yaw is counted but not flown: paths are those of a drone that turns as it is told, while the hull
//! looks where the policy lets it; velocities end at [`crate::autopilot::SPEED_LIMIT`]; a drone whose set-points stop
//! coming lands instead of falling. Not there: memories (trajectories, Lighthouse geometry), spirals, persistent
//! parameters, app channels, radio.

pub mod access;
pub mod commander;
pub mod contents;
pub mod link;
pub mod logging;
pub mod maneuver;
pub mod number;
pub mod packet;
pub mod parameter;
pub mod plan;
pub mod platform;
pub mod server;
pub mod set_point;
pub mod status;
pub mod supervisor;
pub mod variable;
