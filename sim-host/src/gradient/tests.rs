use std::sync::Arc;

use kestrel_core::action::{IntegralVelocities, RotorThrusts, ThrustBodyRates, Velocities};
use kestrel_core::airframe::CRAZYFLIE_2_1;
use kestrel_core::dynamics::Integrator;
use kestrel_core::observation::{BodyLayout, ObservationLayout, PilotLayout, Px4NeuralLayout};
use kestrel_core::planner::NodeGrid;
use kestrel_core::vehicle::Ground;
use nalgebra::Vector3;

use super::*;
use crate::contact::DistanceField;
use crate::estimate::{Deviation, EstimateErrors};
use crate::latency::{Latency, Outages};
use crate::physics::Contacts;
use crate::reward::{Avoidance, Cruise, Encounter, HeadingError, RewardTerm};
use crate::rooms::Ways;
use crate::scenario::{Agents, Downwash, Physics};
use crate::seed::Stream;
use crate::sensor::instrument::Sampling;
use crate::sensor::{SensorSuite, Tof, TofParts, Told, Way};
use crate::simulation::Simulation;
use crate::testing;
use crate::trajectory::{PathAhead, Trajectories, TrajectoryShape};
use crate::world::{Cuboid, Solid};

const AHEAD: PathAhead = PathAhead { points: 2, spacing_secs: 0.2, position_scale_m: 0.5 };

const SCALES: PilotLayout = PilotLayout { position_scale_m: 0.5, velocity_scale: 2.0, body_rates_scale: 10.0 };

/// A task for every action space, integrator and layout, one along curves and one for a team; but for the first two on the drone that has
/// all effects, late.
fn scenarios() -> Vec<Scenario> {
    let rates = ThrustBodyRates::new(&CRAZYFLIE_2_1, 0.9, [8.0, 8.0, 3.0], [10.0, 10.0, 5.0]);
    let velocities = Velocities { rates, speed_limit: 1.0, velocity_gain: 3.0, attitude_gain: 8.0 };
    let late = Scenario {
        airframe: CRAZYFLIE_2_1,
        physics: Physics::clean(Integrator::SemiImplicitEuler, 4, 50.0),
        action: ActionSpace::ThrustBodyRates(rates),
        latency: Latency {
            state_secs: [0.0, 0.015],
            motor_secs: [0.0, 0.005],
            state_jitter_secs: 0.002,
            ..Latency::NONE
        },
        ..testing::hover()
    };
    let near = Preset::Clean {
        integrator: Integrator::RungeKutta4,
        ground: Ground::Near,
        ceiling: Some(1.2),
        downwash: Downwash::Absent,
    };
    let body = BodyLayout { scales: SCALES, action_len: 4, measured_len: 0 };
    let team = Agents { count: 2, ..Agents::ONE };
    let pushed = Preset::Clean {
        integrator: Integrator::SemiImplicitEuler,
        ground: Ground::Distant,
        ceiling: None,
        downwash: Downwash::Felt,
    };
    vec![
        testing::hover(),
        meeting(Scenario {
            agents: team,
            physics: Physics { preset: pushed, ..late.physics },
            ..testing::hover()
        }),
        Scenario { physics: Physics { preset: near, ..late.physics }, ..late.clone() },
        Scenario { action: ActionSpace::Velocities(velocities), ..late.clone() },
        Scenario {
            action: ActionSpace::IntegralVelocities(IntegralVelocities { velocities, integral_gain: 3.0 }),
            ..late.clone()
        },
        Scenario { action: ActionSpace::RateLoop(rates), ..late.clone() },
        Scenario { observation: ObservationLayout::Body(body), ..late.clone() },
        misled(&late, body),
        Scenario {
            goals: Goals::Trajectory(Trajectories {
                shapes: TrajectoryShape::ALL.to_vec(),
                reach: [0.5, 1.0],
                rise: [0.1, 0.2],
                speed: [0.3, 1.5],
            }),
            sensors: SensorSuite::none().with_told(Some(Told::Path(AHEAD))),
            observation: ObservationLayout::Body(BodyLayout { measured_len: AHEAD.len() as u8, ..body }),
            ..late.clone()
        },
        beside_a_wall(&late, body),
        on_its_way(&late, body),
        on_the_shortest_way(&late, body),
        Scenario {
            action: ActionSpace::RotorThrusts(RotorThrusts::new(&CRAZYFLIE_2_1, 0.05, 300.0)),
            observation: ObservationLayout::Px4Neural(Px4NeuralLayout),
            ..late
        },
    ]
}

