//! The meaning of messages that are sent, in MAVLink's axes; what peers ask for is read by [`crate::request`].

pub mod sent;

pub use kestrel_onboard::axes::{
    enu_from_flu, enu_from_ned, flu_from_frd, frd_from_flu, ned_from_enu, ned_from_frd, ned_roll_pitch_yaw,
};
