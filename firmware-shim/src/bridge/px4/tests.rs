//! Scripted PX4s on real sockets: what they say and when follows recordings of PX4's own simulation.

#![expect(clippy::wildcard_enum_match_arm, reason = "a message is one of the dialect's hundreds")]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use kestrel_core::airframe::CF2X;
use mavlink::dialects::common::{
    COMMAND_LONG_DATA, HEARTBEAT_DATA, HIL_ACTUATOR_CONTROLS_DATA, HilActuatorControlsFlags, MavAutopilot, MavCmd,
    MavMessage, MavModeFlag,
};
use mavlink::{MavlinkVersion, Message};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::server::{ANSWER_LIMIT, Listener, Px4Server};
use super::*;
use crate::bridge::BridgeError;
use crate::bridge::drone::Drone;
use crate::bridge::event::{BridgeCounts, BridgeEvent};
use crate::bridge::motors::{MotorOrder, Motors, ThrustCurve};
use crate::bridge::noise::Noise;
use crate::bridge::sensors::Instruments;
use crate::bridge::testing::{FLIGHT_SECS, Judge, QUAD_X, Seen, StateHash, fly};
use crate::lockstep::{Next, SimulationRate};
use crate::plant::{FlatFloor, Plant, Ranges};

const RATE_HZ: u32 = 250;

/// Sensor messages that a PX4 needs before its first answer; 11 to 77 were recorded.
const WAKING_MESSAGES: u64 = 20;

fn listener() -> Listener {
    Listener::open("127.0.0.1:0".parse().unwrap()).unwrap()
}

/// Serves a drone on the floor until `watch` ends it.
fn serve(listener: &Listener, noise: Noise, watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next) -> BridgeCounts {
    let mut plant = FlatFloor::new(&CF2X, 1.0 / RATE_HZ as f32);
    let motors = Motors::new(&CF2X, MotorOrder::QuadX, ThrustCurve::PX4).unwrap();
    let mut drone = Drone::new(&mut plant, motors, Instruments::new(Home::default(), noise, RATE_HZ));
    let simulator = Px4Simulator::new(Home::default(), RATE_HZ, None);
    let period = Duration::from_secs(1) / RATE_HZ;
    Px4Server::new(&mut drone, simulator, period, SimulationRate::Unthrottled).serve(listener, watch).unwrap()
}

fn actuators(time_usec: u64, throttles: [f32; 4], armed: bool) -> HIL_ACTUATOR_CONTROLS_DATA {
    let mut controls = [0.0; 16];
    controls[..4].copy_from_slice(&throttles);
    let custom = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED;
    HIL_ACTUATOR_CONTROLS_DATA {
        time_usec,
        flags: HilActuatorControlsFlags::HIL_ACTUATOR_CONTROLS_FLAGS_LOCKSTEP,
        controls,
        mode: if armed { custom | MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED } else { custom },
    }
}

/// A PX4 that reads the simulator's stream.
struct Px4 {
    stream: TcpStream,
    receiver: Receiver,
    encoder: Encoder,
    buffer: Vec<u8>,
    read: usize,
}

impl Px4 {
    fn connect(address: SocketAddr) -> Self {
        let end = Instant::now() + Duration::from_secs(10);
        let stream = loop {
            match TcpStream::connect(address) {
                Ok(stream) => break stream,
                Err(error) => assert!(Instant::now() < end, "{error}"),
            }
            thread::sleep(Duration::from_millis(1));
        };
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        let mut px4 =
            Self { stream, receiver: Receiver::new(), encoder: Encoder::new(1, 1), buffer: Vec::new(), read: 0 };
        px4.introduce();
        px4
    }

