//! The fork's golden file: flights of one row per control step with their actions, and calls of its controllers.

use std::collections::BTreeMap;
use std::path::Path;

use kestrel_core::action::Setpoint;
use kestrel_core::airframe::{Airframe, HUMMINGBIRD};
use kestrel_core::reference::bullet::{Bullet, BulletState, Quirks};
use kestrel_core::reference::controller::{Allocation, DslPid, DslPidMemory, SimplePid, SimplePidMemory, command};
use kestrel_core::reference::euler::EulerAngles;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use serde::Deserialize;

use super::error::RecordingError;
use super::index::{Json, Part};
use super::model::{Models, Physics, Publisher};
use super::motion::{Clock, Logged, flown, largest, rotor_speeds, rpm};
use super::report::{Kind, Ledger, Worst};
use super::unit::seen;

/// The fork's physics steps \[s\], and how many a control period has unless a flight says otherwise.
const CLOCK: Clock = Clock { step_secs: 1.0 / 240.0, substeps: 5 };

/// Where the two drones of the downwash flight start \[m, world\]: the file does not say.
const DOWNWASH_STARTS: [[f64; 3]; 2] = [[0.0, 0.0, 1.0], [0.05, 0.0, 1.5]];

/// Position, quaternion x y z w, roll pitch yaw, velocity, angular velocity.
type State16 = [f64; 16];

#[derive(Deserialize)]
struct Flight {
    state16: Vec<State16>,
    rpm: Vec<[f64; 4]>,
}

#[derive(Deserialize)]
struct DslPidCall {
    dt: f64,
    pos: [f64; 3],
    quat: [f64; 4],
    vel: [f64; 3],
    target: [f64; 3],
    target_yaw: f64,
    target_vel: [f64; 3],
    rpm: [f64; 4],
    yaw_err: f64,
}

#[derive(Deserialize)]
struct SimplePidCall {
    dt: f64,
    pos: [f64; 3],
    quat: [f64; 4],
    target: [f64; 3],
    rpm: [f64; 4],
}

/// Compares `physics_golden.json`.
pub(super) fn compare(path: &Path, models: &Models, ledger: &mut Ledger) -> Result<(), RecordingError> {
    let json = Json::read(path)?;
    let parts: BTreeMap<String, Part<'_>> = json.whole().entries()?.into_iter().collect();
    for (name, part) in &parts {
        if part.text().starts_with('{') {
            compare_flight(part, &parts, models, ledger)?;
        } else if name.starts_with("dslpid") {
            ledger.add(Kind::ForkDslPid, name, &dsl_pid_calls(part, models)?);
        } else if name.starts_with("simplepid") {
            ledger.add(Kind::ForkSimplePid, name, &simple_pid_calls(part)?);
        } else if name == "downwash_2drones_PYB_DW" {
            ledger.add(Kind::ForkStates, name, &downwash(part, models)?);
        } else if part.text().starts_with('[') && !holds_actions(name) {
            ledger.note(format!("{}: `{name}` is not known, not compared", path.display()));
        }
    }
    Ok(())
}

/// Lists that flights refer to.
fn holds_actions(name: &str) -> bool {
    name.ends_with("_actions") || name.starts_with("seq_")
}

/// Drone, physics and rates of a flight, from its name: `roll_SEQUENCE_MODE[_MODEL]` and the like.
fn settings(part: &Part<'_>, models: &Models) -> Result<(Airframe, Physics, Clock), RecordingError> {
    let name = part.name().to_lowercase();
    let (rest, model) = match name.rsplit_once('_') {
        Some((rest, model)) if models.find(model, Publisher::Fork).is_some() => (rest, model),
        Some(_) | None => (name.as_str(), "cf2x"),
    };
    let airframe = models.find(model, Publisher::Fork);
    let physics = Physics::ALL.into_iter().find(|physics| rest.ends_with(&format!("_{}", physics.name())));
    let clock = if name.contains("240hz") { Clock { substeps: 1, ..CLOCK } } else { CLOCK };
    airframe.zip(physics).map(|(airframe, physics)| (airframe, physics, clock)).ok_or_else(|| {
        part.refuse("a flight whose name ends in no mode", "such as roll_a_PYB_GND or roll_a_PYB_cf2p")
    })
}

