//! What is on either side of a policy: the observation it acts on, and the rotors that its action turns.

use nalgebra::Vector3;

use crate::action::{ActionSpace, ControlMemory, Controls, Persistence};
use crate::elementary::sin_cos_of_half_turn;
use crate::limits::{ACTION_LIMIT, HISTORY_LIMIT, OBSERVATION_LIMIT};
use crate::observation::{ObservationInput, ObservationLayout, PAST_ACTIONS};
use crate::policy_file::PolicyMetadata;
use crate::rate_loop::RateLoop;
use crate::real::Real;
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// Past actions that are kept: as many as the layouts of these features read.
const KEPT_ACTIONS: usize = if cfg!(feature = "reference") { HISTORY_LIMIT } else { PAST_ACTIONS };

/// What is on either side of a network that somebody else computes: observations of states, and rotor speeds of actions,
/// as [`Pilot`](super::Pilot) has them around its policy. Every call takes the metadata of the same policy.
#[derive(Clone, Debug)]
pub struct PolicyController {
    controls: Controls<f32>,
    memory: ControlMemory<f32>,
    /// The newest action is the last.
    history: [[f32; ACTION_LIMIT]; KEPT_ACTIONS],
    /// Of the position error, world.
    integral: Vector3<f32>,
    /// What the rate loop holds until the next action; not read where there is none.
    held: [f32; 4],
    /// The last observation; here, and not on the stack of a firmware's task.
    observation: [f32; OBSERVATION_LIMIT],
}

impl PolicyController {
    /// At the start of an episode: past actions and integral are zero.
    pub fn new(metadata: &PolicyMetadata<'_>) -> Self {
        Self {
            controls: Controls::new(&metadata.action),
            memory: ControlMemory::new(),
            history: [[0.0; ACTION_LIMIT]; KEPT_ACTIONS],
            integral: Vector3::new(0.0, 0.0, 0.0),
            held: [0.0; 4],
            observation: [0.0; OBSERVATION_LIMIT],
        }
    }

    /// Begins a new episode. What the controller behind the action space remembers goes too, unless it was trained to persist.
    pub fn reset(&mut self, metadata: &PolicyMetadata<'_>) {
        self.history = [[0.0; ACTION_LIMIT]; KEPT_ACTIONS];
        self.integral = Vector3::new(0.0, 0.0, 0.0);
        match metadata.action.persistence() {
            Persistence::ResetEachEpisode => self.memory = ControlMemory::new(),
            Persistence::Persist => {}
        }
    }

    /// What the policy acts on, once every control period: `state` on the way to `setpoint`, and what sensors measured, in the
    /// order and the scales of its training (zeros where there are too few).
    pub fn observe(
        &mut self,
        metadata: &PolicyMetadata<'_>,
        measurements: &[f32],
        state: &State<f32>,
        setpoint: &Setpoint<f32>,
    ) -> &[f32] {
        let (layout, goal) = (&metadata.observation, &setpoint.position);
        self.integral = layout.integrate(&self.integral, state, goal, metadata.control_period_secs);
        let input = ObservationInput {
            state,
            angular_velocity_in_world: state.world_from_body.rotate(state.body_rates),
            goal,
            heading: facing(layout, setpoint.yaw),
            integral: &self.integral,
            history: &self.history,
            measurements,
        };
        layout.encode(&input, &mut self.observation);
        self.observation(metadata)
    }

    /// What the policy acted on last.
    pub fn observation(&self, metadata: &PolicyMetadata<'_>) -> &[f32] {
        self.observation.get(..metadata.observation.len()).unwrap_or_default()
    }

    /// Remembers `action`, in \[-1, 1\], and turns it into rotor targets \[rad/s\], within zero and the greatest rotor speed.
    pub fn rotor_targets(
        &mut self,
        metadata: &PolicyMetadata<'_>,
        action: [f32; ACTION_LIMIT],
        state: &State<f32>,
        setpoint: &Setpoint<f32>,
    ) -> [f32; 4] {
        self.remember(metadata, action);
        let secs = metadata.control_period_secs;
        let targets = self.controls.rotor_targets(&action, state, setpoint, &mut self.memory, secs);
        let targets = within_limits(metadata, targets);
        if let Some(rate_loop) = RateLoop::of(&metadata.action) {
            self.held = rate_loop.held(&targets, &state.body_rates);
        }
        targets
    }

    /// Rotor targets \[rad/s\] of the last action at other body rates \[rad/s\]; nothing where the action space has no rate
    /// loop.
    pub fn follow_rates(&self, metadata: &PolicyMetadata<'_>, body_rates: &Vector3<f32>) -> Option<[f32; 4]> {
        RateLoop::of(&metadata.action).map(|rate_loop| rate_loop.rotor_targets(&self.held, body_rates))
    }

    /// Pushes the oldest action that the layout reads out of the history.
    fn remember(&mut self, metadata: &PolicyMetadata<'_>, action: [f32; ACTION_LIMIT]) {
        let needed = metadata.observation.history_len().clamp(1, KEPT_ACTIONS);
        for index in KEPT_ACTIONS - needed..KEPT_ACTIONS - 1 {
            self.history[index] = self.history[index + 1];
        }
        self.history[KEPT_ACTIONS - 1] = action;
    }

    /// The last action, as many values as the action space has.
    pub fn previous_action(&self, metadata: &PolicyMetadata<'_>) -> &[f32] {
        self.history[KEPT_ACTIONS - 1].get(..metadata.action.len()).unwrap_or_default()
    }
}

/// Where the nose should point, x and y in the world; forward where the layout does not show it.
fn facing(layout: &ObservationLayout, yaw: f32) -> [f32; 2] {
    if !layout.shows_heading() {
        return [1.0, 0.0];
    }
    let turns = (yaw / core::f32::consts::TAU + 0.5_f32.copysign(yaw)) as i32;
    let [sine, cosine] = sin_cos_of_half_turn(yaw - turns as f32 * core::f32::consts::TAU);
    [cosine, sine]
}

/// The reference's actions know no limit; rotors do.
fn within_limits(metadata: &PolicyMetadata<'_>, targets: [f32; 4]) -> [f32; 4] {
    match &metadata.action {
        ActionSpace::RotorSpeeds(_)
        | ActionSpace::ThrustBodyRates(_)
        | ActionSpace::RateLoop(_)
        | ActionSpace::Velocities(_)
        | ActionSpace::IntegralVelocities(_)
        | ActionSpace::RotorThrusts(_)
        | ActionSpace::ThrustTorques(_) => targets,
        ActionSpace::Reference(space) => targets.map(|target| target.limited(0.0, space.rotor_speed_limit())),
    }
}
