//! Derivatives of a control period: of rewards and observations by actions and by the state before.
//!
//! The step of a simulation is generic in its number type. [`StepGradient::new`] runs it once with numbers that
//! remember how they were computed, from the command to the observation: action space, latency, every substep of the
//! vehicle, each reward term. What comes out is a program over lanes that computes the bits of the simulation, and
//! pulls derivatives of what it computes back to what it began with (reverse-mode automatic differentiation). Chained
//! from the last control period to the first it is backpropagation through time.
//!
//! What has no derivative is left out: contacts push nothing, sensors and images count as given, and an episode that
//! ends ends the chain. Of what stands around, a reward sees the plane that touches the nearest surface: the plane counts as
//! given, the place before it does not.

mod program;
mod traced;

use kestrel_core::action::{ActionSpace, Controls};
use kestrel_core::real::Real;
use thiserror::Error;

use crate::agent::Agent;
use crate::block::{Actions, Block};
use crate::scenario::{Goals, Preset, Scenario};
use crate::seed::{Purpose, Seed};
use crate::stage::Stage;
use crate::swarm::Mechanics;
pub use program::{LANES, Workspace};
use program::{Program, Wanted};
use traced::{Operation, Traced, record};

/// How far inside its range an action is differentiated: at the limit itself there are two derivatives, and the one
/// outside is zero.
const INSIDE: f32 = 1.0 - 1e-6;

/// The control period of a task, ready to be differentiated; agents of a task stand one after the other.
#[derive(Clone, Debug)]
pub struct StepGradient {
    program: Program,
    /// Where what the program reads comes from.
    sources: Vec<Source>,
    /// Slots of the reward terms that have a derivative, agent by agent.
    rewards: Vec<u32>,
    /// Slots of the observations, agent by agent.
    observations: Vec<u32>,
    /// Slots of what the next control period begins with: where it is read there, and where it is computed here.
    carries: Vec<Carry>,
    /// Slots of the actions, agent by agent; none where nothing depends on one.
    actions: Vec<Option<u32>>,
    silent: Vec<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    /// A column of the block, before the control period.
    Column(usize),
    /// A column of the block that is found when the flight is over.
    LateColumn(usize),
    /// An action of all agents.
    Action(usize),
}

#[derive(Clone, Copy, Debug)]
struct Carry {
    read: u32,
    computed: u32,
}

/// What of a task has no derivatives.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum NotDifferentiable {
    /// Bullet's physics has quirks that choose.
    #[error("bullet physics, which has no derivatives")]
    Bullet,
    /// The actions of the reference system remember, and choose.
    #[error("the action space {name} of the reference system, which has no derivatives")]
    ActionSpace {
        /// Its name.
        name: &'static str,
    },
    /// Goals that move as in the reference system are not traced.
    #[error("a goal that moves along a line or in a wave")]
    MovingGoal,
    /// No reward has one.
    #[error("rewards without a derivative by the flight: {names}")]
    Rewards {
        /// All of them.
        names: String,
    },
}

/// What a control period began with, and what the drones did in it.
#[derive(Clone, Debug)]
pub struct StepRecord {
    /// `[sources]`.
    values: Vec<[f32; LANES]>,
}

impl StepGradient {
    /// Traces a control period of a task.
    ///
    /// # Errors
    /// When it has no derivatives, or none that anything is rewarded for.
    pub fn new(scenario: &Scenario) -> Result<Self, NotDifferentiable> {
        if let Preset::Bullet { .. } = scenario.physics.preset {
            return Err(NotDifferentiable::Bullet);
        }
        if let ActionSpace::Reference(_) = scenario.action {
            return Err(NotDifferentiable::ActionSpace { name: scenario.action.name() });
        }
        if let Goals::Line(_) | Goals::Wave { .. } | Goals::Gates = scenario.goals {
            return Err(NotDifferentiable::MovingGoal);
        }
        let (trace, period) = record(|| Period::fly(scenario, Traced::input));
        period.differentiated(&trace, scenario)
    }

    /// Indices of the reward terms that have no derivative and therefore teach nothing.
    pub fn silent_terms(&self) -> &[usize] {
        &self.silent
    }

    /// Operations of a control period forwards, and additions of derivatives backwards.
    pub fn operations(&self) -> (usize, usize) {
        self.program.len()
    }

    /// Room to differentiate in.
    pub fn workspace(&self) -> Workspace {
        self.program.workspace()
    }

    /// Room for the state before a control period.
    pub fn record(&self) -> StepRecord {
        StepRecord { values: vec![[0.0; LANES]; self.sources.len()] }
    }

    /// Adjoints of a state after which nothing is rewarded.
    pub fn no_adjoints(&self) -> Vec<[f32; LANES]> {
        vec![[0.0; LANES]; self.carries.len()]
    }

