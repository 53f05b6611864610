//! One drone under the rules of a task, step by step: what the tests of the terminations fly.

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;
use serde::Deserialize;

use super::{decode, find_endings};
use crate::config::Document;
use crate::outcome::Ending;
use crate::scenario::Scenario;
use crate::swarm::{Column, Swarm};
use crate::term::{FlightView, RuleTask};
use crate::termination::Termination;
use crate::testing::hover;

/// Control rate of the trials \[Hz\], the reference's.
pub(crate) const RATE_HZ: f64 = 48.0;

/// A scenario that ends by the rules of a YAML list.
pub(crate) fn scenario(rules: &str) -> Scenario {
    #[derive(Deserialize)]
    struct Rules {
        terminations: Vec<Termination>,
    }
    let mut scenario = hover();
    let document = Document::parse("trial.yaml", &format!("terminations: [ {rules} ]")).unwrap();
    let rules: Rules = document.decode().unwrap();
    let goal = scenario.aviary.goal;
    let task = RuleTask { goals: crate::world::Cuboid { low: goal, high: goal }, is_race: true };
    let field = document.root().at("terminations");
    scenario.terminations = Termination::check_all(&rules.terminations, &task, &field).unwrap();
    scenario
}

/// A drone under rules, step by step; what they remember stays.
pub(crate) struct Trial {
    pub(crate) scenario: Scenario,
    pub(crate) memory: Vec<Vec<Column<1, f64>>>,
    pub(crate) swarm: Swarm<1, f64>,
    pub(crate) touches: [Column<1, f64>; 2],
    pub(crate) distance: f64,
    pub(crate) steps: f64,
}

impl Trial {
    pub(crate) fn of(rules: &str) -> Self {
        Self::under(scenario(rules))
    }

    pub(crate) fn under(scenario: Scenario) -> Self {
        let columns = |rule: &Termination| vec![[rule.memory().start]; rule.memory().columns];
        Self {
            memory: scenario.terminations.iter().map(columns).collect(),
            scenario,
            swarm: Swarm::new(&CF2X),
            touches: [[0.0]; 2],
            distance: 0.0,
            steps: 0.0,
        }
    }

    /// How the next step ends, with the drone as it is.
    pub(crate) fn step(&mut self) -> Option<Ending> {
        decode(self.code())
    }

    pub(crate) fn code(&mut self) -> f32 {
        self.steps += 1.0;
        // The last gate is passed after a hundred periods.
        let gates_left = [if self.steps > 100.0 { 0.0 } else { 1.0 }];
        let view = FlightView {
            swarm: &self.swarm,
            goal: &[[0.0]; 3],
            distances: &[self.distance],
            previous_distances: &[self.distance],
            actions: &[],
            previous_actions: &[],
            touches: &self.touches,
            nearest: None,
            passing: None,
            ahead: None,
            signposts: None,
            gates_left: Some(&gates_left),
            steps: &[self.steps],
            agent: 0,
            team: &[],
            arenas: None,
            rooms: None,
            control_rate_hz: RATE_HZ,
        };
        let mut codes = [f32::NAN];
        find_endings(&view, &self.scenario, &mut self.memory, &mut codes);
        codes[0]
    }

    pub(crate) fn at(&mut self, x: f64, y: f64, z: f64) -> Option<Ending> {
        self.swarm.position = [[x], [y], [z]];
        self.step()
    }

    /// Turned \[rad\] about an axis of a level drone.
    pub(crate) fn turned(&mut self, axis: [f64; 3], angle: f64) -> Option<Ending> {
        let Attitude { w, x, y, z } = Attitude::from_axis_angle(Vector3::from(axis), angle);
        self.swarm.attitude = [[w], [x], [y], [z]];
        self.step()
    }
}

pub(crate) const ROLL: [f64; 3] = [1.0, 0.0, 0.0];
pub(crate) const PITCH: [f64; 3] = [0.0, 1.0, 0.0];
pub(crate) const YAW: [f64; 3] = [0.0, 0.0, 1.0];
