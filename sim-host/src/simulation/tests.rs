//! The façade as a whole: determinism, resets, outcomes.

mod carried;
mod determinism;
mod estimate;
mod imaging;
mod navigation;
mod racing;
mod team;

use kestrel_core::action::{ACTION_LEN, ActionSpace};

use super::*;
use crate::config::Document;
use crate::scenario::{Preset, StartPosition, Success};
use crate::termination;
use crate::testing::hover;
use crate::world::{Cuboid, Floor, Solid};
use nalgebra::Vector3;
use proptest::prelude::*;

/// The scenario of a YAML text.
fn scenario(yaml: &str) -> Scenario {
    let document = Document::parse("trial.yaml", yaml).unwrap();
    Scenario::of("trial", &document).unwrap()
}

fn noise(step: usize, count: usize) -> Vec<f32> {
    let mut stream = Stream::new(Seed(99), step as u32, Purpose::Actions);
    (0..count).map(|_| stream.between(-1.2, 1.2)).collect()
}

/// Observations, rewards and episodes of `steps` steps of noise, environment by environment.
fn fly<const LANES: usize>(parts: &[(u32, usize)], steps: usize) -> (Vec<Vec<u32>>, Vec<Episode>)
where
    Simulation<LANES>: Compiled<f32>,
{
    let total: usize = parts.iter().map(|(_, count)| count).sum();
    let mut traces = vec![Vec::new(); total];
    let mut episodes = Vec::new();
    for &(first, count) in parts {
        let mut simulation = Simulation::<LANES>::new(&hover(), Seed(5), first, count);
        for step in 0..steps {
            let all = noise(step, ACTION_LEN * total);
            let from = first as usize;
            let actions: Vec<f32> =
                all.chunks_exact(total).flat_map(|column| column[from..from + count].to_vec()).collect();
            simulation.step(&actions);
            for environment in 0..count {
                let trace = &mut traces[from + environment];
                trace.push(simulation.rewards()[environment].to_bits());
                let values = simulation.observations().chunks_exact(count);
                trace.extend(values.map(|column| column[environment].to_bits()));
            }
        }
        episodes.extend(simulation.take_episodes());
    }
    episodes.sort_by_key(|episode| episode.environment);
    (traces, episodes)
}

#[test]
fn bits_do_not_depend_on_lanes_or_on_how_environments_are_divided() {
    let reference = fly::<64>(&[(0, 40)], 150);
    assert!(reference.1.len() >= 40);
    assert!(reference == fly::<1>(&[(0, 40)], 150));
    assert!(reference == fly::<8>(&[(0, 40)], 150));
    assert!(reference == fly::<8>(&[(0, 11), (11, 29)], 150));
}

#[test]
fn a_lane_equals_a_lone_drone_bit_for_bit() {
    let scenario = hover();
    let mut simulation = Simulation::<64>::new(&scenario, Seed(1), 0, 3);
    let mut stream = Stream::new(Seed(1), 2, Purpose::Reset);
    let beginning = crate::reset::begin::<f32>(&scenario, (0, 0), &mut stream);
    let mut state = beginning.drone.motion;
    let Preset::Clean { integrator, ground, .. } = scenario.physics.preset else { panic!("hover is clean") };
    let air = kestrel_core::vehicle::Air { wind: beginning.wind, force: Vector3::zeros(), ground, ceiling: None };
    for step in 0..20 {
        let actions = noise(step, 12);
        simulation.step(&actions);
        let action = [actions[2], actions[5], actions[8], actions[11]];
        let ActionSpace::RotorSpeeds(space) = scenario.action else { panic!("hover commands rotor speeds") };
        let targets = space.rotor_targets(&action.map(|value: f32| value.clamp(-1.0, 1.0)));
        for _ in 0..scenario.physics.substeps {
            let secs = scenario.physics.substep_secs() as f32;
            state = integrator.advance(&beginning.vehicle, &state, &targets, &air, secs);
        }
        assert_eq!(simulation.state(2), state);
    }
}

#[test]
fn a_restored_simulation_goes_on_to_the_same_bits() {
    let mut simulation = Simulation::<64>::new(&hover(), Seed(8), 0, 70);
    for step in 0..77 {
        simulation.step(&noise(step, 280));
    }
    let saved = simulation.save();
    let mut other = Simulation::<64>::new(&hover(), Seed(9), 0, 70);
    assert!(other.restore(&saved));
    for step in 77..150 {
        simulation.step(&noise(step, 280));
        other.step(&noise(step, 280));
        assert_eq!(simulation.observations(), other.observations());
        assert_eq!(simulation.rewards(), other.rewards());
    }
    assert_eq!(simulation.take_episodes(), other.take_episodes());
    assert!(!Simulation::<64>::new(&hover(), Seed(9), 0, 7).restore(&saved));
}

