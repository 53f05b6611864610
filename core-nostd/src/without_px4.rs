//! Stand-ins for what the feature `px4` holds: types without a value, so that an action space and a layout keep their
//! places in the policy file, and nothing of them is compiled.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::policy_error::PolicyError;
use crate::vehicle::State;

/// Thrusts of rotors as actions, of which there are none without the feature `px4`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum RotorThrusts {}

/// What PX4's neural control shows a policy, which nothing does without the feature `px4`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Px4NeuralLayout {}

impl RotorThrusts {
    pub(crate) const fn rotor_speed_limit(&self) -> f32 {
        match *self {}
    }

    pub(crate) const fn hover_speed_squared(&self) -> f32 {
        match *self {}
    }

    pub(crate) const fn rotor_targets<R>(&self, _action: &[R; 4]) -> [R; 4] {
        match *self {}
    }

    pub(crate) const fn check(&self) -> Result<(), PolicyError> {
        match *self {}
    }
}

impl Px4NeuralLayout {
    pub(crate) const fn len(&self) -> usize {
        match *self {}
    }

    pub(crate) const fn encode<R>(&self, _state: &State<R>, _goal: &Vector3<R>) -> [R; 0] {
        match *self {}
    }
}
