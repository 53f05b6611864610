//! Scripted Betaflights on real sockets.

use std::net::{SocketAddr, UdpSocket};
use std::sync::OnceLock;
use std::thread;
use std::time::{Duration, Instant};

use kestrel_core::airframe::CF2X;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::server::{BetaflightAddresses, BetaflightServer};
use super::*;
use crate::bridge::datagram::DatagramSocket;
use crate::bridge::drone::Drone;
use crate::bridge::event::{BridgeCounts, BridgeEvent};
use crate::bridge::motors::{MotorOrder, Motors, ThrustCurve};
use crate::bridge::noise::Noise;
use crate::bridge::sensors::Instruments;
use crate::bridge::testing::{BETAFLIGHT, FLIGHT_SECS, Judge, Seen, fly};
use crate::lockstep::{Next, SimulationRate};
use crate::message::ned_from_enu;
use crate::plant::{FlatFloor, Plant};

const RATE_HZ: u32 = 500;

fn pulses(throttles: [f32; 4]) -> [u8; PULSES_LEN] {
    let mut bytes = [0; PULSES_LEN];
    bytes[..2].copy_from_slice(&4_u16.to_le_bytes());
    for (motor, throttle) in throttles.into_iter().enumerate() {
        bytes[4 + 4 * motor..8 + 4 * motor].copy_from_slice(&(1000.0 + 1000.0 * throttle).to_le_bytes());
    }
    bytes
}

fn numbers(state: &[u8]) -> [f64; 18] {
    core::array::from_fn(|index| f64::from_le_bytes(state[8 * index..8 * index + 8].try_into().unwrap()))
}

/// What a Betaflight takes for the truth: vectors forward, left and up, the world north, west and up.
struct Taken {
    body_rates_flu: [f64; 3],
    specific_force_flu: [f64; 3],
    nwu_from_flu: Attitude<f64>,
    position: Geodetic,
}

/// `updateState` of `sitl.c` (August 2026), for a Gazebo that began at home.
fn taken(numbers: &[f64; 18], build: BetaflightBuild) -> Taken {
    let [_, roll, pitch, yaw, x, y, z, qw, qx, qy, qz, _, _, _, longitude_deg, latitude_deg, altitude_m, _] =
        *numbers;
    let specific_force_flu = [-x, -y, -z];
    let home = Home::default();
    match build {
        BetaflightBuild::Legacy => Taken {
            body_rates_flu: [roll, -pitch, -yaw],
            specific_force_flu,
            nwu_from_flu: Attitude { w: qw, x: qx, y: qy, z: qz },
            position: Geodetic { latitude_deg, longitude_deg, altitude_m },
        },
        BetaflightBuild::Gazebo => {
            let (qy, qz, k) = (-qy, -qz, FRAC_1_SQRT_2);
            Taken {
                body_rates_flu: [roll, -pitch, yaw],
                specific_force_flu,
                nwu_from_flu: Attitude { w: k * (qw - qz), x: k * (qx - qy), y: k * (qy + qx), z: k * (qz + qw) },
                position: Geodetic {
                    latitude_deg: 2.0 * home.latitude_deg - latitude_deg,
                    longitude_deg: 2.0 * home.longitude_deg - longitude_deg,
                    altitude_m,
                },
            }
        }
    }
}

/// What Betaflight makes of a state, in the frames of [`fly`].
fn seen(state: &[u8; STATE_LEN], build: BetaflightBuild) -> (f64, Seen) {
    let numbers = numbers(state);
    let Taken { body_rates_flu: [roll, pitch, yaw], nwu_from_flu: Attitude { w, x, y, z }, position, .. } =
        taken(&numbers, build);
    let [east, north, up] = [11, 12, 13].map(|index| numbers[index] as f32);
    let seen = Seen {
        position_ned: ned_from_enu(&Home::default().point_at(&position)),
        velocity_ned: [north, east, -up],
        attitude: [w, x, -y, -z].map(|value| value as f32),
        body_rates_frd: [roll, -pitch, -yaw].map(|value| value as f32),
    };
    (numbers[0], seen)
}

/// A Betaflight with sockets of its own.
struct Betaflight {
    state: UdpSocket,
    sticks: UdpSocket,
}

impl Betaflight {
    fn new() -> Self {
        let bind = || UdpSocket::bind("127.0.0.1:0").unwrap();
        let betaflight = Self { state: bind(), sticks: bind() };
        betaflight.state.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
        betaflight
    }

