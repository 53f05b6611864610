//! A scripted ArduPilot on real sockets, with the habits of `SIM_JSON.cpp`'s reader.

use std::net::{SocketAddr, UdpSocket};
use std::thread;
use std::time::Duration;

use kestrel_core::airframe::CF2X;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::server::serve;
use super::*;
use crate::bridge::datagram::DatagramSocket;
use crate::bridge::drone::Drone;
use crate::bridge::event::{BridgeCounts, BridgeEvent};
use crate::bridge::motors::{MotorOrder, Motors, ThrustCurve};
use crate::bridge::noise::Noise;
use crate::bridge::sensors::Instruments;
use crate::bridge::testing::{FLIGHT_SECS, Judge, QUAD_X, Seen, fly};
use crate::geodesy::Home;
use crate::lockstep::{Next, SimulationRate};
use crate::plant::{FlatFloor, Plant, Ranges};

const RATE_HZ: u32 = 400;

fn frame(count: u32, throttles: [f32; 4]) -> Vec<u8> {
    let mut pulses = [1500_u16; 16];
    for (pulse, throttle) in pulses.iter_mut().zip(throttles) {
        *pulse = (1000.0 + 1000.0 * throttle).round() as u16;
    }
    let mut bytes = 18_458_u16.to_le_bytes().to_vec();
    bytes.extend(1200_u16.to_le_bytes());
    bytes.extend(count.to_le_bytes());
    bytes.extend(pulses.iter().flat_map(|pulse| pulse.to_le_bytes()));
    bytes
}

/// Numbers as ArduPilot finds them: after the section's name, after the key's name and two characters.
fn numbers<const LEN: usize>(json: &str, section: &str, key: &str) -> [f32; LEN] {
    let rest = &json[json.find(section).unwrap() + section.len()..];
    let rest = &rest[rest.find(key).unwrap() + key.len() + 2..];
    let inside = rest.strip_prefix('[').unwrap_or_else(|| panic!("Failed to parse Vector3f for {section}/{key}"));
    let mut numbers = inside[..inside.find(']').unwrap()].split(',').map(|number| number.parse().unwrap());
    core::array::from_fn(|_| numbers.next().unwrap())
}

fn seen(json: &str) -> Seen {
    assert!(json.starts_with('\n') && json.ends_with("}\n") && !json.contains(' '), "{json}");
    Seen {
        position_ned: numbers(json, "", "position"),
        velocity_ned: numbers(json, "", "velocity"),
        attitude: numbers(json, "", "quaternion"),
        body_rates_frd: numbers(json, "imu", "gyro"),
    }
}

fn timestamp(json: &str) -> f64 {
    let key = "\"timestamp\":";
    let rest = &json[json.find(key).unwrap() + key.len()..];
    rest[..rest.find(',').unwrap()].parse().unwrap()
}

/// The throttle at which the curve that ArduPilot assumes gives a share of the thrust.
fn throttle(thrust_share: f32) -> f32 {
    let (linear, square) = (0.35_f32, 0.65_f32);
    ((linear * linear + 4.0 * square * thrust_share).sqrt() - linear) / (2.0 * square)
}

struct ArduPilot {
    socket: UdpSocket,
    simulator: SocketAddr,
}

impl ArduPilot {
    fn at(simulator: SocketAddr) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        Self { socket, simulator }
    }

    fn ask(&self, datagram: &[u8]) -> Option<String> {
        self.socket.send_to(datagram, self.simulator).unwrap();
        self.receive()
    }

    fn receive(&self) -> Option<String> {
        let mut bytes = [0; 1024];
        let len = self.socket.recv(&mut bytes).ok()?;
        Some(String::from_utf8(bytes[..len].to_vec()).unwrap())
    }

    fn fly(&self) {
        let mut throttles = [0.0; 4];
        for count in 0..(FLIGHT_SECS * RATE_HZ as f32) as u32 {
            let Some(json) = self.ask(&frame(count, throttles)) else { return };
            let secs = timestamp(&json);
            assert!((secs - f64::from(count + 1) / f64::from(RATE_HZ)).abs() < 1e-5, "{secs}");
            throttles = fly(&seen(&json), secs as f32, &QUAD_X).map(throttle);
        }
    }
}

