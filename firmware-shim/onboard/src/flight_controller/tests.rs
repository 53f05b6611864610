#![expect(deprecated, reason = "peers still send them")]

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use kestrel_core::pilot::Pilot;
use mavlink::dialects::common::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavCmd, MavFrame, MavModeFlag, MavResult, MavType,
    PositionTargetTypemask, SET_MODE_DATA, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use mavlink::{MavlinkVersion, MessageData};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;
use crate::autopilot::Mode;
use crate::controller::Controller;
use crate::failsafe::FailsafeEvent;
use crate::frame::Encoder;
use crate::frame::Frames;
use crate::plant::{FlatFloor, Plant};
use crate::signature::{SignatureTime, Signer, SigningKey};
use crate::signature_guard::Verifier;
use crate::testing::{hover_policy, pilot};

const IDENTITY: VehicleIdentity = VehicleIdentity {
    system: 1,
    origin: Home { latitude_deg: 47.397_742, longitude_deg: 8.545_594, altitude_m: 488.0 },
};

/// A vehicle in its plant, and a ground station.
struct Rig {
    controller: FlightController<Pilot<'static>>,
    plant: FlatFloor,
    station: Encoder,
}

impl Rig {
    fn new() -> Self {
        let controller = FlightController::new(pilot(hover_policy()), &CF2X, IDENTITY);
        let plant = FlatFloor::new(&CF2X, controller.autopilot().control_secs());
        let mut rig = Self { controller, plant, station: Encoder::new(255, 190) };
        rig.fly(0.01);
        rig
    }

    /// One that hovers a metre above the floor.
    fn hovering() -> Self {
        let mut rig = Self::new();
        rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0]);
        rig.accepted(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0; 2]);
        rig.fly(6.0);
        assert_eq!(rig.mode(), Mode::Holding);
        rig
    }

    fn mode(&self) -> Mode {
        self.controller.autopilot().mode()
    }

    fn receive(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.controller.receive(*byte);
        }
    }

    fn send<D: MessageData>(&mut self, message: &D) {
        let bytes = self.station.encode(&Payload::of(message));
        self.receive(&bytes);
    }

    fn command(&mut self, command: MavCmd, parameters: [f32; 2]) -> MavResult {
        let results = self.results(&command_long(command, parameters));
        assert_eq!(results.len(), 1);
        results[0]
    }

    /// The results of the acknowledgements of a command.
    fn results(&mut self, command: &COMMAND_LONG_DATA) -> Vec<MavResult> {
        self.send(command);
        let mut results = Vec::new();
        while let Some(bytes) = self.controller.next_answer() {
            let frame = Frames::new(&bytes).next().unwrap().unwrap();
            let answer = COMMAND_ACK_DATA::deser(MavlinkVersion::V2, frame.payload).unwrap();
            assert_eq!(answer.command, command.command);
            results.push(answer.result);
        }
        results
    }

    fn accepted(&mut self, command: MavCmd, parameters: [f32; 2]) {
        assert_eq!(self.command(command, parameters), MavResult::MAV_RESULT_ACCEPTED, "{command:?}");
    }

    fn fly(&mut self, secs: f32) -> Vec<FailsafeEvent> {
        let mut events = Vec::new();
        for _ in 0..(secs / self.controller.autopilot().control_secs()).round() as u32 {
            let targets = self.controller.tick(self.plant.state(), 1.0);
            events.extend_from_slice(self.controller.autopilot().events());
            self.plant.step(&targets);
        }
        events
    }
}

fn command_long(command: MavCmd, [param1, param2]: [f32; 2]) -> COMMAND_LONG_DATA {
    let open = COMMAND_LONG_DATA { param5: f32::NAN, param6: f32::NAN, param7: f32::NAN, ..Default::default() };
    COMMAND_LONG_DATA { param1, param2, command, target_system: 1, target_component: 1, ..open }
}

fn ground_station() -> HEARTBEAT_DATA {
    HEARTBEAT_DATA { mavtype: MavType::MAV_TYPE_GCS, ..HEARTBEAT_DATA::default() }
}

fn set_point([x, y, z]: [f32; 3]) -> SET_POSITION_TARGET_LOCAL_NED_DATA {
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

#[test]
fn it_takes_off_goes_somewhere_and_lands_on_command() {
    let mut rig = Rig::hovering();
    rig.send(&set_point([0.5, 0.25, -1.2]));
    rig.fly(5.0);
    assert_eq!(rig.mode(), Mode::Guided);
    assert!((rig.plant.state().position - Vector3::new(0.25, 0.5, 1.2)).norm() < 0.1);
    rig.accepted(MavCmd::MAV_CMD_NAV_LAND, [0.0; 2]);
    rig.fly(12.0);
    assert_eq!(rig.mode(), Mode::Disarmed);
    assert!(rig.plant.state().position.z < 0.05);
}

#[test]
fn what_is_refused_is_said() {
    let mut rig = Rig::new();
    let cases = [
        (MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0; 2], MavResult::MAV_RESULT_TEMPORARILY_REJECTED),
        (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [f32::NAN; 2], MavResult::MAV_RESULT_DENIED),
        (MavCmd::MAV_CMD_MISSION_START, [0.0; 2], MavResult::MAV_RESULT_TEMPORARILY_REJECTED),
        (MavCmd::MAV_CMD_DO_SET_SERVO, [0.0; 2], MavResult::MAV_RESULT_UNSUPPORTED),
    ];
    for (command, parameters, result) in cases {
        assert_eq!(rig.command(command, parameters), result, "{command:?}");
    }
    assert_eq!(rig.mode(), Mode::Disarmed);
}