    fn addresses(&self, outputs: SocketAddr) -> BetaflightAddresses {
        BetaflightAddresses {
            outputs,
            state: self.state.local_addr().unwrap(),
            sticks: self.sticks.local_addr().unwrap(),
        }
    }

    /// The next state; what is of another length is not read, as Betaflight does not.
    fn state(&self) -> Option<[u8; STATE_LEN]> {
        let mut bytes = [0; 256];
        loop {
            let len = self.state.recv(&mut bytes).ok()?;
            if let Ok(state) = bytes[..len].try_into() {
                return Some(state);
            }
        }
    }

    /// Answers so many states with the motors of [`fly`]'s flight, counted from the first.
    fn fly(&self, outputs: SocketAddr, build: BetaflightBuild, answers: u32) {
        let mut start_secs = None;
        for _ in 0..answers {
            let Some(state) = self.state() else { return };
            let (secs, seen) = seen(&state, build);
            let elapsed_secs = secs - *start_secs.get_or_insert(secs);
            let throttles = fly(&seen, elapsed_secs as f32, &BETAFLIGHT).map(f32::sqrt);
            self.state.send_to(&pulses(throttles), outputs).unwrap();
        }
    }
}

fn simulate(
    socket: &mut DatagramSocket,
    addresses: BetaflightAddresses,
    build: BetaflightBuild,
    watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
) -> BridgeCounts {
    simulate_at(SimulationRate::Unthrottled, socket, addresses, build, watch)
}

fn simulate_at(
    pace: SimulationRate,
    socket: &mut DatagramSocket,
    addresses: BetaflightAddresses,
    build: BetaflightBuild,
    watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
) -> BridgeCounts {
    let mut plant = FlatFloor::new(&CF2X, 1.0 / RATE_HZ as f32);
    let motors = Motors::new(&CF2X, MotorOrder::Betaflight, ThrustCurve::BETAFLIGHT).unwrap();
    let mut drone = Drone::new(&mut plant, motors, Instruments::new(Home::default(), Noise::Seeded(1), RATE_HZ));
    let simulator =
        BetaflightSimulator::new(Home::default(), build, Some("1500,1500,1000,1500,2000".parse().unwrap()));
    let period = Duration::from_secs(1) / RATE_HZ;
    BetaflightServer::new(&mut drone, simulator, addresses, period, pace).serve(socket, watch).unwrap()
}

#[test]
fn a_betaflight_of_either_build_flies_to_a_point_and_lands() {
    for build in [BetaflightBuild::Gazebo, BetaflightBuild::Legacy] {
        let mut socket = DatagramSocket::open("127.0.0.1:0".parse().unwrap()).unwrap();
        let outputs = socket.address().unwrap();
        let betaflight = Betaflight::new();
        let addresses = betaflight.addresses(outputs);
        let mut judge = Judge::default();
        let (mut start_secs, mut now_secs) = (None, 0.0);
        let counts = thread::scope(|scope| {
            scope.spawn(|| betaflight.fly(outputs, build, u32::MAX));
            simulate(&mut socket, addresses, build, &mut |event| {
                match event {
                    BridgeEvent::Engaged => start_secs = Some(now_secs),
                    BridgeEvent::Stepped(step) => {
                        judge.see(step.secs, step.state);
                        now_secs = step.secs;
                    }
                    BridgeEvent::Waiting
                    | BridgeEvent::Connected(_)
                    | BridgeEvent::Unanswered
                    | BridgeEvent::Gone => {}
                }
                let end = start_secs.is_some_and(|start| now_secs > start + f64::from(FLIGHT_SECS));
                if end { Next::End } else { Next::Fly }
            })
        });
        assert_eq!(counts.garbage, 0);
        // Betaflight is not waited for without end: a busy machine may leave a few states unanswered.
        assert!(counts.unanswered < counts.steps / 100, "{counts:?}");
        judge.judge(start_secs.unwrap(), 0.12);
        let mut sticks = [0; 64];
        assert_eq!(betaflight.sticks.recv(&mut sticks).unwrap(), RADIO_LEN);
        assert_eq!(sticks[12..14], 1000_u16.to_le_bytes(), "the third channel is the throttle");
    }
}

