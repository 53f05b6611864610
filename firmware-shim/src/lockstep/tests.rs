mod determinism;

use std::fs;

use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::Pilot;
use mavlink::dialects::common::{HEARTBEAT_DATA, MavCmd, MavMessage, MavModeFlag, MavResult};

use super::*;
use crate::flight_mode::FlightMode;
use crate::link::faulty::FaultyLink;
use crate::link::memory::MemoryLink;
use crate::link::{DATAGRAM_LIMIT, Link};
use crate::plant::FlatFloor;
use crate::testing::{command_long, datagram, hover_policy, pilot, profile, read_flight_log, set_point, told};

#[test]
fn a_pace_is_a_factor_or_max() {
    assert_eq!("1".parse(), Ok(SimulationRate::Speed(1.0)));
    assert_eq!("0.5".parse(), Ok(SimulationRate::Speed(0.5)));
    assert_eq!("max".parse(), Ok(SimulationRate::Unthrottled));
    for wrong in ["0", "-1", "nan", "inf", "fast", "", "1e9"] {
        let error = wrong.parse::<SimulationRate>().unwrap_err();
        assert!(error.to_string().contains(&format!("found \"{wrong}\"")));
    }
}

#[test]
fn the_clock_keeps_its_speed_on_average() {
    let mut clock = Clock::new(SimulationRate::Speed(2.0), Duration::from_millis(10));
    let start = Instant::now();
    for _ in 0..20 {
        clock.wait();
    }
    assert!(start.elapsed() >= Duration::from_millis(99));
}

/// A million periods, whose wall time is counted and not slept.
#[test]
fn the_clock_does_not_drift_however_odd_its_period() {
    for (speed, control_secs) in [(1.0, 0.01), (7.0, 1.0 / 240.0), (1000.0, 0.001), (0.3, 0.004)] {
        let mut clock = Clock::new(SimulationRate::Speed(speed), Duration::from_secs_f64(control_secs));
        let (start, period_secs) = (clock.start, clock.period_secs.unwrap());
        let mut now = start;
        for _ in 0..1_000_000 {
            now += clock.until_next(period_secs, now);
        }
        let elapsed_secs = (now - start).as_secs_f64();
        let expected_secs = 1e6 * control_secs / speed;
        assert!((elapsed_secs / expected_secs - 1.0).abs() < 1e-6, "{elapsed_secs} s, not {expected_secs} s");
    }
}

/// Every sleep ends late by a share of its period; the next one is shorter for it.
#[test]
fn late_awakenings_do_not_add_up() {
    let mut clock = Clock::new(SimulationRate::Speed(1.0), Duration::from_millis(4));
    let late = Duration::from_millis(1);
    let start = clock.start;
    let mut now = start;
    for _ in 0..10_000 {
        now += clock.until_next(0.004, now) + late;
    }
    let drift = (now - start).as_secs_f64() / (40.0 + late.as_secs_f64()) - 1.0;
    assert!(drift.abs() < 1e-6, "{drift}");
}

#[test]
fn lost_time_is_not_caught_up() {
    let mut clock = Clock::new(SimulationRate::Speed(1.0), Duration::from_millis(10));
    thread::sleep(LAG_LIMIT + Duration::from_millis(100));
    clock.wait();
    let start = Instant::now();
    clock.wait();
    assert!(start.elapsed() >= Duration::from_millis(9));
}

/// Every vehicle tells its mode once a second, or not at all through a bad link.
const PATIENCE_SECS: f64 = 300.0;

/// A client repeats itself this often \[s\].
const RETRY_SECS: f64 = 0.5;

/// A vehicle, its plant, and its links to clients that hold the other ends.
struct Flight {
    vehicle: Box<Vehicle<Pilot<'static>>>,
    plant: FlatFloor,
    links: Box<Links>,
    log: Option<FlightLog>,
}

impl Flight {
    fn new(system: u8, x_m: f32) -> Self {
        Self::with(hover_policy(), system, x_m)
    }

