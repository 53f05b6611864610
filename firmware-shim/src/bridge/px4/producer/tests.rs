//! Our autopilot behind our own simulator: both sides of PX4's interface against each other.

use std::net::SocketAddr;
use std::thread;
use std::time::{Duration, Instant};

use kestrel_core::airframe::CF2X;
use mavlink::MessageData;
use mavlink::dialects::common::{HIL_SENSOR_DATA, HIL_STATE_QUATERNION_DATA, MavMessage};
use proptest::prelude::*;

use super::*;
use crate::autopilot::{Autopilot, Command, Mode, Refusal, Surroundings};
use crate::bridge::drone::Drone;
use crate::bridge::event::BridgeEvent;
use crate::bridge::motors::{MotorOrder, ThrustCurve};
use crate::bridge::noise::Noise;
use crate::bridge::px4::Px4Simulator;
use crate::bridge::px4::client::ExternalSimulator;
use crate::bridge::px4::server::{Listener, Px4Server};
use crate::bridge::sensors::Instruments;
use crate::lockstep::{Next, SimulationRate};
use crate::plant::{FlatFloor, Plant};
use crate::testing::{hover_policy, message, pilot};

const RATE_HZ: u32 = 250;

fn motors() -> Motors {
    Motors::new(&CF2X, MotorOrder::QuadX, ThrustCurve::PX4).unwrap()
}

/// A simulator on a free port that runs while `watch` lets it.
fn simulator(listener: &Listener, noise: Noise, watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next) {
    let mut plant = FlatFloor::new(&CF2X, 1.0 / RATE_HZ as f32);
    let mut drone = Drone::new(&mut plant, motors(), Instruments::new(Home::default(), noise, RATE_HZ));
    let simulator = Px4Simulator::new(Home::default(), RATE_HZ, None);
    let period = Duration::from_secs(1) / RATE_HZ;
    Px4Server::new(&mut drone, simulator, period, SimulationRate::Unthrottled).serve(listener, watch).unwrap();
}

fn listener() -> (Listener, SocketAddr) {
    let listener = Listener::open("127.0.0.1:0".parse().unwrap()).unwrap();
    let address = listener.address().unwrap();
    (listener, address)
}

/// Our autopilot in a simulator elsewhere.
struct Vehicle {
    autopilot: Autopilot<kestrel_core::pilot::Pilot<'static>>,
    plant: ExternalSimulator,
}

impl Vehicle {
    fn at(address: SocketAddr) -> Self {
        let autopilot = Autopilot::new(pilot(hover_policy()), &CF2X);
        let plant = ExternalSimulator::new(address, motors(), autopilot.control_secs());
        Self { autopilot, plant }
    }

    fn tick(&mut self) {
        let targets = self.autopilot.tick(self.plant.state(), &Surroundings::default());
        self.plant.step(&targets);
    }

    /// Ticks until it is so, for at most ten seconds of the wall clock.
    fn tick_until(&mut self, wanted: impl Fn(&Self) -> bool) {
        let end = Instant::now() + Duration::from_secs(10);
        while !wanted(self) {
            assert!(Instant::now() < end, "mode {}", self.autopilot.mode().name());
            self.tick();
        }
    }

    fn fly(&mut self, ticks: u32) {
        for _ in 0..ticks {
            self.tick();
        }
    }
}

#[test]
fn our_policy_flies_in_a_simulator_that_expects_a_px4() {
    let (listener, address) = listener();
    let (mut truth, mut ended) = (Vec::new(), false);
    thread::scope(|scope| {
        let flight = scope.spawn(move || {
            let mut vehicle = Vehicle::at(address);
            vehicle.tick_until(|vehicle| vehicle.plant.state().position.x.is_finite());
            vehicle.tick();
            vehicle.autopilot.command(Command::Arm).unwrap();
            vehicle.autopilot.command(Command::TakeOff { altitude_m: 1.0 }).unwrap();
            vehicle.fly(600);
            assert_eq!(vehicle.autopilot.mode(), Mode::Holding);
            vehicle.autopilot.command(Command::GoTo(Vector3::new(0.5, 0.8, 1.0))).unwrap();
            vehicle.fly(600);
            let there = *vehicle.plant.state();
            vehicle.autopilot.command(Command::Land).unwrap();
            vehicle.tick_until(|vehicle| vehicle.autopilot.mode() == Mode::Disarmed);
            there
        });
        simulator(&listener, Noise::Seeded(2), &mut |event| {
            if let BridgeEvent::Stepped(step) = event {
                truth.push(*step.state);
            }
            ended |= matches!(event, BridgeEvent::Gone);
            if ended { Next::End } else { Next::Fly }
        });
        let there = flight.join().unwrap();
        assert!((there.position - Vector3::new(0.5, 0.8, 1.0)).norm() < 0.1, "it believes {}", there.position);
    });
    let closest =
        truth.iter().map(|state| (state.position - Vector3::new(0.5, 0.8, 1.0)).norm()).fold(9.0, f32::min);
    assert!(closest < 0.05, "{closest} m");
    let end = truth.last().unwrap();
    assert_eq!((end.position.z, end.velocity.norm()), (0.0125, 0.0));
    assert!((end.position.xy() - Vector3::new(0.5, 0.8, 0.0).xy()).norm() < 0.15, "{}", end.position);
}