#[test]
fn a_betaflight_that_goes_stops_the_motors_and_may_come_back() {
    let mut socket = DatagramSocket::open("127.0.0.1:0".parse().unwrap()).unwrap();
    let outputs = socket.address().unwrap();
    let betaflight = Betaflight::new();
    let addresses = betaflight.addresses(outputs);
    let (mut gone, mut engaged, mut last_targets) = (0, 0, [1.0; 4]);
    let counts = thread::scope(|scope| {
        let first = scope.spawn(|| {
            betaflight.fly(outputs, BetaflightBuild::Gazebo, 500);
            thread::sleep(Duration::from_millis(1500));
            betaflight.fly(outputs, BetaflightBuild::Gazebo, 50);
        });
        let counts = simulate(&mut socket, addresses, BetaflightBuild::Gazebo, &mut |event| {
            match event {
                BridgeEvent::Gone => gone += 1,
                BridgeEvent::Engaged => engaged += 1,
                BridgeEvent::Stepped(step) => last_targets = step.rotor_targets,
                BridgeEvent::Waiting | BridgeEvent::Connected(_) | BridgeEvent::Unanswered => {}
            }
            if gone == 2 && matches!(event, BridgeEvent::Stepped(_)) { Next::End } else { Next::Fly }
        });
        first.join().unwrap();
        counts
    });
    assert_eq!((gone, engaged, counts.connections), (2, 2, 2));
    assert_eq!(last_targets, [0.0; 4]);
}

#[test]
fn no_state_makes_the_clock_of_a_betaflight_race() {
    let mut socket = DatagramSocket::open("127.0.0.1:0".parse().unwrap()).unwrap();
    let outputs = socket.address().unwrap();
    let betaflight = Betaflight::new();
    let addresses = betaflight.addresses(outputs);
    let arrivals = thread::scope(|scope| {
        let peer = scope.spawn(|| {
            let mut arrivals = vec![];
            for number in 0..60 {
                let bytes = betaflight.state().unwrap();
                arrivals.push((Instant::now(), numbers(&bytes)[0]));
                if number >= 20 {
                    // One answer is late, which the simulation must not make up for at once.
                    thread::sleep(Duration::from_millis(if number == 40 { 20 } else { 0 }));
                    betaflight.state.send_to(&pulses([0.0; 4]), outputs).unwrap();
                }
            }
            arrivals
        });
        simulate_at(SimulationRate::Speed(1.0), &mut socket, addresses, BetaflightBuild::Gazebo, &mut |_| {
            if peer.is_finished() { Next::End } else { Next::Fly }
        });
        peer.join().unwrap()
    });
    let (unanswered, answered) = arrivals.split_at(21);
    assert!(unanswered.windows(2).all(|pair| pair[1].1 - pair[0].1 > 0.02), "{unanswered:?}");
    // What arrives late makes the next one seem early: only the mean over a few is the sender's.
    let shortest = answered.windows(6).map(|states| states[5].0 - states[0].0).min().unwrap();
    assert!(shortest > Duration::from_millis(7), "five states within {shortest:?}");
}

/// A state that comes before Betaflight's sensors exist ends its thread.
#[test]
fn states_wait_until_betaflight_has_had_time_to_start() {
    let mut socket = DatagramSocket::open("127.0.0.1:0".parse().unwrap()).unwrap();
    // A port of this machine that nobody has yet.
    let late = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let addresses = BetaflightAddresses { outputs: socket.address().unwrap(), state: late, sticks: late };
    let (mut steps, opened) = (0, OnceLock::new());
    thread::scope(|scope| {
        let peer = scope.spawn(|| {
            thread::sleep(Duration::from_millis(300));
            let betaflight = Betaflight { state: UdpSocket::bind(late).unwrap(), ..Betaflight::new() };
            opened.set(Instant::now()).unwrap();
            betaflight.state.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
            betaflight.state().unwrap();
            opened.get().unwrap().elapsed()
        });
        simulate(&mut socket, addresses, BetaflightBuild::Gazebo, &mut |event| {
            if opened.get().is_none() && matches!(event, BridgeEvent::Stepped(_)) {
                steps += 1;
            }
            if peer.is_finished() { Next::End } else { Next::Fly }
        });
        assert!(peer.join().unwrap() >= Duration::from_millis(450));
    });
    assert_eq!(steps, 0, "and no clock runs");
}

// What follows needs no socket.

fn rest() -> State<f32> {
    *FlatFloor::new(&CF2X, 0.002).state()
}

