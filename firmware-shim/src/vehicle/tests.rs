#![expect(deprecated, reason = "peers still send them")]
#![expect(clippy::wildcard_enum_match_arm, reason = "a message is one of the dialect's hundreds")]

mod camera;
mod files;
mod operators;
mod personalities;
mod plans;
mod repetitions;
mod sticks;
mod telemetry;

use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::Pilot;
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, EVENT_DATA, HEARTBEAT_DATA, MavCmd, MavFrame,
    MavMessage, MavModeFlag, MavParamType, MavResult, MavType, PARAM_SET_DATA, PositionTargetTypemask,
    REQUEST_EVENT_DATA, RESPONSE_EVENT_ERROR_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA, TIMESYNC_DATA,
};
use proptest::prelude::*;

use super::*;
use crate::frame::Encoder;
use crate::link::EndpointId;
use crate::plant::{FlatFloor, Plant};
use crate::testing::{
    CONTROL_STATUS, command_long, datagram, datagram_of, dishonest_policy, hover_policy, pilot, profile,
    set_point, told,
};

const NAN: f32 = f32::NAN;
const ARM: [f32; 7] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
const DISARM: [f32; 7] = [0.0; 7];
const LEFT_OPEN: [f32; 7] = [NAN; 7];

const PEER: Peer = Peer { link: 0, endpoint: EndpointId::ONLY };
const ANOTHER: Peer = Peer { link: 1, endpoint: EndpointId::ONLY };

/// A vehicle in its plant, and what it said to [`PEER`].
struct Rig {
    vehicle: Vehicle<Pilot<'static>>,
    plant: FlatFloor,
    heard: Vec<MavMessage>,
}

impl Rig {
    fn new() -> Self {
        Self::with(hover_policy())
    }

    fn with(policy: Vec<u8>) -> Self {
        let vehicle = Vehicle::new(pilot(policy), &CF2X, profile(1));
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
        let targets = self.vehicle.tick(self.plant.state(), &[PEER], &mut |_, frame| heard.extend(told(frame)));
        self.plant.step(&targets);
        targets
    }

    /// Whether the datagram was good; what is answered is heard.
    fn receive(&mut self, datagram: &[u8]) -> bool {
        let heard = &mut self.heard;
        self.vehicle.receive(PEER, datagram, &mut |frame| heard.extend(told(frame)))
    }

    fn fly(&mut self, secs: f32) {
        for _ in 0..(secs / self.vehicle.control_period().as_secs_f32()).round() as u32 {
            self.tick();
        }
    }

