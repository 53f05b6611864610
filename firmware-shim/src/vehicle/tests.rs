use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::Pilot;
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavCmd, MavFrame, MavMessage,
    MavModeFlag, PositionTargetTypemask,
};
use proptest::prelude::*;

use super::*;
use crate::plant::{FlatFloor, Plant};
use crate::testing::{command_long, datagram, dishonest_policy, hover_policy, message, pilot, set_point};

const NAN: f32 = f32::NAN;
const ARM: [f32; 7] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
const DISARM: [f32; 7] = [0.0; 7];
const LEFT_OPEN: [f32; 7] = [NAN; 7];

/// A vehicle in its plant, and what it said.
struct Rig {
    vehicle: MavlinkVehicle<Pilot<'static>>,
    plant: FlatFloor,
    heard: Vec<MavMessage>,
}

impl Rig {
    fn new() -> Self {
        Self::with(hover_policy())
    }

    fn with(policy: Vec<u8>) -> Self {
        let vehicle = MavlinkVehicle::new(pilot(policy), 1);
        let plant = FlatFloor::new(&CF2X, vehicle.control_period().as_secs_f32());
        let mut rig = Self { vehicle, plant, heard: Vec::new() };
        rig.tick();
        rig
    }

    fn flying() -> Self {
        let mut rig = Self::new();
        rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        rig.accepted(MavCmd::MAV_CMD_NAV_TAKEOFF, LEFT_OPEN);
        rig.fly(6.0);
        assert_eq!(rig.vehicle.mode(), Mode::Holding);
        rig
    }

    fn tick(&mut self) -> [f32; 4] {
        let heard = &mut self.heard;
        let targets = self.vehicle.tick(self.plant.state(), &mut |frame| heard.push(message(frame)));
        self.plant.step(&targets);
        targets
    }

    fn fly(&mut self, secs: f32) {
        for _ in 0..(secs / self.vehicle.control_period().as_secs_f32()).round() as u32 {
            self.tick();
        }
    }

    /// What is answered to a datagram with the next tick, without the telemetry.
    fn answers(&mut self, datagram: &[u8]) -> Vec<MavMessage> {
        self.heard.clear();
        self.vehicle.receive(datagram);
        self.tick();
        let streamed = |message: &MavMessage| Stream::of_message(mavlink::Message::message_id(message)).is_some();
        self.heard.drain(..).filter(|message| !streamed(message)).collect()
    }

    fn result(&mut self, message: &COMMAND_LONG_DATA) -> MavResult {
        match &self.answers(&datagram(message))[..] {
            [MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command, result }), ..] => {
                assert_eq!(*command, message.command);
                *result
            }
            answers => panic!("{answers:?}"),
        }
    }

    fn accepted(&mut self, command: MavCmd, parameters: [f32; 7]) {
        assert_eq!(self.result(&command_long(command, parameters)), MavResult::MAV_RESULT_ACCEPTED, "{command:?}");
    }

    fn refused(&mut self, command: MavCmd, parameters: [f32; 7], result: MavResult) {
        let mode = self.vehicle.mode();
        assert_eq!(self.result(&command_long(command, parameters)), result, "{command:?} {parameters:?}");
        assert_eq!(self.vehicle.mode(), mode);
    }
}

fn texts(answers: &[MavMessage]) -> Vec<&str> {
    answers.iter().filter_map(text).collect()
}

fn text(message: &MavMessage) -> Option<&str> {
    match message {
        MavMessage::STATUSTEXT(status) => status.text.to_str().ok(),
        _ => None,
    }
}

#[test]
fn a_flight_by_messages_ends_where_it_was_sent() {
    let mut rig = Rig::flying();
    assert_eq!(rig.answers(&datagram(&set_point([0.5, 1.0, -1.5]))), []);
    rig.fly(16.0);
    let position = rig.plant.state().position;
    assert!((position - nalgebra::Vector3::new(1.0, 0.5, 1.5)).norm() < 0.1, "north is y, east is x: {position}");
    rig.accepted(MavCmd::MAV_CMD_NAV_LAND, LEFT_OPEN);
    rig.fly(10.0);
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
    assert_eq!(texts(&rig.heard), ["landed", "disarmed"]);
}

#[test]
fn telemetry_is_timed_by_the_simulation() {
    let mut rig = Rig::new();
    rig.heard.clear();
    rig.fly(10.0);
    let count = |id| rig.heard.iter().filter(|message| mavlink::Message::message_id(*message) == id).count();
    assert_eq!([0, 1, 245, 30, 32].map(count), [10, 10, 20, 500, 500]);
}