#[test]
fn a_simulator_that_goes_disarms_the_vehicle_and_may_come_back() {
    let (listener, address) = listener();
    let mut vehicle = Vehicle::at(address);
    assert_eq!(vehicle.autopilot.command(Command::Arm).err(), Some(Refusal::StateUnknown));
    for _ in 0..2 {
        thread::scope(|scope| {
            let (sender, receiver) = std::sync::mpsc::channel::<()>();
            let listener = &listener;
            scope.spawn(move || {
                simulator(listener, Noise::Off, &mut |_| match receiver.try_recv() {
                    Err(std::sync::mpsc::TryRecvError::Empty) => Next::Fly,
                    Ok(()) | Err(std::sync::mpsc::TryRecvError::Disconnected) => Next::End,
                });
            });
            vehicle.tick_until(|vehicle| vehicle.plant.state().position.x.is_finite());
            vehicle.tick();
            vehicle.autopilot.command(Command::Arm).unwrap();
            vehicle.autopilot.command(Command::TakeOff { altitude_m: 1.0 }).unwrap();
            vehicle.fly(300);
            assert!(vehicle.plant.state().position.z > 0.5);
            drop(sender);
        });
        vehicle.tick_until(|vehicle| vehicle.autopilot.mode() == Mode::Disarmed);
        assert!(!vehicle.plant.state().position.x.is_finite());
    }
}

// What follows needs no socket.

fn bytes<D: MessageData>(message: &D) -> Vec<u8> {
    Encoder::new(1, 200).encode(&Payload::of(message)).to_vec()
}

fn receive(producer: &mut Producer, bytes: &[u8]) -> Option<SensorReadings> {
    bytes.iter().filter_map(|byte| producer.receive(*byte)).last()
}

fn level_at(time_usec: u64) -> HIL_STATE_QUATERNION_DATA {
    HIL_STATE_QUATERNION_DATA {
        time_usec,
        attitude_quaternion: [1.0, 0.0, 0.0, 0.0],
        lat: 473_977_420,
        lon: 85_455_940,
        alt: 488_000,
        ..HIL_STATE_QUATERNION_DATA::default()
    }
}

fn sensor_at(time_usec: u64) -> HIL_SENSOR_DATA {
    HIL_SENSOR_DATA { time_usec, zacc: -9.8, ..HIL_SENSOR_DATA::default() }
}

#[test]
fn the_first_words_are_those_of_px4() {
    let mut words = Vec::new();
    Producer::new(motors()).introduce(&mut |frame| words.push(message(frame)));
    let [MavMessage::HEARTBEAT(heartbeat), MavMessage::COMMAND_LONG(command)] = &words[..] else {
        panic!("{words:?}")
    };
    assert_eq!(heartbeat.autopilot as u8, 12);
    assert_eq!((command.command as u16, command.param1, command.param2), (511, 115.0, 5000.0));
}

