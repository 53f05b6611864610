use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::Pilot;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;
use crate::autopilot::{Autopilot, Command, Mode, SPEED_LIMIT, Surroundings};
use crate::crtp::access::{ClientOrder, CommandOutcome};
use crate::crtp::commander::{HOVER_SECS, HighLevel, LAND_SECS};
use crate::plant::{FlatFloor, Plant};
use crate::testing::{dishonest_policy, hover_policy, pilot};

/// A server, its vehicle and the plant.
struct Rig {
    server: CrtpServer,
    autopilot: Autopilot<Pilot<'static>>,
    plant: FlatFloor,
    ticks: u32,
    sent: Vec<Packet>,
}

impl Rig {
    fn new() -> Self {
        Self::with(hover_policy())
    }

    fn with(policy: Vec<u8>) -> Self {
        let autopilot = Autopilot::new(pilot(policy), &CF2X);
        let plant = FlatFloor::new(&CF2X, autopilot.control_secs());
        let mut rig = Self { server: CrtpServer::default(), autopilot, plant, ticks: 0, sent: Vec::new() };
        rig.fly(0.01);
        rig
    }

    /// Taken off by the high-level commander to 1 m, and at rest there.
    fn hovering() -> Self {
        let mut rig = Self::new();
        assert_eq!(rig.maneuver(&take_off(1.0, 2.0)), status::OK);
        rig.fly(10.0);
        rig
    }

    fn act(&mut self, state: &State<f32>, act: impl FnOnce(&mut CrtpServer, &mut VehicleAccess)) {
        let autopilot = &mut self.autopilot;
        let mut access = VehicleAccess {
            secs: f64::from(self.ticks) * 0.01,
            state,
            ranges: None,
            mode: autopilot.mode(),
            goal: *autopilot.goal(),
            order: &mut |order| {
                let result = autopilot.command(match order {
                    ClientOrder::Command(command) => command,
                    ClientOrder::EmergencyStop => Command::StopMotors,
                });
                CommandOutcome { result, mode: autopilot.mode(), goal: *autopilot.goal() }
            },
            send: &mut |packet| self.sent.push(packet.clone()),
        };
        act(&mut self.server, &mut access);
    }

    /// What the server answers to a packet, text apart.
    fn send(&mut self, packet: &Packet) -> Option<Packet> {
        let before = self.sent.len();
        let state = *self.plant.state();
        self.act(&state, |server, access| server.receive(packet, access));
        self.sent[before..].iter().find(|packet| packet.port != Port::Console).cloned()
    }

    fn tick(&mut self) {
        let state = *self.plant.state();
        self.act(&state, CrtpServer::tick);
        let targets = self.autopilot.tick(&state, &Surroundings::default());
        self.plant.step(&targets);
        self.ticks += 1;
    }

    fn fly(&mut self, secs: f32) {
        for _ in 0..(secs / 0.01).round() as u32 {
            self.tick();
        }
    }

    /// Flies with a set-point that is sent every 0.1 s.
    fn stream(&mut self, packet: &Packet, secs: f32) {
        for _ in 0..(secs / 0.1).round() as u32 {
            assert_eq!(self.send(packet), None, "set-points are not answered");
            self.fly(0.1);
        }
    }

    /// Status of a maneuver.
    fn maneuver(&mut self, packet: &Packet) -> u8 {
        let reply = self.send(packet).unwrap();
        assert_eq!((reply.port, reply.data().len()), (Port::HighLevelCommander, 4));
        assert_eq!(reply.data()[..2], packet.data()[..2]);
        reply.data()[3]
    }

    /// Everything that was said so far.
    fn words(&self) -> String {
        let console = self.sent.iter().filter(|packet| packet.port == Port::Console);
        String::from_utf8(console.flat_map(|packet| packet.data().to_vec()).collect()).unwrap()
    }

    fn info(&mut self) -> u16 {
        let reply = self.send(&Packet::new(Port::Supervisor, 0).with(&[12])).unwrap();
        assert_eq!(reply.data()[0], 0x8C);
        u16::from_le_bytes([reply.data()[1], reply.data()[2]])
    }

    fn mode(&self) -> Mode {
        self.autopilot.mode()
    }

    fn position(&self) -> Vector3<f32> {
        self.plant.state().position
    }

    fn speed(&self) -> f32 {
        self.plant.state().velocity.norm()
    }
}