/// A task whose drones know little of where they are.
fn misled(late: &Scenario, body: BodyLayout) -> Scenario {
    let deviation = Deviation { noise: 0.02, drift: 0.05 };
    Scenario {
        observation: ObservationLayout::Body(body),
        latency: Latency {
            position_extra_secs: [0.01, 0.05],
            outages: Outages { per_sec: 5.0, secs: [0.02, 0.1] },
            ..late.latency
        },
        estimate: EstimateErrors {
            position: deviation,
            velocity: deviation,
            tilt: deviation,
            heading: deviation,
            body_rates: deviation,
            drift_secs: 0.5,
        },
        ..late.clone()
    }
}

/// A task whose rewards look around, and whose drones see the wall beside the goal.
fn beside_a_wall(late: &Scenario, body: BodyLayout) -> Scenario {
    let wall = Solid::block("wall", Vector3::new(0.3, -2.0, 0.0), Vector3::new(0.4, 2.0, 3.0));
    let zones = TofParts {
        side: 4,
        field_of_view: 0.8,
        pitch: 0.0,
        limit: 4.0,
        noise: [0.01, 0.02],
        sampling: Sampling { rate_hz: 15.0, latency_secs: 0.04, drop_out: 0.1 },
    };
    let mut scenario = Scenario {
        observation: ObservationLayout::Body(BodyLayout { measured_len: 16, ..body }),
        sensors: SensorSuite::none().with_tof(Some(Tof::new(&zones))),
        physics: Physics { contacts: Contacts::Reported, ..late.physics },
        ..late.clone()
    };
    scenario.aviary.world.solids.push(wall);
    scenario.rewards.push(Avoidance { weight: -2.0, reach_m: 1.0, ahead_secs: 0.0 }.into());
    scenario.rewards.push(CRUISE.into());
    scenario
}

const CRUISE: Cruise = Cruise {
    weight: -1.0,
    speed_m_per_s: 1.5,
    slow_within_m: 0.5,
    slow_to_m_per_s: 0.0,
    tolerance_m_per_s: 1.0,
    along_own_way: false,
    along_shortest_way: false,
    ways: None,
    share_aside: 1.0,
};

/// The same, whose drones keep off each other.
fn meeting(mut scenario: Scenario) -> Scenario {
    scenario.rewards.push(Encounter { weight: -2.0, reach_m: 1.0, ahead_secs: 0.5 }.into());
    scenario
}

/// The same, in which they look for their ways and fly along them.
fn on_its_way(late: &Scenario, body: BodyLayout) -> Scenario {
    let mut scenario = beside_a_wall(late, body);
    let grid = NodeGrid::new([-2.0, -2.0, 0.0], [2.0, 2.0, 3.0], 0.2).unwrap();
    let way = Way {
        grid,
        periods: 5,
        lookahead_m: 0.4,
        nearness_cost: 12.0,
        mapped_within_m: 1.0,
        unseen_cost: 1.0,
        shows_nearest: true,
    };
    scenario.sensors = scenario.sensors.with_told(Some(Told::Way(way)));
    scenario.observation = ObservationLayout::Body(BodyLayout { measured_len: 22, ..body });
    scenario.rewards.pop();
    scenario.rewards.push(
        Cruise { along_own_way: true, slow_to_m_per_s: 0.1, share_aside: 0.3, tolerance_m_per_s: 0.3, ..CRUISE }
            .into(),
    );
    scenario.rewards.push(HeadingError { weight: -0.5, heading_deg: 0.0, along_own_way: true }.into());
    scenario
}

/// The same, in which they look ahead and fly along the shortest way.
fn on_the_shortest_way(late: &Scenario, body: BodyLayout) -> Scenario {
    let mut scenario = beside_a_wall(late, body);
    let aviary = &scenario.aviary;
    let bounds = Cuboid { low: Vector3::new(-2.0, -2.0, 0.0), high: Vector3::new(2.0, 2.0, 3.0) };
    let ways = Ways::Same(Arc::new(DistanceField::new(&aviary.world, &aviary.goal, bounds, 0.06).coarse()));
    let looking = |term: &RewardTerm| matches!(term, RewardTerm::Avoidance(_) | RewardTerm::Cruise(_));
    scenario.rewards.retain(|term| !looking(term));
    scenario.rewards.push(Avoidance { weight: -2.0, reach_m: 1.0, ahead_secs: 0.3 }.into());
    scenario.rewards.push(Cruise { along_shortest_way: true, ways: Some(ways), ..CRUISE }.into());
    scenario
}

