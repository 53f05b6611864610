use std::slice;

use super::*;
use crate::experiment_config::{Experiment, load};
use crate::golden::in_repository;
use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_core::airframe::CF2X;
use kestrel_core::dynamics::Integrator;
use kestrel_core::observation::{ObservationLayout, PilotLayout};
use kestrel_core::planner::NodeGrid;
use kestrel_learn::analytic::{AnalyticSettings, AnalyticTrainer};
use kestrel_learn::ppo::{PpoSettings, UpdateMetrics};
use kestrel_learn::rollout::ENV_BATCH;
use kestrel_learn::schedule::Schedule;
use kestrel_sim::contact::DistanceField;
use kestrel_sim::estimate::EstimateErrors;
use kestrel_sim::latency::Latency;
use kestrel_sim::reward;
use kestrel_sim::rooms::Ways;
use kestrel_sim::scenario::{
    Agents, Aviary, Clock, Goals, Physics, Randomisation, Start, StartPosition, Success, TimeLimit,
};
use kestrel_sim::sensor::{Scan, ScanRing, SensorSuite, Told, Way};
use kestrel_sim::termination::{self, Termination};
use kestrel_sim::world::{Cuboid, Solid};
use nalgebra::Vector3;

fn scenario(critic: CriticView) -> Scenario {
    Scenario {
        name: "hover".into(),
        aviary: Aviary::empty(Vector3::new(0.0, 0.0, 1.0)),
        drawn: None,
        airframe: CF2X,
        physics: Physics::clean(Integrator::SemiImplicitEuler, 1, 50.0),
        goals: Goals::Fixed,
        agents: Agents::ONE,
        sensors: SensorSuite::none(),
        clock: Clock::Elapsed,
        time_limit: TimeLimit::Truncates,
        action: ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 0.3)),
        gyro_cutoff_hz: 80.0,
        observation: ObservationLayout::Pilot(PilotLayout {
            position_scale_m: 1.0,
            velocity_scale: 2.0,
            body_rates_scale: 10.0,
        }),
        camera: None,
        critic,
        start: Start {
            position: StartPosition::AroundGoal { nearest_m: 0.0, farthest_m: 0.3 },
            heading_limit: core::f32::consts::PI,
            tilt_limit: 0.3,
            speed_limit: 0.3,
            body_rates_limit: 1.0,
        },
        latency: Latency::NONE,
        estimate: EstimateErrors::NONE,
        randomisation: Randomisation {
            mass: 0.1,
            inertia: 0.1,
            thrust: 0.1,
            rotor_lag: [0.9, 1.1],
            wind_speed: 0.1,
            ..Randomisation::NONE
        },
        rewards: vec![reward::Alive { weight: 1.0 }.into(), reward::Distance { weight: -1.0 }.into()],
        terminations: vec![Termination::Collision, termination::Tilt { limit_deg: 1.0_f64.to_degrees() }.into()],
        // Short, so that a rollout sees truncations too.
        episode_secs: 0.4,
        success: Success::Settle { radius_m: 0.3, within_secs: 0.2 },
    }
}

fn settings() -> PpoSettings {
    PpoSettings {
        environments: 3 * ENV_BATCH,
        steps_per_rollout: 12,
        epochs: 2,
        minibatch: 5 * ENV_BATCH,
        discount: 0.98,
        learning_rate: Schedule::KlAdaptive { initial: 1e-3, target: 0.01, low: 1e-4, high: 1e-2 },
        actor_hidden: vec![16, 16],
        critic_hidden: vec![16],
        ..PpoSettings::default()
    }
}

fn on_threads(threads: usize, updates: u32, critic: CriticView) -> TrainerState {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
    pool.install(|| {
        let mut trainer = Trainer::new(&[scenario(critic)], &settings(), Seed(5));
        for _ in 0..updates {
            trainer.update();
        }
        trainer.save()
    })
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let reference = on_threads(1, 3, CriticView::Privileged);
    assert_eq!(reference, on_threads(2, 3, CriticView::Privileged));
    assert_eq!(reference, on_threads(7, 3, CriticView::Privileged));
}