    fn with(policy: Vec<u8>, system: u8, x_m: f32) -> Self {
        let vehicle = Box::new(Vehicle::new(pilot(policy), &CF2X, profile(system)));
        Self {
            plant: FlatFloor::new(&CF2X, vehicle.control_period().as_secs_f32()).at([x_m, 0.0]),
            vehicle,
            links: Box::default(),
            log: None,
        }
    }

    /// The far end of a new link, which is as bad as `faults` say.
    fn client(&mut self, faults: &str) -> MemoryLink {
        let (far, near) = MemoryLink::pair();
        let link = FaultyLink::new(Box::new(near), &faults.parse().unwrap());
        self.links.attach(Box::new(link)).unwrap();
        far
    }

    fn simulated(&mut self) -> SimulatedVehicle<'_, Pilot<'static>> {
        SimulatedVehicle::new(&mut self.vehicle, &mut self.plant, &mut self.links).with_log(self.log.as_mut())
    }
}

fn fly_all(flights: &mut [Flight], watch: &mut dyn FnMut(&ControlPeriod) -> Next) {
    let mut vehicles: Vec<_> = flights.iter_mut().map(Flight::simulated).collect();
    fly(&mut vehicles, SimulationRate::Unthrottled, watch).unwrap();
}

fn messages(end: &mut MemoryLink) -> Vec<Vec<u8>> {
    let mut buffer = [0; DATAGRAM_LIMIT];
    std::iter::from_fn(|| end.receive(&mut buffer).unwrap().map(|received| received.datagram.to_vec())).collect()
}

/// Where a scripted client wants the vehicle next; it believes nothing that it was not told.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Armed,
    Airborne,
    There,
    Landed,
    Done,
}

/// Flies up, half a metre north and down again, and repeats itself until it is told of success.
struct Client {
    end: MemoryLink,
    stage: Stage,
    due_secs: f64,
}

impl Client {
    fn watch(&mut self, secs: f64) -> Next {
        for bytes in messages(&mut self.end) {
            self.receive(&bytes);
        }
        if self.stage != Stage::Done && secs >= self.due_secs {
            self.due_secs = secs + RETRY_SECS;
            self.send();
        }
        assert!(secs < PATIENCE_SECS, "still not {:?}", self.stage);
        if self.stage == Stage::Done { Next::End } else { Next::Fly }
    }

    fn receive(&mut self, bytes: &[u8]) {
        // What was corrupted on its way is no frame.
        if !crate::frame::Frames::new(bytes).all(|frame| frame.is_ok()) {
            return;
        }
        let Some(message) = told(bytes) else { return };
        self.stage = match (self.stage, message) {
            (stage, MavMessage::HEARTBEAT(heartbeat)) => stage.after(&heartbeat),
            (Stage::There, MavMessage::LOCAL_POSITION_NED(position)) if (position.x - 0.5).abs() < 0.05 => {
                Stage::Landed
            }
            (stage, _) => stage,
        };
    }

    fn send(&mut self) {
        let open = [f32::NAN; 7];
        let arm = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let bytes = match self.stage {
            Stage::Armed => datagram(&command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, arm)),
            Stage::Airborne => datagram(&command_long(MavCmd::MAV_CMD_NAV_TAKEOFF, open)),
            Stage::There => datagram(&set_point([0.5, 0.0, -1.0])),
            Stage::Landed => datagram(&command_long(MavCmd::MAV_CMD_NAV_LAND, open)),
            Stage::Done => return,
        };
        self.end.send(&bytes);
    }
}

impl Stage {
    /// The next thing to want, when the vehicle tells its mode.
    fn after(self, heartbeat: &HEARTBEAT_DATA) -> Self {
        let armed = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
        let flies = heartbeat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED);
        let holds = flies && heartbeat.custom_mode == FlightMode::Policy.custom_mode();
        match self {
            Self::Armed if armed => Self::Airborne,
            Self::Airborne if !armed => Self::Armed,
            Self::Airborne if holds => Self::There,
            Self::Landed if !armed => Self::Done,
            Self::Armed | Self::Airborne | Self::There | Self::Landed | Self::Done => self,
        }
    }
}