fn packet(port: Port, channel: u8, head: &[u8], numbers: &[f32]) -> Packet {
    let packet = Packet::new(port, channel).with(head);
    numbers.iter().fold(packet, |packet, number| packet.with(&number.to_le_bytes()))
}

fn set_point(kind: u8, numbers: &[f32]) -> Packet {
    packet(Port::GenericCommander, 0, &[kind], numbers)
}

fn hover(ahead: f32, left: f32, height_m: f32) -> Packet {
    set_point(10, &[ahead, left, 0.0, height_m])
}

fn take_off(height_m: f32, secs: f32) -> Packet {
    packet(Port::HighLevelCommander, 0, &[1, 0], &[height_m, secs])
}

fn land(secs: f32) -> Packet {
    packet(Port::HighLevelCommander, 0, &[2, 0], &[0.0, secs])
}

fn go_to(point: [f32; 3], secs: f32) -> Packet {
    packet(Port::HighLevelCommander, 0, &[4, 0, 0], &[point[0], point[1], point[2], 0.0, secs])
}

const RELEASE: [u8; 5] = [0; 5];

#[test]
fn a_client_of_velocities_takes_off_flies_and_lands_without_arming() {
    let mut rig = Rig::new();
    // As a client of motions that counts time: a ramp of the height.
    for step in 0..=20 {
        rig.stream(&hover(0.0, 0.0, 0.025 * step as f32), 0.1);
    }
    rig.stream(&hover(0.0, 0.0, 0.5), 3.0);
    assert!((rig.position() - Vector3::new(0.0, 0.0, 0.5)).norm() < 0.05, "{}", rig.position());
    let start = rig.position();
    rig.stream(&hover(0.2, -0.1, 0.5), 4.0);
    rig.stream(&hover(0.0, 0.0, 0.5), 6.0);
    let flown = rig.position() - start;
    assert!((flown - Vector3::new(0.8, -0.4, 0.0)).norm() < 0.05, "{flown}");
    for step in 0..=20 {
        rig.stream(&hover(0.0, 0.0, 0.5 - 0.025 * step as f32), 0.1);
    }
    rig.stream(&hover(0.0, 0.0, 0.0), 6.0);
    rig.send(&set_point(0, &[]));
    assert_eq!(rig.mode(), Mode::Disarmed);
    assert!(rig.position().z < 0.15, "falls the height at which the air under it carries it: {}", rig.position());
    rig.fly(1.0);
    assert!(rig.position().z < 0.02 && rig.speed() < 0.01);
}

/// How far the goal moves in the world within so many seconds of a set-point.
fn moved(rig: &mut Rig, packet: &Packet, secs: f32) -> Vector3<f32> {
    let before = rig.autopilot.goal().position();
    rig.stream(packet, secs);
    rig.autopilot.goal().position() - before
}

#[test]
fn ahead_is_where_a_drone_would_look_that_had_turned_as_told() {
    let mut rig = Rig::hovering();
    let height_m = rig.autopilot.goal().position().z;
    let ahead = hover(0.2, 0.0, height_m);
    assert!((moved(&mut rig, &ahead, 0.5) - Vector3::new(0.1, 0.0, 0.0)).norm() < 1e-3);
    let turning = set_point(10, &[0.0, 0.0, 45.0, height_m]);
    assert!(moved(&mut rig, &turning, 2.0).norm() < 1e-3);
    let left = moved(&mut rig, &ahead, 0.5);
    assert!((left - Vector3::new(0.0, 0.1, 0.0)).norm() < 1e-3, "{left}");
    rig.send(&set_point(7, &[0.1, 0.1, height_m, 180.0]));
    let back = moved(&mut rig, &ahead, 0.5);
    assert!((back - Vector3::new(-0.1, 0.0, 0.0)).norm() < 1e-3, "{back}");
}

#[test]
fn who_begins_to_fly_sees_the_drone_as_it_stands() {
    let mut rig = Rig::new();
    let quarter = core::f32::consts::FRAC_1_SQRT_2;
    let turned = kestrel_core::attitude::Attitude { w: quarter, x: 0.0, y: 0.0, z: quarter };
    let state = State { world_from_body: turned, ..*rig.plant.state() };
    rig.act(&state, |server, access| {
        server.receive(&hover(0.4, 0.0, 0.2), access);
        server.tick(access);
    });
    rig.autopilot.tick(&state, &Surroundings::default());
    let goal = rig.autopilot.goal().position();
    assert!(goal.x.abs() < 1e-6 && goal.y > 1e-3, "{goal}");
}

