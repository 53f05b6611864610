//! Trained actors and their exports fly alike.

use kestrel_core::action::{
    ActionSpace, Persistence, ReferenceActionKind, ReferenceActions, ReferenceController, RotorSpeeds,
};
use kestrel_core::airframe::CF2X;
use kestrel_core::observation::{
    KinematicLayout, ObservationLayout, PilotForLayout, PilotLayout, ReferenceLayout,
};
use kestrel_core::policy_file::PolicyMetadata;
use kestrel_core::reference::controller::command::Precision;
use kestrel_export::seeing::{SeeingActor, SeeingCalibration, export_seeing};
use kestrel_export::{DenseLayer, export};
use kestrel_learn::ppo::{EncoderKind, EncoderSettings, EncoderSharing, MemorySettings, PpoSettings};
use kestrel_learn::rollout::ENV_BATCH;
use kestrel_sim::camera::{Camera, Channel, Mount, OnboardCamera, Optics};
use kestrel_sim::scenario::{Agents, Goals, StartPosition, TeamEnd, TeamRewards, TeamSuccess};
use kestrel_sim::seed::Stream;
use kestrel_sim::world::{Floor, Solid};
use nalgebra::Vector3;

use super::*;
use crate::drone_environment::Trainer;
use crate::experiment_config::load;
use crate::golden::in_repository;

const SCALES: PilotLayout = PilotLayout { position_scale_m: 1.0, velocity_scale: 2.0, body_rates_scale: 10.0 };

/// Hover, and a training of it that takes no time.
fn hover() -> (Scenario, PpoSettings) {
    let experiment = load(&in_repository("configs/hover.yaml"), &[]).expect("it is shipped");
    let settings = PpoSettings {
        environments: 256,
        steps_per_rollout: 12,
        minibatch: 256,
        actor_hidden: vec![16, 16],
        critic_hidden: vec![16],
        ..experiment.training.ppo
    };
    let start = StartPosition::AroundGoal { nearest_m: 0.0, farthest_m: 0.3 };
    let mut scenario = Scenario { episode_secs: 0.4, ..experiment.scenario };
    (scenario.start.position, scenario.start.tilt_limit) = (start, 0.3);
    scenario.observation = ObservationLayout::Pilot(SCALES);
    (scenario, settings)
}

fn starts(episodes: usize) -> Starts {
    Starts { seed: Seed(4), purpose: Purpose::Evaluation, episodes }
}

fn metadata<'a>(name: &'a str, scenario: &Scenario) -> PolicyMetadata<'a> {
    PolicyMetadata {
        name,
        observation: scenario.observation,
        action: scenario.action,
        control_period_secs: scenario.physics.control_secs(),
        seed: 3,
        training_steps: 0,
        airframe: None,
    }
}

#[test]
fn actions_and_observations_of_any_length_train_export_and_fly() {
    let (hover, settings) = hover();
    let cases = [
        (
            ReferenceActionKind::OneDRpm,
            ObservationLayout::PilotFor(PilotForLayout { scales: SCALES, action_len: 1 }),
        ),
        (
            ReferenceActionKind::Pid,
            ObservationLayout::Kinematic(KinematicLayout { past_actions: 15, action_len: 3 }),
        ),
        (ReferenceActionKind::Rpm, ObservationLayout::Reference(ReferenceLayout::of_episode(5.0))),
        (ReferenceActionKind::Tun, ObservationLayout::PilotFor(PilotForLayout { scales: SCALES, action_len: 6 })),
    ];
    for (kind, observation) in cases {
        let action = ActionSpace::Reference(ReferenceActions {
            kind,
            precision: Precision::Exact,
            airframe: CF2X,
            controller: ReferenceController::Dsl(CF2X),
            persistence: Persistence::ResetEachEpisode,
        });
        let scenario = Scenario { action, observation, ..hover.clone() };
        let mut trainer = Trainer::new(std::slice::from_ref(&scenario), &settings, Seed(3));
        assert_eq!(trainer.actor().log_std().len(), kind.len());
        let metrics = trainer.update();
        assert!(metrics.approx_kl.is_finite() && metrics.policy_loss.is_finite(), "{metrics:?}");
        assert!(trainer.actor().log_std().iter().all(|log_std| *log_std != settings.initial_log_std));
        let layers: Vec<DenseLayer<'_>> = trainer.actor().layers().into_iter().map(DenseLayer::from).collect();
        let calibration = sightings_in_flight(&scenario, trainer.actor(), starts(8));
        let exported = export(&layers, &metadata(kind.name(), &scenario), &calibration.observations);
        let file = exported.expect("it fits").float_policy;
        let policy = Policy::parse(&file).expect("it was written");
        let [trained, flown] = [Flyer::Actor(trainer.actor()), Flyer::Policy(&policy)]
            .map(|flyer| evaluate(&scenario, flyer, starts(8)).episode_return);
        assert!((trained - flown).abs() < 1e-3 * trained.abs().max(1.0), "{trained}, exported {flown}");
    }
}