fn compare_flight(
    part: &Part<'_>,
    parts: &BTreeMap<String, Part<'_>>,
    models: &Models,
    ledger: &mut Ledger,
) -> Result<(), RecordingError> {
    let flight: Flight = part.decode()?;
    let (airframe, physics, clock) = settings(part, models)?;
    if flight.state16.len() != flight.rpm.len() + 1 {
        let found = format!("{} states and {} rotor speeds", flight.state16.len(), flight.rpm.len());
        return Err(part.refuse(found, "a start and one of each per control step"));
    }
    ledger.add(Kind::ForkStates, part.name(), &flight.worst_state(&airframe, physics, &clock));
    let words: Vec<String> = part.name().split('_').map(str::to_lowercase).collect();
    let action = words.get(1).and_then(|word| ActionList::named(word));
    if let Some((action, list)) = action.and_then(|action| Some((action, parts.get(action.list())?))) {
        let actions: Vec<Vec<f64>> = list.decode()?;
        if let Some(wrong) = actions.iter().find(|numbers| numbers.len() != action.len()) {
            return Err(list.refuse(format_args!("an action of {} numbers", wrong.len()), action.len()));
        }
        let worst = flight.worst_command(&airframe, &clock, action, &actions);
        ledger.add(Kind::ForkRpm, part.name(), &worst);
    }
    Ok(())
}

/// What a flight's actions are, and the list that holds them.
#[derive(Clone, Copy)]
enum ActionList {
    RotorSpeedsA,
    RotorSpeedsB,
    Offset,
    Velocity,
    Wrench,
}

impl ActionList {
    /// By the second word of a flight's name.
    fn named(word: &str) -> Option<Self> {
        match word {
            "a" => Some(Self::RotorSpeedsA),
            "b" => Some(Self::RotorSpeedsB),
            "pid" => Some(Self::Offset),
            "vel" => Some(Self::Velocity),
            "dynact" => Some(Self::Wrench),
            _ => None,
        }
    }

    const fn list(self) -> &'static str {
        match self {
            Self::RotorSpeedsA => "seq_a",
            Self::RotorSpeedsB => "seq_b",
            Self::Offset => "pid_actions",
            Self::Velocity => "vel_actions",
            Self::Wrench => "dyn_actions",
        }
    }

    const fn len(self) -> usize {
        match self {
            Self::Offset => 3,
            Self::RotorSpeedsA | Self::RotorSpeedsB | Self::Velocity | Self::Wrench => 4,
        }
    }
}

impl Flight {
    /// Flies the recorded rotor speeds down to the floor.
    fn worst_state(&self, airframe: &Airframe, physics: Physics, clock: &Clock) -> Worst {
        let bullet = Bullet::new(airframe, physics.mode(), Quirks::fork());
        let mut drone = logged(&self.state16[0]).0.placed();
        let mut worst = Worst::default();
        for (index, (state, rpm)) in self.state16[1..].iter().zip(&self.rpm).enumerate() {
            let speeds = rotor_speeds(*rpm);
            let advanced = if physics == Physics::Dyn {
                Some(
                    (0..clock.substeps).fold(drone, |drone, _| bullet.step(&drone, &speeds, &[], clock.step_secs)),
                )
            } else {
                flown(&bullet, airframe, clock, drone, &speeds)
            };
            let Some(after) = advanced else { break };
            worst.add(error(&after, state), format_args!("row {}", index + 1));
            drone = after;
        }
        worst
    }

