//! Derivatives of flights, for training by backpropagation through time.

use std::sync::Arc;

use kestrel_learn::analytic::Differentiable;
use kestrel_learn::environment::{Environment, Outcome};
use kestrel_sim::gradient::{LANES, StepGradient, StepRecord, Workspace};
use kestrel_sim::scenario::Scenario;

use super::DroneEnvironment;

/// A window of flight of [`LANES`] environments.
#[derive(Clone, Debug)]
pub struct FlightTape {
    gradient: Arc<StepGradient>,
    agents: usize,
    records: Vec<StepRecord>,
    /// Of each step and agent, whether its episode of a lane ended with it.
    ended: Vec<Vec<[bool; LANES]>>,
    workspace: Workspace,
    /// Derivatives by the state after the step that comes next on the way back.
    state: Vec<[f32; LANES]>,
    /// Derivatives by what was observed, agent by agent.
    seen: Vec<[f32; LANES]>,
}

impl Differentiable for DroneEnvironment {
    type Tape = FlightTape;

    const ENVIRONMENTS: usize = LANES;

    fn tape(task: &Scenario, steps: usize) -> Result<FlightTape, String> {
        let gradient = StepGradient::new(task).map_err(|refusal| refusal.to_string())?;
        let shape = Self::shape(task);
        Ok(FlightTape {
            records: vec![gradient.record(); steps],
            ended: vec![vec![[false; LANES]; shape.agents]; steps],
            workspace: gradient.workspace(),
            state: gradient.no_adjoints(),
            seen: vec![[0.0; LANES]; shape.agents * shape.observation_len],
            agents: shape.agents,
            gradient: Arc::new(gradient),
        })
    }

    fn step_on(&mut self, tape: &mut FlightTape, step: usize, actions: &[f32]) {
        let record = std::slice::from_mut(&mut tape.records[step]);
        self.simulation.take_down(&tape.gradient, actions, record);
        self.simulation.step(actions);
        self.simulation.take_down_end(&tape.gradient, record);
        let ended = &mut tape.ended[step];
        for (row, outcome) in self.simulation.outcomes().iter().enumerate() {
            ended[row / LANES][row % LANES] = *outcome != Outcome::Running;
        }
    }

    fn pull_back(tape: &mut FlightTape, step: usize, by_observations: &[f32], limit: f32, by_actions: &mut [f32]) {
        let FlightTape { gradient, agents, records, ended, workspace, state, seen } = tape;
        if step + 1 == records.len() {
            state.fill([0.0; LANES]);
        }
        gradient.run(&records[step], workspace);
        let count = seen.len();
        for (index, column) in by_observations.chunks_exact(LANES).enumerate() {
            seen[by_agent(index, count, *agents)].copy_from_slice(column);
        }
        // Agents stand one after the other, with as many columns each.
        let columns_of_agent = (state.len() / *agents).max(1);
        let of_agents = state.chunks_exact_mut(columns_of_agent).zip(&ended[step]);
        let seen_by_agents = seen.chunks_exact_mut((count / *agents).max(1)).zip(&ended[step]);
        for (columns, ended) in of_agents.chain(seen_by_agents) {
            for column in columns {
                column.iter_mut().zip(ended).filter(|(_, ended)| **ended).for_each(|(value, _)| *value = 0.0);
            }
        }
        let count = by_actions.len() / LANES;
        let columns: Vec<[f32; LANES]> = gradient.pull_back(workspace, state, seen).collect();
        for (index, column) in by_actions.chunks_exact_mut(LANES).enumerate() {
            column.copy_from_slice(&columns[by_agent(index, count, *agents)]);
        }
        state.chunks_exact_mut(columns_of_agent).for_each(|columns| shorten(columns, limit));
    }

    fn restart(&mut self, environments: &[usize]) {
        self.simulation.restart(environments.iter().copied());
    }
}

/// Where column `index` of `[features][agents]` is among those of `[agents][features]`, of which there are `count`.
pub(super) fn by_agent(index: usize, count: usize, agents: usize) -> usize {
    (index % agents) * (count / agents) + index / agents
}

/// Shortens the derivative of an agent in a lane to the longest that is allowed; one that is not finite is none.
fn shorten(state: &mut [[f32; LANES]], limit: f32) {
    let mut squares = [0.0; LANES];
    for column in &*state {
        squares.iter_mut().zip(column).for_each(|(square, value)| *square += value * value);
    }
    let scales = squares.map(|square: f32| (limit / square.sqrt().max(f32::MIN_POSITIVE)).min(1.0));
    for column in state {
        for ((value, square), scale) in column.iter_mut().zip(&squares).zip(&scales) {
            *value = if square.is_finite() { *value * scale } else { 0.0 };
        }
    }
}
