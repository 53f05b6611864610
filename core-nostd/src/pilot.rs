//! A policy at the controls: the one call that a firmware makes every control period.

use nalgebra::Vector3;

use crate::action::{ACTION_LIMIT, ActionSpace, ControlMemory, Controls, Persistence};
use crate::controller::Setpoint;
use crate::observation::{HISTORY_LIMIT, OBSERVATION_LIMIT, Seen};
use crate::policy_file::{PolicyError, PolicyFile, Scratch};
use crate::real::Real;
use crate::vehicle::State;

/// Flies one drone with one policy.
#[derive(Clone, Debug)]
pub struct Pilot<'a> {
    policy: PolicyFile<'a>,
    controls: Controls<f32>,
    memory: ControlMemory<f32>,
    /// The newest action is the last.
    history: [[f32; ACTION_LIMIT]; HISTORY_LIMIT],
    scratch: Scratch,
}

impl<'a> Pilot<'a> {
    /// A pilot that has not acted yet: its past actions are zero.
    pub fn new(policy: PolicyFile<'a>) -> Self {
        Self {
            controls: Controls::new(&policy.metadata().action),
            memory: ControlMemory::new(),
            history: [[0.0; ACTION_LIMIT]; HISTORY_LIMIT],
            policy,
            scratch: Scratch::new(),
        }
    }

    /// Forgets the past actions, as at the start of an episode, and what the controller behind the action space
    /// remembers, unless it was trained to persist.
    pub fn reset(&mut self) {
        self.history = [[0.0; ACTION_LIMIT]; HISTORY_LIMIT];
        match self.policy.metadata().action.persistence() {
            Persistence::ResetEachEpisode => self.memory = ControlMemory::new(),
            Persistence::Persist => {}
        }
    }

    /// Rotor targets \[rad/s\] on the way to `goal` \[m, world\]: encode, act, mix.
    ///
    /// Within zero and the greatest rotor speed of the action space, whatever the state (a NaN is read as zero).
    /// Call it every `control_period_secs` of the metadata. A policy that sees what sensors measure flies with
    /// [`Self::tick_measured`] instead; here it would see zeros.
    pub fn tick(&mut self, state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        self.tick_measured(&[], state, goal)
    }

    /// As [`Self::tick`], for a policy that sees what sensors measure, in the order and the scales of its training.
    /// The controllers behind action spaces still read the estimated `state`: body rates, or pose and velocity.
    pub fn tick_measured(&mut self, measurements: &[f32], state: &State<f32>, goal: &Vector3<f32>) -> [f32; 4] {
        let metadata = self.policy.metadata();
        let (layout, secs) = (metadata.observation, metadata.control_period_secs);
        let seen = Seen {
            state,
            angular_velocity_in_world: state.world_from_body.rotate(state.body_rates),
            goal,
            history: &self.history,
            measurements,
        };
        let mut observation = [0.0; OBSERVATION_LIMIT];
        layout.encode(&seen, &mut observation);
        let observation = observation.get(..layout.len()).unwrap_or_default();
        let action = self.policy.act(observation, &mut self.scratch);
        self.remember(action);
        let targets = self.controls.rotor_targets(&action, state, &Setpoint::at(*goal), &mut self.memory, secs);
        self.within_limits(targets)
    }

    /// Pushes the oldest action that the layout reads out of the history.
    fn remember(&mut self, action: [f32; ACTION_LIMIT]) {
        let needed = self.policy.metadata().observation.history_len().clamp(1, HISTORY_LIMIT);
        for index in HISTORY_LIMIT - needed..HISTORY_LIMIT - 1 {
            self.history[index] = self.history[index + 1];
        }
        self.history[HISTORY_LIMIT - 1] = action;
    }

    /// The reference's actions know no limit; rotors do.
    fn within_limits(&self, targets: [f32; 4]) -> [f32; 4] {
        match &self.policy.metadata().action {
            ActionSpace::RotorSpeeds(_) | ActionSpace::ThrustBodyRates(_) | ActionSpace::Velocities(_) => targets,
            ActionSpace::Published(space) => {
                targets.map(|target| target.limited(0.0, space.airframe.rotor_speed_limit as f32))
            }
        }
    }

    /// Computes the golden vectors again, in the pilot's own scratch.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`]: do not fly.
    pub fn self_test(&mut self) -> Result<(), PolicyError> {
        self.policy.self_test_with(&mut self.scratch)
    }

    /// The policy that flies.
    pub fn policy(&self) -> &PolicyFile<'a> {
        &self.policy
    }

    /// The last action, in \[-1, 1\], as many values as the action space has.
    pub fn previous_action(&self) -> &[f32] {
        self.history[HISTORY_LIMIT - 1].get(..self.policy.metadata().action.len()).unwrap_or_default()
    }
}
