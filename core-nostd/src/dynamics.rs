//! From one instant to the next: the integrators.

use nalgebra::Vector3;

use crate::attitude::Attitude;
use crate::real::Real;
use crate::vehicle::{Air, Derivative, State, Vehicle};

/// How time advances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Integrator {
    /// First order, one evaluation: rotors, then velocities, then positions, each from the newest values.
    SemiImplicitEuler,
    /// Classic fourth-order Runge–Kutta, four evaluations.
    RungeKutta4,
}

impl Integrator {
    /// Advances `state` by `secs` with rotor targets \[rad/s\] held.
    #[inline(always)]
    pub fn advance<R: Real>(
        self,
        vehicle: &Vehicle<R>,
        state: &State<R>,
        rotor_targets: &[R; 4],
        air: &Air<R>,
        secs: R,
    ) -> State<R> {
        match self {
            Self::SemiImplicitEuler => semi_implicit_euler(vehicle, state, rotor_targets, air, secs),
            Self::RungeKutta4 => runge_kutta_4(vehicle, state, rotor_targets, air, secs),
        }
    }
}

/// One step of semi-implicit Euler.
#[inline(always)]
pub fn semi_implicit_euler<R: Real>(
    vehicle: &Vehicle<R>,
    state: &State<R>,
    rotor_targets: &[R; 4],
    air: &Air<R>,
    secs: R,
) -> State<R> {
    let spin_up = vehicle.rotor_accelerations(&state.rotor_speeds, rotor_targets);
    let rotor_speeds = core::array::from_fn(|i| state.rotor_speeds[i] + spin_up[i] * secs);
    let (acceleration, angular_acceleration) =
        vehicle.accelerations(&State { rotor_speeds, ..*state }, &spin_up, air);
    let velocity = moved(&state.velocity, &acceleration, secs);
    let body_rates = moved(&state.body_rates, &angular_acceleration, secs);
    let turning = state.world_from_body.derivative(body_rates);
    State {
        position: moved(&state.position, &velocity, secs),
        world_from_body: renormalized(&state.world_from_body.advanced(&turning, secs)),
        velocity,
        body_rates,
        rotor_speeds,
    }
}

/// One step of the classic Runge–Kutta method.
#[inline(always)]
pub fn runge_kutta_4<R: Real>(
    vehicle: &Vehicle<R>,
    state: &State<R>,
    rotor_targets: &[R; 4],
    air: &Air<R>,
    secs: R,
) -> State<R> {
    let half = R::from_f64(0.5) * secs;
    let k1 = vehicle.derivative(state, rotor_targets, air);
    let k2 = vehicle.derivative(&advanced(state, &k1, half), rotor_targets, air);
    let k3 = vehicle.derivative(&advanced(state, &k2, half), rotor_targets, air);
    let k4 = vehicle.derivative(&advanced(state, &k3, secs), rotor_targets, air);
    let sixth = R::from_f64(1.0 / 6.0) * secs;
    let end = advanced(state, &simpson(&k1, &k2, &k3, &k4), sixth);
    State { world_from_body: renormalized(&end.world_from_body), ..end }
}

/// `k1 + 2 k2 + 2 k3 + k4`.
#[inline(always)]
fn simpson<R: Real>(
    k1: &Derivative<R>,
    k2: &Derivative<R>,
    k3: &Derivative<R>,
    k4: &Derivative<R>,
) -> Derivative<R> {
    let two = R::from_f64(2.0);
    let sum = |a: R, b: R, c: R, d: R| (a + d) + two * (b + c);
    let vector = |a: &Vector3<R>, b: &Vector3<R>, c: &Vector3<R>, d: &Vector3<R>| {
        Vector3::new(sum(a.x, b.x, c.x, d.x), sum(a.y, b.y, c.y, d.y), sum(a.z, b.z, c.z, d.z))
    };
    let [a, b, c, d] = [&k1.world_from_body, &k2.world_from_body, &k3.world_from_body, &k4.world_from_body];
    Derivative {
        position: vector(&k1.position, &k2.position, &k3.position, &k4.position),
        world_from_body: Attitude {
            w: sum(a.w, b.w, c.w, d.w),
            x: sum(a.x, b.x, c.x, d.x),
            y: sum(a.y, b.y, c.y, d.y),
            z: sum(a.z, b.z, c.z, d.z),
        },
        velocity: vector(&k1.velocity, &k2.velocity, &k3.velocity, &k4.velocity),
        body_rates: vector(&k1.body_rates, &k2.body_rates, &k3.body_rates, &k4.body_rates),
        rotor_speeds: core::array::from_fn(|i| {
            sum(k1.rotor_speeds[i], k2.rotor_speeds[i], k3.rotor_speeds[i], k4.rotor_speeds[i])
        }),
    }
}

