//! A scripted firmware on real sockets.

use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::Duration;

use kestrel_core::airframe::CF2X;
use proptest::prelude::*;

use super::server::CrazyflieServer;
use super::*;
use crate::bridge::datagram::DatagramSocket;
use crate::bridge::drone::Drone;
use crate::bridge::event::{BridgeCounts, BridgeEvent};
use crate::bridge::frames::ned_from_frd;
use crate::bridge::motors::{MotorOrder, Motors, ThrustCurve};
use crate::bridge::sensors::Instruments;
use crate::bridge::testing::{CRAZYFLIE, FLIGHT_SECS, Judge, Seen, fly};
use crate::geodesy::Home;
use crate::lockstep::Next;
use crate::plant::{FlatFloor, Plant};

fn rest() -> State<f32> {
    *FlatFloor::new(&CF2X, 1e-3).state()
}

fn sampled(state: &State<f32>) -> PacketBytes {
    let measurement = Instruments::new(Home::default(), Noise::Off, RATE_HZ).measure(state, state);
    CrazyflieSimulator::new(Noise::Off).sample(&measurement)
}

/// The six counts of a sample.
fn counts(sample: &[u8]) -> [i16; 6] {
    core::array::from_fn(|index| i16::from_le_bytes([sample[2 + 2 * index], sample[3 + 2 * index]]))
}

fn motors(throttles: [f32; 4]) -> Vec<u8> {
    let ratios = throttles.map(|throttle| ((throttle * 65535.0) as u16).to_le_bytes());
    [&[0x90], ratios.as_flattened()].concat()
}

/// Numbers of a pose: position, then x, y, z, w of the attitude.
fn numbers(pose: &[u8]) -> [f32; 7] {
    core::array::from_fn(|index| f32::from_le_bytes(pose[2 + 4 * index..6 + 4 * index].try_into().unwrap()))
}

/// A firmware that says hello, and answers samples with the motors of [`fly`]'s flight, by what it is told alone.
struct Firmware {
    socket: UdpSocket,
    bridge: SocketAddr,
}

impl Firmware {
    fn new(bridge: SocketAddr) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
        socket.send_to(&[HELLO], bridge).unwrap();
        let mut bytes = [0; 32];
        assert_eq!((socket.recv(&mut bytes).unwrap(), bytes[0]), (1, HELLO));
        Self { socket, bridge }
    }

    /// Answers so many samples, at the simulation's time in steps; a client's packet is sent back as it came.
    fn fly(&self, answers: u32, clock: &AtomicU32) {
        let (mut position, mut velocity, mut attitude) = ([0.0_f32; 3], [0.0_f32; 3], [0.0, 0.0, 0.0, 1.0]);
        let (mut answered, mut bytes) = (0, [0; 32]);
        while answered < answers {
            let Ok(len) = self.socket.recv(&mut bytes) else { return };
            match (bytes[0] >> 4, len) {
                (6, 30) => {
                    let pose = numbers(&bytes);
                    velocity = core::array::from_fn(|axis| (pose[axis] - position[axis]) / 0.01);
                    position = [pose[0], pose[1], pose[2]];
                    attitude = [pose[3], pose[4], pose[5], pose[6]];
                }
                (9, 14) => {
                    let sample = counts(&bytes);
                    let rates =
                        [3, 4, 5].map(|index| (f32::from(sample[index]) * DEGREES_PER_SECOND).to_radians());
                    let secs = clock.load(Ordering::Relaxed) as f32 * 1e-3;
                    let throttles = fly(&seen(position, velocity, attitude, rates), secs, &CRAZYFLIE);
                    self.socket.send_to(&motors(throttles), self.bridge).unwrap();
                    answered += 1;
                }
                _ => {
                    self.socket.send_to(&bytes[..len], self.bridge).unwrap();
                }
            }
        }
    }
}

