//! What share of its thrust each rotor really makes, learned in flight: worn motors and propellers, a load, a battery that sags.
//!
//! A policy is made for the drone that it was trained with, and so is the controller behind its actions. What they ask
//! of each rotor is compared with what the drone does, once every control period:
//!
//! ```text
//! d₀' = d₀ + κ (a_z / g − Σ fᵢ / 4)                specific force along body z, and the thrust that rotors should make
//! d_p' = d_p − κ Σ pᵢfᵢ / Σ pᵢ²                    p: roll, pitch, yaw; over seconds the torques of a drone that flies are zero
//! sᵢ = 1 + Σ d_p pᵢ      fᵢ = sᵢ Ωᵢ² / Ω_h²        κ = (period / 2 s) / (1 + (speed / 0.5 m/s)²)²
//! ```
//!
//! with the rotor speeds Ω that were commanded, `Ω_h` where the drone hovers, and what each rotor does to lift, roll, pitch
//! and yaw, one at most (p). A controller's targets u then become Ωᵢ² = uᵢ² / sᵢ. Neither inertia nor the length of the
//! levers is needed, nor how much torque a rotor has about z. The policy stays as it is: what has changed is the drone,
//! and there is nothing that it could forget. Adaptive control allocation by the effectiveness of actuators, as Smeur, Chu and de Croon 2016 ("Adaptive
//! incremental nonlinear dynamic inversion for attitude control of micro air vehicles") identify it by least mean squares.
//!
//! The air turns a drone as well: the faster it is, the less is learned. In steep flight nothing is, and neither on the
//! ground, where rotors idle. 104 bytes; never panics.

use nalgebra::Vector3;

use crate::airframe::GRAVITY;
use crate::policy_file::PolicyAirframe;
use crate::real::Real;
use crate::vehicle::State;

/// Least and greatest share of its thrust that a rotor is believed to make.
pub const SHARES: [f32; 2] = [0.4, 1.3];

/// In which it comes two thirds of the way \[s\].
const LEARNING_SECS: f32 = 2.0;

/// Thrust of a drone that flies, as a share of its weight.
const FLYING: core::ops::Range<f32> = 0.4..1.8;

/// Cosine of the greatest tilt in which it learns: 37 degrees.
const LEAST_UPRIGHT: f32 = 0.8;

/// Body rate up to which it learns \[rad/s\].
const BODY_RATE_LIMIT: f32 = 3.0;

/// Speed at which it learns a quarter as fast, and at twice of it a twenty-fifth \[m/s\]: what the air does to a faster drone
/// would be taken for its rotors.
const SLOW: f32 = 0.5;

/// Greatest part of the weight that one control period may seem to lack.
const RESIDUAL_LIMIT: f32 = 0.5;

/// Squared speed, as a share of the greatest, below which no rotor is slowed down for others: a stopped one comes back late.
const IDLE: f32 = 0.02;

/// Lift, roll, pitch and yaw.
const PATTERNS: usize = 4;

/// The shares of the thrust that the rotors of one drone make, and what makes up for them.
#[derive(Clone, Debug, PartialEq)]
pub struct RotorEffectiveness {
    /// What each rotor does to roll, pitch and yaw; to lift each does one.
    patterns: [[f32; 4]; PATTERNS - 1],
    /// How far the drone is from the one that it should be, by pattern.
    deviations: [f32; PATTERNS],
    /// Squared rotor speed of hovering \[rad²/s²\], and the greatest.
    hover_speed_squared: f32,
    speed_squared_limit: f32,
    /// Of the last control period: velocity \[m/s, world\], and squared speeds that were commanded, as shares of hovering.
    last: Option<(Vector3<f32>, [f32; 4])>,
}

impl RotorEffectiveness {
    /// Nothing is known yet: every rotor makes what it should. The squared rotor speed of hovering is in rad²/s², the greatest
    /// speed in rad/s.
    pub fn new(airframe: &PolicyAirframe, hover_speed_squared: f32, speed_limit: f32) -> Self {
        Self {
            patterns: [
                pattern(airframe.rotor_positions.map(|[_, y]| y)),
                pattern(airframe.rotor_positions.map(|[x, _]| -x)),
                pattern(airframe.torque_per_thrust),
            ],
            deviations: [0.0; PATTERNS],
            hover_speed_squared,
            speed_squared_limit: speed_limit * speed_limit,
            last: None,
        }
    }