#[test]
fn a_resumed_run_comes_to_the_same_bits() {
    let (scenario, settings) = (scenario(CriticView::Observation), settings());
    let mut straight = Trainer::new(std::slice::from_ref(&scenario), &settings, Seed(6));
    (0..2).for_each(|_| drop(straight.update()));
    let bytes = postcard::to_allocvec(&straight.save()).expect("a state serialises");
    let state = postcard::from_bytes(&bytes).expect("and back");
    let mut resumed = Trainer::restore(&[scenario], &settings, state).expect("it is the same run");
    assert_eq!(resumed.updates(), 2);
    for _ in 0..2 {
        let (expected, found) = (straight.update(), resumed.update());
        let timeless = |metrics: UpdateMetrics| UpdateMetrics { rollout_secs: 0.0, update_secs: 0.0, ..metrics };
        assert_eq!(timeless(found), timeless(expected));
    }
    assert_eq!(resumed.save(), straight.save());
}

#[test]
fn a_policy_learns_to_stay_up() {
    let settings = PpoSettings {
        environments: 2 * ENV_BATCH,
        steps_per_rollout: 16,
        minibatch: 8 * ENV_BATCH,
        epochs: 4,
        learning_rate: Schedule::Constant(2e-3),
        entropy_weight: 0.0,
        ..settings()
    };
    let scenario = Scenario { episode_secs: 2.0, ..scenario(CriticView::Observation) };
    let mut trainer = Trainer::new(&[scenario], &settings, Seed(11));
    let lengths: Vec<f32> = (0..60).filter_map(|_| trainer.update().episode_length).collect();
    let mean = |lengths: &[f32]| lengths.iter().sum::<f32>() / lengths.len() as f32;
    let (before, after) = (mean(&lengths[..10]), mean(&lengths[lengths.len() - 10..]));
    assert!(after > 1.5 * before, "episodes lasted {before} steps, then {after}");
}

/// [`scenario`] with the map of its free ways.
fn mapped() -> Scenario {
    let free = scenario(CriticView::Observation);
    let bounds = Cuboid { low: Vector3::new(-1.0, -1.0, 0.0), high: Vector3::new(1.0, 1.0, 2.0) };
    let ways = std::sync::Arc::new(DistanceField::new(
        &free.aviary.world,
        &free.aviary.goal,
        bounds,
        CF2X.collision_radius,
    ));
    let advance = reward::GeodesicProgress::new(1.0, Ways::Same(ways)).into();
    Scenario { rewards: [free.rewards, vec![advance]].concat(), ..free }
}

#[test]
fn a_teacher_says_what_it_would_do_in_the_state_of_each_row() {
    let mut environment = DroneEnvironment::begin(&mapped(), Seed(31), 0, 8);
    let mut actions = vec![0.0; 4 * 5];
    environment.write_teacher_actions(2..7, &mut actions);
    let teacher = Teacher::of(&mapped()).expect("it has a map");
    for (column, row) in (2..7).enumerate() {
        let said: Vec<f32> = actions.chunks_exact(5).map(|values| values[column]).collect();
        assert_eq!(
            said,
            teacher.act(&environment.simulation.state(row), &environment.simulation.goal(row), 0, None)[..4]
        );
    }
    assert!(DroneEnvironment::has_teacher(&mapped()));
    assert!(!DroneEnvironment::has_teacher(&scenario(CriticView::Observation)));
}