#[test]
fn velocities_of_the_world_are_flown_up_to_the_limit() {
    let mut rig = Rig::hovering();
    let start = rig.position();
    rig.stream(&set_point(8, &[0.0, 0.2, 0.1, 0.0]), 2.0);
    rig.stream(&set_point(8, &[0.0; 4]), 6.0);
    assert!((rig.position() - start - Vector3::new(0.0, 0.4, 0.2)).norm() < 0.05, "{}", rig.position());
    for fast in [5.0, 1e30, f32::MAX] {
        let before = rig.autopilot.goal().position();
        rig.stream(&set_point(8, &[fast, fast, 0.0, 0.0]), 0.1);
        let moved = (rig.autopilot.goal().position() - before).norm();
        assert!(moved <= 0.1 * SPEED_LIMIT + 1e-5 && rig.mode().flies(), "{fast}: {moved}");
    }
}

#[test]
fn positions_are_reached_and_moving_points_followed() {
    let mut rig = Rig::hovering();
    rig.stream(&set_point(7, &[0.5, -0.5, 0.8, 0.0]), 6.0);
    assert!((rig.position() - Vector3::new(0.5, -0.5, 0.8)).norm() < 0.05, "{}", rig.position());
    for step in 0..=40_i16 {
        let mut packet = Packet::new(Port::GenericCommander, 0).with(&[6]);
        for number in [500 + 20 * step, -500, 800, 200, 0, 0, 0, 0, 0] {
            packet = packet.with(&number.to_le_bytes());
        }
        rig.stream(&packet.with(&[0; 10]), 0.1);
        let goal = rig.autopilot.goal().position();
        assert!((goal.x - (0.52 + 0.02 * f32::from(step))).abs() < 0.02, "{step}: {goal}");
    }
}

#[test]
fn stale_set_points_become_a_hover_and_then_a_landing() {
    let mut rig = Rig::hovering();
    rig.stream(&set_point(8, &[0.4, 0.0, 0.0, 0.0]), 2.0);
    rig.send(&set_point(8, &[0.4, 0.0, 0.0, 0.0]));
    let mut changes = Vec::new();
    let mut last = rig.mode();
    for tick in 0..1200 {
        rig.tick();
        if rig.mode() != last {
            last = rig.mode();
            changes.push((last, 0.01 * f64::from(tick)));
        }
    }
    let modes: Vec<Mode> = changes.iter().map(|(mode, _)| *mode).collect();
    assert_eq!(modes, [Mode::Holding, Mode::Landing, Mode::Landed, Mode::Disarmed]);
    assert!((changes[0].1 - HOVER_SECS).abs() < 0.03, "{changes:?}");
    assert!((changes[1].1 - LAND_SECS).abs() < 0.03, "{changes:?}");
}

#[test]
fn a_set_point_that_comes_back_in_time_is_flown_on() {
    let mut rig = Rig::hovering();
    rig.stream(&set_point(8, &[0.2, 0.0, 0.0, 0.0]), 1.0);
    rig.fly(1.0);
    assert_eq!(rig.mode(), Mode::Holding);
    rig.stream(&set_point(8, &[0.2, 0.0, 0.0, 0.0]), 0.5);
    assert_eq!(rig.mode(), Mode::Guided);
}

#[test]
fn a_stop_drops_what_flies_and_leaves_alone_what_does_not() {
    for stop in [set_point(0, &[]), packet(Port::Commander, 0, &[], &[0.0; 3]).with(&[0, 0])] {
        let mut rig = Rig::hovering();
        rig.send(&stop);
        rig.fly(0.2);
        assert_eq!(rig.mode(), Mode::Disarmed);
        assert!(rig.plant.state().velocity.z < -1.0, "it falls");
        let mut armed = Rig::new();
        armed.autopilot.command(Command::Arm).unwrap();
        armed.send(&stop);
        assert_eq!(armed.mode(), Mode::Armed);
    }
}

#[test]
fn set_points_on_the_floor_do_not_lift_the_drone() {
    let mut rig = Rig::new();
    for packet in [hover(0.5, 0.0, 0.0), set_point(8, &[0.5, 0.0, 0.0, 0.0]), set_point(7, &[1.0, 1.0, 0.0, 0.0])]
    {
        rig.stream(&packet, 0.5);
        assert_eq!(rig.mode(), Mode::Disarmed);
    }
}

