//! The mission protocol, the vehicle's side.
//!
//! An upload is driven by the vehicle: it asks for one item after the other, again if none comes, and takes over the
//! plan when it is whole and right; until then the old one stays in force. Downloads need no memory: every request is
//! answered at any time.

use kestrel_core::crc32::Crc32;
use kestrel_onboard::fence::Zones;
use mavlink::dialects::common::MavMissionResult;
use nalgebra::Vector3;

use super::fence;
use super::place::{REACH_M, target};
use super::received::MissionRequest;
use super::step::{self, MissionLeg};
use super::{FENCE_ITEMS, MISSION_ITEMS, MissionItem, PlanKind, RALLY_ITEMS, sent};
use crate::frame::Payload;
use crate::geodesy::Home;

/// An item is asked for again after this \[s\]; answers take milliseconds, and clients wait for 1 s or more.
const REPETITION_SECS: f64 = 0.25;

/// An item is asked for so often before the upload is given up.
const TRIES: u8 = 10;

/// The end of an upload is told so often again, until its sender goes on: clients such as MAVSDK wait for it once, and in vain
/// if it is lost. The vehicle cannot know whether it was.
const END_REPETITIONS: u8 = 3;

/// `MAV_MISSION_TYPE_ALL`.
const ALL_PLANS: u8 = 255;

/// `MAV_CMD_NAV_RALLY_POINT`.
const RALLY_POINT: u16 = 5100;

/// What a request changes for the rest of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissionEvent {
    /// There is another plan of this kind, or none any more. Of a mission: [`super::MissionRunner::reset`], and hold.
    Replaced(PlanKind),
    /// There are no plans any more.
    Cleared,
    /// [`super::MissionRunner::jump`] to this item, which may not exist, and tell which one is current either way.
    JumpTo(u16),
}

/// The plans of a vehicle, and peers that upload and download them.
#[derive(Clone, Debug)]
pub struct MissionProtocol {
    home: Home,
    mission: heapless::Vec<MissionItem, MISSION_ITEMS>,
    legs: heapless::Vec<MissionLeg, MISSION_ITEMS>,
    fence_items: heapless::Vec<MissionItem, FENCE_ITEMS>,
    zones: Zones,
    rally: heapless::Vec<MissionItem, RALLY_ITEMS>,
    rally_points: heapless::Vec<Vector3<f32>, RALLY_ITEMS>,
    upload: Option<Upload>,
    ended: Option<Ended>,
}

/// An upload that is not whole yet.
#[derive(Clone, Debug)]
struct Upload {
    plan: PlanKind,
    sender: [u8; 2],
    count: usize,
    items: heapless::Vec<MissionItem, MISSION_ITEMS>,
    asked_secs: f64,
    tries: u8,
}

/// A client's message: who sent it, when, and what sends the answers.
struct Exchange<'a> {
    sender: [u8; 2],
    now_secs: f64,
    send: &'a mut dyn FnMut(Payload),
}

/// How the last upload ended.
#[derive(Clone, Copy, Debug)]
struct Ended {
    plan: PlanKind,
    sender: [u8; 2],
    /// The item that ended it.
    sequence: u16,
    result: MavMissionResult,
    sent_secs: f64,
    repetitions: u8,
}

impl MissionProtocol {
    /// Without plans, for a world that lies at `home`.
    pub fn new(home: Home) -> Self {
        Self {
            home,
            mission: heapless::Vec::new(),
            legs: heapless::Vec::new(),
            fence_items: heapless::Vec::new(),
            zones: Zones::default(),
            rally: heapless::Vec::new(),
            rally_points: heapless::Vec::new(),
            upload: None,
            ended: None,
        }
    }

    /// The legs of the mission, for [`super::MissionRunner::advance`].
    pub fn legs(&self) -> &[MissionLeg] {
        &self.legs
    }

    /// The zones of the fence.
    pub fn zones(&self) -> &Zones {
        &self.zones
    }

    /// Where to land instead of home \[m, world\]; heights are those of the way there.
    pub fn rally_points(&self) -> &[Vector3<f32>] {
        &self.rally_points
    }

