//! The vehicle: a rigid body on four rotors, written once for every number type.
//!
//! World frame: x forward, y left, z up. Body frame: x forward, y left, z up (along the thrust).
//! With mass m, inertia J (diagonal), rotor speeds Ωᵢ, thrust axis b₃ = R e₃ and air velocity u:
//!
//! ```text
//! ṗ = v
//! m v̇ = b₃ k_f Σ Ωᵢ² (1 + ground effect) − m g e₃ − ΣΩᵢ [c_xy w + (c_z − c_xy)(b₃·w) b₃] + f,   w = v − u
//! q̇ = ½ q ⊗ (0, ω)
//! J ω̇ = τ − ω × J ω,   τ_x = Σ yᵢ Fᵢ,  τ_y = −Σ xᵢ Fᵢ,  τ_z = k_m Σ sᵢ Ωᵢ²
//! Ω̇ᵢ = (Ωᵢ* − Ωᵢ) / T,   T = rise or fall time constant
//! ```
//!
//! A drone whose [`FlightEffects`] are known has besides, with w in body axes,
//!
//! ```text
//! m v̇ += −c_b |w| w
//! J ω̇ += c_f ΣΩᵢ (w_y, −w_x, 0) − D ω + J_r [Σ sᵢ Ω̇ᵢ e₃ + ω × e₃ Σ sᵢ Ωᵢ]
//! Ωᵢ* becomes Ωᵢ* (b − c_s ΣΩᵢ²)
//! ```
//!
//! (Mahony, Kumar & Corke 2012, eqs. 1–8; rotor drag after Förster 2015.) A ceiling at a distance d above a rotor of radius
//! R multiplies its thrust by ½ + ½ √(1 + R² / 8d²) (momentum theory, Hsiao & Chirarattananon 2019).

use nalgebra::Vector3;

use crate::airframe::{Airframe, FlightEffects, GRAVITY, Layout};
use crate::attitude::Attitude;
use crate::real::Real;

/// Where a drone is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<R> {
    /// Centre of mass \[m\], world.
    pub position: Vector3<R>,
    /// Attitude, unit quaternion.
    pub world_from_body: Attitude<R>,
    /// Linear velocity \[m/s\], world.
    pub velocity: Vector3<R>,
    /// Angular velocity \[rad/s\], body.
    pub body_rates: Vector3<R>,
    /// Rotor speeds \[rad/s\].
    pub rotor_speeds: [R; 4],
}

impl<R: Real> State<R> {
    /// The same state in another number type.
    #[inline(always)]
    pub fn map<S: Real>(&self, convert: impl Fn(R) -> S + Copy) -> State<S> {
        State {
            position: self.position.map(convert),
            world_from_body: self.world_from_body.map(convert),
            velocity: self.velocity.map(convert),
            body_rates: self.body_rates.map(convert),
            rotor_speeds: self.rotor_speeds.map(convert),
        }
    }

    /// The same state, tumbling no faster than [`BODY_RATE_LIMIT`]: for drones that nobody takes away after a crash. The
    /// model has no air that slows a rotation down, and steps of time follow no faster one.
    #[must_use]
    pub fn tumbling_within_limit(mut self) -> Self {
        let limit = R::from_f64(BODY_RATE_LIMIT);
        let [p, q, r] = [self.body_rates.x, self.body_rates.y, self.body_rates.z];
        let rate = (p * p + q * q + r * r).sqrt();
        if rate > limit {
            self.body_rates = self.body_rates.map(|rate_of_axis| rate_of_axis * (limit / rate));
        }
        self
    }
}

/// Sixteen turns in a second \[rad/s\], three times what gyroscopes measure.
pub const BODY_RATE_LIMIT: f64 = 100.0;

