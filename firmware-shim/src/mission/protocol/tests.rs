use core::slice;
use std::collections::VecDeque;

use mavlink::dialects::common::{
    MISSION_CLEAR_ALL_DATA, MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MISSION_REQUEST_INT_DATA,
    MISSION_REQUEST_LIST_DATA, MavCmd, MavFrame, MavMessage,
};
use proptest::prelude::*;

use super::super::received;
use super::*;
use crate::frame::{Encoder, Frames};
use crate::request::Address;
use crate::testing::{datagram, message};
use MavMissionResult::{
    MAV_MISSION_ACCEPTED, MAV_MISSION_DENIED, MAV_MISSION_INVALID, MAV_MISSION_INVALID_PARAM7,
    MAV_MISSION_INVALID_SEQUENCE, MAV_MISSION_NO_SPACE, MAV_MISSION_OPERATION_CANCELLED, MAV_MISSION_UNSUPPORTED,
};

const PEER: [u8; 2] = [255, 190];
const OTHER: [u8; 2] = [254, 190];
const TICK_SECS: f64 = 0.01;

/// A waypoint that no other number makes, above home.
fn waypoint(number: u16) -> MissionItem {
    MissionItem {
        frame: 1,
        command: 16,
        autocontinue: 1,
        parameters: [f32::from(number), 0.0, 0.0, 0.0],
        place: [i32::from(number) * 1000, 0],
        height: -1.0,
    }
}

fn waypoints(count: u16, first: u16) -> Vec<MissionItem> {
    (first..first + count).map(waypoint).collect()
}

/// The vehicle's side on a clock of its own, whose answers are heard as requests are read.
struct Rig {
    protocol: MissionProtocol,
    secs: f64,
    heard: Vec<Heard>,
    events: Vec<MissionEvent>,
}

/// An answer, with the plan that the mavlink crate does not read.
#[derive(Clone, Debug, PartialEq)]
enum Heard {
    Asked { to: [u8; 2], plan: u8, sequence: u16 },
    Acknowledged { to: [u8; 2], plan: u8, result: u8, identifier: u32 },
    Counted { to: [u8; 2], plan: u8, count: u16, identifier: u32 },
    Told { to: [u8; 2], plan: u8, sequence: u16, item: MissionItem },
}

fn heard(payload: &Payload) -> Heard {
    let bytes = Encoder::new(1, 1).encode(payload);
    let frame = Frames::new(&bytes).next().unwrap().unwrap();
    let to = |address: Address| [address.system, address.component];
    match (frame.message_id, received::request(&frame)) {
        (51, Some((address, MissionRequest::Fetch { plan, sequence }))) => {
            Heard::Asked { to: to(address), plan, sequence }
        }
        (47, Some((address, MissionRequest::Acknowledge { plan, result }))) => {
            let fields = frame.fields::<8>();
            let identifier = u32::from_le_bytes(core::array::from_fn(|i| fields[4 + i]));
            Heard::Acknowledged { to: to(address), plan, result, identifier }
        }
        (44, Some((address, MissionRequest::Count { plan, count }))) => {
            let fields = frame.fields::<9>();
            let identifier = u32::from_le_bytes(core::array::from_fn(|i| fields[5 + i]));
            Heard::Counted { to: to(address), plan, count, identifier }
        }
        (73, Some((address, MissionRequest::Item { plan, sequence, item }))) => {
            Heard::Told { to: to(address), plan, sequence, item }
        }
        other => panic!("{other:?}"),
    }
}

fn acknowledged(to: [u8; 2], plan: u8, result: MavMissionResult) -> Heard {
    Heard::Acknowledged { to, plan, result: result as u8, identifier: 0 }
}

impl Rig {
    fn new() -> Self {
        Self { protocol: MissionProtocol::new(Home::default()), secs: 0.0, heard: Vec::new(), events: Vec::new() }
    }