#[test]
fn a_repeated_command_is_executed_once_and_acknowledged_again() {
    let mut rig = Rig::new();
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0]);
    let take_off = command_long(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0; 2]);
    assert_eq!(rig.results(&take_off), [MavResult::MAV_RESULT_ACCEPTED]);
    rig.fly(0.5);
    rig.accepted(MavCmd::MAV_CMD_DO_FLIGHTTERMINATION, [1.0, 0.0]);
    for confirmation in 1..4 {
        let again = COMMAND_LONG_DATA { confirmation, ..take_off.clone() };
        let results = rig.results(&again);
        assert_eq!(results, [MavResult::MAV_RESULT_ACCEPTED; 2], "not refused as disarmed");
        assert_eq!(rig.mode(), Mode::Disarmed);
        rig.fly(0.1);
    }
    rig.fly(11.0);
    let late = COMMAND_LONG_DATA { confirmation: 4, ..take_off };
    assert_eq!(rig.results(&late), [MavResult::MAV_RESULT_TEMPORARILY_REJECTED], "too late to be a repetition");
}

#[test]
fn the_same_take_off_within_two_seconds_is_a_repetition_and_of_another_sender_is_none() {
    let mut rig = Rig::new();
    rig.accepted(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0]);
    let take_off = command_long(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0; 2]);
    for _ in 0..3 {
        assert!(rig.results(&take_off).iter().all(|result| *result == MavResult::MAV_RESULT_ACCEPTED));
        rig.fly(0.5);
    }
    let station = core::mem::replace(&mut rig.station, Encoder::new(254, 190));
    assert_eq!(rig.results(&take_off), [MavResult::MAV_RESULT_TEMPORARILY_REJECTED]);
    rig.station = station;
    rig.fly(2.0);
    assert_eq!(rig.results(&take_off), [MavResult::MAV_RESULT_TEMPORARILY_REJECTED], "in flight");
}

#[test]
fn any_other_command_that_is_given_twice_is_executed_twice() {
    let mut rig = Rig::hovering();
    for _ in 0..2 {
        rig.send(&set_point([0.5, 0.25, -1.2]));
        assert_eq!(rig.mode(), Mode::Guided);
        let paused = rig.results(&command_long(MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, [0.0; 2]));
        assert_eq!((paused[0], rig.mode()), (MavResult::MAV_RESULT_ACCEPTED, Mode::Holding));
        rig.fly(0.5);
    }
}

#[test]
fn motors_stop_in_flight_at_once_when_they_are_told_to() {
    for (command, parameters) in [
        (MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0, 21196.0]),
        (MavCmd::MAV_CMD_DO_FLIGHTTERMINATION, [1.0, 0.0]),
    ] {
        let mut rig = Rig::hovering();
        rig.accepted(command, parameters);
        assert_eq!(rig.mode(), Mode::Disarmed);
        assert_eq!(rig.controller.tick(rig.plant.state(), 1.0), [0.0; 4]);
    }
}

#[test]
fn a_ground_station_that_falls_silent_lands_it() {
    let mut rig = Rig::hovering();
    assert_eq!(rig.fly(11.0), [], "none was ever heard");
    rig.send(&ground_station());
    assert_eq!(rig.fly(9.9), []);
    assert_eq!(rig.fly(0.2), [FailsafeEvent::LinkLost]);
    assert_eq!(rig.mode(), Mode::Landing);
}

#[test]
fn a_mode_hands_over_to_the_cascade() {
    let mut rig = Rig::hovering();
    rig.send(&SET_MODE_DATA {
        custom_mode: FlightMode::Cascade.custom_mode(),
        target_system: 1,
        base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    });
    assert_eq!((rig.mode(), rig.controller.autopilot().active_controller()), (Mode::Holding, Controller::Cascade));
}

