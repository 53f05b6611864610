//! `kestrel bench`: how fast each stage is on this machine, in one run, beside what limits it.

mod eye;
#[cfg(feature = "gpu")]
pub(crate) mod gpu;
mod seeing;

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::{Duration, Instant};

use kestrel_core::attitude::Attitude;
use kestrel_core::dynamics::Integrator;
use kestrel_core::policy_file::PolicyFile;
use kestrel_sim::camera::{Camera, Canvas, Image, Mover, Scene, View};
use kestrel_sim::scenario::{Physics, Scenario};
use kestrel_sim::seed::{Purpose, Seed, Stream};
use kestrel_sim::simulation::Simulation;
use kestrel_sim::swarm::{Swarm, advance_all};
use kestrel_sim::world::{Pose, Solid, World};
use nalgebra::Vector3;
use rayon::iter::{IntoParallelIterator, ParallelIterator};

pub(crate) use eye::eyes;
use kestrel_experiments::drone_environment::{DroneEnvironment, Trainer};
use kestrel_learn::actor_critic::Actor;
use kestrel_learn::analytic::{AnalyticSettings, AnalyticTrainer};
use kestrel_learn::ppo::PpoSettings;
use kestrel_learn::regulariser::{
    CoresetSettings, Coupling, Curvature, FunctionSpaceSettings, GradientTerm, Learning, QuadraticSettings,
    RegulariserSettings, Strength,
};
pub(crate) use seeing::{SEEING, seeing};

/// Each figure is the best of this many repetitions: on a shared machine the others measure the neighbours.
const REPETITIONS: usize = 5;

/// Random actions that repeat; an odd number, so that no drone sees a period of its own.
const NOISE_STEPS: usize = 101;

/// One line of the table.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Figure {
    /// What is counted.
    pub(crate) what: String,
    /// How often per second.
    pub(crate) per_second: f64,
    /// Where we want to be, for one core or both as `what` says.
    pub(crate) aim: f64,
    /// What keeps it from being faster.
    pub(crate) limit: &'static str,
}

/// Best rate of `work`, which returns how many items it did, over repetitions of at least `duration`.
fn best_rate(duration: Duration, mut work: impl FnMut() -> u64) -> f64 {
    let mut best = 0.0_f64;
    for _ in 0..REPETITIONS {
        let start = Instant::now();
        let mut items = 0;
        while start.elapsed() < duration {
            items += work();
        }
        best = best.max(items as f64 / start.elapsed().as_secs_f64());
    }
    best
}

/// Steps per second of the vehicle alone on one core, `LANES` drones side by side.
fn vehicle_rate<const LANES: usize>(scenario: &Scenario, integrator: Integrator, duration: Duration) -> f64 {
    let physics = Physics::clean(integrator, 1, 500.0);
    // 512 drones: 35 KB, within the second-level cache as a rollout's are.
    let mut swarms = vec![Swarm::<LANES>::new(&scenario.airframe); 512 / LANES];
    let targets = [[scenario.airframe.hover_rotor_speed() as f32; LANES]; 4];
    let rate = best_rate(duration, || {
        advance_all(&mut swarms, &physics, &targets, 20);
        512 * 20
    });
    // A diverged state would be fast and meaningless.
    assert!(swarms[0].state(0).position.z.is_finite(), "the benchmark's drones must stay in flight");
    rate
}

/// Lines for the vehicle.
pub(crate) fn vehicle(scenario: &Scenario, duration: Duration) -> Vec<Figure> {
    let line = |what: &str, per_second, aim, limit| Figure { what: what.to_owned(), per_second, aim, limit };
    let (euler, runge_kutta) = (Integrator::SemiImplicitEuler, Integrator::RungeKutta4);
    vec![
        line(
            "vehicle steps, Euler, one by one, 1 core",
            vehicle_rate::<1>(scenario, euler, duration),
            25e6,
            "the chain of dependent operations",
        ),
        line(
            "vehicle steps, Euler, in lanes, 1 core",
            vehicle_rate::<64>(scenario, euler, duration),
            500e6,
            "loads and stores of 17 states and 15 parameters per step",
        ),
        line(
            "vehicle steps, RK4, one by one, 1 core",
            vehicle_rate::<1>(scenario, runge_kutta, duration),
            10e6,
            "the chain of dependent operations",
        ),
        line(
            "vehicle steps, RK4, in lanes, 1 core",
            vehicle_rate::<64>(scenario, runge_kutta, duration),
            150e6,
            "650 flop per step, 51 live vectors in 32 registers or 16",
        ),
    ]
}

