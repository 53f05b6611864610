//! The reference system's physics, reproduced: gym-pybullet-drones on Bullet, one drone, one physics step.
//!
//! Bullet sees a rigid base with massless links, one per rotor. A step of the multibody modes, with the attitude R
//! at its start, the links' attitude L (R of the step before) and rotor thrusts Fᵢ = `k_f` Ωᵢ², is
//!
//! ```text
//! F = L e₃ Σ Fᵢ + ground effect + drag + downwash          (world)
//! v ← v + h (F / m − g e₃ − v (k + k |v|))                 p ← p + h v
//! ω ← ω + h J⁻¹ (τ − ω × J ω) − h ω (k + k |ω|)            (body; τ = Σ rᵢ × Rᵀ L e₃ Fᵢ + …)
//! R ← R exp(h ω)
//! ```
//!
//! DYN, the reference's own explicit model, knows no links, no damping and no disturbances. What is odd about
//! either is a field of [`Quirks`]; the `clean` physics of [`crate::vehicle`] has none of it.

mod explicit;
mod forces;
mod quirks;

use nalgebra::Vector3;

pub use quirks::{
    AttitudeUpdate, DownwashAxis, DragFrame, DragRotors, DynAttitude, DynLevers, DynReport, GroundQuery,
    LinkAttitude, Quirks, RotorPrecision,
};

use crate::airframe::{Airframe, GRAVITY, Layout};
use crate::attitude::Attitude;
use crate::real::Real;
use crate::reference::vector::{cross, length, square};
use crate::vehicle::State;

/// What acts on a drone; the names are the reference's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BulletMode {
    /// Rotors only.
    Pyb,
    /// Rotors and ground effect.
    PybGnd,
    /// Rotors and drag.
    PybDrag,
    /// Rotors and the downwash of other drones.
    PybDw,
    /// Rotors, ground effect, drag and downwash.
    PybGndDragDw,
    /// Rotors only, by the reference's explicit model instead of Bullet: no damping, no contacts.
    Dyn,
}

impl BulletMode {
    /// Whether the floor at z = 0 cushions the rotors.
    pub const fn has_ground_effect(self) -> bool {
        matches!(self, Self::PybGnd | Self::PybGndDragDw)
    }

    /// Whether the air brakes the drone.
    pub const fn has_drag(self) -> bool {
        matches!(self, Self::PybDrag | Self::PybGndDragDw)
    }

    /// Whether drones above push the drone down.
    pub const fn has_downwash(self) -> bool {
        matches!(self, Self::PybDw | Self::PybGndDragDw)
    }
}

/// An [`Airframe`] in a [`BulletMode`] with its [`Quirks`], ready for arithmetic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bullet<R> {
    /// What acts.
    pub mode: BulletMode,
    /// What is odd about it.
    pub quirks: Quirks,
    /// \[kg\].
    pub mass: R,
    /// Principal moments of inertia about body x, y, z \[kg m²\].
    pub inertia: Vector3<R>,
    /// Thrust of one rotor per squared speed \[N s²/rad²\].
    pub thrust_coefficient: R,
    /// Reaction torque of one rotor per squared speed \[N m s²/rad²\].
    pub torque_coefficient: R,
    /// Levers of the rotors `[x, y]`, body \[m\].
    pub rotor_positions: [[R; 2]; 4],
    /// Ground-effect coefficient times squared quarter radius \[m²\].
    pub ground_effect: R,
    /// Height below which the ground effect grows no further \[m\].
    pub ground_effect_floor: R,
    /// Drag force per speed and summed rotor speed along x, y, z \[N s²/(m rad)\].
    pub drag_coefficients: Vector3<R>,
    /// Downwash strength times squared quarter radius \[N m²\].
    pub downwash_strength: R,
    /// Growth of the downwash's width with depth \[m/m\].
    pub downwash_slope: R,
    /// Width of the downwash at depth zero \[m\].
    pub downwash_offset: R,
}

/// A drone between two physics steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BulletState<R> {
    /// Where the drone is and how it moves; `rotor_speeds` are those of the last physics step.
    pub motion: State<R>,
    /// Attitude that Bullet's links still have: the one before the last step.
    pub link_attitude: Attitude<R>,
    /// Angular velocity as the reference reports it \[rad/s\], world.
    pub reported_angular_velocity: Vector3<R>,
}