    /// The first two messages of PX4.
    fn introduce(&mut self) {
        let autopilot = MavAutopilot::MAV_AUTOPILOT_PX4;
        self.send(&Payload::of(&HEARTBEAT_DATA { autopilot, ..HEARTBEAT_DATA::default() }));
        self.send(&Payload::of(&COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            param1: 115.0,
            param2: 5000.0,
            ..COMMAND_LONG_DATA::default()
        }));
    }

    fn send(&mut self, payload: &Payload) {
        let frame = self.encoder.encode(payload);
        // A simulator that has ended is noticed when reading.
        let _closed = self.stream.write_all(&frame);
    }

    fn answer(&mut self, time_usec: u64, throttles: [f32; 4]) {
        self.send(&Payload::of(&actuators(time_usec, throttles, true)));
    }

    /// The next message; none when the simulator has closed the connection.
    fn next(&mut self) -> Option<MavMessage> {
        loop {
            while self.read < self.buffer.len() {
                self.read += 1;
                if let Some(frame) = self.receiver.push(self.buffer[self.read - 1]) {
                    let frame = frame.unwrap();
                    return Some(MavMessage::parse(MavlinkVersion::V2, frame.message_id, frame.payload).unwrap());
                }
            }
            self.buffer.resize(2048, 0);
            self.read = 0;
            let len = self.stream.read(&mut self.buffer).unwrap_or(0);
            self.buffer.truncate(len);
            if len == 0 {
                return None;
            }
        }
    }

    /// The next sensor message, and the true state that came before it, if one did.
    fn sense(&mut self) -> Option<(HIL_SENSOR_DATA, Option<HIL_STATE_QUATERNION_DATA>)> {
        let mut state = None;
        loop {
            match self.next()? {
                MavMessage::HIL_SENSOR(sensor) => return Some((sensor, state)),
                MavMessage::HIL_STATE_QUATERNION(told) => state = Some(told),
                MavMessage::HIL_GPS(_) | MavMessage::RC_CHANNELS(_) | MavMessage::DISTANCE_SENSOR(_) => {}
                other => panic!("PX4 does not expect {other:?}"),
            }
        }
    }

    /// The first sensor message after PX4 has woken up.
    fn wake(&mut self) -> Option<(HIL_SENSOR_DATA, Option<HIL_STATE_QUATERNION_DATA>)> {
        (0..=WAKING_MESSAGES).map(|_| self.sense()).last()?
    }
}

/// What [`fly`] sees, from PX4's messages alone.
fn seen(sensor: &HIL_SENSOR_DATA, state: &HIL_STATE_QUATERNION_DATA) -> Seen {
    let home = Home::default();
    let global = Geodetic {
        latitude_deg: f64::from(state.lat) * 1e-7,
        longitude_deg: f64::from(state.lon) * 1e-7,
        altitude_m: f64::from(state.alt) * 1e-3,
    };
    Seen {
        position_ned: ned_from_enu(&home.point_at(&global)),
        velocity_ned: [state.vx, state.vy, state.vz].map(|speed| f32::from(speed) * 0.01),
        attitude: state.attitude_quaternion,
        body_rates_frd: [sensor.xgyro, sensor.ygyro, sensor.zgyro],
    }
}

/// A PX4 that flies [`fly`]'s flight again and again, with pauses on the wall clock, until it has made so many steps or the
/// simulator ends. The first step is the first sensor message that was sent after both were `engaged`: before, on a busy
/// machine, some wait unread.
fn pilot(address: SocketAddr, engaged: &AtomicBool, steps: u64, pause: impl Fn(u64) -> Duration) {
    let mut px4 = Px4::connect(address);
    let Some((mut sensor, mut state)) = px4.wake() else { return };
    let (mut known, mut step) = (None, 0);
    while step < steps {
        let mut throttles = [0.0; 4];
        if engaged.load(Ordering::SeqCst) {
            known = state.or(known);
            let secs = (step as f32 / RATE_HZ as f32) % FLIGHT_SECS;
            throttles = known.as_ref().map_or([0.0; 4], |known| fly(&seen(&sensor, known), secs, &QUAD_X));
            thread::sleep(pause(step));
            step += 1;
        }
        px4.answer(sensor.time_usec, throttles);
        let Some(next) = px4.sense() else { return };
        let elapsed = next.0.time_usec - sensor.time_usec;
        assert_eq!(elapsed, 4000, "time advances by a constant step");
        (sensor, state) = next;
    }
}