    fn with(items: &[MissionItem]) -> Self {
        let mut rig = Self::new();
        assert_eq!(rig.upload(0, items), MAV_MISSION_ACCEPTED as u8);
        rig.events.clear();
        rig
    }

    /// What is answered to a request, at once.
    fn ask(&mut self, request: MissionRequest, sender: [u8; 2]) -> Vec<Heard> {
        let answers = &mut self.heard;
        let event =
            self.protocol.handle(&request, sender, self.secs, &mut |payload| answers.push(heard(&payload)));
        self.events.extend(event);
        self.heard.drain(..).collect()
    }

    /// What is said without being asked.
    fn wait(&mut self, secs: f64) -> Vec<Heard> {
        let end = self.secs + secs;
        while self.secs < end - TICK_SECS / 2.0 {
            self.secs += TICK_SECS;
            let answers = &mut self.heard;
            self.protocol.tick(self.secs, &mut |payload| answers.push(heard(&payload)));
        }
        self.heard.drain(..).collect()
    }

    /// Uploads over a link that loses nothing; the result.
    fn upload(&mut self, plan: u8, items: &[MissionItem]) -> u8 {
        let mut answers = self.ask(MissionRequest::Count { plan, count: items.len() as u16 }, PEER);
        loop {
            match answers[..] {
                [Heard::Asked { to: PEER, plan: asked, sequence }] => {
                    assert_eq!(asked, plan);
                    let item = items[usize::from(sequence)];
                    answers = self.ask(MissionRequest::Item { plan, sequence, item }, PEER);
                }
                [Heard::Acknowledged { to: PEER, plan: acknowledged, result, .. }] => {
                    assert_eq!(acknowledged, plan);
                    return result;
                }
                _ => panic!("{answers:?}"),
            }
        }
    }

    /// Downloads over a link that loses nothing.
    fn download(&mut self, plan: u8, sender: [u8; 2]) -> Vec<MissionItem> {
        let count = match self.ask(MissionRequest::List { plan }, sender)[..] {
            [Heard::Counted { to, plan: counted, count, .. }] if to == sender && counted == plan => count,
            ref answers => panic!("{answers:?}"),
        };
        let mut items = Vec::new();
        for sequence in 0..count {
            match self.ask(MissionRequest::Fetch { plan, sequence }, sender)[..] {
                [Heard::Told { item, sequence: told, .. }] if told == sequence => items.push(item),
                ref answers => panic!("{answers:?}"),
            }
        }
        items
    }
}

fn fence_items() -> Vec<MissionItem> {
    let corner = |north, east| MissionItem {
        command: 5001,
        parameters: [4.0, 0.0, 0.0, 0.0],
        place: [north * 10_000, east * 10_000],
        ..waypoint(0)
    };
    vec![corner(-5, -5), corner(-5, 5), corner(5, 5), corner(5, -5)]
}

#[test]
fn what_was_uploaded_is_downloaded_by_anybody() {
    let mut rig = Rig::new();
    for count in [0, 1, 10, 64] {
        let items = waypoints(count, 3);
        assert_eq!(rig.upload(0, &items), MAV_MISSION_ACCEPTED as u8);
        assert_eq!(rig.events.drain(..).collect::<Vec<_>>(), [MissionEvent::Replaced(PlanKind::Mission)]);
        assert_eq!(rig.protocol.legs().len(), items.len());
        assert_eq!(rig.download(0, PEER), items);
        assert_eq!(rig.download(0, OTHER), items);
    }
}