#[test]
fn a_teacher_leads_along_the_way_that_a_drone_has_found() {
    let scan =
        Scan { rings: vec![ScanRing { elevation: 0.0, beams: 4 }], limit: 2.0, near_scale: None, sweeps: false };
    let grid = NodeGrid::new([-1.0, -1.0, 0.0], [1.0, 1.0, 2.0], 0.25).unwrap();
    let way = Way {
        grid,
        periods: 5,
        lookahead_m: 0.3,
        nearness_cost: 12.0,
        mapped_within_m: 100.0,
        unseen_cost: 1.0,
        shows_nearest: false,
    };
    let sensors = SensorSuite::none().with_scan(Some(scan)).with_told(Some(Told::Way(way)));
    let mut task = Scenario { sensors, ..mapped() };
    // The map of its teacher does not have what the beams meet, farther from the goal than what counts as the goal.
    let wall = Solid::block("wall", Vector3::new(0.55, -1.0, 0.0), Vector3::new(0.6, 0.5, 2.0));
    task.aviary.world.solids.push(wall);
    task.start.position = StartPosition::AroundGoal { nearest_m: 0.8, farthest_m: 0.9 };
    let mut environment = DroneEnvironment::begin(&task, Seed(31), 0, 16);
    let mut differ = 0;
    for row in 0..16 {
        let mut actions = vec![0.0; 4];
        environment.write_teacher_actions(row..row + 1, &mut actions);
        let simulation = &environment.simulation;
        let said =
            |found| Teacher::of(&task).unwrap().act(&simulation.state(row), &simulation.goal(row), 0, found);
        assert_eq!(actions, said(simulation.ahead(row))[..4], "row {row}");
        differ += usize::from(actions != said(None)[..4]);
    }
    assert!(differ > 0, "elsewhere than the map of its teacher says");
}

#[test]
fn gradients_through_the_flight_teach_within_a_few_windows_whatever_the_threads() {
    let settings = AnalyticSettings { environments: 128, steps_per_window: 16, ..AnalyticSettings::default() };
    let rewards = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let task = scenario(CriticView::Privileged);
            let mut trainer =
                AnalyticTrainer::<DroneEnvironment>::new(slice::from_ref(&task), &settings, Seed(1)).unwrap();
            (0..60).map(|_| -trainer.update().policy_loss).collect::<Vec<f32>>()
        })
    };
    let found = rewards(1);
    assert_eq!(rewards(2), found);
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    let (first, last) = (mean(&found[..5]), mean(&found[55..]));
    assert!(last > first, "{first} {last}");
}

#[test]
fn gradients_come_from_every_task() {
    let settings = AnalyticSettings { environments: 128, steps_per_window: 16, ..AnalyticSettings::default() };
    let single = scenario(CriticView::Privileged);
    let double = Scenario { rewards: [single.rewards.clone(), single.rewards.clone()].concat(), ..single.clone() };
    let loss = |tasks: [&Scenario; 2]| {
        let tasks = tasks.map(Scenario::clone);
        AnalyticTrainer::<DroneEnvironment>::new(&tasks, &settings, Seed(1)).unwrap().update().policy_loss
    };
    let (first, second, both) = (loss([&single, &double]), loss([&double, &single]), loss([&single, &single]));
    assert!(first != both && second != both && first != second, "{first} {second} {both}");
    assert!((first + second - 3.0 * both).abs() < 1e-3 * both.abs(), "{first} {second} {both}");
}

/// Losses of the updates of a task of drawn worlds, after having checked that neither threads nor a pause change them.
fn learned(task: &str, updates: u32) -> Vec<f32> {
    let overrides = ["scenario.aviary.drawn.worlds.count=3".to_owned()];
    let path = in_repository(&format!("configs/aviaries/{task}.yaml"));
    let task = load(&path, &overrides).unwrap().scenario;
    let settings = AnalyticSettings {
        environments: 128,
        steps_per_window: 20,
        memory_units: 8,
        actor_hidden: vec![16],
        ..AnalyticSettings::default()
    };
    let begin = || AnalyticTrainer::<DroneEnvironment>::new(slice::from_ref(&task), &settings, Seed(1)).unwrap();
    let learn = |threads: usize, updates: u32, mut trainer: AnalyticTrainer<DroneEnvironment>| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let losses: Vec<f32> = pool.install(|| (0..updates).map(|_| trainer.update().policy_loss).collect());
        (losses, trainer)
    };
    let (losses, whole) = learn(1, updates, begin());
    let (first, half) = learn(2, updates / 2, begin());
    let resumed = AnalyticTrainer::restore(slice::from_ref(&task), &settings, half.save()).unwrap();
    let (second, resumed) = learn(2, updates / 2, resumed);
    assert_eq!([first, second].concat(), losses);
    assert_eq!(resumed.actor(), whole.actor());
    losses
}

