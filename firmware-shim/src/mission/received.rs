//! What peers ask about plans, read field by field: the `mavlink` crate's enums reject a command or a plan that they
//! do not know, which must be answered "unsupported".

use kestrel_onboard::fields::{f32_at, i32_at, u16_at};

use super::{ITEM_LEN, MissionItem, OPEN};
use crate::frame::Frame;
use crate::request::Address;

/// `MAV_FRAME_LOCAL_NED` and its relatives, whose coordinates are metres.
const LOCAL_FRAMES: [u8; 8] = [1, 4, 7, 8, 9, 12, 20, 21];

/// `MAV_FRAME_MISSION`: coordinates are parameters of the command.
const MISSION_FRAME: u8 = 2;

/// A request of the mission protocol; plans are numbers yet (`MAV_MISSION_TYPE`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MissionRequest {
    /// `MISSION_COUNT`: an upload begins.
    Count {
        /// Which plan.
        plan: u8,
        /// Its items.
        count: u16,
    },
    /// `MISSION_ITEM_INT` or `MISSION_ITEM`: the next item of an upload.
    Item {
        /// Which plan.
        plan: u8,
        /// Place in it.
        sequence: u16,
        /// What it is.
        item: MissionItem,
    },
    /// `MISSION_ACK`: the peer ends a transfer.
    Acknowledge {
        /// Which plan.
        plan: u8,
        /// `MAV_MISSION_RESULT`.
        result: u8,
    },
    /// `MISSION_REQUEST_LIST`: a download begins.
    List {
        /// Which plan.
        plan: u8,
    },
    /// `MISSION_REQUEST_INT` or `MISSION_REQUEST`: one item of a download.
    Fetch {
        /// Which plan.
        plan: u8,
        /// Place in it.
        sequence: u16,
    },
    /// `MISSION_CLEAR_ALL`.
    Clear {
        /// Which plan, 255 for all.
        plan: u8,
    },
    /// `MISSION_SET_CURRENT`.
    SetCurrent {
        /// Place in the mission.
        sequence: u16,
    },
    /// `MISSION_REQUEST_PARTIAL_LIST` or `MISSION_WRITE_PARTIAL_LIST`, which few vehicles know.
    Partial {
        /// Which plan.
        plan: u8,
    },
}

impl MissionRequest {
    /// Whether it begins to change a plan, or which item of it is flown.
    pub const fn changes_plans(&self) -> bool {
        match self {
            Self::Count { .. } | Self::Clear { .. } | Self::SetCurrent { .. } => true,
            Self::Item { .. }
            | Self::Acknowledge { .. }
            | Self::List { .. }
            | Self::Fetch { .. }
            | Self::Partial { .. } => false,
        }
    }

    /// The number of the plan; none if its sender waits for no acknowledgement.
    pub const fn plan(&self) -> Option<u8> {
        match self {
            Self::Count { plan, .. }
            | Self::Item { plan, .. }
            | Self::List { plan }
            | Self::Fetch { plan, .. }
            | Self::Clear { plan }
            | Self::Partial { plan } => Some(*plan),
            Self::Acknowledge { .. } | Self::SetCurrent { .. } => None,
        }
    }
}

/// The request in a frame and its addressee; none if the message is none of this protocol.
pub fn request(frame: &Frame) -> Option<(Address, MissionRequest)> {
    match frame.message_id {
        37 | 38 => Some(partial(&frame.fields())),
        39 => Some(item(&frame.fields(), Coordinates::Floats)),
        73 => Some(item(&frame.fields(), Coordinates::Integers)),
        40 | 51 => Some(sequenced(&frame.fields(), |plan, sequence| MissionRequest::Fetch { plan, sequence })),
        41 => Some(sequenced(&frame.fields(), |_, sequence| MissionRequest::SetCurrent { sequence })),
        43 => Some(planned(&frame.fields(), |plan| MissionRequest::List { plan })),
        44 => Some(sequenced(&frame.fields(), |plan, count| MissionRequest::Count { plan, count })),
        45 => Some(planned(&frame.fields(), |plan| MissionRequest::Clear { plan })),
        47 => Some(acknowledge(&frame.fields())),
        _ => None,
    }
}

fn planned(fields: &[u8; 3], request: fn(u8) -> MissionRequest) -> (Address, MissionRequest) {
    (Address { system: fields[0], component: fields[1] }, request(fields[2]))
}

