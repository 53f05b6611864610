//! Actions to rotor targets, and where an agent shall go meanwhile.

use kestrel_core::action::Setpoint;
use kestrel_core::action::{ACTION_LIMIT, ControlMemory, Controls, IntegralVelocities};
use kestrel_core::real::Real;
use kestrel_core::reference::controller::command::{Hover, Precision};
use nalgebra::Vector3;

use super::Agent;
use crate::latency::known_states;
use crate::scenario::{Clock, Scenario};
use crate::stage::Stage;
use crate::swarm::{Column, row, set_row, vector};
use crate::trajectory::Trajectory;

impl<const LANES: usize, R: Real> Agent<LANES, R> {
    /// Rotor targets of a control period.
    #[inline(always)]
    pub(crate) fn command(
        &mut self,
        stage: &Stage<'_, R>,
        actions: &[Column<LANES, R>; ACTION_LIMIT],
        targets: &mut [Column<LANES, R>; 4],
    ) {
        // Matched here rather than in the loop, which then has no branch and vectorises.
        match *stage.controls {
            Controls::RotorSpeeds(numbers) => {
                self.command_lanes(stage, &Controls::RotorSpeeds(numbers), actions, targets);
            }
            Controls::ThrustBodyRates(numbers) => {
                self.command_lanes(stage, &Controls::ThrustBodyRates(numbers), actions, targets);
            }
            Controls::Velocities(numbers) => self.command_velocities(stage, &numbers, actions, targets),
            Controls::RotorThrusts(numbers) => {
                self.command_lanes(stage, &Controls::RotorThrusts(numbers), actions, targets);
            }
            Controls::ThrustTorques(numbers) => {
                self.command_lanes(stage, &Controls::ThrustTorques(numbers), actions, targets);
            }
            Controls::Reference(published) => match published.rpm() {
                Some((hover, precision)) => command_around(&hover, precision, actions, targets),
                None => self.command_each(stage, actions, targets),
            },
        }
    }

    #[inline(always)]
    fn command_lanes(
        &mut self,
        stage: &Stage<'_, R>,
        controls: &Controls<R>,
        actions: &[Column<LANES, R>; ACTION_LIMIT],
        targets: &mut [Column<LANES, R>; 4],
    ) {
        let mut memory = ControlMemory::new();
        let setpoint = Setpoint::at(Vector3::new(R::zero(), R::zero(), R::zero()));
        let known = self.known();
        for lane in 0..LANES {
            let (action, state) = (row(actions, lane), known.state(lane));
            let speeds = controls.rotor_targets(&action, &state, &setpoint, &mut memory, stage.control_secs);
            set_row(targets, lane, speeds);
        }
    }

    #[inline(always)]
    fn command_velocities(
        &mut self,
        stage: &Stage<'_, R>,
        space: &IntegralVelocities,
        actions: &[Column<LANES, R>; ACTION_LIMIT],
        targets: &mut [Column<LANES, R>; 4],
    ) {
        // Of the loops' own, so that no store to one of them can change what the others read: they have no branch and vectorise.
        let (space, secs) = (*space, stage.control_secs);
        let known = known_states(&self.swarm, self.latency.as_ref());
        let mut speeds = [[R::zero(); LANES]; 4];
        match &mut self.velocity_integral {
            None => {
                for lane in 0..LANES {
                    let ([a, b, c, d, _, _], state) = (row(actions, lane), known.state(lane));
                    set_row(&mut speeds, lane, space.velocities.rotor_targets(&[a, b, c, d], &state));
                }
            }
            Some(integrals) => {
                let mut sums = **integrals;
                for lane in 0..LANES {
                    let ([a, b, c, d, _, _], state) = (row(actions, lane), known.state(lane));
                    let mut sum = vector(&sums, lane);
                    set_row(&mut speeds, lane, space.rotor_targets(&[a, b, c, d], &state, &mut sum, secs));
                    set_row(&mut sums, lane, sum.into());
                }
                **integrals = sums;
            }
        }
        *targets = speeds;
    }

    fn command_each(
        &mut self,
        stage: &Stage<'_, R>,
        actions: &[Column<LANES, R>; ACTION_LIMIT],
        targets: &mut [Column<LANES, R>; 4],
    ) {
        for lane in 0..LANES {
            let setpoint =
                Setpoint { velocity: vector(&self.goal_velocity, lane), ..Setpoint::at(vector(&self.goal, lane)) };
            let (action, state) = (row(actions, lane), self.known().state(lane));
            let memory = &mut self.controls[lane];
            let speeds = stage.controls.rotor_targets(&action, &state, &setpoint, memory, stage.control_secs);
            set_row(targets, lane, speeds);
        }
    }

    /// Moves the goals, where they move, to where they are after `steps` control periods.
    #[inline(always)]
    pub(crate) fn update_goal(&mut self, scenario: &Scenario) {
        if !scenario.goals.is_moving() {
            return;
        }
        for lane in 0..LANES {
            self.update_goal_of(scenario, lane);
        }
    }

    #[inline(always)]
    pub(super) fn update_goal_of(&mut self, scenario: &Scenario, lane: usize) {
        if let Some(columns) = &self.trajectory {
            let secs = self.steps[lane] * R::from_f32(scenario.physics.control_secs());
            let (offset, velocity) = Trajectory::from_array(&row(columns, lane)).at(secs);
            let centre = scenario.aviary_of(self.room(lane)).goal.map(R::from_f32);
            set_row(&mut self.goal, lane, (centre + offset).into());
            set_row(&mut self.goal_velocity, lane, velocity.into());
            return;
        }
        let secs = self.steps[lane].to_f64() / scenario.physics.control_rate_hz;
        let goal = scenario.goals.at(&scenario.aviary_of(self.room(lane)).goal, self.index, secs);
        // The reference takes differences of the points that it has passed.
        let lag_secs = match scenario.clock {
            Clock::Elapsed => 0.0,
            Clock::Reference => 1.0 / scenario.physics.control_rate_hz,
        };
        let velocity = scenario.goals.velocity_at(secs, lag_secs);
        set_row(&mut self.goal, lane, [goal.x, goal.y, goal.z].map(R::from_f64));
        set_row(&mut self.goal_velocity, lane, [velocity.x, velocity.y, velocity.z].map(R::from_f64));
    }
}

/// Rotor targets of actions around hover.
#[inline(always)]
fn command_around<const LANES: usize, R: Real>(
    hover: &Hover<R>,
    precision: Precision,
    actions: &[Column<LANES, R>; ACTION_LIMIT],
    targets: &mut [Column<LANES, R>; 4],
) {
    for (targets, actions) in targets.iter_mut().zip(actions) {
        for (target, action) in targets.iter_mut().zip(actions) {
            *target = hover.rotor_speed(precision, *action);
        }
    }
}