    /// Takes down what a block begins a control period with, and its actions `[agents · action_len][LANES]`.
    pub(crate) fn take_down(
        &self,
        block: &mut Block<LANES, f32>,
        actions: &[[f32; LANES]],
        record: &mut StepRecord,
    ) {
        let mut columns = block.agents.iter_mut().flat_map(Agent::columns_mut).enumerate();
        let places = self.sources.iter().zip(&mut record.values);
        for (source, values) in places {
            match *source {
                Source::Column(wanted) => {
                    // Sources stand in the order of the columns.
                    if let Some((_, column)) = columns.find(|(index, _)| *index == wanted) {
                        *values = *column;
                    }
                }
                Source::LateColumn(_) => {}
                Source::Action(index) => *values = actions[index].map(|action| action.limited(-INSIDE, INSIDE)),
            }
        }
    }

    /// Takes down what the control period of a record has found in the end.
    pub(crate) fn take_down_end(&self, block: &mut Block<LANES, f32>, record: &mut StepRecord) {
        let mut columns = block.agents.iter_mut().flat_map(Agent::columns_mut).enumerate();
        for (source, values) in self.sources.iter().zip(&mut record.values) {
            match *source {
                Source::LateColumn(wanted) => {
                    if let Some((_, column)) = columns.find(|(index, _)| *index == wanted) {
                        *values = *column;
                    }
                }
                Source::Column(_) | Source::Action(_) => {}
            }
        }
    }

    /// Computes the control period of a record.
    pub fn run(&self, record: &StepRecord, workspace: &mut Workspace) {
        workspace.values[..self.sources.len()].copy_from_slice(&record.values);
        self.program.run(workspace);
    }

    /// Reward terms that have a derivative, of the period that ran last, `[agents · terms]` columns.
    pub fn rewards<'a>(&self, workspace: &'a Workspace) -> impl Iterator<Item = &'a [f32; LANES]> {
        self.rewards.iter().map(|slot| &workspace.values[*slot as usize])
    }

    /// Observations after the period that ran last, `[agents · observation_len]` columns.
    pub fn observations<'a>(&self, workspace: &'a Workspace) -> impl Iterator<Item = &'a [f32; LANES]> {
        self.observations.iter().map(|slot| &workspace.values[*slot as usize])
    }

    /// Carries derivatives through the control period that ran last.
    ///
    /// `state` holds those by the state after it and afterwards those by the state before; `observations [agents ·
    /// observation_len]` are those by what was seen after it. Each reward counts once. Returns those by the actions,
    /// `[agents · action_len]` columns.
    pub fn pull_back<'a>(
        &self,
        workspace: &'a mut Workspace,
        state: &mut [[f32; LANES]],
        observations: &[[f32; LANES]],
    ) -> impl Iterator<Item = [f32; LANES]> + use<'a, '_> {
        self.program.clear(workspace);
        let adjoints = &mut workspace.adjoints;
        let mut add = |slot: u32, values: &[f32; LANES]| {
            let adjoint = &mut adjoints[slot as usize];
            adjoint.iter_mut().zip(values).for_each(|(adjoint, value)| *adjoint += value);
        };
        self.rewards.iter().for_each(|slot| add(*slot, &[1.0; LANES]));
        self.observations.iter().zip(observations).for_each(|(slot, values)| add(*slot, values));
        self.carries.iter().zip(&*state).for_each(|(carry, values)| add(carry.computed, values));
        self.program.pull_back(workspace);
        for (carry, values) in self.carries.iter().zip(state) {
            *values = workspace.adjoints[carry.read as usize];
        }
        let workspace = &*workspace;
        let adjoint = |slot: &Option<u32>| slot.map_or([0.0; LANES], |slot| workspace.adjoints[slot as usize]);
        self.actions.iter().map(adjoint)
    }
}

/// A control period of one environment: what came of it.
struct Period<R> {
    /// Columns before, which are the first inputs; the actions are those behind them.
    columns: usize,
    /// Those of them that are found when the flight is over.
    late: Vec<usize>,
    /// Those columns afterwards.
    after: Vec<R>,
    /// Agent by agent.
    observations: Vec<R>,
    /// Reward terms, agent by agent.
    terms: Vec<R>,
}