    /// Identifiers of the plans, mission, fence and rally points: checksums of their items, zero without any.
    pub fn identifiers(&self) -> [u32; 3] {
        PlanKind::ALL.map(|plan| self.identifier(plan))
    }

    /// Answers a request of `sender` (system, component) at a simulated time \[s\]; its addressee has been checked.
    pub fn handle(
        &mut self,
        request: &MissionRequest,
        sender: [u8; 2],
        now_secs: f64,
        send: &mut dyn FnMut(Payload),
    ) -> Option<MissionEvent> {
        self.note_progress(request, sender);
        match *request {
            MissionRequest::Count { plan, count } => {
                return self.begin(plan, count, Exchange { sender, now_secs, send });
            }
            MissionRequest::Item { plan, sequence, ref item } => {
                return self.take(plan, sequence, item, Exchange { sender, now_secs, send });
            }
            MissionRequest::Acknowledge { plan, result } => self.cancel(plan, result, sender),
            MissionRequest::List { plan } => self.send_count(plan, sender, send),
            MissionRequest::Fetch { plan, sequence } => self.send_item(plan, sequence, sender, send),
            MissionRequest::Clear { plan } => return self.clear(plan, sender, send),
            MissionRequest::SetCurrent { sequence } => return Some(MissionEvent::JumpTo(sequence)),
            MissionRequest::Partial { plan } => {
                send(sent::acknowledge(plan, MavMissionResult::MAV_MISSION_UNSUPPORTED, 0, sender));
            }
        }
        None
    }

    /// A client that asks for something else has received how its upload ended, or does not care.
    fn note_progress(&mut self, request: &MissionRequest, sender: [u8; 2]) {
        match request {
            MissionRequest::Item { .. } | MissionRequest::Acknowledge { .. } => {}
            MissionRequest::Count { .. }
            | MissionRequest::List { .. }
            | MissionRequest::Fetch { .. }
            | MissionRequest::Clear { .. }
            | MissionRequest::SetCurrent { .. }
            | MissionRequest::Partial { .. } => {
                if let Some(ended) = self.ended.as_mut().filter(|ended| ended.sender == sender) {
                    ended.repetitions = 0;
                }
            }
        }
    }

    /// Asks again for what did not come.
    pub fn tick(&mut self, now_secs: f64, send: &mut dyn FnMut(Payload)) {
        self.repeat_end(now_secs, send);
        let Some(upload) = &mut self.upload else { return };
        if now_secs - upload.asked_secs < REPETITION_SECS {
            return;
        }
        if upload.tries >= TRIES {
            return self.end(MavMissionResult::MAV_MISSION_OPERATION_CANCELLED, now_secs, send);
        }
        upload.ask(now_secs, send);
    }

    /// Begins an upload of a plan of so many items.
    fn begin(
        &mut self,
        number: u8,
        count: u16,
        Exchange { sender, now_secs, send }: Exchange<'_>,
    ) -> Option<MissionEvent> {
        let mut refuse = |result| send(sent::acknowledge(number, result, 0, sender));
        let Some(plan) = PlanKind::numbered(number) else {
            refuse(MavMissionResult::MAV_MISSION_UNSUPPORTED);
            return None;
        };
        if self.is_busy_with_other(sender) {
            refuse(MavMissionResult::MAV_MISSION_DENIED);
            return None;
        }
        self.upload = None;
        self.ended = None;
        if usize::from(count) > plan.capacity() {
            refuse(MavMissionResult::MAV_MISSION_NO_SPACE);
            return None;
        }
        let mut upload = Upload::new(plan, count.into(), sender);
        if count > 0 {
            upload.ask(now_secs, send);
            self.upload = Some(upload);
            return None;
        }
        self.upload = Some(upload);
        self.finish(now_secs, send)
    }

