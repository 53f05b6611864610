//! What the vehicle tells about plans. Written by hand where a message has an extension: the `mavlink` crate would
//! leave the plan out.

use mavlink::MessageData;
use mavlink::dialects::common::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_CURRENT_DATA, MISSION_ITEM_INT_DATA, MISSION_ITEM_REACHED_DATA,
    MISSION_REQUEST_INT_DATA, MavMissionResult,
};

use super::MissionItem;
use super::runner::{MissionPhase, MissionRunner};
use crate::frame::Payload;

/// `MISSION_CURRENT` that counts no items: there is no mission.
const NO_MISSION: u16 = u16::MAX;

/// `MISSION_REQUEST_INT`: asks a peer for an item of a plan.
pub fn request(plan: u8, sequence: u16, [system, component]: [u8; 2]) -> Payload {
    let [low, high] = sequence.to_le_bytes();
    payload::<MISSION_REQUEST_INT_DATA>(&[low, high, system, component, plan])
}

/// `MISSION_COUNT`: how many items a plan has, and its identifier.
pub fn count(plan: u8, count: u16, identifier: u32, [system, component]: [u8; 2]) -> Payload {
    let [low, high] = count.to_le_bytes();
    let [a, b, c, d] = identifier.to_le_bytes();
    payload::<MISSION_COUNT_DATA>(&[low, high, system, component, plan, a, b, c, d])
}

/// `MISSION_ITEM_INT`: an item of a plan. Which one is flown is told by [`current`] only.
pub fn item(plan: u8, sequence: u16, item: &MissionItem, [system, component]: [u8; 2]) -> Payload {
    let mut fields = item.fields();
    fields[28..30].copy_from_slice(&sequence.to_le_bytes());
    fields[32..34].copy_from_slice(&[system, component]);
    fields[37] = plan;
    payload::<MISSION_ITEM_INT_DATA>(&fields)
}

/// `MISSION_ACK`: how a request ended, and the identifier of the plan that it left.
pub fn acknowledge(plan: u8, result: MavMissionResult, identifier: u32, [system, component]: [u8; 2]) -> Payload {
    let [a, b, c, d] = identifier.to_le_bytes();
    payload::<MISSION_ACK_DATA>(&[system, component, result as u8, plan, a, b, c, d])
}

/// `MISSION_CURRENT`: which of so many items is next, how far the mission is, and the identifiers of the plans. To be
/// streamed at 1 Hz.
pub fn current(items: usize, identifiers: [u32; 3], runner: &MissionRunner) -> Payload {
    let items = items as u16;
    let total = if items == 0 { NO_MISSION } else { items };
    // MISSION_STATE
    let state = match runner.phase() {
        _ if items == 0 => 1,
        MissionPhase::NotStarted => 2,
        MissionPhase::Active => 3,
        MissionPhase::Paused => 4,
        MissionPhase::Complete => 5,
    };
    // Mission mode: 1 in it, 2 suspended.
    let mode = if runner.phase() == MissionPhase::Active { 1 } else { 2 };
    let mut fields = [0; 18];
    fields[..2].copy_from_slice(&runner.current().to_le_bytes());
    fields[2..4].copy_from_slice(&total.to_le_bytes());
    (fields[4], fields[5]) = (state, mode);
    fields[6..].copy_from_slice(identifiers.map(u32::to_le_bytes).as_flattened());
    payload::<MISSION_CURRENT_DATA>(&fields)
}

/// `MISSION_ITEM_REACHED`.
pub fn reached(sequence: u16) -> Payload {
    Payload::of(&MISSION_ITEM_REACHED_DATA { seq: sequence })
}

fn payload<D: MessageData>(fields: &[u8]) -> Payload {
    Payload::new(D::ID, D::EXTRA_CRC, fields)
}

#[cfg(test)]
#[expect(deprecated, reason = "clients still send what newer messages and frames replace")]
mod tests {
    use mavlink::dialects::common::{MavCmd, MavFrame, MavMessage};

    use super::*;
    use crate::frame::{Encoder, Frames};
    use crate::testing::message;

    const PEER: [u8; 2] = [255, 190];

    fn read(payload: &Payload) -> MavMessage {
        message(&Encoder::new(1, 1).encode(payload))
    }

