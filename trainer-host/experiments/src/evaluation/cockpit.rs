//! Flyers at work.

use kestrel_core::action::ACTION_LIMIT;
use kestrel_core::gru::HiddenState;
use kestrel_core::observation::OBSERVATION_LIMIT;
use kestrel_core::policy_file::{PolicyScratch, VisionPolicy};
use kestrel_core::real::Real;
use kestrel_sim::contact::{Arena, ContactReport};
use kestrel_sim::outcome::Outcome;
use kestrel_sim::scenario::{Goals, Scenario};
use kestrel_sim::seed::{Purpose, Seed, Stream};
use kestrel_sim::simulation::Simulation;
use nalgebra::Vector3;

use super::Flyer;
use crate::known_way::{KnownWay, drawn_out};
use crate::scripted::{Aim, ScriptedPilot};
use crate::stock::StockFlight;

use kestrel_export::policy::Policy;
use kestrel_export::seeing::Memory;
use kestrel_learn::actor_critic::ActorWorkspace;
use kestrel_learn::gru::forget;
use kestrel_learn::network::InputBatch;

/// The scripted pilot touches goals that must be touched softly at this share of the speed that he asks of others who are
/// led: drones that are late and not what they should be touch a quarter harder than they are asked to.
const TOUCH_SHARE: f32 = 0.6;

/// A flyer at work on the environments of one simulation.
pub(crate) struct Cockpit<'a, R> {
    flyer: Flyer<'a>,
    /// One per drone.
    scripted: Vec<ScriptedPilot>,
    /// One per drone, where one of Bitcraze's controllers flies.
    stock: Vec<StockFlight>,
    /// Where no route is written down, the shortest free way leads the scripted pilot past what stands before its goal.
    guide: Option<Guide>,
    noise: Stream,
    /// Of an actor, once it has acted.
    pass: Option<ActorWorkspace>,
    /// What an actor remembers, `[units][rows]`.
    hidden: Vec<f32>,
    /// Of a policy with an eye, one per drone.
    onlookers: Vec<Onlooker>,
    /// Of a recurrent policy, one per drone.
    memories: Vec<HiddenState>,
    observations: Vec<f32>,
    actions: Vec<f32>,
    converted: Vec<R>,
}

impl<'a, R: Real> Cockpit<'a, R> {
    pub(crate) fn new<const LANES: usize>(
        simulation: &Simulation<LANES, R>,
        flyer: Flyer<'a>,
        seed: Seed,
        first: u32,
    ) -> Self {
        let scenario = simulation.scenario();
        let pilot = ScriptedPilot::of(scenario).softer(TOUCH_SHARE);
        Self {
            flyer,
            scripted: (0..simulation.rows()).map(|row| pilot.clone().along(route(simulation, row))).collect(),
            stock: match flyer {
                Flyer::Stock(stock) => vec![StockFlight::new(stock, &scenario.airframe); simulation.rows()],
                Flyer::Actor(_) | Flyer::Policy(_) | Flyer::Nothing | Flyer::Random | Flyer::Scripted => {
                    Vec::new()
                }
            },
            guide: match flyer {
                Flyer::Scripted => Guide::of(scenario, simulation.rows()),
                Flyer::Actor(_) | Flyer::Policy(_) | Flyer::Nothing | Flyer::Random | Flyer::Stock(_) => None,
            },
            noise: Stream::new(seed, first, Purpose::Baseline),
            pass: None,
            hidden: match flyer {
                Flyer::Actor(actor) => vec![0.0; actor.units() * simulation.rows()],
                Flyer::Policy(_) | Flyer::Nothing | Flyer::Random | Flyer::Scripted | Flyer::Stock(_) => {
                    Vec::new()
                }
            },
            onlookers: match flyer {
                Flyer::Policy(Policy::Seeing(policy)) => vec![Onlooker::of(policy); simulation.rows()],
                Flyer::Policy(Policy::Blind(_) | Policy::Recurrent(_))
                | Flyer::Actor(_)
                | Flyer::Nothing
                | Flyer::Random
                | Flyer::Scripted
                | Flyer::Stock(_) => Vec::new(),
            },
            memories: match flyer {
                Flyer::Policy(Policy::Recurrent(_)) => vec![HiddenState::new(); simulation.rows()],
                Flyer::Policy(Policy::Blind(_) | Policy::Seeing(_))
                | Flyer::Actor(_)
                | Flyer::Nothing
                | Flyer::Random
                | Flyer::Scripted
                | Flyer::Stock(_) => Vec::new(),
            },
            observations: Vec::new(),
            actions: vec![0.0; scenario.action.len() * simulation.rows()],
            converted: Vec::new(),
        }
    }