    /// Rotor speeds \[RPM\] that actions become in the recorded states.
    fn worst_command(&self, airframe: &Airframe, clock: &Clock, kind: ActionList, actions: &[Vec<f64>]) -> Worst {
        // The fork gives the controller of `cf2x` to `cf2p` too, but no recording commands that by a controller.
        let controller = DslPid::new(airframe);
        let mut memory = DslPidMemory::new();
        let mut worst = Worst::default();
        for (index, ((state, action), recorded)) in self.state16.iter().zip(actions).zip(&self.rpm).enumerate() {
            let state = logged(state).0.placed().motion;
            let four = || core::array::from_fn(|index| action[index]);
            let mut control = |setpoint: &Setpoint<f64>| {
                controller.command(&mut memory, &state, setpoint, clock.control_secs()).rotor_speeds
            };
            let speeds = match kind {
                ActionList::RotorSpeedsA | ActionList::RotorSpeedsB => command::rotor_speeds(airframe, &four()),
                ActionList::Offset => control(&command::offset(&state, &[action[0], action[1], action[2]])),
                ActionList::Velocity => control(&command::velocity(airframe, &state, &four())),
                ActionList::Wrench => Allocation::new(airframe).rotor_speeds(&command::wrench(airframe, &four())),
            };
            worst.add(largest(&rpm(speeds), recorded), format_args!("row {index}"));
        }
        worst
    }
}

/// Pose and motion, and the angles.
fn logged(state: &State16) -> (Logged, [f64; 3]) {
    let [px, py, pz, x, y, z, w, roll, pitch, yaw, vx, vy, vz, wx, wy, wz] = *state;
    (Logged([px, py, pz, x, y, z, w, vx, vy, vz, wx, wy, wz]), [roll, pitch, yaw])
}

fn error(drone: &BulletState<f64>, state: &State16) -> f64 {
    let (motion, angles) = logged(state);
    let computed = EulerAngles::of(&drone.motion.world_from_body).to_array();
    motion.deviation(drone).max(largest(&computed, &angles))
}

fn downwash(part: &Part<'_>, models: &Models) -> Result<Worst, RecordingError> {
    let rows: Vec<[State16; 2]> = part.decode()?;
    let airframe = models.find("cf2x", Publisher::Fork).expect("the Crazyflie is known");
    let bullet = Bullet::new(&airframe, Physics::PybDw.mode(), Quirks::fork());
    let mut drones = DOWNWASH_STARTS.map(|start| Logged::at_rest(start).placed());
    let speeds = [airframe.hover_rotor_speed(); 4];
    let mut worst = Worst::default();
    for (index, row) in rows.iter().enumerate() {
        for _ in 0..CLOCK.substeps {
            let swarm: Vec<Vector3<f64>> = drones.iter().map(|drone| drone.motion.position).collect();
            drones = drones.map(|drone| bullet.step(&drone, &speeds, &swarm, CLOCK.step_secs));
        }
        let errors = drones.iter().zip(row).map(|(drone, state)| error(drone, state));
        worst.add(errors.fold(0.0, f64::max), format_args!("row {index}"));
    }
    Ok(worst)
}

fn dsl_pid_calls(part: &Part<'_>, models: &Models) -> Result<Worst, RecordingError> {
    let calls: Vec<DslPidCall> = part.decode()?;
    let controller = DslPid::new(&models.find("cf2x", Publisher::Fork).expect("the Crazyflie is known"));
    let mut memory = DslPidMemory::new();
    let mut worst = Worst::default();
    for (index, call) in calls.iter().enumerate() {
        let state: State<f64> = seen(call.pos, call.quat, call.vel);
        let velocity = call.target_vel.into();
        let setpoint = Setpoint { velocity, yaw: call.target_yaw, ..Setpoint::at(call.target.into()) };
        let command = controller.command(&mut memory, &state, &setpoint, call.dt);
        let error =
            largest(&rpm(command.rotor_speeds), &call.rpm).max(largest(&[command.yaw_error], &[call.yaw_err]));
        worst.add(error, format_args!("call {index}"));
    }
    Ok(worst)
}

fn simple_pid_calls(part: &Part<'_>) -> Result<Worst, RecordingError> {
    let calls: Vec<SimplePidCall> = part.decode()?;
    let controller = SimplePid::new(&HUMMINGBIRD);
    let mut memory = SimplePidMemory::new();
    let mut worst = Worst::default();
    for (index, call) in calls.iter().enumerate() {
        let state = seen(call.pos, call.quat, [0.0; 3]);
        let command = controller.command(&mut memory, &state, &Setpoint::at(call.target.into()), call.dt);
        worst.add(largest(&rpm(command.rotor_speeds), &call.rpm), format_args!("call {index}"));
    }
    Ok(worst)
}
