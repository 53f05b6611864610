//! Policies for tests that need no training, and the bytes of a peer.

use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::PolicyFile;
use mavlink::dialects::common::{
    COMMAND_LONG_DATA, MavCmd, MavFrame, MavMessage, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use mavlink::{MavlinkVersion, Message, MessageData};

use crate::frame::{Encoder, Frames, Payload};

/// A policy file that hovers.
pub(crate) fn hover_policy() -> Vec<u8> {
    vec![1]
}

/// A policy file whose golden outputs are not what its network computes.
pub(crate) fn dishonest_policy() -> Vec<u8> {
    vec![2]
}

/// A pilot that lives as long as the test run.
pub(crate) fn pilot(policy: Vec<u8>) -> Pilot<'static> {
    Pilot::new(PolicyFile::parse(policy.leak()).unwrap())
}

/// The bytes in which a ground station (system 255, component 190) sends a message.
pub(crate) fn datagram<D: MessageData>(message: &D) -> Vec<u8> {
    Encoder::new(255, 190).encode(&Payload::of(message)).to_vec()
}

/// A command to system 1.
pub(crate) fn command_long(command: MavCmd, parameters: [f32; 7]) -> COMMAND_LONG_DATA {
    let [param1, param2, param3, param4, param5, param6, param7] = parameters;
    COMMAND_LONG_DATA {
        param1,
        param2,
        param3,
        param4,
        param5,
        param6,
        param7,
        command,
        target_system: 1,
        target_component: 1,
        confirmation: 0,
    }
}

/// A set-point \[m, NED\] for system 1.
pub(crate) fn set_point([x, y, z]: [f32; 3]) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
    SET_POSITION_TARGET_LOCAL_NED_DATA {
        x,
        y,
        z,
        type_mask: PositionTargetTypemask::from_bits_truncate(0b1101_1111_1000),
        target_system: 1,
        target_component: 1,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
        ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
    }
}

/// The message in the bytes of one frame.
pub(crate) fn message(bytes: &[u8]) -> MavMessage {
    let frame = Frames::new(bytes).next().unwrap().unwrap();
    MavMessage::parse(MavlinkVersion::V2, frame.message_id, frame.payload).unwrap()
}