    /// Actions `[action length][rows]` for the simulation's present states.
    pub(crate) fn act<const LANES: usize>(&mut self, simulation: &Simulation<LANES, R>) -> &[R] {
        match self.flyer {
            Flyer::Actor(actor) => {
                self.observe(simulation);
                let Self { pass, hidden, observations: values, actions, .. } = self;
                forget(hidden, simulation.outcomes());
                let pass = pass.get_or_insert_with(|| ActorWorkspace::new(actor, simulation.rows()));
                actions.copy_from_slice(
                    pass.means(actor, InputBatch { values, images: simulation.images(), hidden }),
                );
                hidden.copy_from_slice(pass.hidden());
            }
            Flyer::Policy(policy) => {
                self.observe(simulation);
                for (memory, outcome) in self.memories.iter_mut().zip(simulation.outcomes()) {
                    if *outcome != Outcome::Running {
                        memory.clear();
                    }
                }
                for (onlooker, outcome) in self.onlookers.iter_mut().zip(simulation.outcomes()) {
                    if *outcome != Outcome::Running {
                        onlooker.forget();
                    }
                }
                self.act_one_by_one(policy, simulation.images());
            }
            Flyer::Nothing => {}
            Flyer::Random => self.actions.fill_with(|| self.noise.between(-1.0, 1.0)),
            Flyer::Scripted => self.follow_script(simulation),
            Flyer::Stock(_) => self.follow_goals(simulation),
        }
        self.converted.clear();
        self.converted.extend(self.actions.iter().map(|action| R::from_f32(*action)));
        &self.converted
    }

    fn observe<const LANES: usize>(&mut self, simulation: &Simulation<LANES, R>) {
        self.observations.clear();
        self.observations.extend(simulation.observations().iter().map(|value| value.to_f32()));
    }

    /// The exported policy, with the very inference that the firmware runs.
    fn act_one_by_one(&mut self, policy: &Policy<'_>, images: &[u8]) {
        let rows = self.scripted.len();
        let len = self.observations.len() / rows;
        let mut scratch = PolicyScratch::new();
        let mut observation = [0.0; OBSERVATION_LIMIT];
        for row in 0..rows {
            for (value, column) in observation.iter_mut().zip(self.observations.chunks_exact(rows)) {
                *value = column[row];
            }
            let observation = &observation[..len];
            let action = match policy {
                Policy::Blind(policy) => policy.act(observation, &mut scratch),
                Policy::Seeing(policy) => {
                    let image = &images[row * images.len() / rows..][..images.len() / rows];
                    self.onlookers[row].act(policy, image, observation, &mut scratch)
                }
                Policy::Recurrent(policy) => policy.act(observation, &mut self.memories[row], &mut scratch),
            };
            write_action(&mut self.actions, rows, row, &action);
        }
    }

    fn follow_script<const LANES: usize>(&mut self, simulation: &Simulation<LANES, R>) {
        let rows = simulation.rows();
        for (row, pilot) in self.scripted.iter_mut().enumerate() {
            let begins = simulation.outcomes()[row] != Outcome::Running;
            if begins {
                pilot.reset();
                pilot.follow(route(simulation, row));
            }
            let goal = simulation.goal(row).map(Real::to_f32);
            let mut state = simulation.state(row).map(Real::to_f32);
            if let Goals::Trajectory(_) = simulation.scenario().goals {
                // Beside a goal that moves with it, a drone is at rest.
                state.velocity -= simulation.goal_velocity(row).map(Real::to_f32);
            }
            let guide = self.guide.as_mut();
            let led =
                guide.and_then(|guide| guide.ahead(row, begins, (&state.position, &goal), simulation.room(row)));
            let action = match led {
                Some((ahead, distance)) => pilot.lead(&state, &Aim::at(ahead, &state.position), distance),
                None => pilot.act(&state, &goal),
            };
            write_action(&mut self.actions, rows, row, &action);
        }
    }