#[test]
fn a_forest_is_learned_to_the_same_bits_whatever_the_threads_and_after_a_pause() {
    let losses = learned("forest", 24);
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    assert!(mean(&losses[18..]) < mean(&losses[..6]), "{losses:?}");
}

#[test]
fn so_are_rooms_through_which_drones_look_for_their_ways() {
    let losses = learned("unseen-rooms-tof", 6);
    assert!(losses.iter().all(|loss| loss.is_finite()), "{losses:?}");
}

#[test]
fn so_is_a_forest_with_people_and_one_that_a_team_crosses() {
    for task in ["forest-people", "forest-team"] {
        let losses = learned(task, 6);
        assert!(losses.iter().all(|loss| loss.is_finite()), "{task}: {losses:?}");
    }
}

#[test]
fn so_are_rooms_that_a_camera_sees_and_a_memory_keeps() {
    let overrides = ["scenario.aviary.drawn.worlds.count=3", "training.memory={units: 8, steps_per_window: 8}"];
    let path = in_repository("configs/aviaries/unseen-rooms-camera.yaml");
    let Experiment { scenario: task, training, .. } = load(&path, &overrides.map(str::to_owned)).unwrap();
    let settings = PpoSettings {
        environments: ENV_BATCH,
        steps_per_rollout: 16,
        minibatch: 8 * 32,
        actor_hidden: vec![16],
        critic_hidden: vec![16],
        ..training.ppo
    };
    let tasks = slice::from_ref(&task);
    let learn = |threads: usize, updates: u32, mut trainer: Trainer| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let learned =
            pool.install(|| (0..updates).map(|_| trainer.update()).map(|update| update.policy_loss).collect());
        let losses: Vec<f32> = learned;
        (losses, trainer)
    };
    let (losses, whole) = learn(1, 4, Trainer::new(tasks, &settings, Seed(1)));
    let (first, half) = learn(2, 2, Trainer::new(tasks, &settings, Seed(1)));
    let resumed = Trainer::restore(tasks, &settings, half.save()).unwrap();
    let (second, resumed) = learn(2, 2, resumed);
    assert_eq!([first, second].concat(), losses);
    assert_eq!(resumed.actor(), whole.actor());
    // Its teacher turns the nose, so that the camera sees where it flies.
    assert!(losses.iter().all(|loss| loss.is_finite()) && whole.actor().units() == 8, "{losses:?}");
    let teacher = Teacher::of(&task).unwrap();
    let simulation = Simulation::<8>::new(&task, Seed(3), 0, 40);
    let turns = (0..40).filter(|row| {
        let (state, goal) = (simulation.state(*row), simulation.goal(*row));
        teacher.act(&state, &goal, simulation.room(*row), None)[3].abs() > 0.1
    });
    assert!(turns.count() > 20);
}

#[test]
fn what_an_agent_did_is_found_where_columns_lie_feature_by_feature() {
    // Two agents with three features: [f0 a0, f0 a1, f1 a0, …] is [a0 f0, a0 f1, a0 f2, a1 f0, …].
    let places: Vec<usize> = (0..6).map(|index| derivatives::by_agent(index, 6, 2)).collect();
    assert_eq!(places, [0, 3, 1, 4, 2, 5]);
}
