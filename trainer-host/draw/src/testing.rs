//! Flights for tests: what becomes of drones that do nothing.

use std::path::Path;

use kestrel_core::vehicle::State;
use kestrel_sim::config::{Document, ScenarioConfig};
use kestrel_sim::scenario::{Scenario, Start};
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::Simulation;

use crate::recorded_flight::{DroneFlight, FlightRecording, Placement};

/// The part of an experiment file that is needed here.
#[derive(serde::Deserialize)]
struct Task {
    scenario: ScenarioConfig,
}

/// The task of a shipped experiment, with episodes of so many seconds.
pub(crate) fn scenario(name: &str, secs: f32) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs").join(name);
    let document = Document::read(&path).unwrap();
    let task: Task = document.decode().unwrap();
    let scenario = task.scenario.check("task", &document.root().at("scenario")).unwrap();
    let calm = Start {
        tilt_limit: 0.0,
        speed_limit: 0.0,
        body_rates_limit: 0.0,
        heading_limit: 0.0,
        position: scenario.start.position.clone(),
    };
    Scenario { episode_secs: secs, start: calm, terminations: Vec::new(), ..scenario }
}

/// The first flight of the scenario until all drones have ended it.
pub(crate) fn flown(scenario: &Scenario) -> FlightRecording {
    let mut simulation = Simulation::<1, f64>::new(scenario, Seed(1), 0, 1);
    let rows = simulation.rows();
    let mut flight = at_start(scenario, &simulation);
    let actions = vec![0.0; scenario.action.len() * rows];
    let mut flying = vec![true; rows];
    while flying.contains(&true) {
        simulation.step(&actions);
        let ended = simulation.take_episodes();
        for (row, drone) in flight.drones.iter_mut().enumerate().filter(|(row, _)| flying[*row]) {
            drone.rewards.push(simulation.terms(row).iter().sum());
            match ended.iter().find(|episode| episode.agent as usize == row) {
                Some(episode) => drone.ending = episode.ending.name().to_owned(),
                None => drone.frames.push(frame(&simulation.state(row))),
            }
        }
        for episode in &ended {
            flying[episode.agent as usize] = false;
        }
    }
    flight
}

/// The drones at the first start of the scenario.
pub(crate) fn started(scenario: &Scenario) -> FlightRecording {
    at_start(scenario, &Simulation::new(scenario, Seed(1), 0, 1))
}

fn at_start(scenario: &Scenario, simulation: &Simulation<1, f64>) -> FlightRecording {
    let drone = |row| DroneFlight {
        goal: Some(simulation.goal(row).cast()),
        frames: vec![frame(&simulation.state(row))],
        rewards: Vec::new(),
        ending: String::new(),
        success: false,
    };
    FlightRecording {
        title: scenario.name.clone(),
        control_secs: scenario.physics.control_secs(),
        drones: (0..simulation.rows()).map(drone).collect(),
        movables: Vec::new(),
    }
}

fn frame(state: &State<f64>) -> Placement {
    let attitude = state.world_from_body.map(|part| part as f32);
    Placement { position: state.position.cast(), attitude }
}