#[test]
fn a_policy_of_several_drones_is_exported_from_what_all_of_them_see() {
    let (hover, settings) = hover();
    let goal = |drone: u32| Vector3::new(2.0 * f64::from(drone), 0.0, 1.0);
    let team = Agents { count: 2, ends: TeamEnd::Alone, rewards: TeamRewards::Shared, success: TeamSuccess::Own };
    let scenario = Scenario { agents: team, goals: Goals::PerAgent((0..2).map(goal).collect()), ..hover.clone() };
    let trainer = Trainer::new(std::slice::from_ref(&scenario), &settings, Seed(5));
    let seen = sightings_in_flight(&scenario, trainer.actor(), starts(3)).observations;
    let flights = scenario.episode_steps().div_ceil(8) as usize;
    assert_eq!(seen.len(), flights * 6 * 22);
    // All begin within 0.3 m of the goal of their own.
    for observation in seen.chunks_exact(22).take(6) {
        assert!(observation[..3].iter().map(|value| value * value).sum::<f32>() < 0.09 + 1e-5, "{observation:?}");
    }
}

/// The hover task beside two pillars, with a small camera.
fn with_camera(mut scenario: Scenario) -> Scenario {
    let block =
        |name: &str, y: f64| Solid::block(name, Vector3::new(0.8, y, 0.0), Vector3::new(1.0, y + 0.2, 1.5));
    scenario.aviary.world.solids = vec![block("left", 0.2), block("right", -0.5)];
    scenario.aviary.world.floor = Floor::Solid;
    scenario.action = ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 0.3));
    scenario.camera = Some(OnboardCamera {
        camera: Camera { columns: 12, rows: 10, sample: [0.5; 2], ..Camera::REFERENCE },
        mount: Mount::Body { position: Vector3::zeros(), pitch: 0.0 },
        channels: vec![Channel::Rgb, Channel::Depth { limit_m: 4.0 }],
        frames: 1,
        images_per_frame: 1,
        control_periods_per_image: 2,
        optics: Optics {
            noise: 4.0,
            exposure: 0.2,
            shutter_secs: 0.01,
            latency_periods: 1,
            focal: 0.03,
            turn: 0.02,
        },
    });
    scenario
}

/// An actor whose actions depend much on what it sees; one that remembers has no trunk.
fn attentive(scenario: &Scenario, settings: PpoSettings) -> Actor {
    let trunk = if settings.memory.is_some() { Vec::new() } else { vec![16] };
    let encoder = EncoderSettings { kind: EncoderKind::Small, sharing: EncoderSharing::Shared, trunk };
    let trainer = Trainer::new(std::slice::from_ref(scenario), &PpoSettings { encoder, ..settings }, Seed(23));
    let mut actor = trainer.actor().clone();
    let mut stream = Stream::new(Seed(24), 0, Purpose::Weights);
    let network = actor.log_std_places().start;
    actor.parameters_mut()[..network].iter_mut().for_each(|value| *value += 0.1 * stream.normal());
    actor
}

#[test]
fn an_exported_policy_flies_as_the_actor_does_and_by_what_it_sees() {
    let (_, settings) = hover();
    flies_as_the_actor_does(settings);
}

#[test]
fn an_exported_policy_remembers_what_it_saw_and_forgets_it_with_the_episode() {
    let (_, settings) = hover();
    let memory = Some(MemorySettings { units: 16, steps_per_window: 16 });
    flies_as_the_actor_does(PpoSettings { memory, minibatch: 16 * ENV_BATCH, steps_per_rollout: 16, ..settings });
}