impl<R: Real> BulletState<R> {
    /// A drone put somewhere (loaded or reset), its links up to date.
    ///
    /// The reference forgets rotor speeds at a reset: let `motion.rotor_speeds` be zero.
    pub fn placed(motion: State<R>) -> Self {
        Self {
            motion,
            link_attitude: motion.world_from_body,
            reported_angular_velocity: motion.world_from_body.rotate(motion.body_rates),
        }
    }
}

impl<R: Real> Bullet<R> {
    /// The airframe in the mode.
    pub fn new(airframe: &Airframe, mode: BulletMode, quirks: Quirks) -> Self {
        let real = R::from_f64;
        let quarter_radius = 0.25 * airframe.propeller_radius;
        let drag = airframe.drag_coefficients;
        let floor = quarter_radius * libm::sqrt(15.0 * airframe.ground_effect_coefficient / 4.0);
        Self {
            mode,
            quirks,
            mass: real(airframe.mass),
            inertia: Vector3::from(airframe.inertia.map(real)),
            thrust_coefficient: real(airframe.thrust_coefficient),
            torque_coefficient: real(airframe.torque_coefficient),
            rotor_positions: levers(airframe, mode, &quirks).map(|position| position.map(real)),
            ground_effect: real(airframe.ground_effect_coefficient * quarter_radius * quarter_radius),
            ground_effect_floor: real(floor),
            drag_coefficients: Vector3::new(drag.planar, drag.planar, drag.axial).map(real),
            downwash_strength: real(airframe.downwash.strength * quarter_radius * quarter_radius),
            downwash_slope: real(airframe.downwash.width_slope),
            downwash_offset: real(airframe.downwash.width_offset),
        }
    }

    /// One physics step of `secs` with rotor speeds \[rad/s\] held.
    ///
    /// `swarm` holds the positions \[m, world\] of all drones at the start of the step; whether this drone is among
    /// them does not matter, for only drones above it count. Modes without downwash do not read it.
    #[inline]
    #[must_use]
    pub fn step(
        &self,
        drone: &BulletState<R>,
        rotor_speeds: &[R; 4],
        swarm: &[Vector3<R>],
        secs: R,
    ) -> BulletState<R> {
        let position = &drone.motion.position;
        let downwash = if self.mode.has_downwash() {
            swarm.iter().fold(R::zero(), |total, other| total + self.downwash(position, other))
        } else {
            R::zero()
        };
        self.step_under(drone, rotor_speeds, downwash, secs)
    }

    /// As [`Self::step`] with the summed [`Self::downwash`] of the drones above \[N\].
    #[inline(always)]
    #[must_use]
    pub fn step_under(
        &self,
        drone: &BulletState<R>,
        rotor_speeds: &[R; 4],
        downwash: R,
        secs: R,
    ) -> BulletState<R> {
        match self.mode {
            BulletMode::Dyn => self.explicit_step(drone, rotor_speeds, secs),
            BulletMode::Pyb
            | BulletMode::PybGnd
            | BulletMode::PybDrag
            | BulletMode::PybDw
            | BulletMode::PybGndDragDw => self.multibody_step(drone, rotor_speeds, downwash, secs),
        }
    }

    #[inline(always)]
    fn multibody_step(
        &self,
        drone: &BulletState<R>,
        rotor_speeds: &[R; 4],
        downwash: R,
        secs: R,
    ) -> BulletState<R> {
        let State { position, world_from_body, velocity, body_rates, .. } = drone.motion;
        let wrench = self.wrench(drone, rotor_speeds, downwash);
        let gravity = Vector3::new(R::zero(), R::zero(), R::from_f64(GRAVITY));
        let acceleration = world_from_body.rotate(wrench.force) / self.mass - gravity - self.damping(&velocity);
        let turning = self.angular_acceleration(&wrench.torque, &body_rates) - self.damping(&body_rates);
        let velocity = (velocity + acceleration * secs).map(|value| self.capped(value));
        let body_rates = self.capped_rates(&world_from_body, body_rates + turning * secs);
        let turned = self.turned(&world_from_body, &body_rates, secs);
        BulletState {
            motion: State {
                position: position + velocity * secs,
                world_from_body: turned,
                velocity,
                body_rates,
                rotor_speeds: *rotor_speeds,
            },
            link_attitude: world_from_body,
            reported_angular_velocity: turned.rotate(body_rates),
        }
    }