/// Flies so many commanded steps, and gives what became of them with the hash of their states.
fn lockstep(steps: u64, noise: Noise, pause: impl Fn(u64) -> Duration + Send) -> (BridgeCounts, StateHash, Judge) {
    let listener = listener();
    let address = listener.address().unwrap();
    let (mut hash, mut judge, mut flown) = (StateHash::new(), Judge::default(), 0);
    let engaged = AtomicBool::new(false);
    let counts = thread::scope(|scope| {
        scope.spawn(|| pilot(address, &engaged, u64::MAX, pause));
        serve(&listener, noise, &mut |event| {
            match event {
                BridgeEvent::Engaged => engaged.store(true, Ordering::SeqCst),
                BridgeEvent::Stepped(step) if engaged.load(Ordering::SeqCst) => {
                    hash.add(step.state);
                    judge.see(flown as f64 / f64::from(RATE_HZ), step.state);
                    flown += 1;
                }
                BridgeEvent::Gone => panic!("PX4 has gone after {flown} steps"),
                BridgeEvent::Waiting
                | BridgeEvent::Connected(_)
                | BridgeEvent::Stepped(_)
                | BridgeEvent::Unanswered => {}
            }
            if flown == steps { Next::End } else { Next::Fly }
        })
    });
    (counts, hash, judge)
}

#[test]
fn a_px4_flies_to_a_point_and_lands_in_lockstep() {
    let steps = (FLIGHT_SECS * RATE_HZ as f32) as u64;
    for noise in [Noise::Off, Noise::Seeded(1)] {
        let (counts, _, judge) = lockstep(steps, noise, |_| Duration::ZERO);
        assert_eq!((counts.answered, counts.unanswered, counts.garbage), (steps, 0, 0), "{counts:?}");
        judge.judge(0.0, 0.1);
    }
}

#[test]
fn a_hundred_thousand_steps_repeat_themselves_whatever_the_wall_clock_does() {
    const STEPS: u64 = 100_000;
    let (first, expected, _) = lockstep(STEPS, Noise::Seeded(7), |_| Duration::ZERO);
    let jitter = |step: u64| {
        let [normal, ..] = Noise::Seeded(99).normals(crate::bridge::noise::Purpose::Gyroscope, step);
        // Every five hundredth answer is up to 30 ms late.
        if step.is_multiple_of(500) {
            Duration::from_secs_f32(0.01 * normal.abs().min(3.0))
        } else {
            Duration::ZERO
        }
    };
    let (second, found, _) = lockstep(STEPS, Noise::Seeded(7), jitter);
    assert_eq!((first.unanswered, second.unanswered), (0, 0), "no step is lost");
    assert_eq!(found, expected);
    let (_, other, _) = lockstep(2000, Noise::Seeded(8), |_| Duration::ZERO);
    assert_ne!(other, expected);
}

#[test]
fn a_px4_that_restarts_is_served_again_within_a_second() {
    let listener = listener();
    let address = listener.address().unwrap();
    let mut gone_at = None;
    let mut away = Duration::ZERO;
    let mut connections = 0;
    let counts = thread::scope(|scope| {
        scope.spawn(move || {
            pilot(address, &AtomicBool::new(true), 300, |_| Duration::ZERO);
            thread::sleep(Duration::from_millis(100));
            pilot(address, &AtomicBool::new(true), 300, |_| Duration::ZERO);
        });
        serve(&listener, Noise::Off, &mut |event| {
            match event {
                BridgeEvent::Gone if connections == 2 => return Next::End,
                BridgeEvent::Gone => gone_at = Some(Instant::now()),
                BridgeEvent::Connected(_) => {
                    connections += 1;
                    away = gone_at.map_or(Duration::ZERO, |gone: Instant| gone.elapsed());
                }
                BridgeEvent::Waiting
                | BridgeEvent::Engaged
                | BridgeEvent::Stepped(_)
                | BridgeEvent::Unanswered => {}
            }
            Next::Fly
        })
    });
    assert_eq!(counts.connections, 2);
    assert!((590..=600).contains(&counts.answered), "{counts:?}");
    assert!(away < Duration::from_secs(5), "{away:?}");
}

#[test]
fn a_px4_that_falls_silent_delays_its_steps_and_gives_way_to_another() {
    let listener = listener();
    let address = listener.address().unwrap();
    let started = Instant::now();
    let mut connected = 0;
    let counts = thread::scope(|scope| {
        scope.spawn(move || {
            let mut silent = Px4::connect(address);
            let (mut sensor, _) = silent.wake().unwrap();
            for _ in 0..20 {
                silent.answer(sensor.time_usec, [0.5; 4]);
                (sensor, _) = silent.sense().unwrap();
            }
            // Reads on and never answers again; the next one waits in the queue meanwhile.
            let second = thread::spawn(move || pilot(address, &AtomicBool::new(true), 50, |_| Duration::ZERO));
            while silent.sense().is_some() {}
            second.join().unwrap();
        });
        serve(&listener, Noise::Off, &mut |event| match event {
            BridgeEvent::Connected(_) => {
                connected += 1;
                Next::Fly
            }
            BridgeEvent::Gone if connected == 2 => Next::End,
            BridgeEvent::Waiting
            | BridgeEvent::Engaged
            | BridgeEvent::Stepped(_)
            | BridgeEvent::Unanswered
            | BridgeEvent::Gone => Next::Fly,
        })
    });
    assert_eq!(counts.unanswered, 1, "{counts:?}");
    assert_eq!(counts.connections, 2);
    assert!((50..=70).contains(&counts.answered), "{counts:?}");
    assert!(started.elapsed() > ANSWER_LIMIT);
}