#[test]
fn a_heartbeat_shows_arming() {
    let mut rig = Rig::new();
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    rig.heard.clear();
    rig.fly(1.0);
    let armed = rig.heard.iter().any(|message| match message {
        MavMessage::HEARTBEAT(heartbeat) => heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
        _ => false,
    });
    assert!(armed);
}

#[test]
fn refusals_say_what_kind_they_are() {
    use MavCmd::{
        MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_DO_PAUSE_CONTINUE, MAV_CMD_DO_SET_MODE, MAV_CMD_NAV_LAND,
        MAV_CMD_NAV_TAKEOFF, MAV_CMD_REQUEST_MESSAGE,
    };
    use MavResult::{MAV_RESULT_DENIED, MAV_RESULT_TEMPORARILY_REJECTED, MAV_RESULT_UNSUPPORTED};
    let mut rig = Rig::new();
    rig.refused(MAV_CMD_NAV_TAKEOFF, LEFT_OPEN, MAV_RESULT_TEMPORARILY_REJECTED);
    rig.refused(MAV_CMD_NAV_LAND, LEFT_OPEN, MAV_RESULT_TEMPORARILY_REJECTED);
    rig.refused(MAV_CMD_COMPONENT_ARM_DISARM, LEFT_OPEN, MAV_RESULT_DENIED);
    rig.refused(MAV_CMD_DO_SET_MODE, DISARM, MAV_RESULT_UNSUPPORTED);
    rig.refused(MAV_CMD_REQUEST_MESSAGE, [242.0; 7], MAV_RESULT_DENIED);
    rig.refused(MAV_CMD_REQUEST_MESSAGE, LEFT_OPEN, MAV_RESULT_DENIED);
    rig.accepted(MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    rig.refused(MAV_CMD_NAV_TAKEOFF, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 500.0], MAV_RESULT_DENIED);
    rig.refused(MAV_CMD_NAV_TAKEOFF, [0.0, 0.0, 0.0, 0.0, 47.4, 8.5, 1.0], MAV_RESULT_DENIED);
    let mut rig = Rig::flying();
    rig.refused(MAV_CMD_COMPONENT_ARM_DISARM, DISARM, MAV_RESULT_TEMPORARILY_REJECTED);
    rig.refused(MAV_CMD_DO_PAUSE_CONTINUE, ARM, MAV_RESULT_DENIED);
    rig.accepted(MAV_CMD_DO_PAUSE_CONTINUE, DISARM);
    rig.accepted(MAV_CMD_COMPONENT_ARM_DISARM, [0.0, FORCED, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
}

#[test]
fn a_dishonest_policy_fails_to_arm() {
    let mut rig = Rig::with(dishonest_policy());
    let answers = rig.answers(&datagram(&command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM)));
    assert!(matches!(
        &answers[0],
        MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { result: MavResult::MAV_RESULT_FAILED, .. })
    ));
    assert_eq!(texts(&answers), ["arming refused: policy self-test failed"]);
}

#[test]
fn a_command_unknown_to_the_dialect_is_unsupported() {
    let mut rig = Rig::new();
    let mut fields = [0; 33];
    fields[28..30].copy_from_slice(&60_000_u16.to_le_bytes());
    fields[30..32].copy_from_slice(&[1, 1]);
    rig.vehicle.receive(&Encoder::new(255, 190).encode(&Payload::new(76, 152, &fields)));
    let mut acks = Vec::new();
    rig.vehicle.tick(rig.plant.state(), &mut |frame| acks.push(frame.to_vec()));
    let ack = acks.iter().find_map(|bytes| {
        let frame = Frames::new(bytes).next()?.ok()?;
        (frame.message_id == 77).then(|| frame.fields::<10>())
    });
    assert_eq!(ack, Some([0x60, 0xea, 3, 0, 0, 0, 0, 0, 255, 190]));
}

#[test]
fn a_command_int_is_asked_for_again_as_a_long() {
    let sent = COMMAND_INT_DATA {
        command: MavCmd::MAV_CMD_NAV_LAND,
        target_system: 1,
        target_component: 1,
        ..COMMAND_INT_DATA::default()
    };
    let expected =
        COMMAND_ACK_DATA { command: MavCmd::MAV_CMD_NAV_LAND, result: MavResult::MAV_RESULT_COMMAND_LONG_ONLY };
    assert_eq!(Rig::new().answers(&datagram(&sent)), [MavMessage::COMMAND_ACK(expected)]);
}