    /// Bullet's damping of a linear or angular velocity, per second.
    #[inline(always)]
    fn damping(&self, velocity: &Vector3<R>) -> Vector3<R> {
        let damping = R::from_f64(self.quirks.damping);
        *velocity * (damping + damping * length(velocity))
    }

    /// Euler's equation \[rad/s²\], body.
    #[inline(always)]
    fn angular_acceleration(&self, torque: &Vector3<R>, rates: &Vector3<R>) -> Vector3<R> {
        (*torque - cross(rates, &rates.component_mul(&self.inertia))).component_div(&self.inertia)
    }

    /// A world component of a velocity within the cap; NaN stays.
    #[inline(always)]
    fn capped(&self, value: R) -> R {
        let cap = R::from_f64(self.quirks.velocity_cap);
        let below = cap.where_less(value, cap, value);
        below.where_less(-cap, -cap, below)
    }

    /// Body rates whose world components are within the cap.
    #[inline(always)]
    fn capped_rates(&self, world_from_body: &Attitude<R>, body_rates: Vector3<R>) -> Vector3<R> {
        let in_world = world_from_body.rotate(body_rates);
        body_rates + world_from_body.rotate_inverse(in_world.map(|value| self.capped(value)) - in_world)
    }

    /// The attitude after `secs` of constant body rates.
    #[inline(always)]
    fn turned(&self, attitude: &Attitude<R>, body_rates: &Vector3<R>, secs: R) -> Attitude<R> {
        match self.quirks.attitude_update {
            AttitudeUpdate::ExponentialMap => self.rotated(attitude, body_rates, secs),
            AttitudeUpdate::FirstOrder => attitude.advanced(&attitude.derivative(*body_rates), secs).normalized(),
        }
    }

    /// Bullet's exponential map: beyond the cap it shortens the angle but not the axis, and then normalises.
    #[inline(always)]
    fn rotated(&self, attitude: &Attitude<R>, body_rates: &Vector3<R>, secs: R) -> Attitude<R> {
        let half = R::from_f64(0.5) * secs;
        let cap = R::from_f64(0.5 * self.quirks.rotation_cap);
        let (sinc, cosine) = sinc_cosine((square(body_rates) * half * half).at_most(cap * cap));
        let axis = *body_rates * (sinc * half);
        attitude.after(&Attitude { w: cosine, x: axis.x, y: axis.y, z: axis.z }).normalized()
    }
}

/// Levers of the rotors `[x, y]`, body \[m\].
fn levers(airframe: &Airframe, mode: BulletMode, quirks: &Quirks) -> [[f64; 2]; 4] {
    match (mode, quirks.dyn_levers) {
        (BulletMode::Dyn, DynLevers::NominalArm) => {
            Layout::with_arm(&airframe.layout, airframe.arm).rotor_positions(airframe.rotor_order)
        }
        (BulletMode::Dyn, DynLevers::RotorPositions)
        | (
            BulletMode::Pyb
            | BulletMode::PybGnd
            | BulletMode::PybDrag
            | BulletMode::PybDw
            | BulletMode::PybGndDragDw,
            _,
        ) => airframe.rotor_positions(),
    }
}

/// `sin(a) / a` and `cos(a)` of a squared angle up to π²/4, to the last bits of `f64`: ten terms of both series,
/// without a root, a division or a branch.
#[inline(always)]
fn sinc_cosine<R: Real>(angle_squared: R) -> (R, R) {
    let mut sinc = R::one();
    let mut cosine = R::one();
    for term in 0..10 {
        let even = f64::from(2 * (10 - term));
        sinc = R::one() - angle_squared * R::from_f64(1.0 / (even * (even + 1.0))) * sinc;
        cosine = R::one() - angle_squared * R::from_f64(1.0 / (even * (even - 1.0))) * cosine;
    }
    (sinc, cosine)
}

#[cfg(test)]
mod tests;