#[test]
fn maneuvers_take_their_time_and_end_where_they_should() {
    let mut rig = Rig::new();
    assert_eq!(rig.maneuver(&take_off(0.6, 3.0)), status::OK);
    rig.fly(1.5);
    let halfway = rig.autopilot.goal().position().z;
    assert!((halfway - 0.306).abs() < 0.02, "{halfway}");
    rig.fly(6.0);
    assert!((rig.position() - Vector3::new(0.0, 0.0, 0.6)).norm() < 0.03, "{}", rig.position());
    assert_eq!(rig.maneuver(&go_to([0.5, 0.5, 1.0], 3.0)), status::OK);
    rig.fly(10.0);
    assert!((rig.position() - Vector3::new(0.5, 0.5, 1.0)).norm() < 0.03, "{}", rig.position());
    let relative = packet(Port::HighLevelCommander, 0, &[12, 0, 1, 1], &[-0.5, 0.0, -0.2, 0.0, 2.0]);
    assert_eq!(rig.maneuver(&relative), status::OK);
    rig.fly(8.0);
    assert!((rig.position() - Vector3::new(0.0, 0.5, 0.8)).norm() < 0.03, "{}", rig.position());
    assert_eq!(rig.maneuver(&land(2.0)), status::OK);
    rig.fly(2.5);
    assert_eq!(rig.mode(), Mode::Landing);
    assert!(rig.autopilot.goal().position().z < 0.0, "{}", rig.autopilot.goal().position());
    rig.fly(3.0);
    assert_eq!(rig.mode(), Mode::Landed);
}

#[test]
fn a_plan_begins_with_the_velocity_of_the_one_that_it_replaces() {
    let mut rig = Rig::hovering();
    rig.maneuver(&go_to([1.0, 0.0, 1.0], 4.0));
    rig.fly(2.0);
    let step = |rig: &mut Rig| {
        let before = rig.autopilot.goal().position();
        rig.tick();
        rig.autopilot.goal().position() - before
    };
    let before = step(&mut rig);
    rig.maneuver(&go_to([0.0, 1.0, 1.0], 4.0));
    let after = step(&mut rig);
    assert!((after - before).norm() < 0.05 * before.norm(), "{before} {after}");
}

#[test]
fn maneuvers_with_a_velocity_take_distance_over_velocity() {
    let mut rig = Rig::new();
    let head = |command: u8, height_m: f32, relative: u8| {
        packet(Port::HighLevelCommander, 0, &[command, 0], &[height_m]).with(&[relative, 0, 0, 0, 0, 0])
    };
    assert_eq!(rig.maneuver(&head(9, 0.5, 0).with(&0.25_f32.to_le_bytes())), status::OK);
    rig.fly(1.8);
    assert_eq!(rig.server.commander.high_level(rig.mode()), HighLevel::Flying);
    rig.fly(0.3);
    assert_eq!(rig.server.commander.high_level(rig.mode()), HighLevel::Finished);
    // The usual velocity of landings is 0.5 m/s.
    assert_eq!(rig.maneuver(&head(10, 0.25, 1).with(&0.0_f32.to_le_bytes())), status::OK);
    rig.fly(0.45);
    assert_ne!(rig.mode(), Mode::Landing);
    rig.fly(0.1);
    assert_eq!(rig.mode(), Mode::Landing);
}

#[test]
fn maneuvers_that_cannot_be_are_refused() {
    let mut rig = Rig::new();
    assert_eq!(rig.maneuver(&land(1.0)), status::NOT_PERMITTED);
    assert_eq!(rig.maneuver(&go_to([2000.0, 0.0, 1.0], 1.0)), status::INVALID);
    assert_eq!(rig.maneuver(&take_off(-1.0, 1.0)), status::INVALID);
    assert_eq!(rig.maneuver(&take_off(f32::NAN, 1.0)), status::INVALID);
    assert_eq!(rig.maneuver(&packet(Port::HighLevelCommander, 0, &[13, 0], &[1.0; 3])), status::UNKNOWN_COMMAND);
    assert_eq!(rig.mode(), Mode::Disarmed);
    let mut flying = Rig::hovering();
    assert_eq!(flying.maneuver(&take_off(1.0, 1.0)), status::NOT_PERMITTED);
    let mut dishonest = Rig::with(dishonest_policy());
    assert_eq!(dishonest.maneuver(&take_off(1.0, 1.0)), status::BUSY);
    assert!(dishonest.words().contains("self-test failed"), "{}", dishonest.words());
}