#[test]
fn a_client_that_repeats_itself_flies_through_a_bad_link() {
    let mut garbage = 0;
    for seed in 1..=5 {
        let faults = format!("loss=0.3,duplicate=0.1,reorder=0.2,delay=0.05,corrupt=0.05,seed={seed}");
        let mut flight = [Flight::new(1, 0.0)];
        let end = flight[0].client(&faults);
        let mut client = Client { end, stage: Stage::Armed, due_secs: 0.0 };
        fly_all(&mut flight, &mut |period| client.watch(period.secs));
        let position = flight[0].plant.state().position;
        assert!(position.z < 0.02, "landed at {position:?}");
        assert!((position.y - 0.5).abs() < 0.2, "north of the start: {position:?}");
        garbage += flight[0].vehicle.counts().garbage;
    }
    assert!(garbage > 0, "corrupted datagrams came through");
}

#[test]
fn the_same_flight_has_the_same_log_to_the_byte_and_the_log_has_every_frame() {
    let folder = tempfile::tempdir().unwrap();
    let faults = "loss=0.2,duplicate=0.1,reorder=0.2,delay=0.02,corrupt=0.05,seed=9";
    let [first, second] = ["first.tlog", "second.tlog"].map(|name| {
        let path = folder.path().join(name);
        let mut flight = [Flight::new(1, 0.0)];
        flight[0].log = Some(FlightLog::create(&path, Duration::from_secs(1_700_000_000)).unwrap());
        let mut listener = flight[0].client("seed=0");
        let end = flight[0].client(faults);
        let mut client = Client { end, stage: Stage::Armed, due_secs: 0.0 };
        let mut told = Vec::new();
        fly_all(&mut flight, &mut |period| {
            told.extend(messages(&mut listener));
            client.watch(period.secs)
        });
        let log = fs::read(path).unwrap();
        let entries = read_flight_log(&log);
        let sent: Vec<_> =
            entries.iter().filter(|(_, frame)| frame[5] == 1).map(|(_, frame)| frame.clone()).collect();
        let others: Vec<_> = sent.iter().filter(|frame| !told.contains(frame)).collect();
        assert_eq!(sent.len(), told.len() + others.len());
        // COMMAND_ACK and STATUSTEXT to the client that asked.
        assert!(!others.is_empty() && others.iter().all(|frame| [77, 253].contains(&frame[7])));
        assert_eq!((entries.len() - sent.len()) as u64, flight[0].vehicle.counts().frames);
        assert!(entries.is_sorted_by_key(|(time_us, _)| time_us));
        assert_eq!(entries[0].0, 1_700_000_000_000_000);
        log
    });
    assert!(first == second && first.len() > 10_000);
}

#[test]
fn ten_vehicles_obey_their_own_commands_only() {
    let mut flights: Vec<Flight> = (1..=10).map(|system| Flight::new(system, f32::from(system))).collect();
    let mut ends: Vec<MemoryLink> = flights.iter_mut().map(|flight| flight.client("seed=0")).collect();
    let arm = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let mut armed: Vec<u8> = Vec::new();
    // A vehicle has no state before its first control period.
    fly_all(&mut flights, &mut |_| Next::End);
    for system in [4, 1, 10, 7] {
        let mut command = command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, arm);
        command.target_system = system;
        let bytes = datagram(&command);
        for end in &mut ends {
            end.send(&bytes);
        }
        armed.push(system);
        fly_all(&mut flights, &mut |period| {
            let expected = if armed.contains(&(period.number as u8 + 1)) { Mode::Armed } else { Mode::Disarmed };
            assert_eq!(period.mode, expected, "vehicle {}", period.number);
            Next::End
        });
        for (number, end) in ends.iter_mut().enumerate() {
            let acknowledged = messages(end).iter().any(|bytes| {
                matches!(told(bytes), Some(MavMessage::COMMAND_ACK(ack)) if ack.result == MavResult::MAV_RESULT_ACCEPTED)
            });
            assert_eq!(acknowledged, number + 1 == usize::from(system), "vehicle {number}");
        }
    }
}

