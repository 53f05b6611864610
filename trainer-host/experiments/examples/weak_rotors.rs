//! Pilots that come with Kestrel, on drones whose rotors have become weak: without anything, and with what makes up for weak
//! rotors ([`RotorEffectiveness`]), which each drone has learned in twenty seconds of hovering before.
//!
//! `cargo run --release -p kestrel-experiments --example weak_rotors` prints the table of docs/microcontrollers.md, in about seven
//! minutes of one core.

use std::error::Error;
use std::fs;
use std::path::Path;

use kestrel_core::action::{ACTION_LIMIT, ControlMemory, Controls};
use kestrel_core::effectiveness::RotorEffectiveness;
use kestrel_core::pilot::{PolicyRunner, StatePolicy};
use kestrel_core::policy_file::{Aligned, PolicyAirframe, PolicyScratch};
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_experiments::experiment_config;
use kestrel_experiments::statistics::proportion::wilson;
use kestrel_sim::scenario::{Scenario, Success};
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::Simulation;

/// Drones that fly side by side.
const DRONES: usize = 64;

/// Of flights.
const SEEDS: u64 = 16;

/// Time in which the rotors are learned before the flights \[s\].
const HOVERING_SECS: f32 = 20.0;

/// Bytes of the largest policy.
const POLICY_BYTES: usize = 1 << 14;

/// Rooms, and who flies them: the policy of all Cross rooms, and policies of one room each.
const TASKS: [(&str, &str); 16] = [
    ("aviaries/incremental-cross-0", "crosses"),
    ("aviaries/incremental-cross-1", "crosses"),
    ("aviaries/incremental-cross-2", "crosses"),
    ("aviaries/incremental-cross-3", "crosses"),
    ("aviaries/incremental-cross-4", "crosses"),
    ("aviaries/incremental-cross-5", "crosses"),
    ("aviaries/incremental-cross-6", "crosses"),
    ("aviaries/harder-cross-11", "crosses"),
    ("aviaries/harder-cross-12", "crosses"),
    ("aviaries/harder-cross-13", "crosses"),
    ("aviaries/harder-cross-14", "crosses"),
    ("aviaries/harder-cross-15", "crosses"),
    ("aviaries/harder-cross-16", "crosses"),
    ("aviaries/room-0", "room-0"),
    ("aviaries/room-1", "room-1"),
    ("aviaries/room-2", "room-2"),
];

/// What has happened to a drone: the share of its thrust that each rotor makes. Another rotor is the worn one in every drone.
type Fault = fn(usize) -> [f32; 4];

/// A drone of 27 g carries 5 g more as one whose rotors all make 27/32 of their thrust, but for its inertia, which stays.
const FAULTS: [(&str, Fault); 4] = [
    ("none", |_| [1.0; 4]),
    ("a rotor at 85 %", |drone| core::array::from_fn(|rotor| if rotor == drone % 4 { 0.85 } else { 1.0 })),
    ("5 g more", |_| [27.0 / 32.0; 4]),
    ("all rotors at 85 %", |_| [0.85; 4]),
];

fn main() -> Result<(), Box<dyn Error>> {
    println!("| task | {} |", FAULTS.map(|(name, _)| format!("{name} | compensated")).join(" | "));
    for (task, pilot) in TASKS {
        let cells = FAULTS.iter().flat_map(|(_, fault)| [false, true].map(|compensates| (*fault, compensates)));
        let cells = cells.map(|(fault, compensates)| {
            let successes = successes(task, pilot, fault, compensates, SEEDS)? as f64;
            let flights = (SEEDS as usize * DRONES) as f64;
            let [low, high] = wilson(successes, flights).map(|bound| 100.0 * bound);
            Ok(format!("{:.1} % [{low:.1}, {high:.1}]", 100.0 * successes / flights))
        });
        println!("| {task} | {} |", cells.collect::<Result<Vec<_>, Box<dyn Error>>>()?.join(" | "));
    }
    Ok(())
}

/// How many of the flights of so many seeds succeed.
fn successes(
    task: &str,
    pilot: &str,
    fault: Fault,
    compensates: bool,
    seeds: u64,
) -> Result<usize, Box<dyn Error>> {
    let pilot = Pilot::load(task, pilot)?;
    let mut successes = 0;
    for seed in (0..seeds).map(Seed) {
        let mut drones = Drone::all(&pilot.scenario, fault);
        if compensates {
            for drone in &mut drones {
                drone.compensates = true;
            }
            pilot.hover(seed, &mut drones);
        }
        successes += pilot.fly(seed, &mut drones)?;
    }
    Ok(successes)
}

/// What stays the same from flight to flight.
struct Drone {
    /// Of its thrust, that each rotor makes.
    truth: [f32; 4],
    compensates: bool,
    effectiveness: RotorEffectiveness,
}

impl Drone {
    fn all(scenario: &Scenario, fault: Fault) -> Vec<Self> {
        let (airframe, action) = (PolicyAirframe::from(&scenario.airframe), &scenario.action);
        let effectiveness =
            RotorEffectiveness::new(&airframe, action.hover_speed_squared(), action.rotor_speed_limit());
        let drone = |index| Self { truth: fault(index), compensates: false, effectiveness: effectiveness.clone() };
        (0..DRONES).map(drone).collect()
    }