    fn follow_goals<const LANES: usize>(&mut self, simulation: &Simulation<LANES, R>) {
        for (row, flight) in self.stock.iter_mut().enumerate() {
            if simulation.outcomes()[row] != Outcome::Running {
                flight.reset();
            }
            let state = simulation.known_state(row).map(Real::to_f32);
            let (goal, velocity) = (simulation.goal(row), simulation.goal_velocity(row));
            let action = flight.act(state, goal.map(Real::to_f32), velocity.map(Real::to_f32));
            write_action(&mut self.actions, simulation.rows(), row, &action);
        }
    }
}

/// What the drone of a row has to fly through: places that are drawn have routes of their own.
fn route<const LANES: usize, R: Real>(simulation: &Simulation<LANES, R>, row: usize) -> &[Vector3<f32>] {
    simulation.scenario().aviary_of(simulation.room(row)).route(row / simulation.environments())
}

fn write_action(actions: &mut [f32], count: usize, environment: usize, action: &[f32]) {
    for (column, value) in actions.chunks_exact_mut(count).zip(action) {
        column[environment] = *value;
    }
}

/// Who knows the shortest free way, for scripted pilots without a route.
#[derive(Clone, Debug)]
struct Guide {
    way: KnownWay,
    /// What may stand in the way; nothing where worlds are drawn, in all of which something does.
    arena: Option<Arena>,
    /// Of each drone, whether it is led in its present flight; unknown before the first.
    leads: Vec<Option<bool>>,
}

impl Guide {
    /// So near to the goal \[m\] nothing counts as being in the way: it may be a part of the goal.
    const AT_GOAL_M: f32 = 0.5;

    /// None where a route is written down, or drawn with a course, or no reward asks for the way.
    fn of(scenario: &Scenario, rows: usize) -> Option<Self> {
        let drawn = scenario.drawn.is_some();
        if scenario.goals == Goals::Gates || !drawn && !scenario.aviary.routes.is_empty() {
            return None;
        }
        let arena = || Arena::new(&scenario.aviary.world, &scenario.airframe, ContactReport::Touch);
        Some(Self { way: KnownWay::of(scenario)?, arena: (!drawn).then(arena), leads: vec![None; rows] })
    }

    /// Where the drone of a row is led to \[m, world\], and how far away its goal seems \[m\], if it is led, which is settled
    /// where its flight begins.
    fn ahead(
        &mut self,
        row: usize,
        begins: bool,
        (position, goal): (&Vector3<f32>, &Vector3<f32>),
        room: u32,
    ) -> Option<(Vector3<f32>, f32)> {
        let blocked = || self.arena.as_ref().is_none_or(|arena| is_blocked(arena, position, goal));
        let leads = match self.leads[row] {
            Some(leads) if !begins => leads,
            Some(_) | None => blocked(),
        };
        self.leads[row] = Some(leads);
        leads.then(|| {
            let (ahead, distance) = self.way.ahead(position, goal, room);
            (position + drawn_out(&(ahead - position)), distance)
        })
    }
}

/// Whether something solid is on the straight line, but for its end.
fn is_blocked(arena: &Arena, from: &Vector3<f32>, goal: &Vector3<f32>) -> bool {
    let line = goal - from;
    let limit = line.norm() - Guide::AT_GOAL_M;
    limit > 0.0 && arena.raycast(from.cast(), line.normalize().cast(), limit.into()).is_some()
}

/// What a policy with an eye keeps of the last image of one drone, and what it remembers of its flight.
#[derive(Clone, Debug)]
struct Onlooker {
    memory: Memory,
    image: Vec<u8>,
}

impl Onlooker {
    fn of(policy: &VisionPolicy<'_>) -> Self {
        Self { memory: Memory::of(policy), image: Vec::new() }
    }

    /// Begins another flight.
    fn forget(&mut self) {
        self.memory.borrowed().clear();
        self.image.clear();
    }

    /// Looks at the image if it is another one, and acts.
    fn act(
        &mut self,
        policy: &VisionPolicy<'_>,
        image: &[u8],
        observation: &[f32],
        scratch: &mut PolicyScratch,
    ) -> [f32; ACTION_LIMIT] {
        let mut memory = self.memory.borrowed();
        if self.image != image {
            policy.encode(image, &mut memory).expect("a policy flies with the camera that it was trained with");
            image.clone_into(&mut self.image);
        }
        policy.act(observation, &mut memory, scratch).expect("its memory is its own")
    }
}