/// Environment steps per second on one core, with observation, reward and reset; episodes last to their time limit,
/// as a trained policy's do.
fn environment_rate(scenario: &Scenario, substeps: u32, duration: Duration) -> f64 {
    let mut scenario = Scenario { terminations: Vec::new(), ..scenario.clone() };
    scenario.physics.substeps = substeps;
    let mut simulation = Simulation::<64>::new(&scenario, Seed(0), 0, 256 / scenario.agents.count as usize);
    let actions = vec![0.0; scenario.action.len() * simulation.rows()];
    let rate = best_rate(duration, || {
        for _ in 0..100 {
            simulation.step(&actions);
        }
        simulation.take_episodes();
        100 * simulation.rows() as u64
    });
    black_box(simulation.rewards());
    rate
}

/// Lines for whole environments.
pub(crate) fn environment(scenario: &Scenario, duration: Duration) -> Vec<Figure> {
    let lines = [
        (1, 60e6, "memory traffic of observations and rewards, and resets"),
        (5, 20e6, "five substeps of the vehicle"),
    ];
    let figure = |(substeps, aim, limit)| Figure {
        what: format!("environment steps, {substeps} substep(s), 1 core"),
        per_second: environment_rate(scenario, substeps, duration),
        aim,
        limit,
    };
    lines.map(figure).into()
}

/// One step of Bullet's 240 Hz for one action.
const ONE_SUBSTEP: [&str; 2] = ["scenario.physics.substeps=1", "scenario.physics.control_rate_hz=240"];

/// An aviary whose steps are counted under the actions of an untrained policy, with everything that it ends and touches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Aviary {
    /// File in the folder of aviaries.
    pub(crate) file: &'static str,
    /// What is set otherwise than in the file.
    pub(crate) overrides: &'static [&'static str],
    what: &'static str,
    aim: f64,
    limit: &'static str,
}

/// The reference's tasks as published: Bullet's physics, 12-number observation, contacts that push.
pub(crate) const AVIARIES: [Aviary; 4] = [
    Aviary {
        file: "incremental-cross-0-as-published.yaml",
        overrides: &ONE_SUBSTEP,
        what: "paper steps, free room, 1 core",
        aim: 20e6,
        limit: "angles of the observation, lanes at walls fly one by one",
    },
    Aviary {
        file: "incremental-cross-6-as-published.yaml",
        overrides: &ONE_SUBSTEP,
        what: "paper steps, 9 pillars, 1 core",
        aim: 15e6,
        limit: "as above",
    },
    Aviary {
        file: "room-0-as-published.yaml",
        overrides: &[],
        what: "paper steps, room 0, 5 substeps, 1 core",
        aim: 8e6,
        limit: "five substeps, nearest points of the landing zone",
    },
    Aviary {
        file: "swarm.yaml",
        overrides: &[],
        what: "drone steps, 64 with downwash, 1 core",
        aim: 1e6,
        limit: "2,016 pairs of drones in each of five substeps",
    },
];

/// Tasks as users train them, with their own rules.
pub(crate) const TASKS: [Aviary; 4] = [
    Aviary {
        file: "../hover.yaml",
        overrides: &[],
        what: "hover, random, 1 core",
        aim: 59e6,
        limit: "resets, latency, the body's axes",
    },
    Aviary {
        file: "incremental-cross-6.yaml",
        overrides: &[],
        what: "incremental-cross-6, random, 1 core",
        aim: 20e6,
        limit: "the velocity controller, lanes near pillars one by one",
    },
    Aviary {
        file: "room-0.yaml",
        overrides: &[],
        what: "room-0, random, 1 core",
        aim: 10e6,
        limit: "lanes near furniture one by one, distances of the way",
    },
    Aviary {
        file: "land.yaml",
        overrides: &[],
        what: "land, random, 1 core",
        aim: 9.6e6,
        limit: "contacts that push, one lane at a time",
    },
];

/// Tasks whose worlds are drawn, beside the same in one of these.
pub(crate) const DRAWN: [Aviary; 2] = [
    Aviary {
        file: "unseen-rooms.yaml",
        overrides: &["scenario.aviary.drawn.worlds.count=64"],
        what: "furnished rooms by beams",
        aim: DRAWN_SHARE,
        limit: "searches for ways; aims at 0.7 of one room",
    },
    Aviary {
        file: "forest.yaml",
        overrides: &["scenario.aviary.drawn.worlds.count=64"],
        what: "forests by ranger",
        aim: DRAWN_SHARE,
        limit: "rays of the ranger; aims at 0.7 of one forest",
    },
];

/// Least share of the speed in one world that should be left where every episode draws another.
const DRAWN_SHARE: f64 = 0.7;

/// A world that cameras look at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sight {
    /// File of a task in the folder of aviaries.
    pub(crate) file: &'static str,
    what: &'static str,
    aim: f64,
    limit: &'static str,
}