#[test]
fn garbage_is_counted_and_hurts_nobody() {
    let listener = listener();
    let address = listener.address().unwrap();
    let mut worst: f32 = 0.0;
    let counts = thread::scope(|scope| {
        scope.spawn(move || {
            let mut px4 = Px4::connect(address);
            let (mut sensor, _) = px4.wake().unwrap();
            let nonsense = [f32::NAN, f32::INFINITY, -7.0, 1e30];
            for step in 0..200_u32 {
                let noise: Vec<u8> = (0..step).map(|byte| (byte.wrapping_mul(step * 7919) >> 3) as u8).collect();
                let _closed = px4.stream.write_all(&noise);
                // A frame may be swallowed by one that the noise pretended to begin; a few more get through.
                for _ in 0..5 {
                    px4.answer(sensor.time_usec, nonsense);
                }
                let Some(next) = px4.sense() else { return };
                sensor = next.0;
            }
        });
        serve(&listener, Noise::Off, &mut |event| match event {
            BridgeEvent::Stepped(step) => {
                assert!(step.rotor_targets.iter().all(|target| target.is_finite()));
                worst = step.rotor_targets.into_iter().fold(worst, f32::max);
                assert!(step.state.position.iter().all(|coordinate| coordinate.is_finite()));
                Next::Fly
            }
            BridgeEvent::Gone => Next::End,
            BridgeEvent::Waiting | BridgeEvent::Connected(_) | BridgeEvent::Engaged | BridgeEvent::Unanswered => {
                Next::Fly
            }
        })
    });
    assert!(counts.garbage > 0 && counts.unanswered <= 2, "{counts:?}");
    assert_eq!(worst, CF2X.rotor_speed_limit as f32, "what is too much is limited");
}

#[test]
fn two_simulators_cannot_share_a_port() {
    let first = listener();
    let address = first.address().unwrap();
    let error = Listener::open(address).unwrap_err();
    assert!(matches!(error, BridgeError::Busy { .. }));
    let text = error.to_string();
    assert!(text.contains(&address.to_string()) && text.contains("--instance"), "{text}");
}

#[test]
fn two_px4s_fly_two_simulators_at_once() {
    let flights: Vec<_> = (0..2)
        .map(|seed| thread::spawn(move || lockstep(4500, Noise::Seeded(seed), |_| Duration::ZERO)))
        .collect();
    for flight in flights {
        let (counts, _, judge) = flight.join().unwrap();
        assert_eq!((counts.answered, counts.unanswered), (4500, 0));
        judge.judge(0.0, 0.1);
    }
}

// What follows needs no socket.

fn told(simulator: &mut Px4Simulator, measurement: &Measurement, state: &State<f32>) -> Vec<MavMessage> {
    let mut messages = Vec::new();
    simulator.send(measurement, state, &mut |frame| messages.push(crate::testing::message(frame)));
    messages
}

fn rest() -> State<f32> {
    *FlatFloor::new(&CF2X, 0.004).state()
}