    /// How fast the rotors of a sound drone would turn for the same thrust \[rad/s\].
    fn turned(&mut self, state: &State<f32>, targets: [f32; 4], secs: f32) -> [f32; 4] {
        let mut commanded = targets;
        if self.compensates {
            commanded = self.effectiveness.compensated(&targets);
            self.effectiveness.learn(state, &commanded, secs);
        }
        core::array::from_fn(|rotor| commanded[rotor] * self.truth[rotor].sqrt())
    }
}

/// A policy and its task.
struct Pilot {
    scenario: Scenario,
    policy: Box<Aligned<POLICY_BYTES>>,
    len: usize,
}

impl Pilot {
    fn load(task: &str, pilot: &str) -> Result<Self, Box<dyn Error>> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let experiment = experiment_config::load(&folder.join(format!("configs/{task}.yaml")), &[])?;
        let bytes = fs::read(folder.join(format!("assets/pilots/{pilot}.kestrel")))?;
        let mut policy = Box::new(Aligned([0; POLICY_BYTES]));
        policy.0.get_mut(..bytes.len()).ok_or("a large policy")?.copy_from_slice(&bytes);
        Ok(Self { scenario: experiment.evaluation.scenario, policy, len: bytes.len() })
    }

    /// Holds each drone of the first episodes of a seed where it starts, by the controller of velocities behind the policy.
    fn hover(&self, seed: Seed, drones: &mut [Drone]) {
        let scenario = Scenario {
            terminations: Vec::new(),
            success: Success::Ending,
            episode_secs: f32::INFINITY,
            ..self.scenario.clone()
        };
        let mut flight = Flight::new(&scenario, seed);
        for _ in 0..(HOVERING_SECS / flight.control_secs) as u32 {
            flight.step(drones, |_, _| [0.0; ACTION_LIMIT]);
        }
    }

    /// Flies the first episodes of a seed, one with each drone; how many succeed.
    fn fly(&self, seed: Seed, drones: &mut [Drone]) -> Result<usize, Box<dyn Error>> {
        let policy = StatePolicy::parse(&self.policy.0[..self.len])?;
        let mut policies: Vec<_> = (0..DRONES).map(|_| policy.clone()).collect();
        let mut outcomes = [None; DRONES];
        let (mut flight, mut scratch) = (Flight::new(&self.scenario, seed), PolicyScratch::new());
        for drone in &mut *drones {
            drone.effectiveness.pause();
        }
        while outcomes.contains(&None) {
            flight.step(drones, |row, observation| policies[row].act(observation, &mut scratch));
            for episode in flight.simulation.take_episodes() {
                outcomes[episode.environment as usize].get_or_insert(episode.success);
            }
        }
        Ok(outcomes.iter().filter(|success| **success == Some(true)).count())
    }
}

/// Drones in their tasks, and the controllers behind their actions.
struct Flight {
    simulation: Simulation<64>,
    controls: Controls<f32>,
    memories: Vec<ControlMemory<f32>>,
    control_secs: f32,
}

impl Flight {
    fn new(scenario: &Scenario, seed: Seed) -> Self {
        Self {
            simulation: Simulation::new(scenario, seed, 0, DRONES),
            controls: Controls::new(&scenario.action),
            memories: (0..DRONES).map(|_| ControlMemory::new()).collect(),
            control_secs: 1.0 / scenario.physics.control_rate_hz as f32,
        }
    }

    /// A control period, with an action on the observation of each drone.
    fn step(&mut self, drones: &mut [Drone], mut act: impl FnMut(usize, &[f32]) -> [f32; ACTION_LIMIT]) {
        let simulation = &mut self.simulation;
        let mut actions = vec![0.0; simulation.scenario().action.len() * DRONES];
        let mut speeds = vec![[0.0; 4]; DRONES];
        for (row, (drone, memory)) in drones.iter_mut().zip(&mut self.memories).enumerate() {
            let observation: Vec<f32> =
                simulation.observations().iter().skip(row).step_by(DRONES).copied().collect();
            let action = act(row, &observation);
            let (state, setpoint) = (simulation.known_state(row), Setpoint::at(simulation.goal(row)));
            let targets = self.controls.rotor_targets(&action, &state, &setpoint, memory, self.control_secs);
            speeds[row] = drone.turned(&state, targets, self.control_secs);
            for (slot, value) in actions.iter_mut().skip(row).step_by(DRONES).zip(action) {
                *slot = value;
            }
        }
        simulation.step_with_rotor_speeds(&actions, &speeds);
    }
}

#[test]
fn a_worn_motor_costs_a_room_unless_it_is_made_up_for() -> Result<(), Box<dyn Error>> {
    let [_, (_, worn), ..] = FAULTS;
    let [without, with] =
        [false, true].map(|compensates| successes("aviaries/room-1", "room-1", worn, compensates, 2));
    let (without, with) = (without?, with?);
    assert!(with >= without + 8 && with >= 122, "{without} and {with} of 128");
    Ok(())
}
