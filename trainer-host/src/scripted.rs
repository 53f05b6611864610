//! A pilot written by hand: the baseline that a trained policy has to beat.

use kestrel_core::action::{ACTION_LEN, ActionSpace, ThrustBodyRates};
use kestrel_core::airframe::{Airframe, GRAVITY};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

/// Stiffness and damping of the position loop \[1/s², 1/s\]: critically damped at 2.5 rad/s, slow beside the
/// attitude loop.
const POSITION_GAIN: f32 = 6.0;
const VELOCITY_GAIN: f32 = 5.0;
/// Body rate per attitude error \[1/s\], about a third of the rate loop's bandwidth.
const ATTITUDE_GAIN: f32 = 8.0;
/// Angular acceleration per body-rate error \[1/s\], what rotors with 70 ms lag can follow.
const RATE_GAINS: [f32; 3] = [22.0, 22.0, 8.0];
/// Greatest acceleration that the position loop asks for \[m/s²\].
const ACCELERATION_LIMIT: f32 = 5.0;

/// Geometric tracking control (after Lee, Leok and McClamroch 2010) through the rate controller of the core.
#[derive(Clone, Copy, Debug)]
pub struct ScriptedPilot {
    action: ActionSpace,
    rates: ThrustBodyRates,
}

impl ScriptedPilot {
    /// A pilot for `airframe` that acts through `action`.
    pub fn new(airframe: &Airframe, action: ActionSpace) -> Self {
        let reserve = airframe.thrust_limit() / (airframe.mass * GRAVITY) - 1.0;
        Self { action, rates: ThrustBodyRates::new(airframe, reserve as f32, [6.0, 6.0, 3.0], RATE_GAINS) }
    }

    /// The action that flies `state` towards `goal` \[m, world\], each value within \[-1, 1\].
    pub fn act(&self, state: &State<f32>, goal: &Vector3<f32>) -> [f32; ACTION_LEN] {
        let (thrust_share, rates) = track(state, goal);
        match &self.action {
            ActionSpace::RotorSpeeds(space) => {
                let commands = normalised(&self.rates, thrust_share, &rates);
                let targets = ActionSpace::ThrustBodyRates(self.rates).rotor_targets(&commands, &state.body_rates);
                targets.map(|target| ((target / space.hover_rotor_speed - 1.0) / space.fraction).clamp(-1.0, 1.0))
            }
            ActionSpace::ThrustBodyRates(space) => normalised(space, thrust_share, &rates),
        }
    }
}

/// Thrust and body rates as an action.
fn normalised(space: &ThrustBodyRates, thrust_share: f32, rates: &Vector3<f32>) -> [f32; ACTION_LEN] {
    let [x, y, z] = core::array::from_fn(|axis| rates[axis] / space.body_rates_limit[axis]);
    [(thrust_share - 1.0) / space.thrust_fraction, x, y, z].map(|value| value.clamp(-1.0, 1.0))
}

/// Thrust relative to hover and wanted body rates \[rad/s\].
fn track(state: &State<f32>, goal: &Vector3<f32>) -> (f32, Vector3<f32>) {
    let gravity = GRAVITY as f32;
    let wish = (goal - state.position) * POSITION_GAIN - state.velocity * VELOCITY_GAIN;
    let wish = wish * (ACCELERATION_LIMIT / wish.norm().max(ACCELERATION_LIMIT));
    let push = wish + Vector3::new(0.0, 0.0, gravity);
    let body_z = state.world_from_body.body_z();
    let turn = state.world_from_body.rotate_inverse(body_z.cross(&push.normalize()));
    // Upside down the cross product vanishes: full rate about any axis gets out of there.
    let behind = if body_z.dot(&push) < 0.0 { turn.normalize() } else { turn };
    let share = (push.dot(&body_z) / gravity).max(0.0);
    (share, behind * ATTITUDE_GAIN)
}