    /// What is answered to a datagram, at once and with the next tick, without the telemetry.
    fn answers(&mut self, datagram: &[u8]) -> Vec<MavMessage> {
        self.heard.clear();
        self.receive(datagram);
        self.tick();
        let streamed =
            |message: &MavMessage| TelemetryStream::of_message(mavlink::Message::message_id(message)).is_some();
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

    fn heartbeat(&mut self) -> HEARTBEAT_DATA {
        self.heard.clear();
        self.fly(1.0);
        let mut heartbeats = self.heard.iter().filter_map(|message| match message {
            MavMessage::HEARTBEAT(heartbeat) => Some(heartbeat.clone()),
            _ => None,
        });
        heartbeats.next_back().unwrap()
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
        MAV_CMD_NAV_TAKEOFF, MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, MAV_CMD_REQUEST_MESSAGE,
    };
    use MavResult::{MAV_RESULT_DENIED, MAV_RESULT_TEMPORARILY_REJECTED, MAV_RESULT_UNSUPPORTED};
    let mut rig = Rig::new();
    rig.refused(MAV_CMD_NAV_TAKEOFF, LEFT_OPEN, MAV_RESULT_TEMPORARILY_REJECTED);
    rig.refused(MAV_CMD_NAV_LAND, LEFT_OPEN, MAV_RESULT_TEMPORARILY_REJECTED);
    rig.refused(MAV_CMD_COMPONENT_ARM_DISARM, LEFT_OPEN, MAV_RESULT_DENIED);
    rig.refused(MAV_CMD_DO_SET_MODE, DISARM, MAV_RESULT_DENIED);
    rig.refused(MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, ARM, MAV_RESULT_UNSUPPORTED);
    rig.refused(MAV_CMD_REQUEST_MESSAGE, [100.0; 7], MAV_RESULT_DENIED);
    rig.accepted(MAV_CMD_REQUEST_MESSAGE, [242.0; 7]);
    rig.refused(MAV_CMD_REQUEST_MESSAGE, LEFT_OPEN, MAV_RESULT_DENIED);
    rig.accepted(MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    rig.refused(MAV_CMD_NAV_TAKEOFF, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 600.0], MAV_RESULT_DENIED);
    rig.refused(MAV_CMD_NAV_TAKEOFF, [0.0, 0.0, 0.0, 0.0, 47.4, 8.5, 1.0], MAV_RESULT_DENIED);
    let mut rig = Rig::flying();
    rig.refused(MAV_CMD_COMPONENT_ARM_DISARM, DISARM, MAV_RESULT_TEMPORARILY_REJECTED);
    rig.refused(MAV_CMD_DO_PAUSE_CONTINUE, ARM, MAV_RESULT_TEMPORARILY_REJECTED);
    rig.accepted(MAV_CMD_DO_PAUSE_CONTINUE, DISARM);
    rig.accepted(MAV_CMD_COMPONENT_ARM_DISARM, [0.0, 21196.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
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
    assert_eq!(texts(&answers), ["refused: policy self-test failed"]);
}

#[test]
fn a_command_unknown_to_the_dialect_is_unsupported() {
    let mut rig = Rig::new();
    let mut fields = [0; 33];
    fields[28..30].copy_from_slice(&60_000_u16.to_le_bytes());
    fields[30..32].copy_from_slice(&[1, 1]);
    let command = Encoder::new(255, 190).encode(&Payload::new(76, 152, &fields));
    let mut acks = Vec::new();
    rig.vehicle.receive(PEER, &command, &mut |frame| acks.push(frame.to_vec()));
    let ack = acks.iter().find_map(|bytes| {
        let frame = Frames::new(bytes).next()?.ok()?;
        (frame.message_id == 77).then(|| frame.fields::<10>())
    });
    assert_eq!(ack, Some([0x60, 0xea, 3, 0, 0, 0, 0, 0, 255, 190]));
}

#[test]
fn a_command_with_integers_works_as_well() {
    let mut rig = Rig::new();
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    let sent = COMMAND_INT_DATA {
        command: MavCmd::MAV_CMD_NAV_TAKEOFF,
        z: 1.5,
        target_system: 1,
        target_component: 1,
        ..COMMAND_INT_DATA::default()
    };
    let expected =
        COMMAND_ACK_DATA { command: MavCmd::MAV_CMD_NAV_TAKEOFF, result: MavResult::MAV_RESULT_ACCEPTED };
    assert_eq!(rig.answers(&datagram(&sent)), [MavMessage::COMMAND_ACK(expected)]);
    assert_eq!(rig.vehicle.mode(), Mode::TakingOff);
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
fn set_points_that_cannot_be_followed_are_refused_in_words_once_a_second() {
    let mut rig = Rig::flying();
    let velocity = {
        let mut wanted = set_point([0.0; 3]);
        wanted.type_mask = PositionTargetTypemask::from_bits_truncate(2503);
        wanted
    };
    assert_eq!(texts(&rig.answers(&datagram(&velocity))), ["set-point waits for the offboard mode"]);
    assert_eq!(rig.answers(&datagram(&velocity)), []);
    rig.fly(1.0);
    assert_eq!(texts(&rig.answers(&datagram(&velocity))), ["set-point waits for the offboard mode"]);
    let other = {
        let mut wanted = set_point([0.0, 0.0, -1.0]);
        wanted.coordinate_frame = MavFrame::MAV_FRAME_LOCAL_ENU;
        wanted
    };
    assert_eq!(texts(&rig.answers(&datagram(&other))), ["set-point refused: frame is not understood"]);
    let not_finite = set_point([NAN, 0.0, -1.0]);
    assert_eq!(texts(&rig.answers(&datagram(&not_finite))), ["set-point refused: not a finite number"]);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
}

#[test]
fn garbage_is_counted_and_makes_nobody_a_peer() {
    let mut rig = Rig::new();
    assert!(!rig.receive(b"GET / HTTP/1.1"));
    assert!(!rig.receive(&[]));
    assert!(!rig.receive(&[0xfd; 300]), "one frame with unknown flags, and a part of one");
    assert!(rig.receive(&datagram(&HEARTBEAT_DATA::default())));
    assert_eq!(rig.vehicle.counts(), Counts { frames: 1, garbage: 3, refused: 0, unanswered: 0 });
}

#[test]
fn a_flood_of_requests_is_answered_and_one_of_changes_as_far_as_there_is_room() {
    let mut rig = Rig::new();
    let request = datagram(&command_long(MavCmd::MAV_CMD_NAV_LAND, LEFT_OPEN));
    rig.heard.clear();
    rig.receive(&request.repeat(100));
    assert_eq!(rig.heard.len(), 101, "and why it is refused, once");
    let changes = [2.0, 3.0].map(|value| datagram(&parameter("RTL_RETURN_ALT", value)));
    rig.heard.clear();
    rig.receive(&changes.concat().repeat(50));
    assert!(rig.heard.is_empty(), "everybody hears of it with the next tick");
    assert_eq!(rig.vehicle.counts().unanswered, 100 - ANSWERS as u64);
    rig.tick();
    let told = rig.heard.iter().filter(|message| matches!(message, MavMessage::PARAM_VALUE(_))).count();
    assert_eq!(told, ANSWERS);
}

fn parameter(name: &str, value: f32) -> PARAM_SET_DATA {
    PARAM_SET_DATA {
        param_value: value,
        target_system: 1,
        target_component: 1,
        param_id: name.into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
    }
}

#[test]
fn what_cannot_be_had_is_answered() {
    let mut rig = Rig::new();
    let ask = |message_id, seed, fields: &[u8]| {
        Encoder::new(255, 190).encode(&Payload::new(message_id, seed, fields)).to_vec()
    };
    // LOG_REQUEST_LIST, all of them, of system 1.
    let logs = rig.answers(&ask(117, 128, &[0, 0, 255, 255, 1, 1]));
    assert!(matches!(&logs[..], [MavMessage::LOG_ENTRY(entry)] if entry.num_logs == 0), "{logs:?}");
    // Of another vehicle.
    assert!(rig.answers(&ask(117, 128, &[0, 0, 255, 255, 2, 1])).is_empty());
    // SET_GPS_GLOBAL_ORIGIN to 0°, 0°.
    let mut fields = [0; 13];
    fields[12] = 1;
    let origin = rig.answers(&ask(48, 41, &fields));
    let [latitude, longitude] = Home::default().place().integers();
    assert!(
        matches!(&origin[..], [MavMessage::GPS_GLOBAL_ORIGIN(told), ..]
            if [told.latitude, told.longitude] == [latitude, longitude]),
        "{origin:?}"
    );
    assert_eq!(texts(&origin), ["origin refused: it is that of --home"]);
    let version = rig.answers(&datagram(&command_long(MavCmd::MAV_CMD_REQUEST_PROTOCOL_VERSION, [1.0; 7])));
    assert!(matches!(&version[..], [MavMessage::PROTOCOL_VERSION(_), MavMessage::COMMAND_ACK(_)]), "{version:?}");
    let standard = |number| [number, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    // No take-off before it is armed, no mission without items, and orbits not at all.
    rig.refused(MavCmd::MAV_CMD_DO_SET_STANDARD_MODE, standard(2.0), MavResult::MAV_RESULT_DENIED);
    let mut flying = Rig::flying();
    flying.accepted(MavCmd::MAV_CMD_DO_SET_STANDARD_MODE, standard(7.0));
    assert_eq!(flying.vehicle.mode(), Mode::Landing);
    rig.refused(MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT, standard(0.0), MavResult::MAV_RESULT_DENIED);
}

#[test]
fn peers_of_a_fast_flight_may_be_silent_by_their_own_clocks() {
    let mut rig = Rig::flying();
    rig.vehicle.set_pace(12.0);
    let heartbeat = HEARTBEAT_DATA { mavtype: MavType::MAV_TYPE_GCS, ..HEARTBEAT_DATA::default() };
    for _ in 0..5 {
        rig.receive(&datagram(&heartbeat));
        rig.fly(12.0);
    }
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
    rig.fly(108.1);
    assert_eq!(rig.vehicle.mode(), Mode::Landing);
}

/// A vehicle whose task a command has stopped; what it told.
fn stopped_task() -> Rig {
    let mut rig = Rig::flying();
    rig.vehicle.offer_task(PolicyRole::SetPointsToo);
    let ask = command_long(MavCmd::MAV_CMD_USER_1, [3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let land = command_long(MavCmd::MAV_CMD_NAV_LAND, LEFT_OPEN);
    rig.receive(&[datagram(&ask), datagram(&land)].concat());
    rig.heard.clear();
    rig.vehicle.tend_task(&mut rig.plant);
    rig.fly(0.1);
    rig
}

#[test]
fn a_command_that_comes_before_a_task_has_begun_stops_it() {
    let rig = stopped_task();
    assert_eq!(texts(&rig.heard), ["task stopped"]);
    assert_eq!(rig.vehicle.mode(), Mode::Landing);
}

#[test]
fn an_event_that_was_missed_is_sent_again() {
    let mut rig = stopped_task();
    let told: Vec<&EVENT_DATA> = rig
        .heard
        .iter()
        .filter_map(|message| match message {
            MavMessage::EVENT(told) => Some(told),
            _ => None,
        })
        .collect();
    assert_eq!(told.iter().map(|told| (told.id, told.sequence)).collect::<Vec<_>>(), [(1 << 24 | 3, 1)]);
    let told = told[0].clone();
    let ask = |first_sequence, last_sequence| {
        datagram(&REQUEST_EVENT_DATA { first_sequence, last_sequence, target_system: 1, target_component: 1 })
    };
    let again = rig.answers(&ask(1, 2));
    assert_eq!(again[0], MavMessage::EVENT(told));
    let missing = RESPONSE_EVENT_ERROR_DATA {
        sequence: 2,
        sequence_oldest_available: 1,
        target_system: 255,
        target_component: 190,
        ..RESPONSE_EVENT_ERROR_DATA::default()
    };
    assert_eq!(again[1..], [MavMessage::RESPONSE_EVENT_ERROR(missing)]);
    assert_eq!(rig.answers(&ask(60_000, 10_000)).len(), 16, "a few at a time");
    rig.heard.clear();
    rig.fly(1.1);
    let is_sequence =
        |message: &MavMessage| matches!(message, MavMessage::CURRENT_EVENT_SEQUENCE(told) if told.sequence == 1);
    assert!(rig.heard.iter().any(is_sequence), "who missed it hears of it");
}

#[test]
fn every_text_fits_its_message() {
    let texts = Refusal::ALL.map(Refusal::text).into_iter();
    let texts = texts
        .chain(SetPointError::ALL.map(SetPointError::text))
        .chain(FailsafeEvent::ALL.map(FailsafeEvent::text));
    for text in texts {
        assert!(text.len() <= 50, "{text} has {}", text.len());
    }
}

#[test]
fn the_same_datagrams_at_the_same_ticks_make_the_same_flight() {
    let fly = || {
        let mut rig = Rig::flying();
        for i in 0..20_u8 {
            rig.receive(&datagram(&set_point([f32::from(i) * 0.1, 0.3, -1.2])));
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
            let good = rig.vehicle.receive(PEER, &request, &mut |_| {});
            prop_assert!(good);
            for _ in 0..5 {
                let targets = rig.vehicle.tick(rig.plant.state(), &[], &mut |_, _| {});
                rig.plant.step(&targets);
                prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)));
            }
        }
    }
}

fn command(rig: &mut Rig, command: MavCmd, parameters: &[f32]) -> MavResult {
    let mut all = [0.0; 7];
    all[..parameters.len()].copy_from_slice(parameters);
    rig.result(&command_long(command, all))
}

#[test]
fn modes_are_chosen_by_number_and_told_by_name() {
    use MavResult::{MAV_RESULT_ACCEPTED, MAV_RESULT_DENIED, MAV_RESULT_TEMPORARILY_REJECTED};
    let mut rig = Rig::flying();
    let choose =
        |rig: &mut Rig, main: f32, sub: f32| command(rig, MavCmd::MAV_CMD_DO_SET_MODE, &[129.0, main, sub]);
    assert_eq!(choose(&mut rig, 4.0, 12.0), MAV_RESULT_ACCEPTED);
    assert_eq!(rig.heartbeat().custom_mode, FlightMode::Cascade.custom_mode());
    assert_eq!(choose(&mut rig, 4.0, 11.0), MAV_RESULT_ACCEPTED);
    assert_eq!(rig.heartbeat().custom_mode, FlightMode::Policy.custom_mode());
    assert_eq!(choose(&mut rig, 6.0, 0.0), MAV_RESULT_TEMPORARILY_REJECTED, "no set-points");
    assert_eq!(choose(&mut rig, 1.0, 0.0), MAV_RESULT_DENIED, "manual flight");
    assert_eq!(choose(&mut rig, 4.0, 5.0), MAV_RESULT_ACCEPTED);
    assert_eq!(rig.vehicle.mode(), Mode::Returning);
    assert_eq!(choose(&mut rig, 4.0, 3.0), MAV_RESULT_ACCEPTED);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
    let request = command_long(MavCmd::MAV_CMD_REQUEST_MESSAGE, [435.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    let names: Vec<String> = rig
        .answers(&datagram(&request))
        .iter()
        .filter_map(|answer| match answer {
            MavMessage::AVAILABLE_MODES(mode) => Some(mode.mode_name.to_str().unwrap().to_owned()),
            _ => None,
        })
        .collect();
    assert_eq!(
        names,
        ["RL:linear hover", "PID", "Hold", "Position", "Offboard", "Takeoff", "Land", "Return", "Mission"]
    );
}

#[test]
fn a_mode_is_chosen_by_its_whole_number_as_well() {
    let mut rig = Rig::flying();
    for mode in [FlightMode::Cascade, FlightMode::Policy] {
        let whole = [1.0, mode.custom_mode() as f32, 0.0];
        assert_eq!(command(&mut rig, MavCmd::MAV_CMD_DO_SET_MODE, &whole), MavResult::MAV_RESULT_ACCEPTED);
        assert_eq!(rig.heartbeat().custom_mode, mode.custom_mode());
    }
}

#[test]
fn a_stream_of_velocities_is_followed_in_the_offboard_mode() {
    let mut rig = Rig::flying();
    let velocity = SET_POSITION_TARGET_LOCAL_NED_DATA {
        vx: 0.3,
        type_mask: PositionTargetTypemask::from_bits_truncate(2503),
        ..set_point([0.0; 3])
    };
    rig.answers(&datagram(&velocity));
    assert_eq!(command(&mut rig, MavCmd::MAV_CMD_DO_SET_MODE, &[129.0, 6.0, 0.0]), MavResult::MAV_RESULT_ACCEPTED);
    for _ in 0..50 {
        rig.receive(&datagram(&velocity));
        rig.fly(0.1);
    }
    let moved = rig.plant.state().velocity;
    assert!((moved - nalgebra::Vector3::new(0.0, 0.3, 0.0)).norm() < 0.05, "{moved}");
    rig.heard.clear();
    rig.fly(2.0);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
    assert_eq!(texts(&rig.heard), ["failsafe: no set-points"]);
}

#[test]
fn parameters_change_what_the_vehicle_does() {
    let mut rig = Rig::new();
    let answers = rig.answers(&datagram(&parameter("MIS_TAKEOFF_ALT", 1.7)));
    assert!(matches!(&answers[..], [MavMessage::PARAM_VALUE(value)] if value.param_value == 1.7), "{answers:?}");
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    rig.accepted(MavCmd::MAV_CMD_NAV_TAKEOFF, LEFT_OPEN);
    rig.fly(8.0);
    assert!((rig.plant.state().position.z - 1.7).abs() < 0.1);
}

#[test]
fn a_ground_station_that_falls_silent_is_noticed_in_its_time() {
    let mut rig = Rig::flying();
    let heartbeat = HEARTBEAT_DATA { mavtype: MavType::MAV_TYPE_GCS, ..HEARTBEAT_DATA::default() };
    rig.receive(&datagram(&heartbeat));
    rig.fly(10.0);
    assert_eq!(rig.vehicle.mode(), Mode::Holding);
    rig.fly(0.02);
    assert_eq!(rig.vehicle.mode(), Mode::Landing);
    assert!(texts(&rig.heard).contains(&"failsafe: ground station lost"));
}

#[test]
fn a_place_on_earth_is_flown_to() {
    let mut rig = Rig::flying();
    let origin = Home::default();
    let point = nalgebra::Vector3::new(1.0, -0.5, 1.2);
    let [x, y] = origin.place_of(&point).integers();
    let sent = COMMAND_INT_DATA {
        command: MavCmd::MAV_CMD_DO_REPOSITION,
        frame: MavFrame::MAV_FRAME_GLOBAL_INT,
        x,
        y,
        z: (origin.altitude_m + 1.2) as f32,
        target_system: 1,
        target_component: 1,
        ..COMMAND_INT_DATA::default()
    };
    rig.answers(&datagram(&sent));
    rig.fly(10.0);
    assert!((rig.plant.state().position - point).norm() < 0.1, "{}", rig.plant.state().position);
    let told = rig.heard.iter().rev().find_map(|message| match message {
        MavMessage::GLOBAL_POSITION_INT(position) => Some((position.lat, position.lon, position.relative_alt)),
        _ => None,
    });
    let (lat, lon, relative_alt) = told.unwrap();
    assert!((lat - x).abs() <= 10 && (lon - y).abs() <= 15 && (relative_alt - 1200).abs() < 100);
}

#[test]
fn questions_are_answered() {
    let mut rig = Rig::new();
    let answers = rig.answers(&datagram(&TIMESYNC_DATA { tc1: 0, ts1: 77 }));
    assert!(matches!(&answers[..], [MavMessage::TIMESYNC(TIMESYNC_DATA { tc1: 1.., ts1: 77 })]), "{answers:?}");
    // The next control period is not due for another 4 ms.
    let next_ns = (rig.vehicle.elapsed_secs() * 1e9) as i64;
    rig.vehicle.note_ahead(4e-3);
    let answers = rig.answers(&datagram(&TIMESYNC_DATA { tc1: 0, ts1: 77 }));
    let expected = TIMESYNC_DATA { tc1: next_ns - 4_000_000, ts1: 77 };
    assert!(
        matches!(&answers[..], [MavMessage::TIMESYNC(told)] if (told.tc1 - expected.tc1).abs() < 10),
        "{answers:?}"
    );
    rig.vehicle.note_ahead(0.0);
    // PING to everybody, time 5 and number 6.
    let ping = Payload::new(4, 237, &[5, 0, 0, 0, 0, 0, 0, 0, 6, 0, 0, 0, 0, 0]);
    let mut pongs = Vec::new();
    rig.vehicle.receive(PEER, &Encoder::new(255, 190).encode(&ping), &mut |frame| pongs.push(frame.to_vec()));
    let pong = pongs.iter().find_map(|bytes| {
        let frame = Frames::new(bytes).next()?.ok()?;
        (frame.message_id == 4).then(|| frame.fields::<14>())
    });
    assert_eq!(pong, Some([5, 0, 0, 0, 0, 0, 0, 0, 6, 0, 0, 0, 255, 190]));
}