/// Time derivative of a [`State`].
#[derive(Clone, Copy, Debug)]
pub struct Derivative<R> {
    /// \[m/s\], world.
    pub position: Vector3<R>,
    /// Of the quaternion \[1/s\].
    pub world_from_body: Attitude<R>,
    /// \[m/s²\], world.
    pub velocity: Vector3<R>,
    /// \[rad/s²\], body.
    pub body_rates: Vector3<R>,
    /// \[rad/s²\].
    pub rotor_speeds: [R; 4],
}

/// The air around a drone and what else pushes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air<R> {
    /// Wind velocity \[m/s\], world.
    pub wind: Vector3<R>,
    /// Any other force on the centre of mass \[N\], world: downwash of other drones, a gust, a tether.
    pub force: Vector3<R>,
    /// Whether the ground at z = 0 cushions the rotors.
    pub ground: Ground,
    /// Height of a ceiling that pulls the rotors up \[m\], where there is one near.
    pub ceiling: Option<R>,
}

/// Whether the drone feels the floor below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ground {
    /// Far below: no ground effect.
    Distant,
    /// At z = 0: thrust grows as (R / 4h)² near it (Shi et al. 2019, as in gym-pybullet-drones).
    Near,
}

/// An [`Airframe`] ready for arithmetic, with mass and inertia folded into every gain.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vehicle<R> {
    /// Reciprocal of the mass \[1/kg\].
    pub inverse_mass: R,
    /// Acceleration per squared rotor speed \[m/rad²\].
    pub thrust_gain: R,
    /// Angular acceleration about body x, y, z per squared rotor speed of one rotor of the clockwise order \[1/rad\].
    pub turning_gains: Vector3<R>,
    /// `(J_y − J_z) / J_x` and its cyclic companions.
    pub gyroscopic: Vector3<R>,
    /// Greatest rotor speed \[rad/s\].
    pub rotor_speed_limit: R,
    /// Reciprocal time constant of a rotor that speeds up \[1/s\].
    pub rotor_rise_rate: R,
    /// Reciprocal time constant of a rotor that slows down \[1/s\].
    pub rotor_fall_rate: R,
    /// Deceleration along body x and y per speed and summed rotor speed \[1/rad\].
    pub planar_drag: R,
    /// What drag along body z adds to [`Self::planar_drag`] \[1/rad\].
    pub extra_axial_drag: R,
    /// Where the rotors are, body \[m\].
    pub rotor_positions: [[R; 2]; 4],
    /// One if all four rotors turn the body about x and y (cross), zero if only two do (plus).
    pub diagonal: R,
    /// Squared quarter radius times the ground-effect coefficient \[m²\].
    pub ground_effect: R,
    /// Height below which the ground effect grows no further \[m\].
    pub ground_effect_floor: R,
    /// Squared propeller radius over eight \[m²\].
    pub ceiling_effect: R,
    /// What a real drone has beside; `None` where its airframe has none of it, and nothing is computed.
    pub effects: Option<EffectGains<R>>,
}

/// [`FlightEffects`] over mass and inertia.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectGains<R> {
    /// Angular acceleration about body x and y per air speed and summed rotor speed \[1/(m rad)\].
    pub flapping: [R; 2],
    /// Angular deceleration per body rate \[1/s\].
    pub rate_damping: Vector3<R>,
    /// Inertia of a rotor over the drone's about each body axis; negative where the first rotor turns clockwise.
    pub rotor_inertia: Vector3<R>,
    /// Deceleration per squared air speed \[1/m\].
    pub body_drag: R,
    /// Thrust of each rotor over that of the airframe: one, but for motors that differ.
    pub rotor_thrusts: [R; 4],
    /// Share of a commanded rotor speed that an unloaded battery reaches: one when it is full.
    pub battery: R,
    /// What the load takes of that share, per summed squared rotor speed \[s²/rad²\]; `None` where it takes nothing, and
    /// nothing is computed.
    pub battery_sag: Option<R>,
}