#[test]
fn who_flies_at_a_wall_is_told_to_slow_down() {
    let body = BodyLayout { scales: SCALES, action_len: 4, measured_len: 0 };
    let late = Scenario { airframe: CRAZYFLIE_2_1, ..testing::hover() };
    let mut scenario = beside_a_wall(&late, body);
    scenario.rewards = vec![Avoidance { weight: -2.0, reach_m: 1.0, ahead_secs: 0.0 }.into()];
    let gradient = StepGradient::new(&scenario).unwrap();
    let mut simulation: Simulation = Simulation::new(&scenario, Seed(5), 0, LANES);
    let mut records = [gradient.record()];
    let nothing = vec![0.0; scenario.action.len() * LANES];
    simulation.take_down(&gradient, &nothing, &mut records);
    simulation.step(&nothing);
    simulation.take_down_end(&gradient, &mut records);
    let (mut workspace, mut state) = (gradient.workspace(), gradient.no_adjoints());
    gradient.run(&records[0], &mut workspace);
    let seen = vec![[0.0; LANES]; scenario.observation.len()];
    gradient.pull_back(&mut workspace, &mut state, &seen).for_each(drop);
    // Of the swarm's columns the first six are the position and, behind four of the attitude, the velocity.
    let column = |wanted: usize| {
        let is_it = |carry: &&Carry| gradient.sources[carry.read as usize] == Source::Column(wanted);
        gradient.carries.iter().position(|carry| is_it(&carry)).map(|index| state[index])
    };
    let (by_x, by_speed) = (column(0).unwrap(), column(7).unwrap());
    let approaching: Vec<usize> = (0..LANES).filter(|lane| by_speed[*lane] < 0.0).collect();
    assert!(approaching.len() > LANES / 4, "{approaching:?}");
    assert!(approaching.iter().all(|lane| by_x[*lane] < 0.0), "nearer is worse");
}

/// What the only reward pays per second for a drone that flies so from there.
fn paid(scenario: &Scenario, place: [f32; 3], velocity: [f32; 3]) -> f32 {
    let mut simulation: Simulation = Simulation::new(scenario, Seed(5), 0, 1);
    let state = kestrel_core::vehicle::State {
        position: place.into(),
        world_from_body: kestrel_core::attitude::Attitude::level(),
        velocity: velocity.into(),
        body_rates: Vector3::zeros(),
        ..simulation.state(0)
    };
    simulation.put(0, state);
    simulation.step(&vec![0.0; scenario.action.len()]);
    simulation.terms(0)[0] * scenario.physics.control_rate_hz as f32
}

/// A task with a block before the goal.
fn with_block(low: [f64; 3], high: [f64; 3]) -> Scenario {
    let hover = testing::hover();
    let mut scenario = Scenario {
        physics: Physics { contacts: Contacts::Reported, ..hover.physics },
        terminations: Vec::new(),
        ..hover
    };
    scenario.aviary.goal = Vector3::new(2.0, 0.0, 1.0);
    scenario.aviary.world.solids.push(Solid::block("block", low.into(), high.into()));
    scenario
}

#[test]
fn who_flies_at_a_post_is_told_on_which_side_it_would_be_out_of_the_way() {
    let mut scenario = with_block([1.0, -0.1, 0.0], [1.2, 0.1, 3.0]);
    scenario.rewards = vec![Avoidance { weight: -1.0, reach_m: 0.3, ahead_secs: 0.3 }.into()];
    // In 0.3 s it is in the post, 2 cm from its left side and farther from all others.
    let found = paid(&scenario, [0.5, 0.08, 1.0], [2.0, 0.0, 0.0]);
    assert!((2.0..2.6).contains(&-found), "{found}");
    let clear = paid(&scenario, [0.5, 0.45, 1.0], [2.0, 0.0, 0.0]);
    assert!(clear > -1e-3, "{clear}");
}