#[inline(always)]
fn advanced<R: Real>(state: &State<R>, rate: &Derivative<R>, secs: R) -> State<R> {
    State {
        position: moved(&state.position, &rate.position, secs),
        world_from_body: state.world_from_body.advanced(&rate.world_from_body, secs),
        velocity: moved(&state.velocity, &rate.velocity, secs),
        body_rates: moved(&state.body_rates, &rate.body_rates, secs),
        rotor_speeds: core::array::from_fn(|i| state.rotor_speeds[i] + rate.rotor_speeds[i] * secs),
    }
}

#[inline(always)]
fn moved<R: Real>(value: &Vector3<R>, rate: &Vector3<R>, secs: R) -> Vector3<R> {
    Vector3::new(value.x + rate.x * secs, value.y + rate.y * secs, value.z + rate.z * secs)
}

/// Pulls an almost-unit quaternion back with one Newton step of 1/√s around s = 1: no root, no division, and the
/// remaining error is ⅜ (s − 1)², below 1e-7 for 10 rad/s at 5 ms.
#[inline(always)]
fn renormalized<R: Real>(attitude: &Attitude<R>) -> Attitude<R> {
    let Attitude { w, x, y, z } = *attitude;
    let square = (w * w + x * x) + (y * y + z * z);
    let scale = R::from_f64(1.5) - R::from_f64(0.5) * square;
    Attitude { w: w * scale, x: x * scale, y: y * scale, z: z * scale }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::{Airframe, CF2P, CF2X, FlightEffects, GRAVITY};
    use crate::vehicle::Ground;

    const BOTH: [Integrator; 2] = [Integrator::SemiImplicitEuler, Integrator::RungeKutta4];

    fn at_rest<R: Real>(rotor_speed: f64) -> State<R> {
        let nothing = Vector3::new(R::zero(), R::zero(), R::zero());
        State {
            position: nothing,
            world_from_body: Attitude::level(),
            velocity: nothing,
            body_rates: nothing,
            rotor_speeds: [R::from_f64(rotor_speed); 4],
        }
    }

    fn fly(
        integrator: Integrator,
        airframe: &Airframe,
        start: State<f64>,
        targets: [f64; 4],
        dt: f64,
    ) -> State<f64> {
        let vehicle = Vehicle::new(airframe);
        let steps = (1.0 / dt) as usize;
        (0..steps).fold(start, |state, _| integrator.advance(&vehicle, &state, &targets, &Air::still(), dt))
    }

    #[test]
    fn at_hover_speed_nothing_moves() {
        let hover = CF2X.hover_rotor_speed();
        for integrator in BOTH {
            let state = fly(integrator, &CF2X, at_rest(hover), [hover; 4], 0.002);
            assert!(state.position.norm() < 1e-12 && state.body_rates.norm() < 1e-12);
        }
    }

    #[test]
    fn without_thrust_the_drone_falls_freely() {
        let state = fly(Integrator::RungeKutta4, &CF2X, at_rest(0.0), [0.0; 4], 0.002);
        assert!((state.position.z + 0.5 * GRAVITY).abs() < 1e-9 && (state.velocity.z + GRAVITY).abs() < 1e-9);
    }

    #[test]
    fn rotors_follow_their_targets_with_the_time_constant() {
        let targets = [1000.0, 1000.0, 1000.0, 1000.0];
        let state = fly(Integrator::RungeKutta4, &CF2X, at_rest(0.0), targets, 0.001);
        let expected = 1000.0 * (1.0 - libm::exp(-1.0 / CF2X.rotor_rise_secs));
        assert!((state.rotor_speeds[0] - expected).abs() < 1e-4);
        let state = fly(Integrator::RungeKutta4, &CF2X, at_rest(1000.0), [0.0; 4], 0.001);
        assert!((state.rotor_speeds[0] - 1000.0 * libm::exp(-1.0 / CF2X.rotor_fall_secs)).abs() < 1e-4);
    }

    #[test]
    fn faster_rotors_turn_the_drone_away_from_their_side() {
        let hover = CF2X.hover_rotor_speed();
        let [slow, fast] = [0.99 * hover, 1.01 * hover];
        // Clockwise from front right: faster left rotors roll to the right (+x), faster rear ones pitch down (+y),
        // faster second and fourth ones yaw to the left (+z).
        let cases = [([slow, slow, fast, fast], 0), ([slow, fast, fast, slow], 1), ([slow, fast, slow, fast], 2)];
        for (targets, axis) in cases {
            let vehicle = Vehicle::<f64>::new(&CF2X);
            let state = State { rotor_speeds: targets, ..at_rest(hover) };
            let (_, turning) = vehicle.accelerations(&state, &[0.0; 4], &Air::still());
            for other in 0..3 {
                assert!(if other == axis { turning[other] > 0.1 } else { turning[other].abs() < 1e-9 });
            }
        }
        let vehicle = Vehicle::<f64>::new(&CF2P);
        let state = State { rotor_speeds: [hover, hover, hover, fast], ..at_rest(hover) };
        let (_, turning) = vehicle.accelerations(&state, &[0.0; 4], &Air::still());
        assert!(turning.x > 0.1 && turning.y.abs() < 1e-9);
    }

    #[test]
    fn torques_are_forces_times_arms() {
        let hover = CF2X.hover_rotor_speed();
        let speeds = [hover, hover, 1.1 * hover, hover];
        let vehicle = Vehicle::<f64>::new(&CF2X);
        let (_, turning) =
            vehicle.accelerations(&State { rotor_speeds: speeds, ..at_rest(hover) }, &[0.0; 4], &Air::still());
        let thrusts = speeds.map(|speed| CF2X.thrust_coefficient * speed * speed);
        let positions = CF2X.rotor_positions();
        let roll: f64 = (0..4).map(|i| positions[i][1] * thrusts[i]).sum();
        let pitch: f64 = (0..4).map(|i| -positions[i][0] * thrusts[i]).sum();
        assert!((turning.x - roll / CF2X.inertia[0]).abs() < 1e-9);
        assert!((turning.y - pitch / CF2X.inertia[1]).abs() < 1e-9);
    }

    #[test]
    fn free_rotation_conserves_energy_and_momentum() {
        let mut start = at_rest::<f64>(0.0);
        start.body_rates = Vector3::new(3.0, -2.0, 5.0);
        let airframe = Airframe { inertia: [1.4e-5, 2.4e-5, 3.0e-5], ..CF2X };
        let inertia = Vector3::from(airframe.inertia);
        let end = fly(Integrator::RungeKutta4, &airframe, start, [0.0; 4], 0.001);
        let energy = |state: &State<f64>| state.body_rates.component_mul(&inertia).dot(&state.body_rates);
        let momentum = |state: &State<f64>| state.world_from_body.rotate(state.body_rates.component_mul(&inertia));
        assert!((energy(&end) / energy(&start) - 1.0).abs() < 1e-8);
        assert!((momentum(&end) - momentum(&start)).norm() < 1e-8 * momentum(&start).norm());
    }

    #[test]
    fn runge_kutta_converges_with_fourth_order_and_euler_with_first() {
        let hover = CF2X.hover_rotor_speed();
        let targets = [1.02 * hover, 1.01 * hover, 1.03 * hover, 1.015 * hover];
        let error = |integrator, dt| {
            let exact = fly(Integrator::RungeKutta4, &CF2X, at_rest(hover), targets, 1.0 / 4096.0);
            (fly(integrator, &CF2X, at_rest(hover), targets, dt).position - exact.position).norm()
        };
        let order = |integrator, dt: f64| libm::log2(error(integrator, dt) / error(integrator, dt / 2.0));
        assert!((order(Integrator::SemiImplicitEuler, 1.0 / 512.0) - 1.0).abs() < 0.2);
        assert!(order(Integrator::RungeKutta4, 1.0 / 64.0) > 3.5);
    }

    #[test]
    fn single_precision_stays_close_to_the_oracle() {
        let hover = CF2X.hover_rotor_speed();
        let targets = [1.01 * hover, hover, 1.01 * hover, hover];
        let exact = fly(Integrator::RungeKutta4, &CF2X, at_rest(hover), targets, 0.002);
        let vehicle = Vehicle::<f32>::new(&CF2X);
        let targets = targets.map(|target| target as f32);
        let state = (0..500).fold(at_rest::<f32>(hover), |state, _| {
            runge_kutta_4(&vehicle, &state, &targets, &Air::still(), 0.002)
        });
        assert!((f64::from(state.position.z) - exact.position.z).abs() < 1e-4);
        assert!((f64::from(state.body_rates.z) - exact.body_rates.z).abs() < 1e-3);
    }

    #[test]
    fn drag_opposes_motion_through_the_air() {
        let hover = CF2X.hover_rotor_speed();
        let vehicle = Vehicle::<f64>::new(&CF2X);
        let moving = State { velocity: Vector3::new(1.0, 0.0, 0.0), ..at_rest(hover) };
        let (deceleration, _) = vehicle.accelerations(&moving, &[0.0; 4], &Air::still());
        let expected = 4.0 * hover * CF2X.drag_coefficients.planar / CF2X.mass;
        assert!((deceleration.x + expected).abs() < 1e-9);
        let carried = Air { wind: moving.velocity, ..Air::still() };
        assert!(vehicle.accelerations(&moving, &[0.0; 4], &carried).0.norm() < 1e-9);
    }

    /// A drone whose rotors neither lift nor drag, so that nothing from outside turns it.
    fn adrift(effects: FlightEffects) -> Airframe {
        let inertia = [1.8e-5, 2.1e-5, 3.0e-5];
        Airframe { thrust_coefficient: 1e-30, torque_coefficient: 1e-30, inertia, effects, ..CF2X }
    }

    #[test]
    fn rotors_and_body_keep_their_momentum_together() {
        let airframe = adrift(FlightEffects { rotor_inertia: 3.3e-8, ..FlightEffects::NONE });
        let momentum = |state: &State<f64>| {
            let [a, b, c, d] = state.rotor_speeds;
            let of_body = Vector3::from(airframe.inertia).component_mul(&state.body_rates);
            let of_rotors = Vector3::new(0.0, 0.0, airframe.effects.rotor_inertia * ((a + c) - (b + d)));
            state.world_from_body.rotate(of_body + of_rotors)
        };
        let start = State { body_rates: Vector3::new(2.0, -1.0, 0.5), ..at_rest(1000.0) };
        let end = fly(Integrator::RungeKutta4, &airframe, start, [2000.0, 0.0, 1500.0, 500.0], 0.0005);
        assert!((momentum(&end) - momentum(&start)).norm() < 1e-6 * momentum(&start).norm());
        assert!((end.body_rates - start.body_rates).norm() > 0.5, "they exchange it");
    }

    #[test]
    fn the_side_that_meets_the_air_is_lifted() {
        let effects = FlightEffects { flapping_moment: 3e-8, ..FlightEffects::NONE };
        let vehicle = Vehicle::<f64>::new(&Airframe { effects, ..CF2X });
        let hover = CF2X.hover_rotor_speed();
        let gain = 4.0 * hover * 3e-8 / 1.4e-5;
        let turning = |velocity: Vector3<f64>| {
            let state = State { velocity, ..at_rest(hover) };
            vehicle.accelerations(&state, &[0.0; 4], &Air::still()).1
        };
        // Forward flight lifts the nose (−y), flight to the left the left side (+x).
        assert!((turning(Vector3::new(2.0, 0.0, 0.0)) - Vector3::new(0.0, -2.0 * gain, 0.0)).norm() < 1e-9);
        assert!((turning(Vector3::new(0.0, 1.0, 0.0)) - Vector3::new(gain, 0.0, 0.0)).norm() < 1e-9);
        assert!(turning(Vector3::new(0.0, 0.0, 3.0)).norm() < 1e-9);
    }

    #[test]
    fn damping_slows_each_rate_with_its_own_time() {
        let effects = FlightEffects { rate_damping: [8e-5, 9e-5, 3e-5], ..FlightEffects::NONE };
        let airframe = adrift(effects);
        for axis in 0..3 {
            let mut start = at_rest(0.0);
            start.body_rates[axis] = 3.0;
            let end = fly(Integrator::RungeKutta4, &airframe, start, [0.0; 4], 0.001);
            let rate = effects.rate_damping[axis] / airframe.inertia[axis];
            assert!((end.body_rates[axis] - 3.0 * libm::exp(-rate)).abs() < 1e-6);
        }
    }

    #[test]
    fn a_body_falls_no_faster_than_its_drag_allows() {
        let mut airframe = adrift(FlightEffects { body_drag: 0.05, ..FlightEffects::NONE });
        airframe.drag_coefficients.axial = 0.0;
        airframe.drag_coefficients.planar = 0.0;
        let end = fly(Integrator::RungeKutta4, &airframe, at_rest(0.0), [0.0; 4], 0.001);
        let terminal = libm::sqrt(airframe.weight() / 0.05);
        assert!((end.velocity.z + terminal * libm::tanh(GRAVITY / terminal)).abs() < 1e-6);
    }

    #[test]
    fn a_loaded_battery_turns_the_rotors_slower() {
        let airframe = Airframe { effects: FlightEffects { battery_sag: 0.1, ..FlightEffects::NONE }, ..CF2X };
        let limit = airframe.rotor_speed_limit;
        let end = fly(Integrator::RungeKutta4, &airframe, at_rest(limit), [limit; 4], 0.001);
        // Where the rotor speed x is the share of the limit: x = 1 − 0.1 x².
        let share = (libm::sqrt(1.4) - 1.0) / 0.2;
        assert!((end.rotor_speeds[0] / limit - share).abs() < 1e-3, "{}", end.rotor_speeds[0] / limit);
    }

    #[test]
    fn the_ground_cushions_a_low_drone() {
        let hover = CF2X.hover_rotor_speed();
        let vehicle = Vehicle::<f64>::new(&CF2X);
        let gain = |height: f64| {
            let state = State { position: Vector3::new(0.0, 0.0, height), ..at_rest(hover) };
            vehicle.accelerations(&state, &[0.0; 4], &Air { ground: Ground::Near, ..Air::still() }).0.z / GRAVITY
        };
        // The reference system's figures at its start height and at its limit.
        assert!((gain(0.1125) - 0.030_048).abs() < 1e-5);
        assert!((gain(0.0) - 4.0 / 15.0).abs() < 1e-9);
        assert!(gain(2.0) < 1e-4);
    }

    #[test]
    fn a_ceiling_pulls_a_drone_that_is_near_and_upright() {
        let (radius, hover) = (CF2X.propeller_radius, CF2X.hover_rotor_speed());
        let vehicle = Vehicle::<f64>::new(&CF2X);
        let gain = |distance: f64| {
            let state = State { position: Vector3::new(0.0, 0.0, 2.0 - distance), ..at_rest(hover) };
            vehicle.accelerations(&state, &[0.0; 4], &Air { ceiling: Some(2.0), ..Air::still() }).0.z / GRAVITY
        };
        // Of momentum theory, at half a radius and at a quarter, beyond which nothing grows.
        assert!((gain(0.5 * radius) - 0.112_372).abs() < 1e-6, "{}", gain(0.5 * radius));
        assert!((gain(0.25 * radius) - 0.366_025).abs() < 1e-6, "{}", gain(0.25 * radius));
        for distance in [0.1, 0.0, -3.0] {
            assert!((gain(distance * radius) - gain(0.25 * radius)).abs() < 1e-9);
        }
        assert!(gain(1.0) < 1e-4);
        let mut overturned = State { position: Vector3::new(0.0, 0.0, 1.99), ..at_rest(hover) };
        overturned.world_from_body = Attitude { w: 0.0, x: 1.0, y: 0.0, z: 0.0 };
        let air = Air { ceiling: Some(2.0), ..Air::still() };
        let of = |air: &Air<f64>| vehicle.accelerations(&overturned, &[0.0; 4], air).0;
        assert_eq!(of(&air), of(&Air::still()));
    }
}