#[test]
fn plans_of_different_kinds_do_not_touch_each_other() {
    let mut rig = Rig::with(&waypoints(5, 0));
    let rally = vec![MissionItem { command: 5100, ..waypoint(7) }];
    assert_eq!(rig.upload(1, &fence_items()), MAV_MISSION_ACCEPTED as u8);
    assert_eq!(rig.upload(2, &rally), MAV_MISSION_ACCEPTED as u8);
    assert_eq!(rig.events, [MissionEvent::Replaced(PlanKind::Fence), MissionEvent::Replaced(PlanKind::Rally)]);
    assert_eq!(rig.download(0, PEER), waypoints(5, 0));
    assert_eq!(rig.download(1, PEER), fence_items());
    assert_eq!(rig.download(2, PEER), rally);
    assert_eq!(rig.protocol.rally_points(), [Vector3::new(0.0, 0.7, 1.0)]);
    assert!(!rig.protocol.zones().is_empty());
    assert_eq!(rig.ask(MissionRequest::Clear { plan: 1 }, PEER), [acknowledged(PEER, 1, MAV_MISSION_ACCEPTED)]);
    assert!(rig.protocol.zones().is_empty());
    assert_eq!(rig.download(0, PEER).len(), 5);
    assert_eq!(
        rig.ask(MissionRequest::Clear { plan: 255 }, PEER),
        [acknowledged(PEER, 255, MAV_MISSION_ACCEPTED)]
    );
    assert_eq!(rig.events.last(), Some(&MissionEvent::Cleared));
    assert_eq!(rig.protocol.identifiers(), [0; 3]);
}

#[test]
fn a_client_of_the_mavlink_crate_uploads_and_downloads() {
    let mut rig = Rig::new();
    let mut converse = |bytes: &[u8]| {
        let frame = Frames::new(bytes).next().unwrap().unwrap();
        let (_, request) = received::request(&frame).unwrap();
        let mut answers = Vec::new();
        let sender = [frame.system, frame.component];
        rig.protocol.handle(&request, sender, 0.0, &mut |payload| {
            answers.push(message(&Encoder::new(1, 1).encode(&payload)));
        });
        assert_eq!(answers.len(), 1);
        answers.remove(0)
    };
    let (target_system, target_component) = (1, 1);
    let item = |seq: u16| MISSION_ITEM_INT_DATA {
        param4: 45.0,
        x: 473_977_420 + i32::from(seq) * 10,
        y: 85_455_940,
        z: 2.5,
        seq,
        command: MavCmd::MAV_CMD_NAV_WAYPOINT,
        target_system,
        target_component,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT,
        autocontinue: 1,
        ..MISSION_ITEM_INT_DATA::default()
    };
    let mut answer = converse(&datagram(&MISSION_COUNT_DATA { count: 3, target_system, target_component }));
    for seq in 0..3 {
        let expected = MISSION_REQUEST_INT_DATA { seq, target_system: 255, target_component: 190 };
        assert_eq!(answer, MavMessage::MISSION_REQUEST_INT(expected));
        answer = converse(&datagram(&item(seq)));
    }
    let MavMessage::MISSION_ACK(acknowledgement) = answer else { panic!("{answer:?}") };
    assert_eq!(acknowledgement.mavtype, MAV_MISSION_ACCEPTED);
    let list = MISSION_REQUEST_LIST_DATA { target_system, target_component };
    let expected = MISSION_COUNT_DATA { count: 3, target_system: 255, target_component: 190 };
    assert_eq!(converse(&datagram(&list)), MavMessage::MISSION_COUNT(expected));
    for seq in 0..3 {
        let fetch = MISSION_REQUEST_INT_DATA { seq, target_system, target_component };
        let expected = MISSION_ITEM_INT_DATA { target_system: 255, target_component: 190, ..item(seq) };
        assert_eq!(converse(&datagram(&fetch)), MavMessage::MISSION_ITEM_INT(expected));
    }
    let clear = MISSION_CLEAR_ALL_DATA { target_system, target_component };
    assert!(matches!(converse(&datagram(&clear)), MavMessage::MISSION_ACK(_)));
}