/// In the frames of [`fly`].
fn seen(position: [f32; 3], velocity: [f32; 3], [x, y, z, w]: [f32; 4], rates: [f32; 3]) -> Seen {
    let ned = |[east, north, up]: [f32; 3]| [north, east, -up];
    let Attitude { w, x, y, z } = ned_from_frd(&Attitude { w, x, y, z }).map(|value| value as f32);
    Seen {
        position_ned: ned(position),
        velocity_ned: ned(velocity),
        attitude: [w, x, y, z],
        body_rates_frd: [rates[0], -rates[1], -rates[2]],
    }
}

fn simulate(sockets: &mut [DatagramSocket; 2], watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next) -> BridgeCounts {
    let mut plant = FlatFloor::new(&CF2X, 1e-3);
    let motors = Motors::new(&CF2X, MotorOrder::Crazyflie, ThrustCurve::PX4).unwrap();
    let mut drone = Drone::new(&mut plant, motors, Instruments::new(Home::default(), Noise::Seeded(1), RATE_HZ));
    let [firmware, clients] = sockets;
    // The flight of a scripted firmware, which has no clock, goes faster than real time.
    let simulator = CrazyflieSimulator::new(Noise::Off);
    CrazyflieServer::new(&mut drone, simulator, Duration::from_nanos(1), clients).serve(firmware, watch).unwrap()
}

fn sockets() -> [DatagramSocket; 2] {
    core::array::from_fn(|_| DatagramSocket::open("127.0.0.1:0".parse().unwrap()).unwrap())
}

#[test]
fn a_firmware_flies_to_a_point_and_lands() {
    let mut sockets = sockets();
    let bridge = sockets[0].address().unwrap();
    let mut judge = Judge::default();
    let clock = AtomicU32::new(0);
    let counts = thread::scope(|scope| {
        scope.spawn(|| Firmware::new(bridge).fly(u32::MAX, &clock));
        simulate(&mut sockets, &mut |event| {
            let mut secs = f64::from(clock.load(Ordering::Relaxed)) * 1e-3;
            if let BridgeEvent::Stepped(step) = event {
                secs += 1e-3;
                clock.fetch_add(1, Ordering::Relaxed);
                judge.see(secs, step.state);
            }
            if secs > f64::from(FLIGHT_SECS) { Next::End } else { Next::Fly }
        })
    });
    assert_eq!((counts.garbage, counts.connections), (0, 1));
    judge.judge(0.0, 0.12);
}

#[test]
fn a_client_and_the_firmware_hear_each_other() {
    let mut sockets = sockets();
    let (bridge, clients) = (sockets[0].address().unwrap(), sockets[1].address().unwrap());
    thread::scope(|scope| {
        scope.spawn(|| Firmware::new(bridge).fly(u32::MAX, &AtomicU32::new(0)));
        let client = scope.spawn(move || {
            let client = UdpSocket::bind("127.0.0.1:0").unwrap();
            client.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
            let mut bytes = [0; 32];
            for packet in [&[0xFF][..], &[0xF0, 1, 2, 3]] {
                // Nobody keeps what arrives before the firmware does: a client says it again.
                let mut is_answered = || {
                    client.send_to(packet, clients).unwrap();
                    client.recv(&mut bytes).is_ok_and(|len| bytes[..len] == *packet)
                };
                assert!((0..100).any(|_| is_answered()), "{packet:?}");
            }
        });
        simulate(&mut sockets, &mut |_| if client.is_finished() { Next::End } else { Next::Fly });
        client.join().unwrap();
    });
}