fn flies_as_the_actor_does(settings: PpoSettings) {
    let (hover, _) = hover();
    let scenario = with_camera(hover);
    let actor = attentive(&scenario, settings);
    let met = sightings_in_flight(&scenario, &actor, starts(6));
    assert_eq!(met.observations.len() / 22, met.images.len() / (12 * 10 * 4));
    let layers: Vec<DenseLayer<'_>> = actor.layers().into_iter().map(DenseLayer::from).collect();
    let encoder = actor.encoder().expect("it sees");
    let seeing_actor = SeeingActor {
        shape: *encoder.cnn().shape(),
        encoder_parameters: encoder.cnn_parameters(actor.front_parameters()),
        memory: actor.memory().map(|memory| memory.layers(actor.memory_parameters()).map(DenseLayer::from)),
        layers: &layers,
        control_periods_per_image: 2,
    };
    let calibration = SeeingCalibration { observations: &met.observations, images: &met.images };
    let exported = export_seeing(&seeing_actor, &metadata("seeing", &scenario), calibration).expect("it fits");
    let policies = [&exported.float_policy, &exported.fixed_policy].map(|file| Policy::parse(file).unwrap());
    assert_eq!(policies[0].differing(&scenario), None);
    assert_eq!(policies[0].differing(&Scenario { camera: None, ..scenario.clone() }).as_deref(), Some("camera"));
    let flown = |flyer| evaluate(&scenario, flyer, starts(6)).episode_return;
    let trained = flown(Flyer::Actor(&actor));
    let errors = [&policies[0], &policies[1]].map(|policy| (flown(Flyer::Policy(policy)) - trained).abs());
    let mut blindfolded = actor.clone();
    let eye = blindfolded.log_std_places().end;
    let eye = eye..eye + encoder.parameter_count();
    blindfolded.parameters_mut()[eye].fill(0.0);
    let sight = (flown(Flyer::Actor(&blindfolded)) - trained).abs();
    assert!(sight > 0.005, "the return {trained} changes by {sight} without eyes");
    assert!(errors[0] < 0.01 * sight && errors[1] < 0.2 * sight, "{errors:?} beside the {sight} of seeing");
}

#[test]
fn the_scripted_pilot_touches_tables_as_softly_as_their_rooms_ask() {
    for room in ["room-0", "room-1", "room-2"] {
        let experiment = load(&in_repository(&format!("configs/aviaries/{room}.yaml")), &[]).unwrap();
        let flights = evaluate(&experiment.evaluation.scenario, Flyer::Scripted, starts(64));
        assert!(flights.success_rate > 0.75, "{room}: {flights:?}");
    }
}

#[test]
fn the_scripted_pilot_finds_its_way_where_no_route_is_written_down() {
    let experiment = load(&in_repository("configs/examples/two-gates.yaml"), &[]).unwrap();
    let flights = evaluate(&experiment.evaluation.scenario, Flyer::Scripted, starts(64));
    assert!(flights.success_rate > 0.75, "{flights:?}");
}

#[test]
fn what_flights_collide_with_is_named() {
    let experiment = load(&in_repository("configs/aviaries/room-0.yaml"), &[]).unwrap();
    let scenario = &experiment.evaluation.scenario;
    let flown = evaluate(scenario, Flyer::Random, starts(64));
    let collisions =
        flown.endings.iter().find(|(ending, _)| *ending == Ending::Collision).map_or(0, |(_, count)| *count);
    assert!(collisions > 16, "{flown:?}");
    assert_eq!(flown.hits.iter().map(|(_, count)| count).sum::<usize>(), collisions);
    assert!(flown.hits.is_sorted_by_key(|(_, count)| Reverse(*count)), "{:?}", flown.hits);
    let stands_there = |name: &str| scenario.aviary.world.solids.iter().any(|solid| solid.name.starts_with(name));
    assert!(flown.hits.iter().all(|(name, _)| name == "the floor" || stands_there(name)), "{:?}", flown.hits);
    // A ceiling just above the starts is all that can be met on the way up.
    let mut under_a_ceiling = scenario.clone();
    let (low, high) = (Vector3::new(-1.0, -1.5, 0.75), Vector3::new(7.0, 1.5, 0.8));
    under_a_ceiling.aviary.world.solids = vec![Solid::block("ceiling: board", low, high)];
    under_a_ceiling.aviary.world.floor = Floor::Absent;
    let flown = evaluate(&under_a_ceiling, Flyer::Random, starts(64));
    assert!(matches!(&flown.hits[..], [(name, count)] if name == "ceiling" && *count > 4), "{:?}", flown.hits);
}

#[test]
fn checkpoints_hold_evaluations_without_what_was_hit() {
    let (scenario, _) = hover();
    let flown = Evaluation { hits: Vec::new(), ..evaluate(&scenario, Flyer::Nothing, starts(8)) };
    let hit = Evaluation { hits: vec![("wall".to_owned(), 3)], ..flown.clone() };
    let bytes = postcard::to_allocvec(&hit).unwrap();
    assert_eq!(bytes, postcard::to_allocvec(&flown).unwrap());
    assert_eq!(postcard::from_bytes::<Evaluation>(&bytes).unwrap(), flown);
    // What follows an evaluation is still found behind it.
    let pair = postcard::to_allocvec(&(&hit, 7_u32)).unwrap();
    assert_eq!(postcard::from_bytes::<(Evaluation, u32)>(&pair).unwrap(), (flown, 7));
    assert_eq!(serde_json::from_str::<Evaluation>(&serde_json::to_string(&hit).unwrap()).unwrap(), hit);
}
