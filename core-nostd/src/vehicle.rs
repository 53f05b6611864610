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
//! (Mahony, Kumar & Corke 2012, eqs. 1–8; rotor drag after Förster 2015.)

use nalgebra::Vector3;

use crate::airframe::{Airframe, GRAVITY};
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
}

/// Whether the drone feels the floor below it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ground {
    /// Far below: no ground effect.
    Distant,
    /// At z = 0: thrust grows as (R / 4h)² near it (Shi et al. 2019, as in gym-pybullet-drones).
    Near,
}

/// An [`Airframe`] ready for arithmetic; the fields that randomisation touches may differ from lane to lane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vehicle<R> {
    /// Reciprocal of the mass \[1/kg\].
    pub inverse_mass: R,
    /// Principal moments of inertia \[kg m²\].
    pub inertia: Vector3<R>,
    /// Their reciprocals \[1/(kg m²)\].
    pub inverse_inertia: Vector3<R>,
    /// Thrust of one rotor per squared speed \[N s²/rad²\].
    pub thrust_coefficient: R,
    /// Torque about body x, y, z \[m\] that one newton of each rotor's thrust makes.
    pub torque_arms: [[R; 4]; 3],
    /// Greatest rotor speed \[rad/s\].
    pub rotor_speed_limit: R,
    /// Reciprocal time constant of a rotor that speeds up \[1/s\].
    pub rotor_rise_rate: R,
    /// Reciprocal time constant of a rotor that slows down \[1/s\].
    pub rotor_fall_rate: R,
    /// Drag along body x and y per summed rotor speed \[N s²/(m rad)\].
    pub planar_drag: R,
    /// What drag along body z adds to [`Self::planar_drag`] \[N s²/(m rad)\].
    pub extra_axial_drag: R,
    /// Squared quarter radius times the ground-effect coefficient \[m²\].
    pub ground_effect: R,
    /// Height below which the ground effect grows no further \[m\].
    pub ground_effect_floor: R,
}

impl<R: Real> Vehicle<R> {
    /// The nominal vehicle of an airframe, equal in every lane.
    #[inline(always)]
    pub fn new(airframe: &Airframe) -> Self {
        let real = R::from_f64;
        let inertia = airframe.inertia;
        let yaw_arm = airframe.torque_coefficient / airframe.thrust_coefficient;
        let quarter_radius = 0.25 * airframe.propeller_radius;
        // The reference limits the height where the added thrust would pass 4/15 of the greatest thrust.
        let floor = quarter_radius * libm::sqrt(15.0 * airframe.ground_effect_coefficient / 4.0);
        Self {
            inverse_mass: real(1.0 / airframe.mass),
            inertia: Vector3::new(real(inertia[0]), real(inertia[1]), real(inertia[2])),
            inverse_inertia: Vector3::new(real(1.0 / inertia[0]), real(1.0 / inertia[1]), real(1.0 / inertia[2])),
            thrust_coefficient: real(airframe.thrust_coefficient),
            torque_arms: [
                airframe.rotor_positions.map(|[_, y]| real(y)),
                airframe.rotor_positions.map(|[x, _]| real(-x)),
                airframe.rotor_torque_signs.map(|sign| real(sign * yaw_arm)),
            ],
            rotor_speed_limit: real(airframe.rotor_speed_limit),
            rotor_rise_rate: real(1.0 / airframe.rotor_rise_secs),
            rotor_fall_rate: real(1.0 / airframe.rotor_fall_secs),
            planar_drag: real(airframe.drag_coefficients.planar),
            extra_axial_drag: real(airframe.drag_coefficients.axial - airframe.drag_coefficients.planar),
            ground_effect: real(airframe.ground_effect_coefficient * quarter_radius * quarter_radius),
            ground_effect_floor: real(floor),
        }
    }

    /// Rotor accelerations \[rad/s²\] towards their target speeds \[rad/s\].
    #[inline(always)]
    pub fn rotor_accelerations(&self, rotor_speeds: &[R; 4], targets: &[R; 4]) -> [R; 4] {
        core::array::from_fn(|i| {
            let rate = rotor_speeds[i].where_less(targets[i], self.rotor_rise_rate, self.rotor_fall_rate);
            (targets[i] - rotor_speeds[i]) * rate
        })
    }