impl<R: Real> Period<R> {
    /// From these columns and actions.
    fn fly(scenario: &Scenario, input: impl Fn(usize) -> R) -> Self {
        let mut block = Block::<1, R>::new(scenario, None, (Seed(0), Purpose::Reset), &(0..1));
        let (mut columns, mut late) = (0, Vec::new());
        for agent in &mut block.agents {
            agent.forget_sensors();
            for column in agent.columns_mut() {
                *column = [input(columns)];
                columns += 1;
            }
            late.extend(columns - agent.late_columns()..columns);
        }
        block.update_positions();
        let (agents, len) = (scenario.agents.count as usize, scenario.action.len());
        let actions_of = |agent: usize| -> Actions<1, R> {
            let action = |index: usize| if index < len { input(columns + agent * len + index) } else { R::zero() };
            core::array::from_fn(|index| [action(index)])
        };
        let actions: Vec<Actions<1, R>> = (0..agents).map(actions_of).collect();
        let stage = Stage {
            scenario,
            controls: &Controls::new(&scenario.action),
            mechanics: &Mechanics::new(&scenario.physics, &scenario.airframe),
            arenas: None,
            solver: None,
            control_secs: R::from_f64(1.0 / scenario.physics.control_rate_hz),
        };
        block.command(&stage, &actions);
        block.advance_untouched(&stage, &actions);
        let lone = |columns: &[[R; 1]]| columns.iter().map(|[value]| *value).collect::<Vec<R>>();
        Self {
            columns,
            late,
            observations: block.agents.iter().flat_map(|agent| lone(&agent.observations)).collect(),
            terms: block.agents.iter().flat_map(|agent| lone(&agent.term_values)).collect(),
            after: block.agents.iter_mut().flat_map(Agent::columns_mut).map(|[value]| *value).collect(),
        }
    }
}

impl Period<Traced> {
    fn differentiated(self, trace: &[Operation], scenario: &Scenario) -> Result<StepGradient, NotDifferentiable> {
        let silent = self.silent_terms(trace, scenario.rewards.len());
        if silent.len() == scenario.rewards.len() {
            let names: Vec<&str> = scenario.rewards.iter().map(crate::reward::RewardTerm::name).collect();
            return Err(NotDifferentiable::Rewards { names: names.join(", ") });
        }
        let speaks = |index: usize| !silent.contains(&(index % scenario.rewards.len()));
        let speaking = self.terms.iter().enumerate().filter(|(index, _)| speaks(*index));
        let rewards: Vec<u32> = speaking.map(|(_, term)| term.place).collect();
        let ends: Vec<u32> =
            rewards.iter().copied().chain(self.observations.iter().map(|value| value.place)).collect();
        let carried = self.carried(trace, &ends);
        let outputs = [ends, carried.iter().map(|column| self.after[*column].place).collect()].concat();
        let is_active = |index: usize| index >= self.columns || carried.contains(&index);
        let (program, slots) = Program::new(trace, &Wanted { outputs: &outputs, is_active: &is_active });
        let source = |index: &usize| match index.checked_sub(self.columns) {
            None if self.late.contains(index) => Source::LateColumn(*index),
            None => Source::Column(*index),
            Some(action) => Source::Action(action),
        };
        let sources: Vec<Source> = program.inputs.iter().map(source).collect();
        let slot_of = |wanted: Source| sources.iter().position(|source| *source == wanted).map(|slot| slot as u32);
        let (reward_slots, rest) = slots.split_at(rewards.len());
        let (observations, computed) = rest.split_at(self.observations.len());
        let carry = |(column, computed): (&usize, &u32)| {
            slot_of(Source::Column(*column)).map(|read| Carry { read, computed: *computed })
        };
        Ok(StepGradient {
            rewards: reward_slots.to_vec(),
            observations: observations.to_vec(),
            carries: carried.iter().zip(computed).filter_map(carry).collect(),
            actions: (0..scenario.agents.count as usize * scenario.action.len())
                .map(|action| slot_of(Source::Action(action)))
                .collect(),
            sources,
            program,
            silent,
        })
    }

    /// Columns that the period changes, and by which rewards or observations have a derivative, at once or later.
    fn carried(&self, trace: &[Operation], ends: &[u32]) -> Vec<usize> {
        let is_changed =
            |column: usize| trace[self.after[column].place as usize] != Operation::Input(column as u32);
        let mut carried: Vec<usize> = Vec::new();
        loop {
            let later = carried.iter().map(|column| self.after[*column].place);
            let outputs: Vec<u32> = ends.iter().copied().chain(later).collect();
            let mut found: Vec<usize> = program::sources(trace, &outputs)
                .into_iter()
                .filter(|index| *index < self.columns && is_changed(*index))
                .collect();
            found.sort_unstable();
            if found == carried {
                return carried;
            }
            carried = found;
        }
    }

    /// Terms that depend on nothing that is flown, or on something that was looked at rather than computed with.
    fn silent_terms(&self, trace: &[Operation], terms: usize) -> Vec<usize> {
        let is_silent = |term: &usize| {
            let places: Vec<u32> = self.terms.iter().skip(*term).step_by(terms).map(|term| term.place).collect();
            let is_unknown = |(operation, needed): (&Operation, bool)| {
                needed && matches!(operation, Operation::Constant(bits) if f32::from_bits(*bits).is_nan())
            };
            let looked = trace.iter().zip(program::needed(trace, &places)).any(is_unknown);
            looked || program::sources(trace, &places).is_empty()
        };
        (0..terms).filter(is_silent).collect()
    }
}

#[cfg(test)]
mod tests;
