//! Stand-ins for what the feature `reference` holds: types without a value, so that an action space and a layout keep
//! their places in the policy file, and nothing of the reference system is compiled.

use core::convert::Infallible;
use core::marker::PhantomData;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::limits::ACTION_LIMIT;
use crate::observation::input::ObservationInput;
use crate::policy_error::PolicyError;
use crate::real::Real;
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// The reference system's actions, of which there are none without the feature `reference`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ReferenceActions {}

/// [`ReferenceActions`] ready for arithmetic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceControls<R>(Infallible, PhantomData<R>);

/// What the controller behind an action space remembers from call to call; of one without a controller, nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlMemory<R> {
    /// Of [`IntegralVelocities`](crate::action::IntegralVelocities) \[m/s², world\].
    pub velocity_integral: Vector3<R>,
}

/// The reference system's observations, of which there are none without the feature `reference`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ReferenceLayout {}

/// The reference system's observations of today, of which there are none without the feature `reference`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum KinematicLayout {}

impl ReferenceActions {
    pub(crate) const fn len(&self) -> usize {
        match *self {}
    }

    pub(crate) const fn name(&self) -> &'static str {
        match *self {}
    }

    pub(crate) const fn rotor_speed_limit(&self) -> f32 {
        match *self {}
    }

    pub(crate) const fn hover_speed_squared(&self) -> f32 {
        match *self {}
    }

    pub(crate) const fn persistence(&self) -> crate::persistence::Persistence {
        match *self {}
    }

    pub(crate) const fn check(&self) -> Result<(), PolicyError> {
        match *self {}
    }
}

impl<R> ReferenceControls<R> {
    pub(crate) const fn new(space: &ReferenceActions) -> Self {
        match *space {}
    }

    pub(crate) const fn rotor_targets(
        &self,
        _action: &[R; ACTION_LIMIT],
        _state: &State<R>,
        _setpoint: &Setpoint<R>,
        _memory: &mut ControlMemory<R>,
        _secs: R,
    ) -> [R; 4] {
        match self.0 {}
    }
}

impl<R: Real> ControlMemory<R> {
    /// Nothing, as at the start of an episode.
    pub fn new() -> Self {
        Self { velocity_integral: Vector3::new(R::zero(), R::zero(), R::zero()) }
    }
}

impl<R: Real> Default for ControlMemory<R> {
    fn default() -> Self {
        Self::new()
    }
}

impl ReferenceLayout {
    pub(crate) const fn len(&self) -> usize {
        match *self {}
    }

    pub(crate) const fn history_len(&self) -> usize {
        match *self {}
    }

    pub(crate) const fn encode<R>(&self, _input: &ObservationInput<'_, R>) -> [R; 0] {
        match *self {}
    }

    pub(crate) const fn check(&self, _action_len: usize) -> Result<(), PolicyError> {
        match *self {}
    }
}

impl KinematicLayout {
    pub(crate) const fn len(&self) -> usize {
        match *self {}
    }

    pub(crate) const fn history_len(&self) -> usize {
        match *self {}
    }

    pub(crate) const fn encode<R>(&self, _input: &ObservationInput<'_, R>, _out: &mut [R]) {
        match *self {}
    }

    pub(crate) const fn check(&self, _action_len: usize) -> Result<(), PolicyError> {
        match *self {}
    }
}