#[test]
fn identifiers_follow_what_is_in_a_plan() {
    let mut rig = Rig::with(&waypoints(3, 0));
    let [first, fence, rally] = rig.protocol.identifiers();
    assert!(first != 0 && fence == 0 && rally == 0);
    rig.upload(0, &waypoints(3, 1));
    assert_ne!(rig.protocol.identifiers()[0], first);
    rig.ask(MissionRequest::Count { plan: 0, count: 3 }, PEER);
    let mut answers = Vec::new();
    for (sequence, item) in (0..).zip(waypoints(3, 0)) {
        answers = rig.ask(MissionRequest::Item { plan: 0, sequence, item }, PEER);
    }
    let result = MAV_MISSION_ACCEPTED as u8;
    assert_eq!(answers, [Heard::Acknowledged { to: PEER, plan: 0, result, identifier: first }]);
    let counted = Heard::Counted { to: PEER, plan: 0, count: 3, identifier: first };
    assert_eq!(rig.ask(MissionRequest::List { plan: 0 }, PEER), [counted]);
}

#[test]
fn a_lost_item_is_asked_for_again_ten_times_and_the_old_plan_stays() {
    let old = waypoints(2, 0);
    let mut rig = Rig::with(&old);
    let asked = Heard::Asked { to: PEER, plan: 0, sequence: 0 };
    assert_eq!(rig.ask(MissionRequest::Count { plan: 0, count: 5 }, PEER), slice::from_ref(&asked));
    assert_eq!(rig.wait(0.24), []);
    assert_eq!(rig.wait(0.02), [asked]);
    let item = waypoint(9);
    let asked = Heard::Asked { to: PEER, plan: 0, sequence: 1 };
    assert_eq!(rig.ask(MissionRequest::Item { plan: 0, sequence: 0, item }, PEER), slice::from_ref(&asked));
    let cancelled = acknowledged(PEER, 0, MAV_MISSION_OPERATION_CANCELLED);
    let told = rig.wait(2.6);
    assert_eq!(told[..told.len() - 1], vec![asked; usize::from(TRIES) - 1]);
    assert_eq!(told.last(), Some(&cancelled));
    assert_eq!(rig.wait(5.0), vec![cancelled; END_REPETITIONS.into()], "it may have been lost, too");
    assert_eq!(rig.download(0, PEER), old);
    assert_eq!(rig.events, []);
}

#[test]
fn duplicates_and_strays_are_ignored() {
    let mut rig = Rig::new();
    let item = |plan, sequence| MissionRequest::Item { plan, sequence, item: waypoint(sequence) };
    assert_eq!(rig.ask(item(0, 0), PEER), []);
    rig.ask(MissionRequest::Count { plan: 0, count: 3 }, PEER);
    rig.ask(item(0, 0), PEER);
    for (stray, sender) in [(item(0, 0), PEER), (item(0, 2), PEER), (item(1, 1), PEER), (item(0, 1), OTHER)] {
        assert_eq!(rig.ask(stray, sender), []);
    }
    rig.ask(item(0, 1), PEER);
    assert_eq!(rig.ask(item(0, 2), PEER).len(), 1);
    assert_eq!(rig.download(0, PEER), waypoints(3, 0));
}

#[test]
fn whoever_missed_the_end_hears_it_again() {
    let mut rig = Rig::with(&waypoints(3, 0));
    let last = MissionRequest::Item { plan: 0, sequence: 2, item: waypoint(2) };
    let answers = rig.ask(last, PEER);
    assert!(matches!(answers[..], [Heard::Acknowledged { to: PEER, plan: 0, result: 0, .. }]), "{answers:?}");
    assert_eq!(rig.ask(last, OTHER), []);
    assert_eq!(rig.wait(5.0), vec![answers[0].clone(); END_REPETITIONS.into()]);
    assert_eq!(rig.events, []);
}

#[test]
fn whoever_goes_on_does_not_hear_the_end_again() {
    for request in [MissionRequest::List { plan: 0 }, MissionRequest::SetCurrent { sequence: 1 }] {
        let mut rig = Rig::with(&waypoints(3, 0));
        rig.ask(request, OTHER);
        assert_eq!(rig.wait(0.3).len(), 1, "{request:?} of another sender");
        rig.ask(request, PEER);
        assert_eq!(rig.wait(5.0), [], "{request:?}");
    }
}