    /// Takes an item, if it is the one that was asked for.
    fn take(
        &mut self,
        plan: u8,
        sequence: u16,
        item: &MissionItem,
        Exchange { sender, now_secs, send }: Exchange<'_>,
    ) -> Option<MissionEvent> {
        let Some(upload) = &mut self.upload else {
            self.answer_stray(plan, sequence, sender, send);
            return None;
        };
        let expected =
            plan == upload.plan as u8 && sender == upload.sender && usize::from(sequence) == upload.items.len();
        if !expected {
            return None;
        }
        if let Err(result) = check(upload.plan, item, &self.home) {
            self.end(result, now_secs, send);
            return None;
        }
        // There is room: the count was checked.
        let _ = upload.items.push(*item);
        if upload.items.len() == upload.count {
            return self.finish(now_secs, send);
        }
        upload.tries = 0;
        upload.ask(now_secs, send);
        None
    }

    /// An item that was not asked for may be the last one of an upload whose end its sender has not received.
    fn answer_stray(&self, plan: u8, sequence: u16, sender: [u8; 2], send: &mut dyn FnMut(Payload)) {
        let Some(ended) = &self.ended else { return };
        if ended.sender == sender && ended.plan as u8 == plan && ended.sequence == sequence {
            self.send_end(ended, send);
        }
    }

    /// Takes over an upload that is whole.
    fn finish(&mut self, now_secs: f64, send: &mut dyn FnMut(Payload)) -> Option<MissionEvent> {
        let upload = self.upload.take()?;
        let plan = upload.plan;
        let outcome = self.adopt(plan, &upload.items);
        self.upload = Some(upload);
        self.end(outcome.err().unwrap_or(MavMissionResult::MAV_MISSION_ACCEPTED), now_secs, send);
        outcome.is_ok().then_some(MissionEvent::Replaced(plan))
    }

    /// Replaces a plan.
    fn adopt(&mut self, plan: PlanKind, items: &[MissionItem]) -> Result<(), MavMissionResult> {
        match plan {
            PlanKind::Mission => {
                self.legs = step::legs(items, &self.home)?;
                self.mission = items.iter().copied().collect();
            }
            PlanKind::Fence => {
                self.zones = fence::zones(items, &self.home)?;
                self.fence_items = items.iter().copied().collect();
            }
            PlanKind::Rally => {
                let points: Result<_, _> = items.iter().map(|item| rally_point(item, &self.home)).collect();
                self.rally_points = points?;
                self.rally = items.iter().copied().collect();
            }
        }
        Ok(())
    }

    /// Ends the upload and says how.
    fn end(&mut self, result: MavMissionResult, sent_secs: f64, send: &mut dyn FnMut(Payload)) {
        let Some(Upload { plan, sender, items, count, .. }) = self.upload.take() else { return };
        let sequence = items.len().min(count.saturating_sub(1)) as u16;
        let ended = Ended { plan, sender, sequence, result, sent_secs, repetitions: END_REPETITIONS };
        self.send_end(&ended, send);
        self.ended = Some(ended);
    }

    fn repeat_end(&mut self, now_secs: f64, send: &mut dyn FnMut(Payload)) {
        let Some(mut ended) = self.ended else { return };
        if ended.repetitions > 0 && now_secs - ended.sent_secs >= REPETITION_SECS {
            ended.repetitions -= 1;
            ended.sent_secs = now_secs;
            self.send_end(&ended, send);
            self.ended = Some(ended);
        }
    }

    fn send_end(&self, ended: &Ended, send: &mut dyn FnMut(Payload)) {
        let accepted = ended.result == MavMissionResult::MAV_MISSION_ACCEPTED;
        let identifier = if accepted { self.identifier(ended.plan) } else { 0 };
        send(sent::acknowledge(ended.plan as u8, ended.result, identifier, ended.sender));
    }

    /// A peer that acknowledges with an error gives up its upload.
    fn cancel(&mut self, plan: u8, result: u8, sender: [u8; 2]) {
        let given_up = result != MavMissionResult::MAV_MISSION_ACCEPTED as u8;
        if given_up && self.upload.as_ref().is_some_and(|upload| upload.is(plan, sender)) {
            self.upload = None;
        }
    }

    fn send_count(&self, number: u8, sender: [u8; 2], send: &mut dyn FnMut(Payload)) {
        send(match PlanKind::numbered(number) {
            Some(plan) => sent::count(number, self.items(plan).len() as u16, self.identifier(plan), sender),
            None => sent::acknowledge(number, MavMissionResult::MAV_MISSION_UNSUPPORTED, 0, sender),
        });
    }