#[test]
fn messages_have_the_rates_fields_and_units_that_px4_expects() {
    let mut simulator = Px4Simulator::new(Home::default(), RATE_HZ, Some("1500,1500,1000,1500".parse().unwrap()));
    let mut instruments = Instruments::new(Home::default(), Noise::Off, RATE_HZ);
    let (mut sensors, mut slow, mut fixes, mut states, mut radios) = (0, 0, 0, 0, 0);
    let mut last_micros = 0;
    for _ in 0..250 {
        let measurement = instruments.measure(&rest(), &rest());
        for message in told(&mut simulator, &measurement, &rest()) {
            match message {
                MavMessage::HIL_SENSOR(sensor) => {
                    assert!(sensor.time_usec >= START_MICROS && sensor.time_usec > last_micros);
                    last_micros = sensor.time_usec;
                    assert_eq!([sensor.xacc, sensor.yacc], [0.0, 0.0]);
                    assert!((sensor.zacc + 9.8).abs() < 1e-6);
                    let fields = sensor.fields_updated.bits();
                    assert!([0x3F, 0x3F | 0x1C0 | 0x1A00].contains(&fields), "whole groups only: {fields:#x}");
                    if fields != 0x3F {
                        slow += 1;
                        assert!((sensor.abs_pressure - 956.0).abs() < 1.0, "{} hPa", sensor.abs_pressure);
                    }
                    sensors += 1;
                }
                MavMessage::HIL_GPS(gps) => {
                    fixes += 1;
                    assert_eq!((gps.lat, gps.lon, gps.alt), (473_977_420, 85_455_940, 488_013));
                    assert_eq!((gps.fix_type, gps.eph, gps.epv, gps.cog), (3, 30, 50, u16::MAX));
                }
                MavMessage::HIL_STATE_QUATERNION(state) => {
                    states += 1;
                    assert_eq!(state.zacc, -999, "in thousandths of standard gravity");
                }
                MavMessage::RC_CHANNELS(radio) => {
                    radios += 1;
                    assert_eq!((radio.chancount, radio.chan3_raw, radio.chan5_raw), (4, 1000, u16::MAX));
                }
                other => panic!("{other:?}"),
            }
        }
    }
    assert_eq!((sensors, slow, fixes, states, radios), (250, 50, 10, 50, 10));
}

#[test]
fn a_hard_landing_and_a_fast_spin_keep_their_signs_in_px4() {
    let mut simulator = Px4Simulator::new(Home::default(), RATE_HZ, None);
    let rate = 2000.0_f32.to_radians();
    let measurement =
        Measurement { specific_force_frd: [235.0, 0.0, -157.0], body_rates_frd: [rate, -rate, 0.0], ..still() };
    let sensed = told(&mut simulator, &measurement, &rest()).into_iter().find_map(|message| match message {
        MavMessage::HIL_SENSOR(sensor) => Some(sensor),
        _ => None,
    });
    let sensor = sensed.unwrap();
    // Whole numbers of units, as `SimulatorMavlink::update_sensors` casts them to `int16_t`.
    let kept = |value: f32, unit: f32| (value / unit) as i32;
    assert_eq!([sensor.xacc, sensor.yacc, sensor.zacc].map(|force| kept(force, FORCE_UNIT)), [32767, 0, -32767]);
    assert_eq!([sensor.xgyro, sensor.ygyro, sensor.zgyro].map(|rate| kept(rate, RATE_UNIT)), [32767, -32767, 0]);
}

#[test]
fn the_true_state_comes_as_often_as_it_is_asked_for() {
    let mut simulator = Px4Simulator::new(Home::default(), RATE_HZ, None);
    let measurement = Instruments::new(Home::default(), Noise::Off, RATE_HZ).measure(&rest(), &rest());
    let mut count = |micros: Option<f32>| {
        if let Some(param2) = micros {
            let command = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
            let ask = COMMAND_LONG_DATA { command, param1: 115.0, param2, ..COMMAND_LONG_DATA::default() };
            simulator.receive(&Encoder::new(1, 1).encode(&Payload::of(&ask)));
        }
        let is_state = |message: &MavMessage| matches!(message, MavMessage::HIL_STATE_QUATERNION(_));
        (0..250).flat_map(|_| told(&mut simulator, &measurement, &rest())).filter(is_state).count()
    };
    assert_eq!(count(None), 50);
    assert_eq!(count(Some(5000.0)), 250, "at most with every sensor message");
    assert_eq!(count(Some(100_000.0)), 10);
    assert_eq!(count(Some(-1.0)), 0);
    assert_eq!(count(Some(f32::NAN)), 0);
    assert_eq!(count(Some(0.0)), 50);
}