    /// The fields with extensions, which the mavlink crate does not read.
    fn fields<const LEN: usize>(payload: &Payload) -> [u8; LEN] {
        let bytes = Encoder::new(1, 1).encode(payload);
        Frames::new(&bytes).next().unwrap().unwrap().fields()
    }

    #[test]
    fn messages_are_read_by_the_mavlink_crate() {
        let [target_system, target_component] = PEER;
        let expected = MISSION_REQUEST_INT_DATA { seq: 300, target_system, target_component };
        assert_eq!(read(&request(1, 300, PEER)), MavMessage::MISSION_REQUEST_INT(expected));
        let expected = MISSION_COUNT_DATA { count: 300, target_system, target_component };
        assert_eq!(read(&count(1, 300, 7, PEER)), MavMessage::MISSION_COUNT(expected));
        let mavtype = MavMissionResult::MAV_MISSION_NO_SPACE;
        let expected = MISSION_ACK_DATA { target_system, target_component, mavtype };
        assert_eq!(read(&acknowledge(1, mavtype, 7, PEER)), MavMessage::MISSION_ACK(expected));
        assert_eq!(read(&reached(300)), MavMessage::MISSION_ITEM_REACHED(MISSION_ITEM_REACHED_DATA { seq: 300 }));
    }

    #[test]
    fn an_item_is_read_by_the_mavlink_crate() {
        let sent = MissionItem {
            frame: 6,
            command: 16,
            autocontinue: 1,
            parameters: [1.0, 2.0, 3.0, 4.0],
            place: [5, -6],
            height: 7.0,
        };
        let expected = MISSION_ITEM_INT_DATA {
            param1: 1.0,
            param2: 2.0,
            param3: 3.0,
            param4: 4.0,
            x: 5,
            y: -6,
            z: 7.0,
            seq: 300,
            command: MavCmd::MAV_CMD_NAV_WAYPOINT,
            target_system: 255,
            target_component: 190,
            frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
            current: 0,
            autocontinue: 1,
        };
        assert_eq!(read(&item(2, 300, &sent, PEER)), MavMessage::MISSION_ITEM_INT(expected));
        assert_eq!(fields::<38>(&item(2, 300, &sent, PEER))[37], 2, "the plan");
    }

    #[test]
    fn extensions_name_the_plan_and_its_identifier() {
        assert_eq!(fields(&request(1, 3, PEER)), [3, 0, 255, 190, 1]);
        assert_eq!(fields(&count(2, 3, 0x0403_0201, PEER)), [3, 0, 255, 190, 2, 1, 2, 3, 4]);
        let acknowledged = acknowledge(1, MavMissionResult::MAV_MISSION_DENIED, 0x0403_0201, PEER);
        assert_eq!(fields(&acknowledged), [255, 190, 14, 1, 1, 2, 3, 4]);
    }

    #[test]
    fn frames_are_those_of_pymavlink() {
        let hex = |payload: &Payload| {
            let bytes = Encoder::new(1, 1).encode(payload);
            let digits = bytes.iter().flat_map(|byte| [byte >> 4, byte & 15]);
            digits.filter_map(|digit| char::from_digit(digit.into(), 16)).collect::<String>()
        };
        // Of pymavlink 2.4.50, dialect common: mission_request_int, mission_item_int.
        assert_eq!(hex(&request(1, 3, PEER)), "fd0500000001013300000300ffbe01fbce");
        let sent = MissionItem {
            frame: 6,
            command: 16,
            autocontinue: 1,
            parameters: [1.0, 2.0, 3.0, 4.0],
            place: [5, -6],
            height: 7.0,
        };
        let expected = "fd2600000001014900000000803f000000400000404000008040\
                        05000000faffffff0000e0402c011000ffbe06000102c5f0";
        assert_eq!(hex(&item(2, 300, &sent, PEER)), expected);
    }

    #[test]
    fn without_a_mission_the_current_item_says_so() {
        let current = current(0, [0; 3], &MissionRunner::default());
        assert_eq!(read(&current), MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA { seq: 0 }));
        let mut expected = [0; 18];
        expected[2..6].copy_from_slice(&[0xff, 0xff, 1, 2]);
        assert_eq!(fields(&current), expected);
    }
}