fn simulate(
    socket: &mut DatagramSocket,
    noise: Noise,
    watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
) -> BridgeCounts {
    let mut plant = FlatFloor::new(&CF2X, 1.0 / RATE_HZ as f32);
    let motors = Motors::new(&CF2X, MotorOrder::QuadX, ThrustCurve::ARDUPILOT).unwrap();
    let mut drone = Drone::new(&mut plant, motors, Instruments::new(Home::default(), noise, RATE_HZ));
    let period = Duration::from_secs_f64(1.0 / f64::from(RATE_HZ));
    serve(&mut drone, socket, period, SimulationRate::Unthrottled, watch).unwrap()
}

fn socket() -> (DatagramSocket, SocketAddr) {
    let socket = DatagramSocket::open("127.0.0.1:0".parse().unwrap()).unwrap();
    let address = socket.address().unwrap();
    (socket, address)
}

#[test]
fn an_ardupilot_flies_to_a_point_and_lands() {
    for noise in [Noise::Off, Noise::Seeded(4)] {
        let (mut socket, address) = socket();
        let mut judge = Judge::default();
        let steps = (FLIGHT_SECS * RATE_HZ as f32) as u64;
        let mut flown = 0;
        let counts = thread::scope(|scope| {
            scope.spawn(|| ArduPilot::at(address).fly());
            simulate(&mut socket, noise, &mut |event| {
                if let BridgeEvent::Stepped(step) = event {
                    judge.see(step.secs, step.state);
                    flown += 1;
                }
                if flown == steps { Next::End } else { Next::Fly }
            })
        });
        assert_eq!((counts.steps, counts.connections, counts.garbage), (steps, 1, 0));
        judge.judge(0.0, 0.1);
    }
}

#[test]
fn a_lost_answer_is_repeated_and_a_restarted_ardupilot_begins_at_zero() {
    let (mut socket, address) = socket();
    let mut steps = 0;
    thread::scope(|scope| {
        scope.spawn(move || {
            let first = ArduPilot::at(address);
            let one = first.ask(&frame(0, [0.0; 4])).unwrap();
            let two = first.ask(&frame(1, [0.0; 4])).unwrap();
            assert_eq!(first.ask(&frame(1, [0.0; 4])).unwrap(), two, "the same frame gets the same line");
            assert_ne!(one, two);
            first.socket.send_to(b"garbage", address).unwrap();
            first.socket.send_to(&frame(2, [0.0; 4])[..39], address).unwrap();
            let second = ArduPilot::at(address);
            let again = second.ask(&frame(0, [0.0; 4])).unwrap();
            assert_eq!(timestamp(&again), timestamp(&one));
            second.ask(&frame(1, [0.0; 4])).unwrap();
        });
        let counts = simulate(&mut socket, Noise::Off, &mut |event| {
            if matches!(event, BridgeEvent::Stepped(_)) {
                steps += 1;
            }
            // The last answer is sent before the loop looks again.
            if steps == 4 && matches!(event, BridgeEvent::Waiting) { Next::End } else { Next::Fly }
        });
        assert_eq!((counts.steps, counts.connections, counts.garbage), (4, 2, 2));
    });
}

#[test]
fn an_ardupilot_that_stops_asking_stops_the_simulation() {
    let (mut socket, address) = socket();
    let mut steps = 0;
    thread::scope(|scope| {
        scope.spawn(move || ArduPilot::at(address).ask(&frame(0, [1.0; 4])));
        simulate(&mut socket, Noise::Off, &mut |event| match event {
            BridgeEvent::Stepped(_) => {
                steps += 1;
                Next::Fly
            }
            BridgeEvent::Gone => Next::End,
            BridgeEvent::Waiting | BridgeEvent::Connected(_) | BridgeEvent::Engaged | BridgeEvent::Unanswered => {
                Next::Fly
            }
        });
    });
    assert_eq!(steps, 1);
}

