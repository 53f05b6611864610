//! Every term against numbers made by hand, the reference's both as published and corrected.

mod component;
mod term;

use std::sync::Arc;

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use serde::Deserialize;

use super::*;
use crate::config::{Document, RewardConfig};
use crate::world::{Cuboid, Solid, World};

/// Control rate of the trials \[Hz\], the reference's.
const RATE_HZ: f64 = 48.0;

/// Ways to the origin, around a wall of 2 m by 1 m at x = 1 that leaves a passage below y = -1.
fn ways() -> DistanceField {
    let wall = Solid::block("wall", Vector3::new(1.0, -1.0, -2.0), Vector3::new(1.1, 2.0, 2.0));
    let bounds = Cuboid { low: Vector3::repeat(-2.0), high: Vector3::repeat(2.0) };
    DistanceField::new(&World { solids: vec![wall], ..World::empty() }, &Vector3::zeros(), bounds, 0.06)
}

/// The term of a line of YAML.
fn term(yaml: &str) -> WeightedTerm {
    #[derive(Deserialize)]
    struct Rewards {
        rewards: Vec<RewardConfig>,
    }
    let document = Document::parse("trial.yaml", &format!("rewards: [ {yaml} ]")).unwrap();
    let rewards: Rewards = document.decode().unwrap();
    let field = document.root().at("rewards");
    RewardConfig::check_all(&rewards.rewards, RATE_HZ, &Arc::new(ways()), &field).unwrap().remove(0)
}

/// A term and the drone that it looks at, step by step; what it remembers stays.
struct Trial {
    term: WeightedTerm,
    memory: Vec<Column<1, f64>>,
    swarm: Swarm<1, f64>,
    team: Vec<[Column<1, f64>; 3]>,
    agent: usize,
    steps: f64,
    distance: f64,
    previous_distance: f64,
    action: [f64; 4],
    previous_action: [f64; 4],
    touches: [Column<1, f64>; 2],
    ends: Ends<1, f64>,
}

impl Trial {
    fn of(yaml: &str) -> Self {
        let term = term(yaml);
        Self {
            memory: vec![[term.term.memory_start()]; term.term.memory_len()],
            term,
            swarm: Swarm::new(&CF2X),
            team: vec![[[0.0]; 3]],
            agent: 0,
            steps: 0.0,
            distance: 0.0,
            previous_distance: 0.0,
            action: [0.0; 4],
            previous_action: [0.0; 4],
            touches: [[0.0]; 2],
            ends: Ends { success: [0.0], failure: [0.0], time_up: [0.0] },
        }
    }

    /// What the next step pays with the drone here.
    fn at(&mut self, x: f64, y: f64, z: f64) -> f64 {
        self.swarm.position = [[x], [y], [z]];
        self.team[self.agent] = self.swarm.position;
        self.pay()
    }

    /// As [`Self::at`], of several places in order.
    fn along(&mut self, places: &[[f64; 3]]) -> Vec<f64> {
        places.iter().map(|[x, y, z]| self.at(*x, *y, *z)).collect()
    }

    fn turned(&mut self, attitude: Attitude<f64>) -> f64 {
        let Attitude { w, x, y, z } = attitude;
        self.swarm.attitude = [[w], [x], [y], [z]];
        self.pay()
    }

    fn moving(&mut self, velocity: [f64; 3]) -> f64 {
        self.swarm.velocity = velocity.map(|value| [value]);
        self.pay()
    }

    fn away(&mut self, distance: f64) -> f64 {
        self.distance = distance;
        self.pay()
    }

    fn pay(&mut self) -> f64 {
        self.steps += 1.0;
        let (actions, previous) = (self.action.map(|value| [value]), self.previous_action.map(|value| [value]));
        let view = StepView {
            swarm: &self.swarm,
            actions: &actions,
            previous_actions: &previous,
            distances: &[self.distance],
            previous_distances: &[self.previous_distance],
            touches: &self.touches,
            steps: &[self.steps],
            ends: &self.ends,
            agent: self.agent,
            team: &self.team,
            control_secs: 1.0 / RATE_HZ,
        };
        let mut values = [f64::NAN];
        self.term.evaluate(&view, &mut self.memory, &mut values);
        values[0]
    }
}

/// A turn \[rad\] about a body axis of a level drone.
fn turn(axis: [f64; 3], angle: f64) -> Attitude<f64> {
    let [x, y, z] = axis.map(|part| part * (0.5 * angle).sin());
    Attitude { w: (0.5 * angle).cos(), x, y, z }
}

const ROLL: [f64; 3] = [1.0, 0.0, 0.0];
const PITCH: [f64; 3] = [0.0, 1.0, 0.0];
const YAW: [f64; 3] = [0.0, 0.0, 1.0];

#[track_caller]
fn assert_near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-12, "found {found}, expected {expected}");
}

#[track_caller]
fn assert_all_near(found: &[f64], expected: &[f64]) {
    let near = |(found, expected): (&f64, &f64)| (found - expected).abs() < 1e-12;
    assert!(
        found.len() == expected.len() && found.iter().zip(expected).all(near),
        "found {found:?}, expected {expected:?}"
    );
}

#[test]
fn a_turn_is_a_unit_quaternion() {
    let up = turn(ROLL, 0.3).rotate(Vector3::z());
    assert_near(up.y, -(0.3_f64.sin()));
    assert_near(up.z, 0.3_f64.cos());
}