#[test]
fn requests_to_other_systems_are_none_of_its_business() {
    let mut rig = Rig::new();
    let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    for (target_system, target_component) in [(2, 1), (1, 2), (2, 0)] {
        let foreign = COMMAND_LONG_DATA { target_system, target_component, ..arm.clone() };
        assert_eq!(rig.answers(&datagram(&foreign)), []);
        assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
    }
    let everybody = COMMAND_LONG_DATA { target_system: 0, target_component: 0, ..arm };
    assert_eq!(rig.result(&everybody), MavResult::MAV_RESULT_ACCEPTED);
    let mut rig = Rig::flying();
    let mut foreign = set_point([3.0, 3.0, -3.0]);
    foreign.target_system = 2;
    assert_eq!(rig.answers(&datagram(&foreign)), []);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
}

#[test]
fn a_repeated_command_is_executed_once_and_answered_again() {
    let mut rig = Rig::new();
    let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_eq!(rig.result(&arm), MavResult::MAV_RESULT_ACCEPTED);
    let take_off = command_long(MavCmd::MAV_CMD_NAV_TAKEOFF, LEFT_OPEN);
    assert_eq!(rig.result(&take_off), MavResult::MAV_RESULT_ACCEPTED);
    for confirmation in 1..4 {
        let again = COMMAND_LONG_DATA { confirmation, ..take_off.clone() };
        assert_eq!(rig.result(&again), MavResult::MAV_RESULT_ACCEPTED, "not refused as in flight");
    }
    assert_eq!(rig.result(&take_off), MavResult::MAV_RESULT_TEMPORARILY_REJECTED, "a new one is");
}

#[test]
fn a_repetition_whose_original_was_lost_is_executed() {
    let mut rig = Rig::new();
    let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_eq!(rig.result(&COMMAND_LONG_DATA { confirmation: 2, ..arm }), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(rig.vehicle.mode(), Mode::Armed);
}

#[test]
fn a_repetition_long_after_is_executed_again() {
    let mut rig = Rig::new();
    let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    rig.result(&arm);
    rig.fly(11.0);
    assert_eq!(rig.vehicle.mode(), Mode::Disarmed);
    rig.result(&COMMAND_LONG_DATA { confirmation: 1, ..arm });
    assert_eq!(rig.vehicle.mode(), Mode::Armed);
}

#[test]
fn commands_of_more_senders_than_are_remembered_still_work() {
    let mut rig = Rig::new();
    let arm = Payload::of(&command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM));
    for sender in 200..210 {
        let datagram = Encoder::new(sender, 190).encode(&arm);
        assert_eq!(rig.answers(&datagram).len(), 1);
    }
}

#[test]
fn set_points_that_cannot_be_followed_are_refused_in_words_once_a_second() {
    let mut rig = Rig::flying();
    let velocity = {
        let mut wanted = set_point([0.0; 3]);
        wanted.type_mask = PositionTargetTypemask::from_bits_truncate(2503);
        wanted
    };
    assert_eq!(texts(&rig.answers(&datagram(&velocity))), ["set-point refused: only positions are followed"]);
    assert_eq!(rig.answers(&datagram(&velocity)), []);
    rig.fly(1.0);
    assert_eq!(texts(&rig.answers(&datagram(&velocity))), ["set-point refused: only positions are followed"]);
    let body = {
        let mut wanted = set_point([0.0, 0.0, -1.0]);
        wanted.coordinate_frame = MavFrame::MAV_FRAME_BODY_FRD;
        wanted
    };
    assert_eq!(texts(&rig.answers(&datagram(&body))), ["set-point refused: frame must be LOCAL_NED"]);
    let not_finite = set_point([NAN, 0.0, -1.0]);
    assert_eq!(texts(&rig.answers(&datagram(&not_finite))), ["set-point refused: not a finite number"]);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
}

