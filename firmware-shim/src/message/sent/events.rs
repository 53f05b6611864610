//! Events: messages whose numbers the vehicle's metadata words.

use serde::Serialize;
use serde_json::{Value, json};

use crate::frame::Payload;

/// Upper eight bits of every event: the component that they are of, the autopilot.
const COMPONENT: u32 = 1;

/// `MAV_COMP_ID_ALL`, and every system.
const EVERYBODY: [u8; 2] = [0, 0];

/// Levels of a log and of clients: notice and information.
const NOTICE: u8 = 0x55;
const INFORMATION: u8 = 0x66;

/// Bytes of the arguments.
const ARGUMENTS_LEN: usize = 40;

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EventContent {
    /// The task was begun from a start.
    TaskBegun {
        /// Its number.
        start: u32,
    },
    /// The task from a start has ended.
    TaskEnded {
        /// Its number.
        start: u32,
        /// Whether by success.
        success: bool,
        /// How long it took \[s\].
        secs: f32,
    },
    /// A command stopped the task.
    TaskStopped,
}

/// Something that happened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Event {
    /// Its number.
    pub sequence: u16,
    /// When.
    pub time_boot_ms: u32,
    /// What.
    pub content: EventContent,
}

impl EventContent {
    /// Lower 24 bits of its number in the metadata.
    const fn sub_id(self) -> u32 {
        match self {
            Self::TaskBegun { .. } => 1,
            Self::TaskEnded { .. } => 2,
            Self::TaskStopped => 3,
        }
    }

    const fn level(self) -> u8 {
        match self {
            Self::TaskEnded { .. } => NOTICE,
            Self::TaskBegun { .. } | Self::TaskStopped => INFORMATION,
        }
    }

    fn arguments(self) -> [u8; ARGUMENTS_LEN] {
        let mut arguments = [0; ARGUMENTS_LEN];
        match self {
            Self::TaskBegun { start } => arguments[..4].copy_from_slice(&start.to_le_bytes()),
            Self::TaskEnded { start, success, secs } => {
                arguments[..4].copy_from_slice(&start.to_le_bytes());
                arguments[4] = u8::from(success);
                arguments[5..9].copy_from_slice(&secs.to_le_bytes());
            }
            Self::TaskStopped => {}
        }
        arguments
    }
}

/// What the metadata says of all events, as MAVLink's `events.schema.json` has it.
pub fn definitions() -> impl Serialize {
    let argument = |name: &str, kind: &str| json!({ "name": name, "type": kind });
    let start = argument("start", "uint32_t");
    let event = |content: EventContent, name: &str, message: &str, arguments: &[&Value]| json!({ "sub_id": content.sub_id(), "name": name, "message": message, "arguments": arguments });
    let ended = EventContent::TaskEnded { start: 0, success: false, secs: 0.0 };
    let (outcome, secs) = (argument("outcome", "task_outcome_t"), argument("secs", "float"));
    let entry = |value: u8, name: &str| json!({ "value": value, "name": name, "description": name });
    json!({
        "version": 1,
        "components": [{
            "component_id": COMPONENT,
            "namespace": "kestrel",
            "enums": [{
                "name": "task_outcome_t",
                "type": "uint8_t",
                "description": "How a task ended, by the true state",
                "entries": [entry(0, "failure"), entry(1, "success")],
            }],
            "event_groups": [{
                "name": "default",
                "events": [
                    event(EventContent::TaskBegun { start: 0 }, "task_begun", "Task begun from start {1}", &[&start]),
                    event(ended, "task_ended", "Task from start {1}: {2} after {3:.2} s", &[&start, &outcome, &secs]),
                    event(EventContent::TaskStopped, "task_stopped", "Task stopped", &[]),
                ],
            }],
        }],
    })
}

/// `EVENT`.
pub fn event(event: &Event) -> Payload {
    let Event { sequence, time_boot_ms, content } = *event;
    let id = COMPONENT << 24 | content.sub_id();
    let fields = [id, time_boot_ms].into_iter().flat_map(u32::to_le_bytes).chain(sequence.to_le_bytes());
    let fields = fields.chain(EVERYBODY).chain([content.level()]).chain(content.arguments());
    Payload::new(410, 160, &fields.collect::<heapless::Vec<u8, 53>>())
}

/// `CURRENT_EVENT_SEQUENCE`.
pub fn current_sequence(sequence: u16) -> Payload {
    let [low, high] = sequence.to_le_bytes();
    Payload::new(411, 106, &[low, high, 0])
}

/// `RESPONSE_EVENT_ERROR`: it is not kept any more, or was never sent.
pub fn unavailable(sequence: u16, oldest: u16, [system, component]: [u8; 2]) -> Payload {
    let numbers = [sequence, oldest].into_iter().flat_map(u16::to_le_bytes);
    Payload::new(413, 77, &numbers.chain([system, component, 0]).collect::<heapless::Vec<u8, 7>>())
}
