//! A pilot written by hand: the baseline that a trained policy has to beat.

use kestrel_core::action::{ACTION_LEN, ActionSpace, ThrustBodyRates};
use kestrel_core::airframe::{Airframe, GRAVITY};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

/// Gains of the position loop \[1/s³, 1/s², 1/s\]: the best of five sets on the hover task; faster loops meet the
/// rotors' lag and oscillate.
const INTEGRAL_GAIN: f32 = 3.0;
const POSITION_GAIN: f32 = 6.0;
const VELOCITY_GAIN: f32 = 4.5;
/// Greatest acceleration that the integral may ask for, against wind and a wrong mass \[m/s²\].
const INTEGRAL_LIMIT: f32 = 3.0;
/// Errors count in the integral only this close to the goal, so that a long way does not wind it up \[m\].
const INTEGRAL_RANGE_M: f32 = 0.3;
/// Farther goals pull no harder than this \[m\], which limits the speed to 1.1 m/s.
const LEASH_M: f32 = 0.8;
/// Body rate per attitude error \[1/s\].
const ATTITUDE_GAIN: f32 = 6.0;
/// Angular acceleration per body-rate error \[1/s\], as in the example experiments.
const RATE_GAINS: [f32; 3] = [16.0, 16.0, 6.0];
/// Greatest acceleration that the position loop asks for \[m/s²\].
const ACCELERATION_LIMIT: f32 = 5.0;

/// Geometric tracking control (after Lee, Leok and McClamroch 2010) through the rate controller of the core.
#[derive(Clone, Copy, Debug)]
pub struct ScriptedPilot {
    action: ActionSpace,
    rates: ThrustBodyRates,
    control_secs: f32,
    /// Acceleration \[m/s²\] that the integral of the error asks for, world.
    integral: Vector3<f32>,
}

impl ScriptedPilot {
    /// A pilot for `airframe` that acts through `action` every `control_secs`.
    pub fn new(airframe: &Airframe, action: ActionSpace, control_secs: f32) -> Self {
        let reserve = airframe.thrust_limit() / (airframe.mass * GRAVITY) - 1.0;
        let rates = ThrustBodyRates::new(airframe, reserve as f32, [6.0, 6.0, 3.0], RATE_GAINS);
        Self { action, rates, control_secs, integral: Vector3::zeros() }
    }

    /// Forgets the integral, as at the start of an episode.
    pub fn reset(&mut self) {
        self.integral = Vector3::zeros();
    }

    /// The action that flies `state` towards `goal` \[m, world\], each value within \[-1, 1\].
    pub fn act(&mut self, state: &State<f32>, goal: &Vector3<f32>) -> [f32; ACTION_LEN] {
        let error = goal - state.position;
        if error.norm() < INTEGRAL_RANGE_M {
            self.integral += error * (INTEGRAL_GAIN * self.control_secs);
            self.integral *= INTEGRAL_LIMIT / self.integral.norm().max(INTEGRAL_LIMIT);
        }
        let (thrust_share, rates) = track(state, &error, &self.integral);
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
fn track(state: &State<f32>, error: &Vector3<f32>, integral: &Vector3<f32>) -> (f32, Vector3<f32>) {
    let gravity = GRAVITY as f32;
    let pull = error * (LEASH_M / error.norm().max(LEASH_M));
    let wish = pull * POSITION_GAIN - state.velocity * VELOCITY_GAIN;
    let wish = wish * (ACCELERATION_LIMIT / wish.norm().max(ACCELERATION_LIMIT));
    let push = wish + integral + Vector3::new(0.0, 0.0, gravity);
    let body_z = state.world_from_body.body_z();
    let turn = state.world_from_body.rotate_inverse(body_z.cross(&push.normalize()));
    // Upside down the cross product vanishes: full rate about any axis gets out of there.
    let behind = if body_z.dot(&push) < 0.0 { turn.normalize() } else { turn };
    let share = (push.dot(&body_z) / gravity).max(0.0);
    (share, behind * ATTITUDE_GAIN)
}