#[test]
fn velocities_and_attitudes_are_those_of_their_frames() {
    let state = State { velocity: Vector3::new(1.0, 2.0, 3.0), ..rest() };
    let payload = hil_state(&state, &Home::default(), &still(), 5);
    let bytes = Encoder::new(1, 1).encode(&payload);
    let MavMessage::HIL_STATE_QUATERNION(message) = crate::testing::message(&bytes) else { panic!() };
    assert_eq!([message.vx, message.vy, message.vz], [200, 100, -300]);
    // Level and facing east: a quarter turn to the right about down.
    let expected = [core::f32::consts::FRAC_1_SQRT_2, 0.0, 0.0, core::f32::consts::FRAC_1_SQRT_2];
    for (found, expected) in message.attitude_quaternion.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6);
    }
}

fn still() -> Measurement {
    Instruments::new(Home::default(), Noise::Off, RATE_HZ).measure(&rest(), &rest())
}

/// PX4's collision prevention takes them.
#[test]
fn what_rangers_see_is_told_with_the_sample_in_which_they_do() {
    let mut simulator = Px4Simulator::new(Home::default(), RATE_HZ, None);
    let ranges = Ranges { front: Some(1.25), back: None, left: None, right: Some(0.5), up: None, down: Some(0.1) };
    let messages = told(&mut simulator, &Measurement { ranges: Some(ranges), ..still() }, &rest());
    let rangers: Vec<_> = messages
        .iter()
        .filter_map(|message| match message {
            MavMessage::DISTANCE_SENSOR(ranger) => Some((ranger.orientation as u8, ranger.current_distance)),
            _ => None,
        })
        .collect();
    assert_eq!(rangers, [(0, 125), (4, 401), (6, 401), (2, 50), (24, 401), (25, 10)]);
    let none = told(&mut simulator, &still(), &rest());
    assert!(!none.iter().any(|message| matches!(message, MavMessage::DISTANCE_SENSOR(_))));
}

#[test]
fn a_disarmed_px4_turns_no_motor() {
    let mut simulator = Px4Simulator::new(Home::default(), RATE_HZ, None);
    let mut encoder = Encoder::new(1, 1);
    simulator.receive(&encoder.encode(&Payload::of(&actuators(START_MICROS, [0.5; 4], false))));
    assert!(simulator.engaged() && simulator.answered());
    assert_eq!(simulator.throttles(), [0.0; 4]);
    simulator.receive(&encoder.encode(&Payload::of(&actuators(START_MICROS, [0.1, 0.2, 0.3, 0.4], true))));
    assert_eq!(simulator.throttles(), [0.1, 0.2, 0.3, 0.4]);
    simulator.reconnect();
    assert!(!simulator.engaged());
    assert_eq!(simulator.throttles(), [0.0; 4], "a new PX4 has not commanded anything");
}

#[test]
fn answers_to_messages_that_waited_unread_are_not_taken_for_the_last() {
    let mut simulator = Px4Simulator::new(Home::default(), RATE_HZ, None);
    let mut encoder = Encoder::new(1, 1);
    for _ in 0..3 {
        told(&mut simulator, &still(), &rest());
    }
    let mut answer = |time_usec: u64| {
        simulator.receive(&encoder.encode(&Payload::of(&actuators(time_usec, [0.0; 4], false))));
        (simulator.awake(), simulator.engaged(), simulator.answered())
    };
    assert_eq!(answer(START_MICROS), (true, false, false));
    assert_eq!(answer(START_MICROS + 4000), (true, false, false));
    assert_eq!(answer(START_MICROS + 8000), (true, true, true));
    let mut simulator = Px4Simulator::new(Home::default(), RATE_HZ, None);
    told(&mut simulator, &still(), &rest());
    simulator.receive(&encoder.encode(&Payload::of(&actuators(0, [0.0; 4], false))));
    assert!(simulator.engaged(), "a clock that is not the simulator's says nothing");
}

#[test]
fn every_rate_keeps_its_time() {
    for rate_hz in [50, 250, 400, 500, 1200] {
        let mut simulator = Px4Simulator::new(Home::default(), rate_hz, None);
        for _ in 0..10 * rate_hz {
            told(&mut simulator, &still(), &rest());
        }
        let elapsed = simulator.time_micros() - START_MICROS;
        assert!(elapsed.abs_diff(10_000_000) <= 12, "{elapsed} µs at {rate_hz} Hz");
    }
}

proptest! {
    #[test]
    fn no_stream_of_bytes_panics(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        let mut simulator = Px4Simulator::new(Home::default(), RATE_HZ, None);
        simulator.receive(&bytes);
        prop_assert!(simulator.throttles().iter().all(|throttle| *throttle == 0.0));
    }
}
