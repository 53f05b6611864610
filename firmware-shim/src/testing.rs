//! The bytes of a peer, and who it talks to.

pub(crate) use kestrel_onboard::testing::{
    blind_policy, dishonest_policy, hover_policy, hover_policy_every, pilot, sensing_policy,
};
use mavlink::dialects::common::{
    COMMAND_LONG_DATA, MavCmd, MavFrame, MavMessage, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use mavlink::{MavlinkVersion, Message, MessageData};

use crate::frame::{Encoder, Frames, Payload};
use crate::geodesy::Home;
use crate::message::sent::identity::PolicyIdentity;
use crate::personality::Personality;
use crate::vehicle::VehicleProfile;

/// The bytes in which a ground station (system 255, component 190) sends a message.
pub(crate) fn datagram<D: MessageData>(message: &D) -> Vec<u8> {
    Encoder::new(255, 190).encode(&Payload::of(message)).to_vec()
}

/// The bytes in which another system sends a message.
pub(crate) fn datagram_of<D: MessageData>(system: u8, message: &D) -> Vec<u8> {
    Encoder::new(system, 190).encode(&Payload::of(message)).to_vec()
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

/// `CONTROL_STATUS`, which the `mavlink` crate does not know, as it does not know the command (in a `COMMAND_LONG`) by which
/// the control is asked for.
pub(crate) const CONTROL_STATUS: u32 = 512;
const COMMAND_LONG: u32 = 76;

/// The message in the bytes of one frame.
pub(crate) fn message(bytes: &[u8]) -> MavMessage {
    let frame = Frames::new(bytes).next().unwrap().unwrap();
    MavMessage::parse(MavlinkVersion::V2, frame.message_id, frame.payload).unwrap()
}

/// The same of what a vehicle says; none if the crate does not know it.
pub(crate) fn told(bytes: &[u8]) -> Option<MavMessage> {
    let frame = Frames::new(bytes).next().unwrap().unwrap();
    (![CONTROL_STATUS, COMMAND_LONG].contains(&frame.message_id)).then(|| message(bytes))
}

/// Who a vehicle of tests is.
pub(crate) fn profile(system: u8) -> VehicleProfile {
    VehicleProfile {
        system,
        personality: Personality::Generic,
        origin: Home::default(),
        policy: PolicyIdentity::of("linear hover", b"a policy"),
    }
}

/// Times \[µs since 1970\] and frames of a flight log.
pub(crate) fn read_flight_log(mut bytes: &[u8]) -> Vec<(u64, Vec<u8>)> {
    let mut entries = Vec::new();
    while let Some((time_us, rest)) = bytes.split_first_chunk() {
        let frame = Frames::new(rest).next().unwrap().unwrap().bytes;
        entries.push((u64::from_be_bytes(*time_us), frame.to_vec()));
        bytes = &rest[frame.len()..];
    }
    entries
}
