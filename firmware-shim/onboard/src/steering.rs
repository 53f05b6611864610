//! Flight without a policy: a cascade of proportional controllers, with an integral for what pushes all the time.
//!
//! It takes over where a policy fails, flies where a peer chooses it, and follows what no policy was trained for: a position
//! asks for a velocity, that for an attitude, that for body rates, and those for rotor speeds. The last three are the
//! core's ([`IntegralVelocities`], [`ThrustBodyRates`]); its integral lifts a drone that is a third too heavy for its rotors.
//! The reference system's PID (`DslPid` of kestrel-core's feature `reference`) was tried first: rotors that lag by 0.09 s, as
//! real ones do, let it oscillate.

use kestrel_core::action::{IntegralVelocities, ThrustBodyRates, Velocities};
use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use crate::goal::MovingGoal;

/// Greatest body rates that are asked for \[rad/s\], about x, y, z.
const BODY_RATES_LIMIT: [f32; 3] = [8.0, 8.0, 3.0];

/// Greatest body rate that may be asked for \[rad/s\]: what the gyroscope measures, 2000°/s. Nobody means a faster one.
const BODY_RATE_LIMIT: f32 = 35.0;

/// Angular acceleration per error of the body rates \[1/s\], as policies of velocities have them by default.
const RATE_GAINS: [f32; 3] = [16.0, 16.0, 6.0];

/// Body rates per error of the attitude \[1/s\]: with the rotors' lag 8 oscillates.
const ATTITUDE_GAIN: f32 = 5.0;

/// Yaw rate per error of the heading \[1/s\]: a third of the gain below it.
const HEADING_GAIN: f32 = 2.0;

/// Acceleration per error of the velocity \[1/s\].
const VELOCITY_GAIN: f32 = 3.0;

/// Velocity per error of the position \[1/s\]: a third of the gain below it.
const POSITION_GAIN: f32 = 1.0;

/// Acceleration per integrated error of the velocity \[1/s²\]: with the gain above it a damping ratio of 0.87.
const INTEGRAL_GAIN: f32 = 3.0;

/// Greatest velocity that is asked for along an axis \[m/s\].
const SPEED_LIMIT: f32 = 2.0;

/// A controller for one airframe.
#[derive(Clone, Debug)]
pub struct Steering {
    controller: IntegralVelocities,
    /// What the integral makes up for \[m/s², world\].
    integral: Vector3<f32>,
}

/// What a peer steers by directly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AttitudeSetPoint {
    /// An attitude, with the share of the greatest thrust in \[0, 1\].
    Attitude {
        /// Wanted.
        world_from_body: Attitude<f32>,
        /// Share of the greatest thrust.
        thrust: f32,
    },
    /// Body rates, with the share of the greatest thrust in \[0, 1\].
    BodyRates {
        /// Wanted \[rad/s\].
        body_rates: Vector3<f32>,
        /// Share of the greatest thrust.
        thrust: f32,
    },
}

impl Steering {
    /// For a nominal drone.
    pub fn new(airframe: &Airframe) -> Self {
        let hover = airframe.hover_rotor_speed();
        let greatest = airframe.rotor_speed_limit / hover;
        // From no thrust to all of it.
        let authority = greatest * greatest - 1.0;
        Self {
            controller: IntegralVelocities {
                velocities: Velocities {
                    rates: ThrustBodyRates::new(airframe, authority.max(1.0) as f32, BODY_RATES_LIMIT, RATE_GAINS),
                    speed_limit: SPEED_LIMIT,
                    velocity_gain: VELOCITY_GAIN,
                    attitude_gain: ATTITUDE_GAIN,
                },
                integral_gain: INTEGRAL_GAIN,
            },
            integral: Vector3::zeros(),
        }
    }

    /// Takes over: forgets what the integral makes up for.
    pub fn begin(&mut self) {
        self.integral = Vector3::zeros();
    }

