//! The active controller: the policy, or the cascade of controllers that takes its place.

use kestrel_core::airframe::Airframe;
use kestrel_core::effectiveness::RotorEffectiveness;
use kestrel_core::policy_file::PolicyAirframe;
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;

use crate::goal::MovingGoal;
use crate::policy_backend::PolicyBackend;
use crate::steering::{AttitudeSetPoint, Steering};

/// Share of the greatest rotor speed below which no rotor turns in flight: a stopped one takes a tenth of a second to come back,
/// and some never do.
const IDLE: f32 = 0.05;

/// Rotors this close to their limits count as being there, as a share of the greatest speed.
const AT_LIMIT: f32 = 1e-3;

/// What flies toward goals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Controller {
    /// The policy.
    Policy,
    /// The cascade of controllers, the "PID".
    Cascade,
}

/// Both, one of them active.
pub struct Controllers<P> {
    backend: P,
    steering: Steering,
    active: Controller,
    effectiveness: RotorEffectiveness,
    /// Least and greatest rotor speed in flight \[rad/s\].
    limits: [f32; 2],
    silent_secs: f32,
    saturated_secs: f32,
}

impl<P: PolicyBackend> Controllers<P> {
    /// For an airframe, with the policy active.
    pub fn new(backend: P, airframe: &Airframe) -> Self {
        let [hover, limit] = [airframe.hover_rotor_speed(), airframe.rotor_speed_limit].map(|speed| speed as f32);
        Self {
            backend,
            steering: Steering::new(airframe),
            active: Controller::Policy,
            effectiveness: RotorEffectiveness::new(&PolicyAirframe::from(airframe), hover * hover, limit),
            limits: [IDLE * limit, limit],
            silent_secs: 0.0,
            saturated_secs: 0.0,
        }
    }

    /// Which controller flies.
    pub fn active(&self) -> Controller {
        self.active
    }

    /// What is known of the rotors.
    pub fn effectiveness(&self) -> &RotorEffectiveness {
        &self.effectiveness
    }

    /// As [`Self::effectiveness`], to forget it or to pause.
    pub fn effectiveness_mut(&mut self) -> &mut RotorEffectiveness {
        &mut self.effectiveness
    }

    /// What computes the policy.
    pub fn backend(&mut self) -> &mut P {
        &mut self.backend
    }

    /// How long the policy, while active, has not answered \[s\].
    pub fn silent_secs(&self) -> f32 {
        self.silent_secs
    }

    /// How long the policy, while active, has kept a rotor at its limits \[s\].
    pub fn saturated_secs(&self) -> f32 {
        self.saturated_secs
    }

    /// Begins a flight, or hands over in flight.
    pub fn begin(&mut self, controller: Controller) {
        self.active = controller;
        self.silent_secs = 0.0;
        self.saturated_secs = 0.0;
        match controller {
            Controller::Policy => self.backend.reset(),
            Controller::Cascade => self.steering.begin(),
        }
    }

    /// Rotor targets \[rad/s\] toward a goal, in flight; nothing while the policy gives none that can be flown.
    pub fn toward(&mut self, state: &State<f32>, goal: &MovingGoal, secs: f32) -> Option<[f32; 4]> {
        match self.active {
            Controller::Policy => {
                let setpoint = Setpoint { yaw: goal.heading(), ..Setpoint::at(goal.position()) };
                let targets = self.backend.tick(state, &setpoint).filter(is_finite);
                // Above its goal, on the floor too, a policy may want no thrust at all.
                let least = if goal.position().z < state.position.z { f32::NEG_INFINITY } else { self.limits[0] };
                self.judge(targets.as_ref(), least, secs);
                targets.map(|targets| self.limited(targets))
            }
            Controller::Cascade => {
                let targets = self.steering.toward(state, goal, secs);
                Some(self.limited(targets))
            }
        }
    }

    /// Rotor targets \[rad/s\] of a flight that begins.
    pub fn idle(&self) -> [f32; 4] {
        let [low, _] = self.limits;
        [low; 4]
    }

    /// Rotor targets \[rad/s\] that a peer steers by directly, in flight.
    pub fn follow(&self, state: &State<f32>, attitude_set_point: &AttitudeSetPoint) -> [f32; 4] {
        self.limited(self.steering.follow(state, attitude_set_point))
    }

    /// Rotor targets \[rad/s\], in flight, with which a drone of weak rotors does what it would do by these targets if they were
    /// sound; where it flies freely it learns how weak they are.
    pub fn compensated(&mut self, state: &State<f32>, targets: &[f32; 4], secs: f32, is_free: bool) -> [f32; 4] {
        let commanded = self.limited(self.effectiveness.compensated(targets));
        if is_free {
            self.effectiveness.learn(state, &commanded, secs);
        } else {
            self.effectiveness.pause();
        }
        commanded
    }

    /// Counts how long the policy is silent, or keeps a rotor at `least` or at its greatest speed \[rad/s\].
    fn judge(&mut self, targets: Option<&[f32; 4]>, least: f32, secs: f32) {
        let Some(targets) = targets else {
            self.silent_secs += secs;
            return;
        };
        self.silent_secs = 0.0;
        let [_, high] = self.limits;
        let margin = AT_LIMIT * high;
        let saturated = targets.iter().any(|target| !(least + margin..high - margin).contains(target));
        self.saturated_secs = if saturated { self.saturated_secs + secs } else { 0.0 };
    }

    /// No motor stops in flight, and none exceeds its limit.
    fn limited(&self, targets: [f32; 4]) -> [f32; 4] {
        let [low, high] = self.limits;
        targets.map(|target| target.max(low).min(high))
    }
}

fn is_finite(targets: &[f32; 4]) -> bool {
    targets.iter().all(|target| target.is_finite())
}