#[test]
fn along_the_shortest_way_means_around_what_stands_before_the_goal() {
    let mut scenario = with_block([0.9, -2.0, 0.0], [1.0, 0.3, 3.0]);
    let bounds = Cuboid { low: Vector3::new(-2.0, -2.0, 0.0), high: Vector3::new(3.0, 2.0, 3.0) };
    let field = DistanceField::new(&scenario.aviary.world, &scenario.aviary.goal, bounds, 0.06).coarse();
    let place = [0.7, -0.5, 1.0];
    let leg = (field.ahead(place, 0.4) - Vector3::from(place)).normalize();
    assert!(leg.y > 0.5, "{leg}");
    let ways = Some(Ways::Same(Arc::new(field)));
    scenario.rewards = vec![Cruise { along_shortest_way: true, ways, ..CRUISE }.into()];
    let [along, against, straight] = [leg * 1.5, -leg * 1.5, Vector3::new(1.4, 0.5, 0.0)]
        .map(|velocity: Vector3<f32>| paid(&scenario, place, velocity.into()));
    assert!(along > -0.05 && against < -1.5 && straight < along - 0.1, "{along} {against} {straight}");
}

fn actions(scenario: &Scenario, rows: usize, stream: &mut Stream) -> Vec<f32> {
    (0..scenario.action.len() * rows).map(|_| stream.between(-0.9, 0.9)).collect()
}

#[test]
fn the_program_computes_the_bits_of_the_simulation() {
    for scenario in scenarios() {
        let gradient = StepGradient::new(&scenario).unwrap();
        // What instruments deliver is given, and not computed.
        let found = if let Some(Told::Way(way)) = scenario.sensors.told() { way.len() } else { 0 };
        let measured = scenario.sensors.tof().map_or(0, Tof::len) + found;
        let mut simulation: Simulation = Simulation::new(&scenario, Seed(3), 0, 2 * LANES);
        let (mut records, mut workspace) = (vec![gradient.record(); 2], gradient.workspace());
        let mut stream = Stream::new(Seed(4), 0, Purpose::Reset);
        for _ in 0..20 {
            let actions = actions(&scenario, simulation.rows(), &mut stream);
            simulation.take_down(&gradient, &actions, &mut records);
            simulation.step(&actions);
            simulation.take_down_end(&gradient, &mut records);
            for (block, record) in records.iter().enumerate() {
                gradient.run(record, &mut workspace);
                assert_same(&simulation, &gradient, (&workspace, measured), block);
            }
        }
        assert_eq!(gradient.silent_terms(), [0, 6], "being alive and failing have no derivative");
    }
}

/// That a block of the simulation has the rewards of a workspace and its observations, so many measured ones at their end aside,
/// but where an episode has ended.
fn assert_same(
    simulation: &Simulation,
    gradient: &StepGradient,
    (workspace, measured): (&Workspace, usize),
    block: usize,
) {
    let (rows, environments, len) = (simulation.rows(), simulation.environments(), simulation.observation_len());
    let seen: Vec<[f32; LANES]> = gradient.observations(workspace).copied().collect();
    let rewards: Vec<[f32; LANES]> = gradient.rewards(workspace).copied().collect();
    let agents = rows / environments;
    for (agent, lane) in (0..agents).flat_map(|agent| (0..LANES).map(move |lane| (agent, lane))) {
        let row = agent * environments + block * LANES + lane;
        if simulation.outcomes()[row] != crate::outcome::Outcome::Running {
            continue;
        }
        for (index, column) in seen[agent * len..(agent + 1) * len - measured].iter().enumerate() {
            assert_eq!(column[lane], simulation.observations()[index * rows + row]);
        }
        let terms = simulation.terms(row).into_iter().enumerate();
        let speaking = terms.filter(|(index, _)| !gradient.silent_terms().contains(index));
        let count = rewards.len() / agents;
        let found = rewards[agent * count..(agent + 1) * count].iter().map(|column| column[lane]);
        assert!(found.eq(speaking.map(|(_, value)| value)), "row {row}");
    }
}

/// Weighted sum of what a period computes.
fn objective(period: &Period<f64>, (silent, count): (&[usize], usize), weights: &[f64]) -> f64 {
    let terms = period.terms.iter().enumerate().filter(|(index, _)| !silent.contains(&(index % count)));
    let seen = period.observations.iter().chain(&period.after).zip(weights);
    terms.map(|(_, term)| *term).sum::<f64>() + seen.map(|(value, weight)| value * weight).sum::<f64>()
}