/// Images of 64×48 pixels with colour, depth and labels.
pub(crate) const SIGHTS: [Sight; 3] = [
    Sight {
        file: "incremental-cross-6.yaml",
        what: "pillars",
        aim: 55e3,
        limit: "planes and roots per pixel, then a look-up and a division for each",
    },
    Sight { file: "stream/stream-00.yaml", what: "random room", aim: 40e3, limit: "as above" },
    Sight { file: "room-0.yaml", what: "room 0", aim: 20e3, limit: "as above" },
];

/// Views that are looked along in turn.
const VIEWS: usize = 64;

/// From all over a world and in all directions.
fn views(world: &World) -> Vec<View> {
    let bounds = world.solids.iter().map(Solid::extent);
    let (low, high) = bounds.reduce(|(a, b), (c, d)| (a.inf(&c), b.sup(&d))).unwrap_or_default();
    let mut stream = Stream::new(Seed(0), 0, Purpose::Baseline);
    let mut share = || f64::from(stream.between(0.1, 0.9));
    let view = |_| {
        let eye =
            Vector3::new(low.x + share() * (high.x - low.x), low.y + share() * (high.y - low.y), 0.2 + share());
        let (sine, cosine) = (TAU * share()).sin_cos();
        View::towards(eye, eye + Vector3::new(cosine, sine, 0.1 * (share() - 0.5)), Vector3::z())
    };
    (0..VIEWS).map(view).collect()
}

/// Images per second of one core.
pub(crate) fn sight(sight: &Sight, scenario: &Scenario, duration: Duration) -> Figure {
    let world = &scenario.aviary.world;
    let views = views(world);
    let (scene, mut canvas, mut image) = (Scene::new(world), Canvas::default(), Image::default());
    let per_second = best_rate(duration, || {
        for view in &views {
            scene.render_into(&Camera::REFERENCE, view, &mut canvas, &mut image);
            black_box(&image);
        }
        VIEWS as u64
    });
    let what = format!("images, {}, {} bodies, 1 core", sight.what, world.solids.len());
    Figure { what, per_second, aim: sight.aim, limit: sight.limit }
}

/// Drones of a scene that are placed in turn.
const PLACED: usize = 8;

/// Drones placed in a scene per second by one core: what an image of a team costs besides what is in view.
pub(crate) fn placing(scenario: &Scenario, duration: Duration) -> Figure {
    let mut scene = Scene::new(&scenario.aviary.world).with_drones(&scenario.airframe, PLACED);
    let mut turn = 0.0;
    let per_second = best_rate(duration, || {
        for drone in 0..PLACED {
            turn += 0.1;
            let world_from_body = Attitude::from_axis_angle(Vector3::z(), turn);
            scene.place(Mover::Drone(drone), &Pose { position: Vector3::new(turn, 0.0, 1.0), world_from_body });
        }
        black_box(&scene);
        PLACED as u64
    });
    let limit = "38 faces turned and lit, 72 corners, each drone";
    Figure { what: "drones placed in a scene, 1 core".to_owned(), per_second, aim: 500e3, limit }
}

/// Least share of the speed of training that what keeps an earlier task should leave.
const HELD_SHARE: f64 = 0.9;

/// What keeps an earlier task: three anchors and a coreset.
const MEMORIES: [(&str, RegulariserSettings); 4] = [
    ("diagonal anchor", anchor(Curvature::Fisher)),
    ("factored anchor", anchor(Curvature::Kronecker)),
    ("anchor in actions", RegulariserSettings::FunctionSpace(FunctionSpaceSettings { parts: 32, strength: 0.3 })),
    ("coreset", RegulariserSettings::Coreset(CoresetSettings { bytes: None, strength: 1.0 })),
];

const fn anchor(curvature: Curvature) -> RegulariserSettings {
    RegulariserSettings::Quadratic(QuadraticSettings {
        curvature,
        gradient: GradientTerm::Balance,
        coupling: Coupling::Gradient,
        strength: Strength::Fixed(0.1),
        decay: 1.0,
    })
}

/// Steps per second of one core in an aviary; each drone's step counts.
pub(crate) fn aviary(aviary: &Aviary, scenario: &Scenario, duration: Duration) -> Figure {
    let environments = if scenario.agents.count == 1 { 256 } else { 64 };
    let mut simulation = Simulation::<64>::new(scenario, Seed(0), 0, environments);
    let mut noise = Stream::new(Seed(0), 0, Purpose::Baseline);
    let len = scenario.action.len() * simulation.rows();
    let actions: Vec<Vec<f32>> =
        (0..NOISE_STEPS).map(|_| (0..len).map(|_| noise.between(-1.0, 1.0)).collect()).collect();
    let per_second = best_rate(duration, || {
        for actions in &actions {
            simulation.step(actions);
        }
        simulation.take_episodes();
        (NOISE_STEPS * simulation.rows()) as u64
    });
    black_box(simulation.rewards());
    Figure { what: aviary.what.to_owned(), per_second, aim: aviary.aim, limit: aviary.limit }
}