    /// What share of its thrust each rotor makes, within [`SHARES`].
    #[inline(never)]
    pub fn shares(&self) -> [f32; 4] {
        let [lift, turns @ ..] = self.deviations;
        core::array::from_fn(|rotor| {
            let turning = self.patterns.iter().zip(turns).map(|(pattern, deviation)| deviation * pattern[rotor]);
            turning.fold(1.0 + lift, |share, part| share + part).limited(SHARES[0], SHARES[1])
        })
    }

    /// Forgets what it has learned.
    pub fn reset(&mut self) {
        self.deviations = [0.0; PATTERNS];
        self.last = None;
    }

    /// The next control period does not follow the last: somebody else has flown in between, or nobody.
    pub fn pause(&mut self) {
        self.last = None;
    }

    /// Learns from the control period before this `state`, in which the rotor speeds of the last call were commanded, and
    /// remembers the `commanded` ones of now \[rad/s\], which may be [`Self::compensated`]. Values that are not finite teach
    /// nothing.
    pub fn learn(&mut self, state: &State<f32>, commanded: &[f32; 4], secs: f32) {
        let commanded = commanded.map(|speed| speed * speed / self.hover_speed_squared);
        let Some((velocity, commanded)) = self.last.replace((state.velocity, commanded)) else { return };
        let shares = self.shares();
        let thrusts: [f32; 4] = core::array::from_fn(|rotor| shares[rotor] * commanded[rotor]);
        let up = state.world_from_body.rotate(Vector3::new(0.0, 0.0, 1.0));
        let [p, q, r] = state.body_rates.into();
        let lift = 0.25 * ((thrusts[0] + thrusts[1]) + (thrusts[2] + thrusts[3]));
        let is_calm = (p * p + q * q) + r * r < BODY_RATE_LIMIT * BODY_RATE_LIMIT;
        let change = Vector3::new(
            (state.velocity.x - velocity.x) / secs,
            (state.velocity.y - velocity.y) / secs,
            (state.velocity.z - velocity.z) / secs + GRAVITY as f32,
        );
        let made = ((change.x * up.x + change.y * up.y) + change.z * up.z) / GRAVITY as f32;
        let is_instructive = FLYING.contains(&lift) && up.z > LEAST_UPRIGHT && is_calm && made.is_finite();
        if !is_instructive {
            return;
        }
        let [x, y, z] = velocity.into();
        let slowness = SLOW * SLOW / (SLOW * SLOW + ((x * x + y * y) + z * z));
        let gain = slowness * slowness * secs / LEARNING_SECS;
        let lacking = |pattern: &[f32; 4]| {
            let [a, b, c, d] = core::array::from_fn(|rotor| pattern[rotor] * thrusts[rotor]);
            let [w, x, y, z] = pattern.map(|part| part * part);
            -((a + b) + (c + d)) / ((w + x) + (y + z)).at_least(1.0)
        };
        let [roll, pitch, yaw] = &self.patterns;
        let residuals = [made - lift, lacking(roll), lacking(pitch), lacking(yaw)];
        for (deviation, residual) in self.deviations.iter_mut().zip(residuals) {
            let residual = residual.limited(-RESIDUAL_LIMIT, RESIDUAL_LIMIT);
            *deviation = (*deviation + gain * residual).limited(SHARES[0] - 1.0, SHARES[1] - 1.0);
        }
    }

    /// Rotor targets \[rad/s\] with which the drone does what `targets` would do to the one that it should be. What a rotor
    /// cannot make is taken from all alike, so that the drone sinks and does not tip over.
    #[inline(never)]
    pub fn compensated(&self, targets: &[f32; 4]) -> [f32; 4] {
        let shares = self.shares();
        let wanted: [f32; 4] = core::array::from_fn(|rotor| targets[rotor] * targets[rotor] / shares[rotor]);
        let excess =
            wanted.iter().fold(0.0_f32, |excess, squared| excess.at_least(squared - self.speed_squared_limit));
        let idle = IDLE * self.speed_squared_limit;
        wanted.map(|squared| {
            let left = (squared - excess).at_least(squared.at_most(idle));
            left.limited(0.0, self.speed_squared_limit).sqrt()
        })
    }
}

/// Levers as shares of the longest.
fn pattern(levers: [f32; 4]) -> [f32; 4] {
    let longest = levers.iter().fold(0.0_f32, |longest, lever| longest.at_least(lever.abs()));
    let per_longest = if longest > 0.0 { 1.0 / longest } else { 0.0 };
    levers.map(|lever| lever * per_longest)
}

#[cfg(test)]
mod tests;