#[test]
fn one_upload_at_a_time() {
    let mut rig = Rig::new();
    rig.ask(MissionRequest::Count { plan: 0, count: 2 }, PEER);
    let denied = [acknowledged(OTHER, 0, MAV_MISSION_DENIED)];
    assert_eq!(rig.ask(MissionRequest::Count { plan: 0, count: 1 }, OTHER), denied);
    assert_eq!(rig.ask(MissionRequest::Clear { plan: 0 }, OTHER), denied);
    assert_eq!(rig.download(0, OTHER), [], "but anybody may look");
    for sequence in 0..2 {
        rig.ask(MissionRequest::Item { plan: 0, sequence, item: waypoint(sequence) }, PEER);
    }
    assert_eq!(rig.download(0, OTHER), waypoints(2, 0));
    assert_eq!(rig.ask(MissionRequest::Count { plan: 0, count: 1 }, OTHER).len(), 1);
}

#[test]
fn a_peer_may_start_over_or_give_up() {
    let mut rig = Rig::with(&waypoints(1, 9));
    rig.ask(MissionRequest::Count { plan: 0, count: 3 }, PEER);
    rig.ask(MissionRequest::Item { plan: 0, sequence: 0, item: waypoint(0) }, PEER);
    let asked = Heard::Asked { to: PEER, plan: 0, sequence: 0 };
    assert_eq!(rig.ask(MissionRequest::Count { plan: 0, count: 2 }, PEER), [asked]);
    assert_eq!(rig.ask(MissionRequest::Acknowledge { plan: 0, result: 0 }, PEER), [], "of a download");
    assert_eq!(rig.ask(MissionRequest::Acknowledge { plan: 0, result: 15 }, OTHER), []);
    assert_eq!(rig.wait(0.3).len(), 1, "still asking");
    assert_eq!(rig.ask(MissionRequest::Acknowledge { plan: 0, result: 15 }, PEER), []);
    assert_eq!(rig.wait(5.0), []);
    assert_eq!(rig.download(0, PEER), waypoints(1, 9));
}

#[test]
fn what_does_not_fit_or_cannot_be_flown_is_refused_and_the_old_plan_stays() {
    let old = waypoints(2, 0);
    let mut rig = Rig::with(&old);
    for (plan, count) in [(0, 65), (1, 33), (2, 9), (0, u16::MAX)] {
        assert_eq!(
            rig.ask(MissionRequest::Count { plan, count }, PEER),
            [acknowledged(PEER, plan, MAV_MISSION_NO_SPACE)]
        );
    }
    let unknown = MissionItem { command: 60_000, ..waypoint(1) };
    assert_eq!(rig.upload(0, &[waypoint(0), unknown, waypoint(2)]), MAV_MISSION_UNSUPPORTED as u8);
    let below = MissionItem { height: 1.0, ..waypoint(1) };
    assert_eq!(rig.upload(0, &[below]), MAV_MISSION_INVALID_PARAM7 as u8);
    assert_eq!(rig.upload(1, &waypoints(1, 0)), MAV_MISSION_UNSUPPORTED as u8);
    assert_eq!(rig.upload(2, &waypoints(1, 0)), MAV_MISSION_UNSUPPORTED as u8);
    let mut bow_tie = fence_items();
    bow_tie.swap(0, 1);
    assert_eq!(rig.upload(1, &bow_tie), MAV_MISSION_INVALID as u8);
    assert_eq!(rig.download(0, PEER), old);
    assert_eq!(rig.download(1, PEER), []);
    assert_eq!(rig.events, []);
}