// What follows needs no socket.

fn rest() -> State<f32> {
    *FlatFloor::new(&CF2X, 0.0025).state()
}

fn line(state: &State<f32>) -> JsonLine {
    let measurement = Instruments::new(Home::default(), Noise::Off, RATE_HZ).measure(state, state);
    let mut line = JsonLine::new();
    write_line(&mut line, 1.5, &measurement, state).unwrap();
    line
}

#[test]
fn the_line_is_to_the_letter_what_the_reader_takes() {
    assert_eq!(
        line(&rest()).as_str(),
        "\n{\"timestamp\":1.500000,\"imu\":{\"gyro\":[0.000000,0.000000,0.000000],\
         \"accel_body\":[0.000000,0.000000,-9.800000]},\"position\":[0.000000,0.000000,-0.012500],\
         \"quaternion\":[0.707107,0.000000,0.000000,0.707107],\"velocity\":[0.000000,0.000000,0.000000]}\n"
    );
}

#[test]
fn no_state_makes_a_line_too_long() {
    for wild in [f32::NAN, f32::INFINITY, f32::MAX, -f32::MAX] {
        let state = State { position: Vector3::repeat(wild), velocity: Vector3::repeat(wild), ..rest() };
        let line = line(&state);
        assert!(line.ends_with("}\n") && !line.contains("NaN") && !line.contains("inf"), "{line}");
    }
}

#[test]
fn frames_of_both_lengths_are_read() {
    let short = frame(7, [0.0, 0.25, 0.5, 1.0]);
    let expected = Servos { count: 7, throttles: [0.0, 0.25, 0.5, 1.0] };
    assert_eq!(Servos::read(&short), Some(expected));
    let mut long = short.clone();
    long[..2].copy_from_slice(&29_569_u16.to_le_bytes());
    assert_eq!(Servos::read(&long), None, "too short for 32 servos");
    long.resize(72, 0);
    assert_eq!(Servos::read(&long), Some(expected));
    long[0] ^= 1;
    assert_eq!(Servos::read(&long), None);
}

/// The longest line, and ArduPilot's names.
#[test]
fn what_rangers_see_has_its_numbers() {
    let mut simulator = ArdupilotSimulator::new();
    let ranges = Ranges { front: Some(1.25), back: None, left: Some(2.0), right: None, up: None, down: Some(0.1) };
    let state = *FlatFloor::new(&CF2X, 0.0025).state();
    let mut instruments = Instruments::new(Home::default(), Noise::Off, RATE_HZ);
    let mut measurement = Measurement { ranges: Some(ranges), ..instruments.measure(&state, &state) };
    let line = simulator.answer(&measurement, &state, 0.0025).to_owned();
    let seen =
        ",\"rng_1\":1.250,\"rng_2\":10.000,\"rng_3\":2.000,\"rng_4\":10.000,\"rng_5\":10.000,\"rng_6\":0.100}";
    assert!(line.trim_end().ends_with(seen), "{line}");
    measurement.specific_force_frd = [-1e30; 3];
    measurement.body_rates_frd = [-1e30; 3];
    let far = State { position: Vector3::repeat(-1e30), velocity: Vector3::repeat(-1e30), ..state };
    assert!(!simulator.answer(&measurement, &far, 1e9).is_empty());
}

proptest! {
    #[test]
    fn no_datagram_panics(datagram in proptest::collection::vec(any::<u8>(), 0..100)) {
        let mut simulator = ArdupilotSimulator::new();
        prop_assert_eq!(simulator.receive(&datagram), None);
        prop_assert_eq!(simulator.garbage(), 1);
    }

    #[test]
    fn whatever_a_frame_holds_throttles_are_shares(rest in proptest::collection::vec(any::<u8>(), 38)) {
        let servos = Servos::read(&[&18_458_u16.to_le_bytes()[..], &rest].concat()).unwrap();
        prop_assert!(servos.throttles.iter().all(|throttle| (0.0..=1.0).contains(throttle)));
    }
}