/// Steps per second of one core in one of a task's worlds, and where every episode draws another, which was made before.
pub(crate) fn drawn(task: &Aviary, scenario: &Scenario, duration: Duration) -> [Figure; 2] {
    (0..scenario.rooms()).into_par_iter().for_each(|room| scenario.prepare_room(room));
    let in_one = aviary(task, &scenario.in_room(0), duration);
    let in_many = aviary(task, scenario, duration);
    let figure = |which: &str, aim: f64, Figure { per_second, .. }| Figure {
        what: format!("{}, {which}", task.what),
        per_second,
        aim,
        limit: task.limit,
    };
    let alone = in_one.per_second;
    [figure("always one", alone, in_one), figure("one per episode", task.aim * alone, in_many)]
}

/// Environment steps per second of training, rollout and optimisation, on all cores, held by a memory of one task.
fn training_rate(
    scenario: &Scenario,
    settings: &PpoSettings,
    (epochs, memory): (u32, RegulariserSettings),
    duration: Duration,
) -> f64 {
    let settings = PpoSettings { epochs, target_kl: None, ..settings.clone() };
    let mut trainer = Trainer::new(std::slice::from_ref(scenario), &settings, Seed(0));
    trainer.update();
    let mut memory = memory.begin(Learning { actor: trainer.actor(), critic: trainer.critic() });
    trainer.consolidate(&mut memory);
    best_rate(duration, || {
        let before = trainer.steps();
        trainer.update_with(&mut memory);
        trainer.steps() - before
    })
}

/// Lines for PPO end to end, alone and with what keeps an earlier task.
pub(crate) fn training(scenario: &Scenario, settings: &PpoSettings, duration: Duration) -> Vec<Figure> {
    let rate = |epochs, memory| training_rate(scenario, settings, (epochs, memory), duration);
    let alone = |epochs, aim, limit| Figure {
        what: format!("PPO steps, {epochs} epoch(s), all cores"),
        per_second: rate(epochs, RegulariserSettings::None),
        aim,
        limit,
    };
    let mut figures = vec![
        alone(4, 600e3, "matrix products, then tanh, exp and Adam"),
        alone(1, 1.8e6, "matrix products, then tanh and the rollout"),
    ];
    let aim = HELD_SHARE * figures[0].per_second;
    figures.extend(MEMORIES.map(|(what, memory)| Figure {
        what: format!("PPO steps, 4 epochs, {what}"),
        per_second: rate(4, memory),
        aim,
        limit: "its pull in every minibatch; the aim is nine tenths of PPO alone",
    }));
    figures
}

/// Line for training by gradients through the physics, if the task has them.
pub(crate) fn gradients(scenario: &Scenario, settings: &AnalyticSettings, duration: Duration) -> Option<Figure> {
    let mut trainer =
        AnalyticTrainer::<DroneEnvironment>::new(std::slice::from_ref(scenario), settings, Seed(0)).ok()?;
    let rate = best_rate(duration, || {
        let before = trainer.steps();
        trainer.update();
        trainer.steps() - before
    });
    Some(Figure {
        what: "steps trained by gradients, all cores".into(),
        per_second: rate,
        aim: 3e6,
        limit: "values and derivatives between first and second cache, then matrix products",
    })
}

/// Lines for inference of `actor` and of its exports.
pub(crate) fn inference(actor: &Actor, exports: &[PolicyFile<'_>], duration: Duration) -> Vec<Figure> {
    let mut figures = vec![Figure {
        what: "policy inferences, batch of 256, 1 core".into(),
        per_second: batched_rate(actor, duration),
        aim: 5e6,
        limit: "matrix products and 128 hyperbolic tangents",
    }];
    figures.extend(exports.iter().map(|policy| Figure {
        what: format!("policy inferences, {}, alone, 1 core", policy.arithmetic().name()),
        per_second: lone_rate(policy, duration),
        aim: 500e3,
        limit: "written for a microcontroller: one row block at a time",
    }));
    figures
}

fn batched_rate(actor: &Actor, duration: Duration) -> f64 {
    let observations = vec![0.1; actor.mlp().inputs() * 256];
    let mut actions = vec![0.0; actor.action_len() * 256];
    best_rate(duration, || {
        actor.act_mean(kestrel_learn::network::InputBatch::without_images(black_box(&observations)), &mut actions);
        black_box(&actions);
        256
    })
}

fn lone_rate(policy: &PolicyFile<'_>, duration: Duration) -> f64 {
    let observation = vec![0.1; policy.metadata().observation.len()];
    let mut scratch = policy.scratch();
    best_rate(duration, || {
        for _ in 0..256 {
            black_box(policy.act(black_box(&observation), &mut scratch));
        }
        256
    })
}