fn sequenced(fields: &[u8; 5], request: fn(u8, u16) -> MissionRequest) -> (Address, MissionRequest) {
    (Address { system: fields[2], component: fields[3] }, request(fields[4], u16_at(fields, 0)))
}

fn partial(fields: &[u8; 7]) -> (Address, MissionRequest) {
    (Address { system: fields[4], component: fields[5] }, MissionRequest::Partial { plan: fields[6] })
}

fn acknowledge(fields: &[u8; 4]) -> (Address, MissionRequest) {
    let request = MissionRequest::Acknowledge { plan: fields[3], result: fields[2] };
    (Address { system: fields[0], component: fields[1] }, request)
}

/// How the two messages of an item write its place.
#[derive(Clone, Copy)]
enum Coordinates {
    /// In degrees, metres or as parameters.
    Floats,
    /// As [`MissionItem::place`].
    Integers,
}

fn item(fields: &[u8; ITEM_LEN], coordinates: Coordinates) -> (Address, MissionRequest) {
    let frame = fields[34];
    let place = [16, 20].map(|at| match coordinates {
        Coordinates::Floats => integer(f32_at(fields, at), frame),
        Coordinates::Integers => i32_at(fields, at),
    });
    let item = MissionItem {
        frame,
        command: u16_at(fields, 30),
        autocontinue: fields[36],
        parameters: core::array::from_fn(|i| f32_at(fields, 4 * i)),
        place,
        height: f32_at(fields, 24),
    };
    let request = MissionRequest::Item { plan: fields[37], sequence: u16_at(fields, 28), item };
    (Address { system: fields[32], component: fields[33] }, request)
}

/// A coordinate of `MISSION_ITEM` as that of `MISSION_ITEM_INT`. What does not fit becomes the smallest integer, which
/// is no place in any frame.
fn integer(coordinate: f32, frame: u8) -> i32 {
    if coordinate.is_nan() {
        return OPEN;
    }
    let steps = match frame {
        MISSION_FRAME => 1.0,
        _ if LOCAL_FRAMES.contains(&frame) => 1e4,
        _ => 1e7,
    };
    let scaled = libm::round(f64::from(coordinate) * steps);
    if scaled.abs() < f64::from(i32::MAX) { scaled as i32 } else { i32::MIN }
}

#[cfg(test)]
#[expect(deprecated, reason = "clients still send what newer messages and frames replace")]
mod tests {
    use mavlink::dialects::common::{
        MISSION_ACK_DATA, MISSION_CLEAR_ALL_DATA, MISSION_COUNT_DATA, MISSION_ITEM_DATA, MISSION_ITEM_INT_DATA,
        MISSION_REQUEST_DATA, MISSION_REQUEST_INT_DATA, MISSION_REQUEST_LIST_DATA,
        MISSION_REQUEST_PARTIAL_LIST_DATA, MISSION_SET_CURRENT_DATA, MISSION_WRITE_PARTIAL_LIST_DATA, MavCmd,
        MavFrame, MavMissionResult,
    };

    use super::*;
    use crate::frame::{Encoder, Frames, Payload};

    const TARGET: Address = Address { system: 8, component: 9 };

    fn read(payload: &Payload) -> Option<(Address, MissionRequest)> {
        let bytes = Encoder::new(255, 190).encode(payload);
        request(&Frames::new(&bytes).next().unwrap().unwrap())
    }

    fn asked<D: mavlink::MessageData>(message: &D) -> MissionRequest {
        let (address, request) = read(&Payload::of(message)).unwrap();
        assert_eq!(address, TARGET);
        request
    }

