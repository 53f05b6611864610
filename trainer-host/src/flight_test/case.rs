//! One flight of a test, checked: what is flown, what goes wrong, and what is to come of it.

use std::sync::Arc;

use kestrel_core::airframe::Airframe;
use kestrel_shim::ground_station::StationOrder;
use kestrel_shim::parameter::Parameters;
use kestrel_shim::policy_bytes::PolicyBytes;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use nalgebra::Vector3;

use super::expectation::Expectation;
use super::fault::Fault;

/// One flight of a test.
#[derive(Clone, Debug)]
pub(crate) struct Case {
    /// Name of the file's tests.
    pub(crate) suite: String,
    /// Its own, with what the matrix chose.
    pub(crate) name: String,
    /// Where, with what, and by which physics.
    pub(crate) scenario: Arc<Scenario>,
    /// The drone that the autopilot believes to fly.
    pub(crate) airframe: Airframe,
    /// Who flies.
    pub(crate) pilot: CasePilot,
    /// How the autopilot is set.
    pub(crate) parameters: Parameters,
    /// The episode whose drone and wind are flown; none for a nominal drone in still air.
    pub(crate) seed: Option<Seed>,
    /// Wind beside that \[m/s, world\].
    pub(crate) wind: Vector3<f64>,
    /// How long it lasts \[s, simulated\].
    pub(crate) secs: f64,
    /// What the ground station sends, in the order of time.
    pub(crate) script: Vec<ScriptStep>,
    /// What goes wrong.
    pub(crate) faults: Vec<Fault>,
    /// What is to come of it.
    pub(crate) expectations: Vec<Expectation>,
    /// Where it goes, for pictures \[m, world\].
    pub(crate) goal: Vector3<f32>,
}

/// Who flies.
#[derive(Clone, Debug)]
pub(crate) enum CasePilot {
    /// The autopilot's cascade of controllers.
    Cascade,
    /// A policy.
    Policy(Arc<PolicyBytes>),
}

/// What the ground station sends.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ScriptStep {
    /// When, for the first time \[s\].
    pub(crate) at_secs: f64,
    /// For how long it is sent again and again \[s\]; zero for once.
    pub(crate) for_secs: f64,
    /// What.
    pub(crate) order: StationOrder,
}

impl Case {
    /// Name of the file's tests and its own.
    pub(crate) fn full_name(&self) -> String {
        format!("{}/{}", self.suite, self.name)
    }
}