#[test]
fn other_addresses_damage_and_noise_change_nothing() {
    let mut rig = Rig::new();
    let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0]);
    rig.send(&COMMAND_LONG_DATA { target_system: 2, ..arm });
    rig.receive(b"noise without a start");
    let mut damaged = rig.station.encode(&Payload::of(&arm)).to_vec();
    damaged[12] ^= 0x20;
    rig.receive(&damaged);
    assert_eq!(rig.mode(), Mode::Disarmed);
    assert_eq!(rig.controller.counts(), Counts { frames: 1, garbage: 2, refused: 0, unanswered: 0 });
    assert!(rig.controller.next_answer().is_none());
    rig.send(&arm);
    assert_eq!(rig.mode(), Mode::Armed);
}

#[test]
fn a_secured_vehicle_obeys_signed_frames_only() {
    let mut rig = Rig::new();
    let (key, now) = (SigningKey([3; 32]), SignatureTime(4_000_000_000_000));
    let verifier = Verifier::new(key.clone(), now, SignatureTime(0));
    rig.controller.secure(SignatureGuard::Signed(verifier), Signer::new(key.clone(), 2, now));
    let arm = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0]);
    rig.send(&arm);
    assert_eq!((rig.mode(), rig.controller.counts().refused), (Mode::Disarmed, 1));
    rig.station = Encoder::new(255, 190).signed(Signer::new(key.clone(), 1, now));
    rig.send(&arm);
    assert_eq!(rig.mode(), Mode::Armed);
    let answer = rig.controller.next_answer().unwrap();
    let mut verifier = Verifier::new(key, now, SignatureTime(0));
    assert_eq!(verifier.verify(&Frames::new(&answer).next().unwrap().unwrap()), Ok(()));
    assert_eq!(rig.controller.signature_times(), Some([SignatureTime(now.0 + 1); 2]));
    let later = SignatureTime(now.0 + 500);
    rig.controller.advance_clock(later);
    assert_eq!(rig.controller.signature_times().map(|[_, sent]| sent), Some(later));
}

#[test]
fn a_battery_that_is_no_number_keeps_it_on_the_ground() {
    let mut rig = Rig::new();
    rig.controller.tick(rig.plant.state(), f32::NAN);
    let result = rig.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0]);
    assert_eq!(result, MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
}

#[test]
fn a_flood_of_commands_is_counted() {
    let mut rig = Rig::new();
    for _ in 0..7 {
        rig.send(&command_long(MavCmd::MAV_CMD_NAV_LAND, [0.0; 2]));
    }
    // Each but the first is acknowledged twice, and four acknowledgements may wait.
    assert_eq!(rig.controller.counts().unanswered, 1 + 6 * 2 - 4);
}

/// The messages that are read, with the seeds of their checksums and the lengths of their fields.
const READ: [(u32, u8, usize); 10] = [
    (0, 50, 9),
    (4, 237, 14),
    (11, 89, 6),
    (75, 158, 35),
    (76, 152, 33),
    (82, 49, 39),
    (84, 143, 53),
    (86, 5, 53),
    (110, 84, 254),
    (111, 34, 18),
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever arrives in right frames, in any mode: no panic, and rotor targets that motors can follow.
    #[test]
    fn no_payload_brings_it_out_of_bounds(
        messages in proptest::collection::vec((0..READ.len(), proptest::collection::vec(any::<u8>(), 254)), 1..40),
        commands in proptest::collection::vec(
            (proptest::sample::select(vec![17_u16, 20, 21, 22, 176, 178, 192, 193, 300, 400]), any::<[f32; 7]>()), 1..40
        ),
        states in proptest::collection::vec(any::<[f32; 17]>(), 1..4),
        battery in any::<f32>()
    ) {
        let mut rig = Rig::hovering();
        let limit = CF2X.rotor_speed_limit as f32;
        for (message, bytes) in messages {
            let (id, seed, len) = READ[message];
            let frame = rig.station.encode(&Payload::new(id, seed, &bytes[..len]));
            rig.receive(&frame);
            let targets = rig.controller.tick(rig.plant.state(), battery);
            prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)), "{targets:?}");
        }
        for (command, parameters) in commands {
            let mut fields = [0; 33];
            fields[..28].copy_from_slice(parameters.map(f32::to_le_bytes).as_flattened());
            fields[28..30].copy_from_slice(&command.to_le_bytes());
            let frame = rig.station.encode(&Payload::new(76, 152, &fields));
            rig.receive(&frame);
            let targets = rig.controller.tick(rig.plant.state(), battery);
            prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)), "{targets:?}");
        }
        for [x, y, z, a, b, c, d, e, f, g, h, i, j, k, l, m, n] in states {
            let state = State {
                position: Vector3::new(x, y, z),
                world_from_body: Attitude { w: a, x: b, y: c, z: d },
                velocity: Vector3::new(e, f, g),
                body_rates: Vector3::new(h, i, j),
                rotor_speeds: [k, l, m, n],
            };
            let targets = rig.controller.tick(&state, battery);
            prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)), "{targets:?}");
        }
    }

    #[test]
    fn no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        Rig::new().receive(&bytes);
    }
}