fn told(state: &State<f32>, build: BetaflightBuild, secs: f64) -> [f64; 18] {
    let mut instruments = Instruments::new(Home::default(), Noise::Off, RATE_HZ);
    let measurement = instruments.measure(state, state);
    numbers(&BetaflightSimulator::new(Home::default(), build, None).send(&measurement, state, secs))
}

#[test]
fn states_have_eighteen_doubles_in_their_units() {
    let state = State { velocity: Vector3::new(1.0, 2.0, 3.0), body_rates: Vector3::new(0.1, 0.2, 0.3), ..rest() };
    let expected = [
        [2.5, 0.1, -0.2, -0.3, 0.0, 0.0],
        [-9.8, FRAC_1_SQRT_2, 0.0, 0.0, -FRAC_1_SQRT_2, 1.0],
        [2.0, 3.0, 8.545_594, 47.397_742, 488.0125, 95_598.1],
    ];
    for (found, expected) in told(&state, BetaflightBuild::Legacy, 2.5).iter().zip(expected.as_flattened()) {
        let signless_zero = found + 0.0;
        assert!(
            (signless_zero - expected).abs() < 1e-5 * expected.abs().max(1.0),
            "{found} instead of {expected}"
        );
    }
}

#[test]
fn a_betaflight_of_either_build_takes_vectors_for_forward_left_and_up() {
    let attitude = Attitude::from_axis_angle(Vector3::new(0.6, 0.8, 0.0), 0.5).map(|value| value as f32);
    let state = State { world_from_body: attitude, body_rates: Vector3::new(0.1, 0.2, 0.3), ..rest() };
    let up_in_body = attitude.rotate_inverse(Vector3::z());
    for build in [BetaflightBuild::Gazebo, BetaflightBuild::Legacy] {
        let taken = taken(&told(&state, build, 0.0), build);
        for axis in 0..3 {
            assert!((taken.body_rates_flu[axis] - f64::from(state.body_rates[axis])).abs() < 1e-6);
            // At rest the accelerometer feels the floor push upwards, and so does the estimate of where up is.
            assert!((taken.specific_force_flu[axis] - 9.8 * f64::from(up_in_body[axis])).abs() < 1e-5);
            let estimate = taken.nwu_from_flu.rotate_inverse(Vector3::z());
            assert!((estimate[axis] - f64::from(up_in_body[axis])).abs() < 1e-6);
        }
        // East is against west.
        let east = taken.nwu_from_flu.rotate_inverse(-Vector3::y());
        let expected = attitude.rotate_inverse(Vector3::x());
        assert!((east - expected.map(f64::from)).norm() < 1e-6, "{build:?}: {east} instead of {expected}");
    }
}

#[test]
fn sticks_are_told_only_with_a_radio() {
    assert_eq!(BetaflightSimulator::new(Home::default(), BetaflightBuild::Gazebo, None).sticks(1.0), None);
    let radio = "1100,1200,1300,1400".parse().unwrap();
    let sticks =
        BetaflightSimulator::new(Home::default(), BetaflightBuild::Gazebo, Some(radio)).sticks(1.0).unwrap();
    assert_eq!(sticks[..8], 1.0_f64.to_le_bytes());
    let channel = |number: usize| u16::from_le_bytes([sticks[6 + 2 * number], sticks[7 + 2 * number]]);
    assert_eq!([1, 2, 3, 4, 5, 16].map(channel), [1100, 1200, 1300, 1400, 1500, 1500]);
}

#[test]
fn outputs_of_at_least_four_motors_are_read() {
    assert_eq!(throttles(&pulses([0.0, 0.25, 0.5, 1.0])), Some([0.0, 0.25, 0.5, 1.0]));
    assert_eq!(throttles(&pulses([f32::NAN, f32::INFINITY, -2.0, 7.0])), Some([0.0, 0.0, 0.0, 1.0]));
    let mut three = pulses([0.5; 4]);
    three[0] = 3;
    assert_eq!(throttles(&three), None);
    assert_eq!(throttles(&pulses([0.5; 4])[..16]), None, "the shares of port 9002 are not obeyed");
}

proptest! {
    #[test]
    fn no_datagram_panics(datagram in proptest::collection::vec(any::<u8>(), 0..100)) {
        let mut simulator = BetaflightSimulator::new(Home::default(), BetaflightBuild::Gazebo, None);
        simulator.receive(&datagram);
        prop_assert!(simulator.throttles().iter().all(|throttle| (0.0..=1.0).contains(throttle)));
    }
}