    #[test]
    fn requests_are_read_as_the_mavlink_crate_writes_them() {
        let (target_system, target_component) = (8, 9);
        let count = MISSION_COUNT_DATA { count: 300, target_system, target_component };
        assert_eq!(asked(&count), MissionRequest::Count { plan: 0, count: 300 });
        let list = MISSION_REQUEST_LIST_DATA { target_system, target_component };
        assert_eq!(asked(&list), MissionRequest::List { plan: 0 });
        let fetch = MISSION_REQUEST_DATA { seq: 3, target_system, target_component };
        assert_eq!(asked(&fetch), MissionRequest::Fetch { plan: 0, sequence: 3 });
        let fetch = MISSION_REQUEST_INT_DATA { seq: 3, target_system, target_component };
        assert_eq!(asked(&fetch), MissionRequest::Fetch { plan: 0, sequence: 3 });
        let clear = MISSION_CLEAR_ALL_DATA { target_system, target_component };
        assert_eq!(asked(&clear), MissionRequest::Clear { plan: 0 });
        let current = MISSION_SET_CURRENT_DATA { seq: 3, target_system, target_component };
        assert_eq!(asked(&current), MissionRequest::SetCurrent { sequence: 3 });
        let mavtype = MavMissionResult::MAV_MISSION_OPERATION_CANCELLED;
        let acknowledge = MISSION_ACK_DATA { target_system, target_component, mavtype };
        assert_eq!(asked(&acknowledge), MissionRequest::Acknowledge { plan: 0, result: 15 });
        let (start_index, end_index) = (1, 2);
        let partial = MISSION_WRITE_PARTIAL_LIST_DATA { start_index, end_index, target_system, target_component };
        assert_eq!(asked(&partial), MissionRequest::Partial { plan: 0 });
        let partial =
            MISSION_REQUEST_PARTIAL_LIST_DATA { start_index, end_index, target_system, target_component };
        assert_eq!(asked(&partial), MissionRequest::Partial { plan: 0 });
    }

    #[test]
    fn the_plan_is_the_extension_of_every_message() {
        let plan = |id, seed, fields: &[u8]| read(&Payload::new(id, seed, fields)).unwrap().1;
        assert_eq!(plan(44, 221, &[5, 0, 8, 9, 1]), MissionRequest::Count { plan: 1, count: 5 });
        assert_eq!(plan(43, 132, &[8, 9, 2]), MissionRequest::List { plan: 2 });
        assert_eq!(plan(51, 196, &[5, 0, 8, 9, 1]), MissionRequest::Fetch { plan: 1, sequence: 5 });
        assert_eq!(plan(45, 232, &[8, 9, 255]), MissionRequest::Clear { plan: 255 });
        assert_eq!(plan(47, 153, &[8, 9, 0, 1]), MissionRequest::Acknowledge { plan: 1, result: 0 });
        let mut fields = [0; ITEM_LEN];
        fields[37] = 2;
        assert!(matches!(plan(73, 38, &fields), MissionRequest::Item { plan: 2, sequence: 0, .. }));
    }

    #[test]
    fn an_item_is_read_as_the_mavlink_crate_writes_it() {
        let sent = MISSION_ITEM_INT_DATA {
            param1: 1.0,
            param2: 2.0,
            param3: 3.0,
            param4: 4.0,
            x: 473_977_420,
            y: -5,
            z: 7.0,
            seq: 300,
            command: MavCmd::MAV_CMD_NAV_WAYPOINT,
            target_system: 8,
            target_component: 9,
            frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
            current: 1,
            autocontinue: 1,
        };
        let item = MissionItem {
            frame: 6,
            command: 16,
            autocontinue: 1,
            parameters: [1.0, 2.0, 3.0, 4.0],
            place: [473_977_420, -5],
            height: 7.0,
        };
        assert_eq!(asked(&sent), MissionRequest::Item { plan: 0, sequence: 300, item });
    }

    #[test]
    fn floats_become_integers_of_their_frame() {
        let place = |x, y, frame| {
            let sent = MISSION_ITEM_DATA {
                x,
                y,
                frame,
                target_system: 8,
                target_component: 9,
                command: MavCmd::MAV_CMD_NAV_WAYPOINT,
                ..MISSION_ITEM_DATA::default()
            };
            let request = asked(&sent);
            let MissionRequest::Item { item, .. } = request else { panic!("{request:?}") };
            item.place
        };
        assert_eq!(place(47.5, -8.25, MavFrame::MAV_FRAME_GLOBAL), [475_000_000, -82_500_000]);
        assert_eq!(place(1.5, -2.0, MavFrame::MAV_FRAME_LOCAL_NED), [15_000, -20_000]);
        assert_eq!(place(2.0, 3.0, MavFrame::MAV_FRAME_MISSION), [2, 3]);
        assert_eq!(place(f32::NAN, f32::INFINITY, MavFrame::MAV_FRAME_GLOBAL), [OPEN, i32::MIN]);
        assert_eq!(place(1e30, -1e30, MavFrame::MAV_FRAME_LOCAL_NED), [i32::MIN; 2]);
    }
}
