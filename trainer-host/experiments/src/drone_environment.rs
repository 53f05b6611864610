//! Our simulator as an [`Environment`] of the learner: a row is a drone.

mod derivatives;

use std::ops::Range;

use kestrel_core::encoder::Volume;
use kestrel_sim::PRIVILEGED_LEN;
use kestrel_sim::camera::OnboardCamera;
use kestrel_sim::scenario::{CriticView, Scenario};
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::{Simulation, SimulationState};

pub use derivatives::FlightTape;

use crate::teacher::Teacher;
use kestrel_learn::environment::{Environment, Episode, Outcome, TaskShape};
use kestrel_learn::ppo;

/// A training run of drones.
pub type Trainer = ppo::Trainer<DroneEnvironment>;

/// Everything that such a run needs to go on.
pub type TrainerState = ppo::TrainerState<SimulationState>;

/// Drones in their aviaries, and the teacher of their task if it has one.
#[derive(Clone, Debug)]
pub struct DroneEnvironment {
    simulation: Simulation,
    teacher: Option<Teacher>,
}

impl Environment for DroneEnvironment {
    type Task = Scenario;
    type State = SimulationState;

    fn name(task: &Scenario) -> &str {
        &task.name
    }

    fn shape(task: &Scenario) -> TaskShape {
        TaskShape {
            agents: task.agents.count as usize,
            observation_len: task.observation.len(),
            privileged_len: match task.critic {
                CriticView::Observation => 0,
                CriticView::Privileged => PRIVILEGED_LEN,
            },
            action_len: task.action.len(),
            image: task.camera.as_ref().map(image_of),
        }
    }

    fn has_teacher(task: &Scenario) -> bool {
        Teacher::of(task).is_some()
    }

    fn begin(task: &Scenario, seed: Seed, first: u32, count: usize) -> Self {
        Self { simulation: Simulation::new(task, seed, first, count), teacher: Teacher::of(task) }
    }

    fn step(&mut self, actions: &[f32]) {
        self.simulation.step(actions);
    }

    fn observations(&self) -> &[f32] {
        self.simulation.observations()
    }

    fn privileged(&self) -> &[f32] {
        self.simulation.privileged()
    }

    fn images(&self) -> &[u8] {
        self.simulation.images()
    }

    fn rewards(&self) -> &[f32] {
        self.simulation.rewards()
    }

    fn outcomes(&self) -> &[Outcome] {
        self.simulation.outcomes()
    }

    fn final_observations(&self) -> &[f32] {
        self.simulation.final_observations()
    }

    fn final_privileged(&self) -> &[f32] {
        self.simulation.final_privileged()
    }

    fn final_images(&self) -> &[u8] {
        self.simulation.final_images()
    }

    fn write_teacher_actions(&mut self, rows: Range<usize>, actions: &mut [f32]) {
        let Self { simulation, teacher: Some(teacher) } = self else { return };
        let count = rows.len();
        for (index, row) in rows.enumerate() {
            let (state, goal, found) = (simulation.state(row), simulation.goal(row), simulation.ahead(row));
            let action = teacher.act(&state, &goal, simulation.room(row), found);
            for (column, value) in actions.chunks_exact_mut(count).zip(action) {
                column[index] = value;
            }
        }
    }

    fn take_episodes(&mut self) -> Vec<Episode> {
        let episodes = self.simulation.take_episodes().into_iter();
        episodes
            .map(|episode| Episode {
                steps: episode.steps,
                total_reward: episode.total_reward,
                success: Some(episode.success),
                terms: episode.terms,
            })
            .collect()
    }

    fn save(&self) -> SimulationState {
        self.simulation.save()
    }

    fn restore(&mut self, state: &SimulationState) -> bool {
        self.simulation.restore(state)
    }
}

/// The images of a camera; sides that are too large for any encoder become the largest number, which all refuse.
pub(crate) fn image_of(camera: &OnboardCamera) -> Volume {
    let [rows, columns, channels] = [camera.camera.rows, camera.camera.columns, camera.pixel_len()]
        .map(|len| u16::try_from(len).unwrap_or(u16::MAX));
    Volume { rows, columns, channels }
}

#[cfg(test)]
mod tests;