    fn send_item(&self, number: u8, sequence: u16, sender: [u8; 2], send: &mut dyn FnMut(Payload)) {
        let refuse = |result| sent::acknowledge(number, result, 0, sender);
        let Some(plan) = PlanKind::numbered(number) else {
            return send(refuse(MavMissionResult::MAV_MISSION_UNSUPPORTED));
        };
        send(match self.items(plan).get(usize::from(sequence)) {
            Some(item) => sent::item(number, sequence, item, sender),
            None => refuse(MavMissionResult::MAV_MISSION_INVALID_SEQUENCE),
        });
    }

    fn clear(&mut self, number: u8, sender: [u8; 2], send: &mut dyn FnMut(Payload)) -> Option<MissionEvent> {
        let mut answer = |result| send(sent::acknowledge(number, result, 0, sender));
        let plan = PlanKind::numbered(number);
        if plan.is_none() && number != ALL_PLANS {
            answer(MavMissionResult::MAV_MISSION_UNSUPPORTED);
            return None;
        }
        if self.is_busy_with_other(sender) {
            answer(MavMissionResult::MAV_MISSION_DENIED);
            return None;
        }
        (self.upload, self.ended) = (None, None);
        for cleared in PlanKind::ALL.into_iter().filter(|each| plan.is_none_or(|plan| plan == *each)) {
            self.adopt(cleared, &[]).expect("nothing is wrong with no items");
        }
        answer(MavMissionResult::MAV_MISSION_ACCEPTED);
        Some(plan.map_or(MissionEvent::Cleared, MissionEvent::Replaced))
    }

    fn is_busy_with_other(&self, sender: [u8; 2]) -> bool {
        self.upload.as_ref().is_some_and(|upload| upload.sender != sender)
    }

    fn items(&self, plan: PlanKind) -> &[MissionItem] {
        match plan {
            PlanKind::Mission => &self.mission,
            PlanKind::Fence => &self.fence_items,
            PlanKind::Rally => &self.rally,
        }
    }

    fn identifier(&self, plan: PlanKind) -> u32 {
        let items = self.items(plan);
        if items.is_empty() {
            return 0;
        }
        let mut checksum = Crc32::new();
        items.iter().flat_map(MissionItem::fields).for_each(|byte| checksum.add(byte));
        checksum.value().max(1)
    }
}

impl Upload {
    fn new(plan: PlanKind, count: usize, sender: [u8; 2]) -> Self {
        Self { plan, sender, count, items: heapless::Vec::new(), asked_secs: 0.0, tries: 0 }
    }

    /// Asks for the next item.
    fn ask(&mut self, now_secs: f64, send: &mut dyn FnMut(Payload)) {
        self.asked_secs = now_secs;
        self.tries += 1;
        send(sent::request(self.plan as u8, self.items.len() as u16, self.sender));
    }

    fn is(&self, plan: u8, sender: [u8; 2]) -> bool {
        self.plan as u8 == plan && self.sender == sender
    }
}

/// Checks an item by itself as it comes, so that its sender learns which one is wrong.
fn check(plan: PlanKind, item: &MissionItem, home: &Home) -> Result<(), MavMissionResult> {
    match plan {
        PlanKind::Mission => step::leg(item, home).map(drop),
        PlanKind::Fence => fence::check(item, home),
        PlanKind::Rally => rally_point(item, home).map(drop),
    }
}

fn rally_point(item: &MissionItem, home: &Home) -> Result<Vector3<f32>, MavMissionResult> {
    if item.command != RALLY_POINT {
        return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED);
    }
    let target = target(item, home, REACH_M)?;
    let [x, y] = target.horizontal_m.ok_or(MavMissionResult::MAV_MISSION_INVALID_PARAM5_X)?;
    let height = target.height_m.ok_or(MavMissionResult::MAV_MISSION_INVALID_PARAM7)?;
    Ok(Vector3::new(x, y, height))
}

#[cfg(test)]
mod tests;