    /// Linear \[m/s², world\] and angular \[rad/s², body\] acceleration.
    #[inline(always)]
    pub fn accelerations(&self, state: &State<R>, air: &Air<R>) -> (Vector3<R>, Vector3<R>) {
        let thrusts = self.thrusts(state, air.ground);
        let thrust = (thrusts[0] + thrusts[1]) + (thrusts[2] + thrusts[3]);
        let body_z = state.world_from_body.body_z();
        let drag = self.drag(state, &body_z, air);
        let linear = Vector3::new(
            (body_z.x * thrust + (air.force.x - drag.x)) * self.inverse_mass,
            (body_z.y * thrust + (air.force.y - drag.y)) * self.inverse_mass,
            (body_z.z * thrust + (air.force.z - drag.z)) * self.inverse_mass - R::from_f64(GRAVITY),
        );
        (linear, self.angular_acceleration(&state.body_rates, &thrusts))
    }

    /// Time derivative of the whole state.
    #[inline(always)]
    pub fn derivative(&self, state: &State<R>, rotor_targets: &[R; 4], air: &Air<R>) -> Derivative<R> {
        let (velocity, body_rates) = self.accelerations(state, air);
        Derivative {
            position: state.velocity,
            world_from_body: state.world_from_body.derivative(state.body_rates),
            velocity,
            body_rates,
            rotor_speeds: self.rotor_accelerations(&state.rotor_speeds, rotor_targets),
        }
    }

    /// Thrust of each rotor \[N\].
    #[inline(always)]
    fn thrusts(&self, state: &State<R>, ground: Ground) -> [R; 4] {
        let thrusts = state.rotor_speeds.map(|speed| self.thrust_coefficient * (speed * speed));
        match ground {
            Ground::Distant => thrusts,
            Ground::Near => self.cushioned(state, thrusts),
        }
    }

    /// Thrusts with the ground effect of a floor at z = 0, rotor by rotor, none beyond a tilt of 90°.
    #[inline(always)]
    fn cushioned(&self, state: &State<R>, thrusts: [R; 4]) -> [R; 4] {
        let [_, _, [to_x, to_y, up]] = state.world_from_body.rows();
        core::array::from_fn(|i| {
            // torque_arms hold y and -x of the rotor.
            let height = state.position.z + (to_y * self.torque_arms[0][i] - to_x * self.torque_arms[1][i]);
            let height = height.at_least(self.ground_effect_floor);
            let gain = self.ground_effect / (height * height);
            thrusts[i] + thrusts[i] * up.where_less(R::zero(), R::zero(), gain)
        })
    }

    /// Rotor drag \[N\], world, to be subtracted.
    #[inline(always)]
    fn drag(&self, state: &State<R>, body_z: &Vector3<R>, air: &Air<R>) -> Vector3<R> {
        let [a, b, c, d] = state.rotor_speeds;
        let summed_speed = (a + b) + (c + d);
        let wind = &air.wind;
        let through_air =
            Vector3::new(state.velocity.x - wind.x, state.velocity.y - wind.y, state.velocity.z - wind.z);
        let planar = self.planar_drag * summed_speed;
        let along = body_z.x * through_air.x + body_z.y * through_air.y + body_z.z * through_air.z;
        let axial = self.extra_axial_drag * summed_speed * along;
        Vector3::new(
            planar * through_air.x + axial * body_z.x,
            planar * through_air.y + axial * body_z.y,
            planar * through_air.z + axial * body_z.z,
        )
    }

    /// Euler's equation for a diagonal inertia \[rad/s²\].
    #[inline(always)]
    fn angular_acceleration(&self, rates: &Vector3<R>, thrusts: &[R; 4]) -> Vector3<R> {
        let torque = |arms: &[R; 4]| {
            (arms[0] * thrusts[0] + arms[1] * thrusts[1]) + (arms[2] * thrusts[2] + arms[3] * thrusts[3])
        };
        let [x, y, z] = &self.torque_arms;
        let inertia = &self.inertia;
        Vector3::new(
            (torque(x) + (inertia.y - inertia.z) * (rates.y * rates.z)) * self.inverse_inertia.x,
            (torque(y) + (inertia.z - inertia.x) * (rates.z * rates.x)) * self.inverse_inertia.y,
            (torque(z) + (inertia.x - inertia.y) * (rates.x * rates.y)) * self.inverse_inertia.z,
        )
    }
}

impl<R: Real> Air<R> {
    /// No wind, no force, no ground.
    #[inline(always)]
    pub fn still() -> Self {
        let nothing = Vector3::new(R::zero(), R::zero(), R::zero());
        Self { wind: nothing, force: nothing, ground: Ground::Distant }
    }
}
