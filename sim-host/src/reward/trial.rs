//! One drone and one term, step by step: what the tests of the terms fly.

use std::sync::Arc;

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use serde::Deserialize;

use super::RewardTerm;
use crate::config::Document;
use crate::contact::DistanceField;
use crate::physics::Contacts;
use crate::rooms::{Arenas, Ways};
use crate::swarm::{Column, Swarm};
use crate::term::{Ends, FlightView, GoalKind, RewardTask, StepView};
use crate::world::{Cuboid, Solid, World};

/// Control rate of the trials \[Hz\], the reference's.
pub(super) const RATE_HZ: f64 = 48.0;

/// Ways to the origin, around a wall of 2 m by 1 m at x = 1 that leaves a passage below y = -1.
pub(super) fn ways() -> DistanceField {
    let wall = Solid::block("wall", Vector3::new(1.0, -1.0, -2.0), Vector3::new(1.1, 2.0, 2.0));
    let bounds = Cuboid { low: Vector3::repeat(-2.0), high: Vector3::repeat(2.0) };
    DistanceField::new(&World { solids: vec![wall], ..World::empty() }, &Vector3::zeros(), bounds, 0.06)
}

/// What terms are checked against: a task with these contacts, whose drones look for their ways.
pub(super) fn task(contacts: Contacts) -> RewardTask {
    RewardTask { goals: GoalKind::OnePlace, contacts, ways: Ways::Same(Arc::new(ways())), own_way: true }
}

/// The term of a line of YAML.
pub(super) fn term(yaml: &str) -> RewardTerm {
    #[derive(Deserialize)]
    struct Rewards {
        rewards: Vec<RewardTerm>,
    }
    let document = Document::parse("trial.yaml", &format!("rewards: [ {yaml} ]")).unwrap();
    let rewards: Rewards = document.decode().unwrap();
    RewardTerm::check_all(&rewards.rewards, &task(Contacts::Reported), &document.root().at("rewards"))
        .unwrap()
        .remove(0)
}

/// A term and the drone that it looks at, step by step; what it remembers stays.
pub(super) struct Trial {
    pub(super) term: RewardTerm,
    pub(super) memory: Vec<Column<1, f64>>,
    pub(super) swarm: Swarm<1, f64>,
    pub(super) team: Vec<[Column<1, f64>; 3]>,
    pub(super) agent: usize,
    pub(super) steps: f64,
    pub(super) distance: f64,
    pub(super) previous_distance: f64,
    pub(super) action: [f64; 4],
    pub(super) previous_action: [f64; 4],
    pub(super) touches: [Column<1, f64>; 2],
    pub(super) ends: Ends<1, f64>,
    pub(super) arenas: Option<Arenas>,
    pub(super) nearest: Option<[Column<1, f64>; 4]>,
    pub(super) passing: Option<[Column<1, f64>; 7]>,
    pub(super) ahead: Option<[Column<1, f64>; 3]>,
    pub(super) signposts: Option<[Column<1, f64>; 3]>,
}

impl Trial {
    pub(super) fn of(yaml: &str) -> Self {
        let term = term(yaml);
        Self {
            memory: vec![[term.memory().start]; term.memory().columns],
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
            arenas: None,
            nearest: None,
            passing: None,
            ahead: None,
            signposts: None,
        }
    }

    /// What the next step pays with the drone here.
    pub(super) fn at(&mut self, x: f64, y: f64, z: f64) -> f64 {
        self.swarm.position = [[x], [y], [z]];
        self.team[self.agent] = self.swarm.position;
        self.pay()
    }

    /// As [`Self::at`], of several places in order.
    pub(super) fn along(&mut self, places: &[[f64; 3]]) -> Vec<f64> {
        places.iter().map(|[x, y, z]| self.at(*x, *y, *z)).collect()
    }

    pub(super) fn turned(&mut self, attitude: Attitude<f64>) -> f64 {
        let Attitude { w, x, y, z } = attitude;
        self.swarm.attitude = [[w], [x], [y], [z]];
        self.pay()
    }

    pub(super) fn moving(&mut self, velocity: [f64; 3]) -> f64 {
        self.swarm.velocity = velocity.map(|value| [value]);
        self.pay()
    }

    pub(super) fn away(&mut self, distance: f64) -> f64 {
        self.distance = distance;
        self.pay()
    }

    pub(super) fn pay(&mut self) -> f64 {
        self.steps += 1.0;
        let (actions, previous) = (self.action.map(|value| [value]), self.previous_action.map(|value| [value]));
        let flight = FlightView {
            swarm: &self.swarm,
            goal: &[[0.0]; 3],
            distances: &[self.distance],
            previous_distances: &[self.previous_distance],
            actions: &actions,
            previous_actions: &previous,
            touches: &self.touches,
            gates_left: None,
            nearest: self.nearest.as_ref(),
            passing: self.passing.as_ref(),
            ahead: self.ahead.as_ref(),
            signposts: self.signposts.as_ref(),
            steps: &[self.steps],
            agent: self.agent,
            team: &self.team,
            arenas: self.arenas.as_ref(),
            rooms: None,
            control_rate_hz: RATE_HZ,
        };
        let view = StepView { flight, ends: &self.ends };
        let mut values = [f64::NAN];
        self.term.evaluate(&view, &mut self.memory, &mut values);
        values[0]
    }
}

/// A turn \[rad\] about a body axis of a level drone.
pub(super) fn turn(axis: [f64; 3], angle: f64) -> Attitude<f64> {
    let [x, y, z] = axis.map(|part| part * (0.5 * angle).sin());
    Attitude { w: (0.5 * angle).cos(), x, y, z }
}

pub(super) const ROLL: [f64; 3] = [1.0, 0.0, 0.0];
pub(super) const PITCH: [f64; 3] = [0.0, 1.0, 0.0];
pub(super) const YAW: [f64; 3] = [0.0, 0.0, 1.0];

#[track_caller]
pub(super) fn assert_near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-12, "found {found}, expected {expected}");
}

#[track_caller]
pub(super) fn assert_all_near(found: &[f64], expected: &[f64]) {
    let near = |(found, expected): (&f64, &f64)| (found - expected).abs() < 1e-12;
    assert!(
        found.len() == expected.len() && found.iter().zip(expected).all(near),
        "found {found:?}, expected {expected:?}"
    );
}