impl<R: Real> Vehicle<R> {
    /// The vehicle of an airframe.
    #[inline(always)]
    pub fn new(airframe: &Airframe) -> Self {
        let real = R::from_f64;
        let [jx, jy, jz] = airframe.inertia;
        let thrust = airframe.thrust_coefficient;
        let (arm_x, arm_y, diagonal) = match airframe.layout {
            Layout::Cross { x, y } => (x, y, 1.0),
            Layout::Plus { arm } => (arm, arm, 0.0),
        };
        let quarter_radius = 0.25 * airframe.propeller_radius;
        // The reference limits the height where the added thrust would pass 4/15 of the greatest thrust.
        let floor = quarter_radius * libm::sqrt(15.0 * airframe.ground_effect_coefficient / 4.0);
        let drag = airframe.drag_coefficients;
        Self {
            inverse_mass: real(1.0 / airframe.mass),
            thrust_gain: real(thrust / airframe.mass),
            turning_gains: Vector3::new(
                real(airframe.rotor_order.side() * (thrust * arm_y / jx)),
                real(thrust * arm_x / jy),
                real(airframe.torque_coefficient / jz),
            ),
            gyroscopic: Vector3::new(real((jy - jz) / jx), real((jz - jx) / jy), real((jx - jy) / jz)),
            rotor_speed_limit: real(airframe.rotor_speed_limit),
            rotor_rise_rate: real(1.0 / airframe.rotor_rise_secs),
            rotor_fall_rate: real(1.0 / airframe.rotor_fall_secs),
            planar_drag: real(drag.planar / airframe.mass),
            extra_axial_drag: real((drag.axial - drag.planar) / airframe.mass),
            rotor_positions: airframe.rotor_positions().map(|position| position.map(real)),
            diagonal: real(diagonal),
            ground_effect: real(airframe.ground_effect_coefficient * quarter_radius * quarter_radius),
            ground_effect_floor: real(floor),
            ceiling_effect: real(airframe.propeller_radius * airframe.propeller_radius / 8.0),
            effects: (airframe.effects != FlightEffects::NONE).then(|| EffectGains::new(airframe)),
        }
    }

    /// Rotor accelerations \[rad/s²\] towards their target speeds \[rad/s\].
    #[inline(always)]
    pub fn rotor_accelerations(&self, rotor_speeds: &[R; 4], targets: &[R; 4]) -> [R; 4] {
        let share = self.effects.as_ref().map(|effects| effects.battery_share(rotor_speeds));
        core::array::from_fn(|i| {
            let missing = share.map_or(targets[i], |share| targets[i] * share) - rotor_speeds[i];
            missing * R::zero().where_less(missing, self.rotor_rise_rate, self.rotor_fall_rate)
        })
    }

    /// Linear \[m/s², world\] and angular \[rad/s², body\] acceleration while the rotors' speeds change by `spin_up`
    /// \[rad/s²\].
    #[inline(always)]
    pub fn accelerations(&self, state: &State<R>, spin_up: &[R; 4], air: &Air<R>) -> (Vector3<R>, Vector3<R>) {
        let squares = self.squared_speeds(state, air);
        let body_z = state.world_from_body.body_z();
        let drag = self.drag(state, &body_z, air);
        let along_z = ((squares[0] + squares[1]) + (squares[2] + squares[3])) * self.thrust_gain - drag.axial;
        let push = |body_z: R, force: R, air_speed: R| {
            body_z * along_z + (force * self.inverse_mass - drag.planar * air_speed)
        };
        let linear = Vector3::new(
            push(body_z.x, air.force.x, drag.air_velocity.x),
            push(body_z.y, air.force.y, drag.air_velocity.y),
            push(body_z.z, air.force.z, drag.air_velocity.z) - R::from_f64(GRAVITY),
        );
        let mut angular = self.angular_acceleration(&state.body_rates, &squares);
        if let Some(effects) = &self.effects {
            angular += effects.angular_acceleration(state, spin_up, &drag.air_velocity);
        }
        (linear, angular)
    }