#[test]
fn a_firmware_that_goes_stops_the_motors_and_may_come_back() {
    let mut sockets = sockets();
    let bridge = sockets[0].address().unwrap();
    let (mut engaged, mut last_targets) = (0, [1.0; 4]);
    let [clock, gone] = [0, 0].map(AtomicU32::new);
    let counts = thread::scope(|scope| {
        scope.spawn(|| {
            Firmware::new(bridge).fly(700, &clock);
            while gone.load(Ordering::Relaxed) == 0 {
                thread::sleep(Duration::from_millis(5));
            }
            Firmware::new(bridge).fly(50, &clock);
        });
        simulate(&mut sockets, &mut |event| {
            match event {
                BridgeEvent::Gone => _ = gone.fetch_add(1, Ordering::Relaxed),
                BridgeEvent::Engaged => engaged += 1,
                BridgeEvent::Stepped(step) => last_targets = step.rotor_targets,
                BridgeEvent::Waiting | BridgeEvent::Connected(_) | BridgeEvent::Unanswered => {}
            }
            if gone.load(Ordering::Relaxed) == 2 { Next::End } else { Next::Fly }
        })
    });
    assert_eq!((engaged, counts.connections), (2, 2));
    assert_eq!(last_targets, [0.0; 4]);
}

// What follows needs no socket.

#[test]
fn a_sample_has_the_counts_of_the_firmwares_instruments() {
    let state = State { body_rates: Vector3::new(0.1, -0.2, 0.3), ..rest() };
    let sample = sampled(&state);
    assert_eq!((sample.len(), &sample[..2]), (14, &[0x90, 0][..]));
    let [x, y, z, roll, pitch, yaw] = counts(&sample);
    assert_eq!(([x, y], [roll, pitch, yaw]), ([0, 0], [94, -188, 282]));
    // One g, of 9.8 instead of 9.81 m/s², in counts of 2⁻¹¹ g.
    assert_eq!(z, 2046);
}

#[test]
fn a_pose_comes_with_every_tenth_step() {
    let attitude = Attitude::from_axis_angle(Vector3::new(0.6, 0.8, 0.0), 0.5).map(|value| value as f32);
    let state = State { position: Vector3::new(1.0, 2.0, 3.0), world_from_body: attitude, ..rest() };
    let mut simulator = CrazyflieSimulator::new(Noise::Off);
    let poses: Vec<_> = (0..20).map(|_| simulator.pose(&state)).collect();
    let given: Vec<usize> = (0..20).filter(|step| poses[*step].is_some()).collect();
    assert_eq!(given, [0, 10]);
    let pose = poses[10].as_ref().unwrap();
    assert_eq!((pose.len(), &pose[..2]), (30, &[0x61, 8][..]));
    let expected = [1.0, 2.0, 3.0, attitude.x, attitude.y, attitude.z, attitude.w];
    assert!(numbers(pose).iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6));
    let noisy = CrazyflieSimulator::new(Noise::Seeded(1)).pose(&state).unwrap();
    let error = (0..3).map(|axis| (numbers(&noisy)[axis] - expected[axis]).abs()).fold(0.0, f32::max);
    assert!(error > 1e-5 && error < 6e-3, "{error}");
}

#[test]
fn what_a_firmware_says_is_told_apart() {
    let mut simulator = CrazyflieSimulator::new(Noise::Off);
    let said = [&[HELLO][..], &motors([0.0, 0.25, 0.5, 1.0]), &[0x00, b'h', b'i'], &[0x90, 1], &[], &[0xA0; 40]];
    let heard = said.map(|datagram| simulator.receive(datagram));
    assert_eq!(heard, [Said::Hello, Said::Motors, Said::ForClient, Said::Garbage, Said::Garbage, Said::Garbage]);
    assert!(
        simulator
            .throttles()
            .iter()
            .zip([0.0, 0.25, 0.5, 1.0])
            .all(|(found, wanted)| (found - wanted).abs() < 1e-4)
    );
    assert_eq!((simulator.engaged(), simulator.waiting(), simulator.garbage()), (true, 0, 2));
}

proptest! {
    #[test]
    fn no_datagram_panics(datagram in proptest::collection::vec(any::<u8>(), 0..64)) {
        let mut simulator = CrazyflieSimulator::new(Noise::Off);
        simulator.receive(&datagram);
        prop_assert!(simulator.throttles().iter().all(|throttle| (0.0..=1.0).contains(throttle)));
    }
}