#[test]
fn what_is_no_plan_or_no_item_is_said_so() {
    let mut rig = Rig::with(&waypoints(2, 0));
    let unsupported = |plan| [acknowledged(PEER, plan, MAV_MISSION_UNSUPPORTED)];
    assert_eq!(rig.ask(MissionRequest::Count { plan: 3, count: 1 }, PEER), unsupported(3));
    assert_eq!(rig.ask(MissionRequest::Count { plan: 255, count: 1 }, PEER), unsupported(255));
    assert_eq!(rig.ask(MissionRequest::List { plan: 3 }, PEER), unsupported(3));
    assert_eq!(rig.ask(MissionRequest::Fetch { plan: 3, sequence: 0 }, PEER), unsupported(3));
    assert_eq!(rig.ask(MissionRequest::Clear { plan: 3 }, PEER), unsupported(3));
    assert_eq!(rig.ask(MissionRequest::Partial { plan: 0 }, PEER), unsupported(0));
    let beyond = rig.ask(MissionRequest::Fetch { plan: 0, sequence: 2 }, PEER);
    assert_eq!(beyond, [acknowledged(PEER, 0, MAV_MISSION_INVALID_SEQUENCE)]);
    assert_eq!(rig.ask(MissionRequest::SetCurrent { sequence: 1 }, PEER), []);
    assert_eq!(rig.events, [MissionEvent::JumpTo(1)]);
}

/// Uniform numbers from a seed (xorshift64*, Vigna 2016).
struct Dice(u64);