    /// Time derivative of the whole state.
    #[inline(always)]
    pub fn derivative(&self, state: &State<R>, rotor_targets: &[R; 4], air: &Air<R>) -> Derivative<R> {
        let rotor_speeds = self.rotor_accelerations(&state.rotor_speeds, rotor_targets);
        let (velocity, body_rates) = self.accelerations(state, &rotor_speeds, air);
        Derivative {
            position: state.velocity,
            world_from_body: state.world_from_body.derivative(state.body_rates),
            velocity,
            body_rates,
            rotor_speeds,
        }
    }

    /// Squared rotor speeds \[rad²/s²\], raised by what floor and ceiling add.
    #[inline(always)]
    fn squared_speeds(&self, state: &State<R>, air: &Air<R>) -> [R; 4] {
        let mut squares = state.rotor_speeds.map(|speed| speed * speed);
        if let Some(effects) = &self.effects {
            squares = core::array::from_fn(|rotor| squares[rotor] * effects.rotor_thrusts[rotor]);
        }
        if air.ground == Ground::Near {
            squares = self.cushioned(state, squares);
        }
        air.ceiling.map_or(squares, |ceiling| self.pulled(state, squares, ceiling))
    }

    /// The ground effect of a floor at z = 0, rotor by rotor, none beyond a tilt of 90°.
    #[inline(always)]
    fn cushioned(&self, state: &State<R>, squares: [R; 4]) -> [R; 4] {
        let [_, _, [from_x, from_y, up]] = state.world_from_body.rows();
        core::array::from_fn(|i| {
            let [x, y] = self.rotor_positions[i];
            let height = (state.position.z + (from_x * x + from_y * y)).at_least(self.ground_effect_floor);
            let gain = self.ground_effect / (height * height);
            squares[i] + squares[i] * up.where_less(R::zero(), R::zero(), gain)
        })
    }

    /// The ceiling effect, rotor by rotor, none beyond a tilt of 90°; it grows no further where the distance is a quarter of
    /// the radius.
    #[inline(always)]
    fn pulled(&self, state: &State<R>, squares: [R; 4], ceiling: R) -> [R; 4] {
        let [_, _, [from_x, from_y, up]] = state.world_from_body.rows();
        let (half, nearest) = (R::from_f64(0.5), self.ceiling_effect * R::from_f64(0.5));
        core::array::from_fn(|i| {
            let [x, y] = self.rotor_positions[i];
            let distance = (ceiling - (state.position.z + (from_x * x + from_y * y))).at_least(R::zero());
            let gain =
                half * (R::one() + self.ceiling_effect / (distance * distance).at_least(nearest)).sqrt() - half;
            squares[i] + squares[i] * up.where_less(R::zero(), R::zero(), gain)
        })
    }

    /// Rotor drag: its part along body z as a deceleration \[m/s²\], the rest as a rate \[1/s\] on the air velocity.
    #[inline(always)]
    fn drag(&self, state: &State<R>, body_z: &Vector3<R>, air: &Air<R>) -> Drag<R> {
        let [a, b, c, d] = state.rotor_speeds;
        let summed_speed = (a + b) + (c + d);
        let (velocity, wind) = (&state.velocity, &air.wind);
        let air_velocity = Vector3::new(velocity.x - wind.x, velocity.y - wind.y, velocity.z - wind.z);
        let along = (body_z.x * air_velocity.x + body_z.y * air_velocity.y) + body_z.z * air_velocity.z;
        let mut planar = self.planar_drag * summed_speed;
        if let Some(effects) = &self.effects {
            planar += effects.body_drag * length(&air_velocity);
        }
        Drag { planar, axial: self.extra_axial_drag * summed_speed * along, air_velocity }
    }

