//! Live video of a vehicle's camera: an RTSP server of one H.264 stream, as the network cameras of drones offer it.
//!
//! In the order of the data: `rtsp` parses requests and describes the stream, `rtp` cuts encoded pictures into packets,
//! and `server` holds the sockets and threads. Players on `FFmpeg` (ffplay, `OpenCV`) and `GStreamer` (`QGroundControl`) read
//! it over TCP and UDP.

mod rtp;
mod rtsp;
mod server;

use std::io;
use std::net::SocketAddr;

pub use server::RtspServer;

/// NAL unit type of a sequence parameter set (ITU-T H.264, table 7-1).
const SEQUENCE_PARAMETER_SET: u8 = 7;

/// Bytes of a sequence parameter set up to its level: header, profile, constraints, level (ITU-T H.264, 7.3.2.1.1).
const PROFILE_LEN: usize = 4;

/// What a video stream carries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VideoFormat {
    /// Width of a picture \[px\].
    pub columns: u16,
    /// Height of a picture \[px\].
    pub rows: u16,
    /// Pictures per second \[Hz\].
    pub rate_hz: u8,
    /// NAL unit of type 7, without its start code.
    pub sequence_parameter_set: Vec<u8>,
    /// NAL unit of type 8, without its start code.
    pub picture_parameter_set: Vec<u8>,
}

impl VideoFormat {
    /// Profile, constraints and level of the stream, if its sequence parameter set is one.
    fn profile_and_level(&self) -> Option<[u8; 3]> {
        let [header, profile_and_level @ ..] = *self.sequence_parameter_set.first_chunk::<PROFILE_LEN>()?;
        (rtp::nal_unit_type(header) == SEQUENCE_PARAMETER_SET).then_some(profile_and_level)
    }
}

/// Why there is no video stream.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// The address is taken, or is not of this machine.
    #[error("cannot listen at {address}: {reason}")]
    Listen {
        /// Wanted address.
        address: SocketAddr,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// The format does not say the profile of the stream.
    #[error(
        "expected a sequence parameter set (a NAL unit of type 7 without its start code), found {len} bytes that are none"
    )]
    ParameterSet {
        /// Length of what was found \[bytes\].
        len: usize,
    },
}

#[cfg(test)]
mod tests;