    /// Rotor targets \[rad/s\] toward a goal, `secs` after the last call.
    pub fn toward(&mut self, state: &State<f32>, goal: &MovingGoal, secs: f32) -> [f32; 4] {
        let error = goal.position() - state.position;
        let wanted = (goal.velocity() + error * POSITION_GAIN) / SPEED_LIMIT;
        let (sine, cosine) = libm::sincosf(0.5 * goal.heading());
        let wanted_heading = Attitude { w: cosine, x: 0.0, y: 0.0, z: sine };
        let yaw_rate = turn(&heading(&state.world_from_body), &wanted_heading).z * HEADING_GAIN;
        let [_, _, yaw_rate_limit] = BODY_RATES_LIMIT;
        let action = [wanted.x, wanted.y, wanted.z, yaw_rate / yaw_rate_limit];
        self.controller.rotor_targets(&action, state, &mut self.integral, secs)
    }

    /// Rotor targets \[rad/s\] that a peer asks for directly.
    pub fn follow(&self, state: &State<f32>, attitude_set_point: &AttitudeSetPoint) -> [f32; 4] {
        match attitude_set_point {
            AttitudeSetPoint::Attitude { world_from_body, thrust } => {
                let body_rates = turn(&state.world_from_body, world_from_body).component_mul(&Vector3::new(
                    ATTITUDE_GAIN,
                    ATTITUDE_GAIN,
                    HEADING_GAIN,
                ));
                self.turning(state, &body_rates, *thrust)
            }
            AttitudeSetPoint::BodyRates { body_rates, thrust } => self.turning(state, body_rates, *thrust),
        }
    }

    fn turning(&self, state: &State<f32>, body_rates: &Vector3<f32>, thrust: f32) -> [f32; 4] {
        let rates = &self.controller.velocities.rates;
        let lift = thrust * rates.speed_squared_limit / rates.hover_speed_squared;
        let [x, y, z] = BODY_RATES_LIMIT;
        let action = [(lift - 1.0) / rates.thrust_fraction, body_rates.x / x, body_rates.y / y, body_rates.z / z];
        rates.rotor_targets(&action, &state.body_rates)
    }
}

impl AttitudeSetPoint {
    /// Whether the attitude is one, body rates are such as a gyroscope measures, and the thrust is a share.
    pub fn is_valid(&self) -> bool {
        let share = |thrust: &f32| (0.0..=1.0).contains(thrust);
        match self {
            Self::Attitude { world_from_body: Attitude { w, x, y, z }, thrust } => {
                let square = w * w + x * x + y * y + z * z;
                (0.9..1.1).contains(&square) && share(thrust)
            }
            Self::BodyRates { body_rates, thrust } => {
                // A NaN is in no range.
                body_rates.iter().all(|rate| rate.abs() <= BODY_RATE_LIMIT) && share(thrust)
            }
        }
    }
}

/// Where the nose points \[rad\], counter-clockwise from the world's x axis.
pub fn yaw(attitude: &Attitude<f32>) -> f32 {
    let Attitude { w, z, .. } = heading(attitude);
    libm::atan2f(2.0 * w * z, w * w - z * z)
}

/// The part of an attitude that turns about the vertical; level where there is none.
pub fn heading(attitude: &Attitude<f32>) -> Attitude<f32> {
    let square = attitude.w * attitude.w + attitude.z * attitude.z;
    if square < f32::EPSILON {
        return Attitude::level();
    }
    Attitude { w: attitude.w, x: 0.0, y: 0.0, z: attitude.z }.normalized()
}

fn inverse(attitude: &Attitude<f32>) -> Attitude<f32> {
    let Attitude { w, x, y, z } = *attitude;
    Attitude { w, x: -x, y: -y, z: -z }
}