    /// Euler's equation for a diagonal inertia \[rad/s²\].
    #[inline(always)]
    fn angular_acceleration(&self, rates: &Vector3<R>, squares: &[R; 4]) -> Vector3<R> {
        let [first, second, third, fourth] = *squares;
        let roll = (third * self.diagonal + fourth) - (first * self.diagonal + second);
        let pitch = (second * self.diagonal + third) - (fourth * self.diagonal + first);
        let yaw = (second + fourth) - (first + third);
        let (gain, gyroscopic) = (&self.turning_gains, &self.gyroscopic);
        Vector3::new(
            roll * gain.x + gyroscopic.x * (rates.y * rates.z),
            pitch * gain.y + gyroscopic.y * (rates.z * rates.x),
            yaw * gain.z + gyroscopic.z * (rates.x * rates.y),
        )
    }
}

impl<R: Real> EffectGains<R> {
    /// The gains of an airframe with equal motors.
    #[inline(always)]
    pub fn new(airframe: &Airframe) -> Self {
        let real = R::from_f64;
        let (effects, [jx, jy, jz]) = (&airframe.effects, airframe.inertia);
        let [dx, dy, dz] = effects.rate_damping;
        let rotor = libm::copysign(effects.rotor_inertia, airframe.torque_coefficient);
        Self {
            flapping: [real(effects.flapping_moment / jx), real(effects.flapping_moment / jy)],
            rate_damping: Vector3::new(real(dx / jx), real(dy / jy), real(dz / jz)),
            rotor_inertia: Vector3::new(real(rotor / jx), real(rotor / jy), real(rotor / jz)),
            body_drag: real(effects.body_drag / airframe.mass),
            rotor_thrusts: [R::one(); 4],
            battery: R::one(),
            battery_sag: (effects.battery_sag != 0.0).then(|| {
                real(effects.battery_sag / (4.0 * airframe.rotor_speed_limit * airframe.rotor_speed_limit))
            }),
        }
    }

    /// Share of a commanded rotor speed that the battery reaches under the load of these rotor speeds \[rad/s\].
    #[inline(always)]
    fn battery_share(&self, rotor_speeds: &[R; 4]) -> R {
        let Some(sag) = self.battery_sag else { return self.battery };
        let [a, b, c, d] = rotor_speeds.map(|speed| speed * speed);
        self.battery - sag * ((a + b) + (c + d))
    }

    /// What they add to Euler's equation \[rad/s²\]; `air_velocity` \[m/s\] is that of the drone in the air, world.
    #[inline(always)]
    fn angular_acceleration(&self, state: &State<R>, spin_up: &[R; 4], air_velocity: &Vector3<R>) -> Vector3<R> {
        let [air_x, air_y] = state.world_from_body.planar_in_body(air_velocity);
        let ([a, b, c, d], rates) = (state.rotor_speeds, &state.body_rates);
        let summed_speed = (a + b) + (c + d);
        let momentum = (b + d) - (a + c);
        let reaction = (spin_up[1] + spin_up[3]) - (spin_up[0] + spin_up[2]);
        let [flapping_x, flapping_y] = self.flapping.map(|gain| gain * summed_speed);
        let (damping, rotor) = (&self.rate_damping, &self.rotor_inertia);
        Vector3::new(
            flapping_x * air_y - damping.x * rates.x + rotor.x * (rates.y * momentum),
            -(flapping_y * air_x) - damping.y * rates.y - rotor.y * (rates.x * momentum),
            rotor.z * reaction - damping.z * rates.z,
        )
    }
}

#[inline(always)]
fn length<R: Real>(vector: &Vector3<R>) -> R {
    ((vector.x * vector.x + vector.y * vector.y) + vector.z * vector.z).sqrt()
}

/// Rotor drag in the two parts that the model needs.
struct Drag<R> {
    planar: R,
    axial: R,
    air_velocity: Vector3<R>,
}

impl<R: Real> Air<R> {
    /// No wind, no force, no ground, no ceiling.
    #[inline(always)]
    pub fn still() -> Self {
        let nothing = Vector3::new(R::zero(), R::zero(), R::zero());
        Self { wind: nothing, force: nothing, ground: Ground::Distant, ceiling: None }
    }
}