#[test]
fn answers_carry_the_time_of_the_sensors_and_the_motors_of_px4() {
    let mut producer = Producer::new(motors());
    let sensed = receive(&mut producer, &bytes(&sensor_at(1_234_000))).unwrap();
    let limit = CF2X.rotor_speed_limit as f32;
    producer.command(&[limit, 0.5 * limit, 0.0, f32::NAN]);
    let mut answer = None;
    producer.answer(sensed, &mut |frame| answer = Some(message(frame)));
    let Some(MavMessage::HIL_ACTUATOR_CONTROLS(controls)) = &answer else { panic!("{answer:?}") };
    assert_eq!(controls.time_usec, 1_234_000);
    // The Crazyflie's front right, rear right, rear left, front left: motors 1, 4, 2, 3 of the quad X.
    assert_eq!(controls.controls[..5], [1.0, 0.0, 0.0, 0.25, 0.0]);
    assert_eq!((controls.mode.bits(), controls.flags.bits()), (129, 1));
    producer.command(&[0.0; 4]);
    producer.answer(sensed, &mut |frame| answer = Some(message(frame)));
    let Some(MavMessage::HIL_ACTUATOR_CONTROLS(controls)) = &answer else { panic!("{answer:?}") };
    assert_eq!(controls.mode.bits(), 1, "motors that stand are not armed");
}

#[test]
fn between_two_true_states_the_inertial_sensors_carry_on() {
    let mut producer = Producer::new(motors());
    assert_eq!(producer.state(), None);
    receive(&mut producer, &bytes(&sensor_at(1_000_000)));
    assert_eq!(producer.state(), None, "sensors alone say nothing");
    receive(&mut producer, &bytes(&level_at(1_000_000)));
    for step in 1..=100 {
        let sensor = HIL_SENSOR_DATA { xacc: 1.0, zgyro: 0.5, ..sensor_at(1_000_000 + 4000 * step) };
        receive(&mut producer, &bytes(&sensor));
    }
    // 0.4 s at 1 m/s² along a nose that faced north and turned right by 0.2 rad.
    let state = producer.state().unwrap();
    assert!((state.velocity.y - 0.4).abs() < 0.01 && (state.velocity.x - 0.04).abs() < 0.01, "{}", state.velocity);
    assert!((state.position.y - 0.08).abs() < 0.01, "{}", state.position);
    let nose = state.world_from_body.rotate(Vector3::x());
    assert!((nose.x.atan2(nose.y) - 0.2).abs() < 0.01);
    assert!((state.body_rates.z + 0.5).abs() < 1e-6, "to the right is negative about up");
}

#[test]
fn a_state_that_is_not_confirmed_expires_and_nonsense_confirms_nothing() {
    let mut producer = Producer::new(motors());
    receive(&mut producer, &bytes(&level_at(1_000_000)));
    receive(&mut producer, &bytes(&sensor_at(1_900_000)));
    assert!(producer.state().is_some());
    let nonsense = HIL_STATE_QUATERNION_DATA { attitude_quaternion: [f32::NAN; 4], ..level_at(1_900_000) };
    receive(&mut producer, &bytes(&nonsense));
    let nothing = HIL_STATE_QUATERNION_DATA { attitude_quaternion: [0.0; 4], ..level_at(1_900_000) };
    receive(&mut producer, &bytes(&nothing));
    let infinite = HIL_STATE_QUATERNION_DATA { rollspeed: f32::INFINITY, ..level_at(1_900_000) };
    receive(&mut producer, &bytes(&infinite));
    receive(&mut producer, &bytes(&sensor_at(2_000_001)));
    assert_eq!(producer.state(), None);
    let noise = HIL_SENSOR_DATA { xacc: f32::NAN, ..sensor_at(2_004_000) };
    assert_eq!(receive(&mut producer, &bytes(&noise)), None, "a sensor message without numbers is none");
}

proptest! {
    #[test]
    fn whatever_a_simulator_says_the_state_is_finite(
        fields in proptest::collection::vec(any::<u8>(), 64), sensor in any::<bool>(), gap in 0_u64..200_000
    ) {
        let mut producer = Producer::new(motors());
        receive(&mut producer, &bytes(&level_at(1_000_000)));
        let (id, seed) = if sensor { (107, 108) } else { (115, 4) };
        let mut fields = fields;
        fields[..8].copy_from_slice(&(1_000_000 + gap).to_le_bytes());
        receive(&mut producer, &bytes(&sensor_at(1_000_000)));
        receive(&mut producer, &Encoder::new(1, 1).encode(&Payload::new(id, seed, &fields)));
        receive(&mut producer, &bytes(&sensor_at(1_000_000 + gap + 4000)));
        if let Some(state) = producer.state() {
            let vectors = [state.position, state.velocity, state.body_rates];
            let finite = vectors.iter().all(|vector| vector.iter().all(|value| value.is_finite()));
            prop_assert!(finite, "{:?}", state);
        }
    }
}