impl Dice {
    fn roll(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// One way of a link that loses a fifth, doubles a twentieth and delays everything by 10 ms to 60 ms, each on its own,
/// so that much is overtaken.
struct Way<T> {
    travelling: Vec<(f64, T)>,
}

impl<T: Clone> Way<T> {
    const LOSS: f64 = 0.2;
    const DUPLICATION: f64 = 0.05;

    fn send(&mut self, sent: T, secs: f64, dice: &mut Dice) {
        if dice.roll() < Self::DUPLICATION {
            self.travelling.push((secs + 0.01 + 0.2 * dice.roll(), sent.clone()));
        }
        if dice.roll() >= Self::LOSS {
            self.travelling.push((secs + 0.01 + 0.05 * dice.roll(), sent));
        }
    }

    fn arrivals(&mut self, secs: f64) -> VecDeque<T> {
        let (arrived, travelling) = self.travelling.drain(..).partition(|(due, _)| *due <= secs);
        self.travelling = travelling;
        let mut arrived: Vec<(f64, T)> = arrived;
        arrived.sort_by(|a, b| a.0.total_cmp(&b.0));
        arrived.into_iter().map(|(_, sent)| sent).collect()
    }
}

/// A client that uploads: it sends the count, and the last item, again after 1 s of silence, at most five times.
struct Client {
    items: Vec<MissionItem>,
    sent: MissionRequest,
    spoke_secs: f64,
    repetitions: u32,
    outcome: Option<u8>,
}

/// What a client reports when no answer comes.
const TIMEOUT: u8 = 255;

impl Client {
    fn new(items: Vec<MissionItem>, secs: f64) -> (Self, MissionRequest) {
        let sent = MissionRequest::Count { plan: 0, count: items.len() as u16 };
        (Self { items, sent, spoke_secs: secs, repetitions: 0, outcome: None }, sent)
    }

    fn receive(&mut self, heard: &Heard, secs: f64) -> Option<MissionRequest> {
        match *heard {
            Heard::Asked { plan, sequence, .. } => {
                let item = *self.items.get(usize::from(sequence))?;
                self.sent = MissionRequest::Item { plan, sequence, item };
                (self.spoke_secs, self.repetitions) = (secs, 0);
                Some(self.sent)
            }
            Heard::Acknowledged { result, .. } => {
                self.outcome = Some(result);
                None
            }
            Heard::Counted { .. } | Heard::Told { .. } => None,
        }
    }

    fn tick(&mut self, secs: f64) -> Option<MissionRequest> {
        if secs - self.spoke_secs < 1.0 {
            return None;
        }
        (self.spoke_secs, self.repetitions) = (secs, self.repetitions + 1);
        if self.repetitions > 5 {
            self.outcome = Some(TIMEOUT);
            return None;
        }
        Some(self.sent)
    }
}

/// Uploads over a lossy link; what the client reports.
fn upload_with_losses(rig: &mut Rig, items: Vec<MissionItem>, dice: &mut Dice) -> u8 {
    let (mut up, mut down) = (Way { travelling: Vec::new() }, Way { travelling: Vec::new() });
    let (mut client, first) = Client::new(items, rig.secs);
    up.send(first, rig.secs, dice);
    let outcome = loop {
        for answer in rig.wait(TICK_SECS) {
            down.send(answer, rig.secs, dice);
        }
        for request in up.arrivals(rig.secs) {
            for answer in rig.ask(request, PEER) {
                down.send(answer, rig.secs, dice);
            }
        }
        for answer in down.arrivals(rig.secs) {
            if let Some(request) = client.receive(&answer, rig.secs) {
                up.send(request, rig.secs, dice);
            }
        }
        if let Some(outcome) = client.outcome {
            break outcome;
        }
        if let Some(request) = client.tick(rig.secs) {
            up.send(request, rig.secs, dice);
        }
    };
    // Whatever still travels arrives, and the vehicle comes to rest.
    for _ in 0..500 {
        rig.wait(TICK_SECS);
        for request in up.arrivals(rig.secs) {
            rig.ask(request, PEER);
        }
    }
    outcome
}

#[test]
fn uploads_survive_a_fifth_of_losses_and_what_the_client_hears_is_true() {
    let mut dice = Dice(0x1234_5678_9abc_def1);
    let mut rig = Rig::new();
    let mut held = Vec::new();
    let mut accepted = 0;
    for flight in 0..200_u16 {
        let items = waypoints(1 + flight % 20, 1 + flight);
        let outcome = upload_with_losses(&mut rig, items.clone(), &mut dice);
        let found = rig.download(0, PEER);
        assert!(found == items || found == held, "neither the new plan nor the old one");
        if outcome == MAV_MISSION_ACCEPTED as u8 {
            assert_eq!(found, items);
            accepted += 1;
        } else {
            assert!([TIMEOUT, MAV_MISSION_OPERATION_CANCELLED as u8].contains(&outcome), "{outcome}");
        }
        held = found;
    }
    assert!(accepted >= 199, "{accepted} of 200");
}

#[test]
fn a_client_that_waits_for_the_end_only_once_seldom_misses_it() {
    let mut dice = Dice(0xfeed_5678_9abc_def1);
    let mut rig = Rig::new();
    let mut heard = 0;
    for flight in 0..200_u16 {
        let items = waypoints(5, flight);
        rig.ask(MissionRequest::Count { plan: 0, count: 5 }, PEER);
        for (sequence, item) in (0..).zip(items) {
            // Each item takes a request and an answer; after a loss the vehicle asks again.
            while dice.roll() < 0.36 {
                assert_eq!(rig.wait(0.26).len(), 1);
            }
            let answers = rig.ask(MissionRequest::Item { plan: 0, sequence, item }, PEER);
            assert_eq!(answers.len(), 1);
        }
        let ends = 1 + rig.wait(2.0).len();
        assert_eq!(ends, 1 + usize::from(END_REPETITIONS));
        heard += u32::from((0..ends).any(|_| dice.roll() >= 0.2));
    }
    assert!(heard >= 198, "{heard} of 200; told once it would be 160");
}

fn any_item() -> impl Strategy<Value = MissionItem> {
    let command = prop_oneof![
        6 => Just(16_u16),
        4 => prop_oneof![Just(17_u16), Just(19), Just(20), Just(21), Just(22), Just(93), Just(178), Just(2000)],
        4 => 5000_u16..5005,
        1 => Just(5100_u16),
        1 => any::<u16>(),
    ];
    let float = prop_oneof![
        4 => Just(0.0_f32), 2 => Just(3.0), 2 => Just(f32::NAN), 1 => Just(f32::INFINITY), 1 => any::<f32>()
    ];
    let place = prop_oneof![4 => -100_000_i32..100_000, 1 => Just(i32::MAX), 1 => any::<i32>()];
    let frame = prop_oneof![6 => Just(1_u8), 1 => Just(6), 1 => any::<u8>()];
    let height = prop_oneof![6 => -5.0_f32..0.0, 1 => Just(f32::NAN), 1 => any::<f32>()];
    ([float.clone(), float.clone(), float.clone(), float], [place.clone(), place], command, frame, 0_u8..2, height)
        .prop_map(|(parameters, place, command, frame, autocontinue, height)| MissionItem {
            frame,
            command,
            autocontinue,
            parameters,
            place,
            height,
        })
}

fn any_request() -> impl Strategy<Value = MissionRequest> {
    let plan = prop_oneof![6 => Just(0_u8), 3 => Just(1), 1 => Just(2), 1 => any::<u8>()].boxed();
    let number = prop_oneof![8 => 0_u16..4, 1 => any::<u16>()].boxed();
    prop_oneof![
        3 => (plan.clone(), number.clone()).prop_map(|(plan, count)| MissionRequest::Count { plan, count }),
        9 => (plan.clone(), number.clone(), any_item())
            .prop_map(|(plan, sequence, item)| MissionRequest::Item { plan, sequence, item }),
        1 => (plan.clone(), any::<u8>()).prop_map(|(plan, result)| MissionRequest::Acknowledge { plan, result }),
        1 => plan.clone().prop_map(|plan| MissionRequest::List { plan }),
        1 => (plan.clone(), number.clone()).prop_map(|(plan, sequence)| MissionRequest::Fetch { plan, sequence }),
        1 => plan.clone().prop_map(|plan| MissionRequest::Clear { plan }),
        1 => number.prop_map(|sequence| MissionRequest::SetCurrent { sequence }),
        1 => plan.prop_map(|plan| MissionRequest::Partial { plan }),
    ]
}

proptest! {
    #[test]
    fn no_request_panics_answers_at_length_or_changes_a_plan_half_way(
        requests in proptest::collection::vec((any_request(), any::<bool>(), 0.0_f64..0.5), 1..100)
    ) {
        let mut protocol = MissionProtocol::new(Home::default());
        let mut secs = 0.0;
        for (request, other, pause_secs) in requests {
            let before = protocol.identifiers();
            let mut answers = Vec::new();
            let event = protocol.handle(&request, if other { OTHER } else { PEER }, secs, &mut |payload| {
                answers.push(heard(&payload));
            });
            prop_assert!(answers.len() <= 1);
            let accepted = matches!(answers[..], [Heard::Acknowledged { result: 0, .. }]);
            prop_assert!(accepted || protocol.identifiers() == before, "changed without saying so");
            prop_assert!(accepted || event.is_none() || matches!(event, Some(MissionEvent::JumpTo(_))));
            secs += pause_secs;
            let mut told = 0;
            protocol.tick(secs, &mut |_| told += 1);
            prop_assert!(told <= 2);
            prop_assert_eq!(protocol.legs().len(), protocol.mission.len());
        }
    }

    #[test]
    fn no_bytes_of_a_mission_message_panic(
        id in prop_oneof![Just(37_u32), Just(38), Just(39), Just(40), Just(41), Just(43), Just(44), Just(45), Just(47), Just(51), Just(73)],
        payload in proptest::collection::vec(any::<u8>(), 0..60)
    ) {
        let frame = crate::frame::Frame { version: crate::frame::FrameVersion::V2, sequence: 0, system: 255, component: 190, message_id: id, payload: &payload, bytes: &payload };
        let (_, request) = received::request(&frame).unwrap();
        let mut protocol = MissionProtocol::new(Home::default());
        protocol.handle(&MissionRequest::Count { plan: 0, count: 1 }, PEER, 0.0, &mut |_| {});
        protocol.handle(&request, PEER, 0.0, &mut |_| {});
    }
}