#[test]
fn set_points_come_before_maneuvers_until_they_are_said_to_end() {
    let mut rig = Rig::hovering();
    rig.stream(&hover(0.0, 0.0, 1.0), 0.5);
    assert_eq!(rig.maneuver(&go_to([0.5, 0.0, 1.0], 1.0)), status::BUSY);
    assert!(rig.words().contains("set-points are streaming"));
    rig.send(&Packet::new(Port::GenericCommander, 1).with(&RELEASE));
    assert_eq!(rig.maneuver(&go_to([0.5, 0.0, 1.0], 1.0)), status::OK);
    rig.fly(6.0);
    assert!((rig.position().x - 0.5).abs() < 0.03 && rig.mode() == Mode::Guided);
    assert_eq!(rig.maneuver(&packet(Port::HighLevelCommander, 0, &[3, 0], &[])), status::OK);
    assert_eq!(rig.mode(), Mode::Disarmed);
}

#[test]
fn maneuvers_of_other_groups_are_not_flown() {
    let mut rig = Rig::new();
    let for_group = |groups: u8| packet(Port::HighLevelCommander, 0, &[1, groups], &[1.0, 1.0]);
    assert_eq!(rig.maneuver(&for_group(4)), status::OK);
    rig.fly(0.1);
    assert_eq!(rig.mode(), Mode::Disarmed);
    assert_eq!(rig.maneuver(&packet(Port::HighLevelCommander, 0, &[0, 6], &[])), status::OK);
    assert_eq!(rig.maneuver(&for_group(4)), status::OK);
    rig.fly(0.1);
    assert!(rig.mode().flies());
}

#[test]
fn arming_is_answered_by_both_services() {
    let mut rig = Rig::new();
    let mut arm = |port, channel, commander_packet: u8| {
        let reply = rig.send(&Packet::new(port, channel).with(&[1, commander_packet])).unwrap();
        (reply.data().to_vec(), rig.mode())
    };
    assert_eq!(arm(Port::Supervisor, 1, 1), (vec![0x81, 1, 1], Mode::Armed));
    assert_eq!(arm(Port::Supervisor, 1, 0), (vec![0x81, 1, 0], Mode::Disarmed));
    assert_eq!(arm(Port::Platform, 0, 1), (vec![1, 1, 1], Mode::Armed));
    let mut rig = Rig::hovering();
    let reply = rig.send(&Packet::new(Port::Supervisor, 1).with(&[1, 0])).unwrap();
    assert_eq!((reply.data(), rig.mode().flies()), (&[0x81, 0, 1][..], true), "not in flight");
}

#[test]
fn the_bits_say_what_the_vehicle_does() {
    let mut rig = Rig::new();
    assert_eq!(rig.info(), 0b010_0000_1101, "can be armed, arms itself, can fly; no plan");
    rig.maneuver(&take_off(0.5, 1.0));
    rig.tick();
    assert_eq!(rig.info(), 0b001_0001_1110, "armed, flies, on a plan");
    rig.fly(2.0);
    assert_eq!(rig.info(), 0b011_0001_1110, "the plan is over");
    rig.stream(&hover(0.0, 0.0, 0.5), 0.1);
    assert_eq!(rig.info(), 0b110_0001_1110, "set-points fly");
    for (question, expected) in [(1, 0), (2, 1), (5, 1), (9, 0), (11, 1)] {
        let reply = rig.send(&Packet::new(Port::Supervisor, 0).with(&[question])).unwrap();
        assert_eq!(reply.data(), [question | 0x80, expected]);
    }
}

#[test]
fn an_emergency_stop_is_for_good() {
    let stops = [
        Packet::new(Port::Supervisor, 1).with(&[3]),
        Packet::new(Port::Localization, 1).with(&[3]),
        Packet::new(Port::Parameter, 2).with(&[0, 0, 1]),
    ];
    for stop in stops {
        let mut rig = Rig::hovering();
        rig.send(&stop);
        assert_eq!(rig.mode(), Mode::Disarmed);
        rig.fly(2.0);
        assert!(rig.position().z < 0.02, "it fell");
        assert_eq!(rig.info() & 0b100_1001, 0b100_0000, "locked, cannot be armed, cannot fly");
        assert_eq!(rig.maneuver(&take_off(1.0, 1.0)), status::BUSY);
        rig.stream(&hover(0.0, 0.0, 1.0), 0.5);
        let reply = rig.send(&Packet::new(Port::Supervisor, 1).with(&[1, 1])).unwrap();
        assert_eq!((reply.data(), rig.mode()), (&[0x81, 0, 0][..], Mode::Disarmed));
        assert!(rig.words().contains("locked"), "{}", rig.words());
    }
}