#[test]
fn the_clock_truncates_and_keeps_the_last_observation() {
    let mut scenario = hover();
    scenario.terminations.clear();
    scenario.aviary.world.floor = Floor::Absent;
    scenario.episode_secs = 0.05;
    let mut simulation = Simulation::<64>::new(&scenario, Seed(2), 0, 2);
    for _ in 0..5 {
        assert!(simulation.outcomes().iter().all(|outcome| *outcome == Outcome::Running));
        simulation.step(&[0.3; 8]);
    }
    assert_eq!(simulation.outcomes(), [Outcome::Truncated; 2]);
    // The previous action is the last thing an observation holds; a reset clears it.
    assert_eq!(simulation.final_observations()[21 * 2], 0.3);
    assert_eq!(simulation.observations()[21 * 2], 0.0);
    let episodes = simulation.take_episodes();
    assert!(episodes.iter().all(|episode| episode.steps == 5));
}

#[test]
fn a_drone_that_meets_a_wall_collides() {
    let mut scenario = hover();
    scenario.start.position =
        StartPosition::Within(Cuboid { low: Vector3::new(0.0, 0.0, 1.0), high: Vector3::new(0.0, 0.0, 1.0) });
    scenario.start.speed_limit = 0.0;
    let wall = |x: f64| Solid::block("wall", Vector3::new(x, -1.0, 0.0), Vector3::new(x + 0.1, 1.0, 2.0));
    scenario.aviary.world.solids = vec![wall(0.063)];
    let mut near = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
    near.step(&[0.0; 4]);
    assert_eq!(near.outcomes(), [Outcome::Running]);
    scenario.aviary.world.solids = vec![wall(0.059)];
    let mut touching = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
    touching.step(&[0.0; 4]);
    assert_eq!(touching.outcomes(), [Outcome::Terminated]);
    assert_eq!(touching.take_episodes()[0].ending, crate::outcome::Ending::Collision);
}

/// A door, as high as a room: what the drone flies against is far from its centre.
#[test]
fn a_drone_that_meets_a_large_movable_collides() {
    let flight = |height: f64| {
        let mut scenario = scenario(&format!(
            "aviary:
  goal_m: [0, 0, 1]
  movables: [ {{ box: {{ center_m: [0.5, 0, {}], size_m: [0.02, 0.5, {height}] }}, mass_kg: 5 }} ]
start: {{ position: {{ exactly: [ {{ position_m: [0, 0, 2.5] }} ] }} }}
rewards: [ alive: {{ weight: 1 }} ]
terminations: [ collision ]
success: {{ settle: {{ radius_m: 1, within_secs: 1 }} }}",
            0.5 * height
        ));
        // A configuration that said so would be refused.
        let StartPosition::Exactly(places) = &mut scenario.start.position else { panic!("it is a place") };
        places[0].position.x = 0.44;
        let mut simulation = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
        simulation.step(&[0.0; 4]);
        simulation.outcomes()[0]
    };
    assert_eq!(flight(2.4), Outcome::Running);
    assert_eq!(flight(3.0), Outcome::Terminated);
}

#[test]
fn reaching_the_region_slowly_enough_is_success() {
    let mut scenario = hover();
    let everywhere = Cuboid { low: Vector3::repeat(-5.0), high: Vector3::repeat(5.0) };
    scenario.success = Success::Reach { region: everywhere, speed_limit: 20.0 };
    let mut simulation = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
    simulation.step(&[0.0; 4]);
    assert!(simulation.take_episodes()[0].success);
    scenario.success = Success::Reach { region: everywhere, speed_limit: 0.0 };
    let mut simulation = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
    simulation.step(&[0.0; 4]);
    assert!(simulation.take_episodes().is_empty());
}

#[test]
fn terms_add_up_to_the_return() {
    let mut simulation = Simulation::<64>::new(&hover(), Seed(3), 0, 16);
    for step in 0..120 {
        simulation.step(&noise(step, 64));
    }
    for episode in simulation.take_episodes() {
        let sum: f32 = episode.terms.iter().sum();
        assert!((sum - episode.total_reward).abs() < 1e-3 * episode.total_reward.abs().max(1.0));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn no_action_breaks_an_observation(bits in prop::collection::vec(any::<u32>(), 16), steps in 1_usize..40) {
        let mut scenario = hover();
        scenario.terminations =
            vec![termination::Distance { limit_m: 50.0 }.into()];
        let mut simulation = Simulation::<64>::new(&scenario, Seed(4), 0, 4);
        let actions: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
        for _ in 0..steps {
            simulation.step(&actions);
            prop_assert!(simulation.observations().iter().all(|value| value.is_finite()));
            prop_assert!(simulation.rewards().iter().all(|value| value.is_finite()));
        }
    }
}