#[test]
fn derivatives_are_those_of_central_differences_in_double_precision() {
    for scenario in scenarios() {
        let gradient = StepGradient::new(&scenario).unwrap();
        let mut simulation: Simulation = Simulation::new(&scenario, Seed(5), 0, LANES);
        let mut stream = Stream::new(Seed(6), 0, Purpose::Reset);
        for _ in 0..7 {
            let actions = actions(&scenario, simulation.rows(), &mut stream);
            simulation.step(&actions);
        }
        let mut records = [gradient.record()];
        let rows = simulation.rows();
        let actions = actions(&scenario, rows, &mut stream);
        simulation.take_down(&gradient, &actions, &mut records);
        simulation.step(&actions);
        simulation.take_down_end(&gradient, &mut records);
        let mut workspace = gradient.workspace();
        gradient.run(&records[0], &mut workspace);
        compare(&scenario, &gradient, (&records[0], &mut workspace), &mut stream);
    }
}

fn compare(
    scenario: &Scenario,
    gradient: &StepGradient,
    (record, workspace): (&StepRecord, &mut Workspace),
    stream: &mut Stream,
) {
    let seen_len = scenario.agents.count as usize * scenario.observation.len();
    let observations: Vec<f32> = (0..seen_len).map(|_| stream.between(-1.0, 1.0)).collect();
    let carries: Vec<f32> = gradient.carries.iter().map(|_| stream.between(-1e-3, 1e-3)).collect();
    let mut state: Vec<[f32; LANES]> = carries.iter().map(|weight| [*weight; LANES]).collect();
    let seen: Vec<[f32; LANES]> = observations.iter().map(|weight| [*weight; LANES]).collect();
    let by_actions: Vec<[f32; LANES]> = gradient.pull_back(workspace, &mut state, &seen).collect();
    let column_of = |carry: &Carry| match gradient.sources[carry.read as usize] {
        Source::Column(column) => column,
        Source::LateColumn(_) | Source::Action(_) => usize::MAX,
    };
    for lane in [0, 17, 63] {
        let values = |index: usize| {
            let places = gradient.sources.iter().zip(&record.values);
            let is_here = |source: &Source| match *source {
                Source::Column(column) | Source::LateColumn(column) => column == index,
                Source::Action(action) => action + columns(scenario) == index,
            };
            places.filter(|(source, _)| is_here(source)).map(|(_, column)| f64::from(column[lane])).next()
        };
        let mut weights = vec![0.0; observations.len() + columns(scenario)];
        weights.iter_mut().zip(&observations).for_each(|(weight, value)| *weight = f64::from(*value));
        for (carry, weight) in gradient.carries.iter().zip(&carries) {
            weights[observations.len() + column_of(carry)] = f64::from(*weight);
        }
        let at = |moved: usize, by: f64| {
            let input = |index| values(index).unwrap_or(0.0) + if index == moved { by } else { 0.0 };
            objective(&Period::fly(scenario, input), (&gradient.silent, scenario.rewards.len()), &weights)
        };
        let carried = gradient.carries.iter().map(column_of).zip(&state);
        let acted = by_actions.iter().enumerate().map(|(action, column)| (columns(scenario) + action, column));
        for (input, column) in carried.chain(acted) {
            let step = 1e-6 * values(input).unwrap_or(0.0).abs().max(1.0);
            let expected = (at(input, step) - at(input, -step)) / (2.0 * step);
            let found = f64::from(column[lane]);
            let error = (found - expected).abs() / (expected.abs() + 1e-2);
            assert!(error < 1e-3, "{}, input {input}: {found}, {expected}", scenario.action.name());
        }
    }
}

fn columns(scenario: &Scenario) -> usize {
    Period::<f64>::fly(scenario, |_| 0.0).columns
}

#[test]
fn what_has_no_derivative_is_refused_by_name() {
    let scenario = testing::hover();
    let silent = Scenario { rewards: vec![crate::reward::Alive { weight: 1.0 }.into()], ..scenario.clone() };
    assert_eq!(
        StepGradient::new(&silent).unwrap_err().to_string(),
        "rewards without a derivative by the flight: alive"
    );
    let moving = Scenario { goals: Goals::Line([1.0, 0.0, 0.0].into()), ..scenario };
    assert_eq!(StepGradient::new(&moving).unwrap_err(), NotDifferentiable::MovingGoal);
}