/// The shortest turn from one attitude to another, as a rotation vector in the body \[rad\]; for small turns exact.
fn turn(from: &Attitude<f32>, to: &Attitude<f32>) -> Vector3<f32> {
    let Attitude { w, x, y, z } = inverse(from).after(to);
    let shorter = if w < 0.0 { -2.0 } else { 2.0 };
    Vector3::new(x, y, z) * shorter
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::{CF2X, GRAVITY};

    use super::*;
    use crate::plant::{FlatFloor, Plant};

    const CONTROL_SECS: f32 = 0.01;

    /// A drone that climbed to a metre, and its steering.
    fn hovering(heading_rad: f64) -> (FlatFloor, Steering) {
        let mut plant = FlatFloor::new(&CF2X, CONTROL_SECS);
        let turned = Attitude::from_axis_angle(Vector3::z(), heading_rad).map(|value| value as f32);
        plant.put(State { world_from_body: turned, ..*plant.state() });
        let mut steering = Steering::new(&CF2X);
        let heading = yaw(&plant.state().world_from_body);
        fly(&mut plant, &mut steering, MovingGoal::at(Vector3::new(0.0, 0.0, 1.0), heading), 6.0);
        (plant, steering)
    }

    fn fly(plant: &mut FlatFloor, steering: &mut Steering, goal: MovingGoal, secs: f32) {
        for _ in 0..(secs / CONTROL_SECS) as u32 {
            let targets = steering.toward(plant.state(), &goal, CONTROL_SECS);
            plant.step(&targets);
        }
    }

    #[test]
    fn it_reaches_a_point_with_any_heading_and_turns_to_any() {
        for (from, to) in [(0.0, 0.0_f32), (1.5, 1.5), (-2.5, 1.0), (core::f64::consts::PI, -2.0)] {
            let (mut plant, mut steering) = hovering(from);
            let goal = Vector3::new(0.3, -0.2, 1.2);
            fly(&mut plant, &mut steering, MovingGoal::at(goal, to), 10.0);
            let state = plant.state();
            assert!((state.position - goal).norm() < 0.05, "{} with {from}", state.position);
            assert!((yaw(&state.world_from_body) - to).abs() < 0.05, "{}", yaw(&state.world_from_body));
        }
    }

    #[test]
    fn it_catches_a_tumbling_drone() {
        let (mut plant, mut steering) = hovering(0.0);
        let mut state = *plant.state();
        state.position.z = 3.0;
        state.body_rates = Vector3::new(6.0, -4.0, 2.0);
        state.world_from_body =
            Attitude::from_axis_angle(Vector3::new(1.0, 1.0, 0.0), 1.0).map(|value| value as f32);
        plant.put(state);
        steering.begin();
        let goal = Vector3::new(0.0, 0.0, 3.0);
        fly(&mut plant, &mut steering, MovingGoal::at(goal, 0.0), 10.0);
        assert!((plant.state().position - goal).norm() < 0.1, "{}", plant.state().position);
    }

    #[test]
    fn an_attitude_and_body_rates_are_followed() {
        let (mut plant, steering) = hovering(0.7);
        let hover = (CF2X.hover_rotor_speed() / CF2X.rotor_speed_limit).powi(2) as f32;
        let wanted = Attitude::from_axis_angle(Vector3::new(0.0, 0.0, 1.0), 1.0)
            .after(&Attitude::from_axis_angle(Vector3::new(1.0, 0.0, 0.0), 0.2))
            .map(|value| value as f32);
        for _ in 0..300 {
            let attitude_set_point = AttitudeSetPoint::Attitude { world_from_body: wanted, thrust: hover };
            plant.step(&steering.follow(plant.state(), &attitude_set_point));
        }
        assert!(turn(&plant.state().world_from_body, &wanted).norm() < 0.03);
        let (mut plant, steering) = hovering(0.0);
        let body_rates = Vector3::new(0.0, 0.0, 1.5);
        for _ in 0..100 {
            plant
                .step(&steering.follow(plant.state(), &AttitudeSetPoint::BodyRates { body_rates, thrust: hover }));
        }
        assert!((plant.state().body_rates - body_rates).norm() < 0.1, "{}", plant.state().body_rates);
        assert!((plant.state().position.z - 1.0).abs() < 0.1, "the hover thrust holds it up");
    }

    fn yawed(degrees: f32) -> Attitude<f32> {
        Attitude::from_axis_angle(Vector3::z(), f64::from(degrees).to_radians()).map(|value| value as f32)
    }

    /// The same attitude, of the other sign.
    fn negated(attitude: &Attitude<f32>) -> Attitude<f32> {
        attitude.map(|value| -value)
    }

    #[test]
    fn a_turn_is_the_shorter_one_whatever_the_signs_of_the_quaternions() {
        for (from, to, degrees) in
            [(0.0, 90.0, 90.0), (0.0, -90.0, -90.0), (170.0, -170.0, 20.0), (-170.0, 170.0, -20.0)]
        {
            let (from, to) = (yawed(from), yawed(to));
            let expected = Vector3::new(0.0, 0.0, 2.0 * f32::sin(0.5 * f32::to_radians(degrees)));
            for from in [from, negated(&from)] {
                for to in [to, negated(&to)] {
                    assert!((turn(&from, &to) - expected).norm() < 1e-5, "{} by {degrees}", turn(&from, &to));
                }
            }
        }
    }

    #[test]
    fn an_attitude_across_south_is_reached_without_a_turn_through_north() {
        let hover = (CF2X.hover_rotor_speed() / CF2X.rotor_speed_limit).powi(2) as f32;
        for wanted in [yawed(-170.0), negated(&yawed(-170.0))] {
            let (mut plant, steering) = hovering(170_f64.to_radians());
            for _ in 0..200 {
                let set_point = AttitudeSetPoint::Attitude { world_from_body: wanted, thrust: hover };
                plant.step(&steering.follow(plant.state(), &set_point));
                let north = heading(&plant.state().world_from_body).rotate(Vector3::x()).x;
                assert!(north < -0.9, "it looks south all the time");
            }
            assert!(turn(&plant.state().world_from_body, &wanted).norm() < 0.05);
        }
    }

    #[test]
    fn the_integral_does_not_wind_up_while_a_goal_is_out_of_reach() {
        let (mut plant, mut steering) = hovering(0.0);
        for _ in 0..1000 {
            steering.toward(plant.state(), &MovingGoal::at(Vector3::new(9.0, -9.0, 9.0), 0.0), 0.1);
        }
        assert!(steering.integral.norm() < GRAVITY as f32, "{}", steering.integral);
        let goal = Vector3::new(0.0, 0.0, 1.0);
        fly(&mut plant, &mut steering, MovingGoal::at(goal, 0.0), 8.0);
        assert!((plant.state().position - goal).norm() < 0.05, "{}", plant.state().position);
    }

    #[test]
    fn a_drone_that_is_heavier_and_weaker_than_it_should_be_takes_off_in_time() {
        let weak = Airframe { mass: 1.15 * CF2X.mass, thrust_coefficient: 0.85 * CF2X.thrust_coefficient, ..CF2X };
        let mut plant = FlatFloor::new(&weak, CONTROL_SECS);
        let mut steering = Steering::new(&CF2X);
        let goal = MovingGoal::at(Vector3::new(0.0, 0.0, 0.5), 0.0);
        fly(&mut plant, &mut steering, goal, 5.0);
        assert!((plant.state().position.z - 0.5).abs() < 0.1, "{}", plant.state().position);
        fly(&mut plant, &mut steering, goal, 5.0);
        assert!((plant.state().position.z - 0.5).abs() < 0.02, "{}", plant.state().position);
    }

    #[test]
    fn targets_are_within_limits_whatever_is_asked() {
        let (plant, steering) = hovering(0.0);
        let limit = CF2X.rotor_speed_limit as f32 * 1.000_001;
        for body_rates in [Vector3::repeat(1e30), Vector3::repeat(f32::NAN), Vector3::repeat(-f32::INFINITY)] {
            for thrust in [0.0, 1.0, f32::NAN] {
                let attitude_set_point = AttitudeSetPoint::BodyRates { body_rates, thrust };
                assert!(!attitude_set_point.is_valid());
                let targets = steering.follow(plant.state(), &attitude_set_point);
                assert!(targets.iter().all(|target| (0.0..=limit).contains(target)), "{targets:?}");
            }
        }
    }
}
