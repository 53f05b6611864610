//! A recording of an episode that is flown for it.

use kestrel_core::real::Real;
use kestrel_core::vehicle::State;
use kestrel_sim::outcome::Episode;
use kestrel_sim::simulation::Simulation;
use kestrel_sim::world::Pose;

use super::{Placed, Recording, Track};
use crate::evaluation::{Cockpit, Flyer, Starts};
use crate::experiment_config::Experiment;
use crate::results::starts;

/// Flies the episode that an evaluation flies as number `start`, in double precision, and keeps everything.
pub fn fly(experiment: &Experiment, flyer: Flyer<'_>, starts: Starts, start: u32) -> Recording {
    fly_watched(experiment, flyer, (starts, start), &mut |_, _| true)
}

/// The same; `watch` sees the simulation and the tracks at the start and after each step, and says whether to go on.
pub(crate) fn fly_watched(
    experiment: &Experiment,
    flyer: Flyer<'_>,
    (starts, start): (Starts, u32),
    watch: &mut dyn FnMut(&Simulation<1, f64>, &[Track]) -> bool,
) -> Recording {
    let mut simulation = waiting(experiment, starts, start);
    let mut cockpit = Cockpit::new(&simulation, flyer, starts.seed, start);
    let mut drones = tracks(&simulation);
    let mut movables = vec![placed(&simulation)];
    let mut flying = vec![true; drones.len()];
    while watch(&simulation, &drones) && flying.contains(&true) {
        let actions = cockpit.act(&simulation).to_vec();
        simulation.step(&actions);
        let ended = simulation.take_episodes();
        for (row, track) in drones.iter_mut().enumerate().filter(|(row, _)| flying[*row]) {
            let action: Vec<f64> = actions.iter().skip(row).step_by(flying.len()).copied().collect();
            let end = ended.iter().find(|episode| episode.agent as usize == row);
            let after = end.is_none().then(|| simulation.state(row));
            track.push(&action, &simulation.terms(row), after.as_ref());
            if let Some(episode) = end {
                finish(track, episode);
            }
        }
        for episode in &ended {
            flying[episode.agent as usize] = false;
        }
        if flying.contains(&true) {
            movables.push(placed(&simulation));
        }
    }
    recording(experiment, flyer.name(), (starts, start), drones, movables)
}

/// A flight that is no episode of a task, such as a session of a vehicle behind MAVLink: kept while it goes on.
#[derive(Clone, Debug, Default)]
pub struct SessionRecorder {
    track: Option<Track>,
    rotor_targets: [f32; 4],
    movables: Vec<Vec<Placed>>,
}

impl SessionRecorder {
    /// Keeps a control period: the true state at its beginning, and what the rotors are told then \[rad/s\].
    pub fn note(&mut self, state: &State<f32>, rotor_targets: &[f32; 4], movables: &[Pose]) {
        match &mut self.track {
            // It goes where it is told; what stands in films is where it began.
            None => self.track = Some(Track::starting(state.position.map(f64::from).into(), state)),
            Some(track) => track.push(&self.rotor_targets, &[], Some(state)),
        }
        self.rotor_targets = *rotor_targets;
        self.movables.push(movables.iter().map(Placed::of).collect());
    }

    /// All of it, in the aviary of a task; nothing if there was no control period.
    pub fn recording(self, experiment: &Experiment, pilot: &str) -> Option<Recording> {
        let drones = vec![self.track?];
        let recording = recording(experiment, pilot, (starts(experiment), 0), drones, self.movables);
        Some(Recording { components: Vec::new(), ..recording })
    }
}

/// The beginning of that episode: states without steps.
pub fn at_start(experiment: &Experiment, starts: Starts, start: u32) -> Recording {
    let simulation = waiting(experiment, starts, start);
    recording(experiment, "at the start", (starts, start), tracks(&simulation), vec![placed(&simulation)])
}

fn waiting(experiment: &Experiment, starts: Starts, start: u32) -> Simulation<1, f64> {
    Simulation::with_purpose(&experiment.evaluation.scenario, starts.seed, starts.purpose, start, 1)
}

fn tracks(simulation: &Simulation<1, f64>) -> Vec<Track> {
    let goal = |row| simulation.goal(row).map(Real::to_f64).into();
    (0..simulation.rows()).map(|row| Track::starting(goal(row), &simulation.state(row))).collect()
}

fn recording(
    experiment: &Experiment,
    pilot: &str,
    (starts, start): (Starts, u32),
    drones: Vec<Track>,
    movables: Vec<Vec<Placed>>,
) -> Recording {
    let scenario = &experiment.evaluation.scenario;
    Recording {
        pilot: pilot.to_owned(),
        config: experiment.resolved_yaml.clone(),
        seed: starts.seed.0,
        start,
        components: scenario.rewards.iter().map(|term| term.name().to_owned()).collect(),
        drones,
        movables: if scenario.aviary.world.movables.is_empty() { Vec::new() } else { movables },
    }
}

fn placed(simulation: &Simulation<1, f64>) -> Vec<Placed> {
    simulation.movables(0).iter().map(Placed::of).collect()
}

fn finish(track: &mut Track, episode: &Episode) {
    track.finish(episode.ending.name(), episode.success);
}