#[test]
fn ten_vehicles_speak_with_their_own_numbers_and_tell_their_own_places() {
    let mut flights: Vec<Flight> = (1..=10).map(|system| Flight::new(system, f32::from(system))).collect();
    let mut ends: Vec<MemoryLink> = flights.iter_mut().map(|flight| flight.client("seed=0")).collect();
    fly_all(&mut flights, &mut |_| Next::End);
    for (system, end) in (1_u8..).zip(&mut ends) {
        let told = messages(end);
        assert!(told.iter().all(|bytes| bytes[5] == system));
        let east_m = told.iter().find_map(|bytes| match self::told(bytes) {
            Some(MavMessage::LOCAL_POSITION_NED(position)) => Some(position.y),
            _ => None,
        });
        assert_eq!(east_m, Some(f32::from(system)), "x of the world is east");
    }
}

#[test]
fn together_each_flies_as_it_flies_alone() {
    let goal = |system: u8| [0.1 * f32::from(system), 0.0, -1.0];
    let conduct = |systems: std::ops::RangeInclusive<u8>| {
        let mut flights: Vec<Flight> =
            systems.clone().map(|system| Flight::new(system, f32::from(system))).collect();
        let mut ends: Vec<MemoryLink> = flights.iter_mut().map(|flight| flight.client("seed=0")).collect();
        fly_all(&mut flights, &mut |period| {
            let tick = (period.secs / 0.01).round() as u32;
            let system = systems.start() + period.number as u8;
            let command = match tick {
                10 => Some((MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])),
                20 => Some((MavCmd::MAV_CMD_NAV_TAKEOFF, [f32::NAN; 7])),
                _ => None,
            };
            if let Some((command, parameters)) = command {
                let mut command = command_long(command, parameters);
                command.target_system = system;
                ends[period.number].send(&datagram(&command));
            } else if tick == 500 {
                let mut target = set_point(goal(system));
                target.target_system = system;
                ends[period.number].send(&datagram(&target));
            }
            if tick < 1000 || period.number + 1 < ends.len() { Next::Fly } else { Next::End }
        });
        flights.iter().map(|flight| *flight.plant.state()).collect::<Vec<_>>()
    };
    let together = conduct(1..=3);
    assert!(together.iter().all(|state| state.position.z > 0.5));
    let alone: Vec<_> = (1..=3).flat_map(|system| conduct(system..=system)).collect();
    assert_eq!(together, alone);
}

#[test]
fn nobody_flies_nowhere() {
    fly_all(&mut [], &mut |_| panic!("there is nobody"));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_the_flight_of_all() {
    use std::path::Path;

    let mut flights = [Flight::new(1, 0.0), Flight::new(2, 1.0)];
    flights[1].log = Some(FlightLog::create(Path::new("/dev/full"), Duration::ZERO).unwrap());
    let _listener = flights[1].client("seed=0");
    let mut vehicles: Vec<_> = flights.iter_mut().map(Flight::simulated).collect();
    let mut last_secs = 0.0;
    let error = fly(&mut vehicles, SimulationRate::Unthrottled, &mut |period| {
        last_secs = period.secs;
        Next::Fly
    })
    .unwrap_err();
    assert!(matches!(error, FlightError::Log(_)), "{error}");
    assert!(last_secs < 1.1, "{last_secs}");
}

#[test]
fn a_flight_outlives_a_link_that_corrupts_everything() {
    let mut flight = [Flight::new(1, 0.0)];
    let mut end = flight[0].client("received.corrupt=1,received.duplicate=0.5,seed=2");
    let heartbeat = datagram(&HEARTBEAT_DATA::default());
    fly_all(&mut flight, &mut |period| {
        end.send(&heartbeat);
        messages(&mut end);
        if period.secs < 2.0 { Next::Fly } else { Next::End }
    });
    assert_eq!(flight[0].vehicle.counts().frames, 0);
    assert!(flight[0].vehicle.counts().garbage >= 200);
}
