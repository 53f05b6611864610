//! Events: what happened, as numbers that clients word by the vehicle's metadata, and that are sent again to who missed one.
//!
//! Source: <https://mavlink.io/en/services/events.html>, and the receiver of MAVLink's `libevents`.

use std::collections::VecDeque;

use kestrel_onboard::fields::u16_at;
use kestrel_onboard::request::Address;

use super::Vehicle;
use crate::frame::{Frame, Payload};
use crate::message::sent::events::{self, Event, EventContent};
use crate::policy_backend::PolicyBackend;

/// `REQUEST_EVENT`.
const REQUEST: u32 = 412;

/// Events that can be asked for again.
const KEPT: usize = 32;

/// What a request is answered with at most: a few of a client's many go unanswered, and are asked for again.
const ANSWERS: u16 = 16;

/// What has happened so far.
#[derive(Clone, Debug, Default)]
pub(super) struct EventLog {
    /// Of the last event; zero before the first.
    sequence: u16,
    kept: VecDeque<Event>,
}

impl EventLog {
    fn note(&mut self, content: EventContent, time_boot_ms: u32) -> &Event {
        self.sequence = self.sequence.wrapping_add(1);
        if self.kept.len() == KEPT {
            self.kept.pop_front();
        }
        self.kept.push_back(Event { sequence: self.sequence, time_boot_ms, content });
        &self.kept[self.kept.len() - 1]
    }

    /// What a peer is told that asked for an event.
    fn answer(&self, sequence: u16, peer: [u8; 2]) -> Payload {
        if let Some(event) = self.kept.iter().find(|event| event.sequence == sequence) {
            return events::event(event);
        }
        let oldest = self.kept.front().map_or(self.sequence, |event| event.sequence);
        events::unavailable(sequence, oldest, peer)
    }
}

/// The first and the last event that a frame asks for, and from whom; nothing in another frame.
fn request(frame: &Frame<'_>) -> Option<(Address, [u16; 2])> {
    if frame.message_id != REQUEST {
        return None;
    }
    let fields: [u8; 6] = frame.fields();
    let [.., system, component] = fields;
    Some((Address { system, component }, [u16_at(&fields, 0), u16_at(&fields, 2)]))
}

impl<P: PolicyBackend> Vehicle<P> {
    /// Tells everybody what has happened.
    pub(super) fn tell_event(&mut self, content: EventContent) {
        let payload = events::event(self.events.note(content, self.time_boot_ms()));
        self.controller.answer(payload);
    }

    /// The number of the last event, for who missed it; nothing before the first.
    pub(super) fn event_sequence(&self) -> Option<Payload> {
        (!self.events.kept.is_empty()).then(|| events::current_sequence(self.events.sequence))
    }

    /// Sends events again, if a frame asks for some; whether it does.
    pub(super) fn handle_event_request(&mut self, frame: &Frame<'_>) -> bool {
        let Some((address, [first, last])) = request(frame) else { return false };
        if self.controller.is_meant(address) {
            for ahead in 0..=last.wrapping_sub(first).min(ANSWERS - 1) {
                let answer = self.events.answer(first.wrapping_add(ahead), [frame.system, frame.component]);
                self.controller.answer(answer);
            }
        }
        true
    }
}