#[test]
fn streams_can_be_set_and_versions_asked_for() {
    let mut rig = Rig::new();
    rig.accepted(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [30.0, 1e6, 0.0, 0.0, 0.0, 0.0, 0.0]);
    rig.refused(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, [24.0; 7], MavResult::MAV_RESULT_DENIED);
    rig.heard.clear();
    rig.fly(10.0);
    let attitudes = rig.heard.iter().filter(|message| matches!(message, MavMessage::ATTITUDE(_))).count();
    assert_eq!(attitudes, 10);
    let request = command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [148.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let answers = rig.answers(&datagram(&request));
    assert!(answers.iter().any(|answer| matches!(answer, MavMessage::AUTOPILOT_VERSION(_))), "{answers:?}");
}

#[test]
fn garbage_is_counted_and_makes_nobody_a_peer() {
    let mut rig = Rig::new();
    assert!(!rig.vehicle.receive(b"GET / HTTP/1.1"));
    assert!(!rig.vehicle.receive(&[]));
    assert!(!rig.vehicle.receive(&[0xfd; 300]), "one frame with unknown flags, and a part of one");
    assert!(rig.vehicle.receive(&datagram(&HEARTBEAT_DATA::default())));
    assert_eq!(rig.vehicle.counts(), Counts { frames: 1, garbage: 3, unanswered: 0 });
}

#[test]
fn a_flood_of_requests_is_answered_as_far_as_there_is_room() {
    let mut rig = Rig::new();
    let request = datagram(&command_long(MavCmd::MAV_CMD_NAV_LAND, LEFT_OPEN));
    for _ in 0..100 {
        rig.vehicle.receive(&request);
    }
    assert_eq!(rig.vehicle.counts().unanswered, 101 - ANSWERS as u64);
    assert_eq!(rig.answers(&request).len(), ANSWERS);
    assert_eq!(rig.answers(&request).len(), 1);
}

#[test]
fn every_text_fits_its_message() {
    let refusals = [
        Refusal::SelfTest,
        Refusal::StateUnknown,
        Refusal::NotLevel,
        Refusal::Moving,
        Refusal::NotArmed,
        Refusal::InFlight,
        Refusal::NotCruising,
        Refusal::NotFlying,
        Refusal::Altitude,
        Refusal::Speed,
    ];
    let errors = [
        SetPointError::Frame,
        SetPointError::Motion,
        SetPointError::Position,
        SetPointError::NotFinite,
        SetPointError::Outside,
    ];
    for text in refusals.map(Refusal::text).iter().chain(&errors.map(SetPointError::text)) {
        assert!(text.len() <= 50, "{text} has {}", text.len());
    }
}

#[test]
fn the_same_datagrams_at_the_same_ticks_make_the_same_flight() {
    let fly = || {
        let mut rig = Rig::flying();
        for i in 0..20_u8 {
            rig.vehicle.receive(&datagram(&set_point([f32::from(i) * 0.1, 0.3, -1.2])));
            rig.fly(0.37);
        }
        *rig.plant.state()
    };
    assert_eq!(fly(), fly());
}

/// A checksummed frame of a message that carries requests, with any fields.
fn any_request() -> impl Strategy<Value = Vec<u8>> {
    let message = prop_oneof![Just((75_u32, 158_u8, 35_usize)), Just((76, 152, 33)), Just((84, 143, 53))];
    let commands =
        prop_oneof![Just(400_u16), Just(22), Just(21), Just(193), Just(511), Just(512), Just(176), any::<u16>()];
    let special = prop_oneof![Just(0.0_f32), Just(1.0), Just(NAN), Just(f32::INFINITY), any::<f32>()];
    let floats = proptest::collection::vec(special, 12);
    let tail = proptest::collection::vec(any::<u8>(), 53);
    (message, commands, floats, tail, 0_u8..3).prop_map(
        |((id, seed, len), command, floats, mut fields, target)| {
            for (bytes, float) in fields.chunks_exact_mut(4).zip(floats) {
                bytes.copy_from_slice(&float.to_le_bytes());
            }
            if id == 84 {
                fields[48..53].copy_from_slice(&[0xf8, 0x0d, target, 0, 1]);
            } else {
                fields[28..30].copy_from_slice(&command.to_le_bytes());
                fields[30..33].copy_from_slice(&[target, 0, 0]);
            }
            Encoder::new(255, 190).encode(&Payload::new(id, seed, &fields[..len])).to_vec()
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(128))]
    #[test]
    fn no_request_panics_or_reaches_the_motors_as_nonsense(
        requests in proptest::collection::vec(any_request(), 1..40)
    ) {
        let mut rig = Rig::flying();
        let limit = CF2X.rotor_speed_limit as f32 * 1.000_001;
        for request in requests {
            prop_assert!(rig.vehicle.receive(&request));
            for _ in 0..5 {
                let targets = rig.vehicle.tick(rig.plant.state(), &mut |_| {});
                rig.plant.step(&targets);
                prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)));
            }
        }
    }
}