#[test]
fn a_watchdog_that_was_set_must_be_set_again() {
    for feed in [Packet::new(Port::Supervisor, 1).with(&[4]), Packet::new(Port::Localization, 1).with(&[4])] {
        let mut rig = Rig::hovering();
        for _ in 0..5 {
            rig.send(&feed);
            rig.fly(0.9);
        }
        assert!(rig.mode().flies());
        rig.fly(0.2);
        assert_eq!(rig.mode(), Mode::Disarmed);
    }
}

#[test]
fn log_blocks_follow_the_true_state_until_the_client_parts() {
    let mut rig = Rig::hovering();
    rig.send(&Packet::new(Port::Log, 1).with(&[6, 1, 7, 2, 0]));
    rig.send(&Packet::new(Port::Log, 1).with(&[3, 1, 10]));
    rig.sent.clear();
    rig.fly(1.05);
    let heights: Vec<f32> =
        rig.sent.iter().map(|packet| f32::from_le_bytes(packet.data()[4..].try_into().unwrap())).collect();
    assert_eq!(heights.len(), 10);
    assert!(heights.iter().all(|height| (height - rig.position().z).abs() < 0.01), "{heights:?}");
    rig.server.part();
    rig.sent.clear();
    rig.fly(1.0);
    assert!(rig.sent.is_empty());
}

#[test]
fn the_greeting_is_text_in_pieces() {
    let mut rig = Rig::new();
    let reply = rig.send(&platform::handshake()).unwrap();
    assert!(reply.data().starts_with(b"Bitcraze Crazyflie"));
    assert!(rig.words().starts_with("Kestrel ") && rig.words().ends_with('\n'), "{}", rig.words());
}

#[test]
fn the_same_refusal_is_said_once_a_second() {
    let mut rig = Rig::hovering();
    rig.sent.clear();
    rig.stream(&set_point(11, &[0.0; 4]), 3.0);
    assert_eq!(rig.words().matches("chooses its attitude").count(), 3);
}

#[test]
fn a_policy_that_is_refused_lets_others_fly() {
    let mut rig = Rig::hovering();
    rig.maneuver(&go_to([1.0, 0.0, 1.0], 4.0));
    rig.fly(1.0);
    rig.autopilot.command(Command::Land).unwrap();
    rig.fly(6.0);
    assert_eq!(rig.mode(), Mode::Landed);
}

fn any_packet() -> impl Strategy<Value = Packet> {
    let numbers = || proptest::collection::vec(prop_oneof![any::<f32>(), -2.0_f32..2.0], 0..7);
    prop_oneof![
        (0_usize..11, 0_u8..4, proptest::collection::vec(any::<u8>(), 0..=30))
            .prop_map(|(port, channel, data)| Packet::new(Port::ALL[port], channel).with(&data)),
        (0_u8..14, numbers()).prop_map(|(kind, numbers)| set_point(kind, &numbers)),
        (0_u8..14, proptest::collection::vec(0_u8..2, 1..4), numbers()).prop_map(|(command, bytes, numbers)| {
            packet(Port::HighLevelCommander, 0, &[&[command][..], &bytes].concat(), &numbers)
        }),
        (0_u8..9, 0_u8..4, 0_u8..9, 0_u8..70).prop_map(|(command, block, kind, variable)| {
            Packet::new(Port::Log, 1).with(&[command, block, kind, variable, 0])
        }),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn whatever_comes_motors_and_goals_are_finite_and_packets_bounded(
        script in proptest::collection::vec((any_packet(), 0_u32..60), 1..30)
    ) {
        let limit = CF2X.rotor_speed_limit as f32 * 1.000_001;
        let mut rig = Rig::new();
        for (packet, ticks) in script {
            rig.send(&packet);
            for _ in 0..ticks {
                let state = *rig.plant.state();
                rig.act(&state, CrtpServer::tick);
                let targets = rig.autopilot.tick(&state, &Surroundings::default());
                rig.plant.step(&targets);
                rig.ticks += 1;
                prop_assert!(targets.iter().all(|target| (0.0..=limit).contains(target)), "{targets:?}");
                prop_assert!(rig.autopilot.goal().position().iter().all(|value| value.is_finite()));
            }
            prop_assert!(rig.sent.iter().all(|packet| packet.encode().len() <= 31));
            rig.sent.clear();
        }
    }
}
