//! One flight: the vehicle behind MAVLink in the simulation, a ground station in the same process, and a log of the truth.

use std::cell::Cell;
use std::rc::Rc;

use kestrel_core::attitude::Attitude;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::PolicyError;
use kestrel_core::vehicle::State;
use kestrel_shim::autopilot::Mode;
use kestrel_shim::controller::Controller;
use kestrel_shim::geodesy::Home;
use kestrel_shim::link::memory::MemoryLink;
use kestrel_shim::link::{LinkError, Links};
use kestrel_shim::lockstep::{self, FlightError, Next, SimulatedVehicle, SimulationRate};
use kestrel_shim::message::sent::identity::PolicyIdentity;
use kestrel_shim::personality::Personality;
use kestrel_shim::vehicle::{Vehicle, VehicleProfile};
use kestrel_sim::world::Pose;
use sha2::{Digest, Sha256};

use super::backend::FailingPolicy;
use super::case::{Case, CasePilot};
use super::plant::FailingPlant;
use super::station::{ScriptedStation, VEHICLE};

/// A control period of a flight, before the drone moves in it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Moment {
    /// Simulated time \[s\].
    pub(crate) secs: f64,
    /// True state.
    pub(crate) state: State<f32>,
    /// What the autopilot is doing.
    pub(crate) mode: Mode,
    /// Which controller flies, or is going to.
    pub(crate) controller: Controller,
    /// What the autopilot tells the rotors \[rad/s\].
    pub(crate) rotor_targets: [f32; 4],
    /// Whether the drone touches a wall, furniture or a movable body.
    pub(crate) touching: bool,
    /// What the ground station hears the vehicle say.
    pub(crate) heard: Vec<String>,
}

/// What came of a case.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FlownCase {
    /// Time between two moments \[s\].
    pub(crate) control_secs: f64,
    /// At least one.
    pub(crate) moments: Vec<Moment>,
    /// Where each movable body was at each of them.
    pub(crate) movables: Vec<Vec<Pose>>,
    /// Of every bit of every moment: the beginning of its SHA-256, as long as ten thousand flights need to differ.
    pub(crate) hash: u64,
}

/// Why there is no flight.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CaseError {
    /// The policy file is damaged or of another version.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// A link within the process fails.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The loop fails.
    #[error(transparent)]
    Flight(#[from] FlightError),
}

/// Flies a case from its start to its end, as fast as it goes.
///
/// # Errors
/// When its policy cannot be read.
pub(crate) fn fly(case: &Case) -> Result<FlownCase, CaseError> {
    let clock = Rc::new(Cell::new(0.0));
    let mut plant = FailingPlant::new(case, &clock);
    let control_secs = 1.0 / case.scenario.physics.control_rate_hz;
    let mut vehicle = vehicle(case, &clock)?;
    let (ours, theirs) = MemoryLink::pair();
    let mut links = Links::default();
    links.attach(Box::new(theirs))?;
    let mut station = ScriptedStation::new(case, ours, control_secs);
    let mut moments: Vec<Moment> = Vec::new();
    let mut failure = None;
    let mut watch = |period: &lockstep::ControlPeriod<'_>| {
        let before = station.texts().len();
        failure = station.advance(period.secs).err();
        let heard = station.texts()[before..].iter().map(|said| said.text.clone()).collect();
        moments.push(moment(period, heard));
        let over = period.secs + 0.5 * control_secs >= case.secs;
        if over || failure.is_some() { Next::End } else { Next::Fly }
    };
    let flown = &mut [SimulatedVehicle::new(&mut vehicle, &mut plant, &mut links)];
    lockstep::fly(flown, SimulationRate::Unthrottled, &mut watch)?;
    failure.map_or(Ok(()), Err)?;
    Ok(FlownCase::of(control_secs, moments, plant))
}

/// The vehicle of a case, on the ground.
fn vehicle<'a>(case: &'a Case, clock: &Rc<Cell<f64>>) -> Result<Vehicle<FailingPolicy<'a>>, PolicyError> {
    let (pilot, identity) = match &case.pilot {
        CasePilot::Cascade => (None, PolicyIdentity::of("none", &[])),
        CasePilot::Policy(bytes) => {
            let policy = bytes.policy()?.on(&case.airframe);
            let identity = PolicyIdentity::of(policy.metadata().name, bytes.bytes());
            (Some(Pilot::with_runner(policy)), identity)
        }
    };
    let control_secs = case.scenario.physics.control_secs();
    let backend = FailingPolicy { pilot, faults: &case.faults, clock: Rc::clone(clock), control_secs };
    let origin = Home::default();
    let profile = VehicleProfile { system: VEHICLE, personality: Personality::Generic, origin, policy: identity };
    let mut vehicle = Vehicle::new(backend, &case.airframe, profile);
    vehicle.adjust(case.parameters.clone());
    Ok(vehicle)
}

fn moment(period: &lockstep::ControlPeriod<'_>, heard: Vec<String>) -> Moment {
    Moment {
        secs: period.secs,
        state: *period.state,
        mode: period.mode,
        controller: period.controller,
        rotor_targets: period.rotor_targets,
        touching: false,
        heard,
    }
}

impl FlownCase {
    fn of(control_secs: f64, mut moments: Vec<Moment>, plant: FailingPlant<'_>) -> Self {
        let mut movables: Vec<Vec<Pose>> = Vec::new();
        for (moment, scene) in moments.iter_mut().zip(plant.into_scenes()) {
            moment.touching = scene.touching;
            movables.resize(scene.movables.len(), Vec::new());
            movables.iter_mut().zip(scene.movables).for_each(|(poses, pose)| poses.push(pose));
        }
        let hash = hash(&moments);
        Self { control_secs, moments, movables, hash }
    }

    /// How long it was \[s\].
    pub(crate) fn secs(&self) -> f64 {
        self.moments.last().map_or(0.0, |last| last.secs)
    }
}

/// Of every bit.
fn hash(moments: &[Moment]) -> u64 {
    let mut hasher = Sha256::new();
    for Moment { secs, state, mode, controller, rotor_targets, touching, heard } in moments {
        hasher.update(secs.to_le_bytes());
        let Attitude { w, x, y, z } = state.world_from_body;
        let vectors = [state.position, state.velocity, state.body_rates];
        let numbers = vectors.iter().flat_map(|vector| vector.iter().copied());
        for number in numbers.chain([w, x, y, z]).chain(state.rotor_speeds).chain(*rotor_targets) {
            hasher.update(number.to_le_bytes());
        }
        hasher.update([*mode as u8, *controller as u8, u8::from(*touching)]);
        hasher.update(heard.join("\n"));
    }
    let digest: [u8; 32] = hasher.finalize().into();
    let [a, b, c, d, e, f, g, h, ..] = digest;
    u64::from_be_bytes([a, b, c, d, e, f, g, h])
}
