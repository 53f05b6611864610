use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;
use crate::airframe::{Airframe, CF2X};
use crate::dynamics::Integrator;
use crate::setpoint::Setpoint;
use crate::vehicle::{Air, State, Vehicle};

const STEPS_PER_SEC: usize = 500;

fn still(position: Vector3<f64>) -> State<f64> {
    State {
        position,
        world_from_body: Attitude::level(),
        velocity: Vector3::zeros(),
        body_rates: Vector3::zeros(),
        rotor_speeds: [CF2X.hover_rotor_speed(); 4],
    }
}

/// Rotor targets \[rad/s\] of motors that give the thrust which the counts stand for.
fn rotor_targets(airframe: &Airframe, mix: &Mix<f64>) -> [f64; 4] {
    mix.motor_thrusts().map(|thrust| (thrust / airframe.thrust_coefficient).sqrt())
}

/// The end of a flight of ten seconds.
fn flown(start: State<f64>, mut mix: impl FnMut(&State<f64>, f64) -> Mix<f64>) -> State<f64> {
    let vehicle = Vehicle::new(&CF2X);
    (0..10 * STEPS_PER_SEC).fold(start, |state, step| {
        let targets = rotor_targets(&CF2X, &mix(&state, step as f64 * STABILISER_SECS));
        let integrator = Integrator::SemiImplicitEuler;
        integrator.advance(&vehicle, &state, &targets, &Air::still(), STABILISER_SECS)
    })
}

fn goal() -> Setpoint<f64> {
    Setpoint { yaw: 1.0, ..Setpoint::at(Vector3::new(0.6, -0.4, 1.3)) }
}

#[test]
fn the_cascade_reaches_a_point_and_a_heading() {
    let start = still(Vector3::new(0.0, 0.0, 1.0));
    let mut cascade = Cascade::begun(&start);
    let end = flown(start, |state, _| cascade.mix(state, &goal()));
    assert!((end.position - goal().position).norm() < 0.02, "{}", end.position);
    assert!((end.world_from_body.roll_pitch_yaw()[2] - 1.0).abs() < 0.02);
}

#[test]
fn the_cascade_follows_a_steady_point_half_a_second_late() {
    let start = still(Vector3::zeros());
    let mut cascade = Cascade::begun(&start);
    let at = |secs: f64| Vector3::new(0.4 * secs, 0.0, 0.0);
    let end = flown(start, |state, secs| cascade.mix(state, &Setpoint::at(at(secs))));
    let late = (at(10.0) - end.position).x / 0.4;
    assert!((0.45..0.55).contains(&late), "{late} s");
}

#[test]
fn mellinger_reaches_a_point_and_a_heading_and_follows_without_lag() {
    let start = still(Vector3::new(0.0, 0.0, 1.0));
    let mut mellinger = Mellinger::new(CF2X.mass);
    let end = flown(start, |state, _| mellinger.mix(state, &goal(), &Vector3::zeros()));
    assert!((end.position - goal().position).norm() < 0.05, "{}", end.position);
    assert!((end.world_from_body.roll_pitch_yaw()[2] - 1.0).abs() < 0.05);
    let mut mellinger = Mellinger::new(CF2X.mass);
    let velocity = Vector3::new(0.4, 0.0, 0.0);
    let end = flown(still(Vector3::zeros()), |state, secs| {
        let moving = Setpoint { velocity, ..Setpoint::at(velocity * secs) };
        mellinger.mix(state, &moving, &Vector3::zeros())
    });
    assert!((end.position - velocity * 10.0).norm() < 0.05, "{}", end.position);
}

#[test]
fn mixes_lean_towards_the_goal() {
    let start = still(Vector3::zeros());
    let (mut cascade, mut mellinger) = (Cascade::begun(&start), Mellinger::new(CF2X.mass));
    // Ahead and to the left is nose down and left side down.
    let goal = Setpoint::at(Vector3::new(0.2, 0.2, 0.0));
    for mix in [cascade.mix(&start, &goal), mellinger.mix(&start, &goal, &Vector3::zeros())] {
        let [front_right, rear_right, rear_left, front_left] = mix.motor_counts();
        assert!(rear_right > front_left && rear_right > rear_left && front_right > front_left);
        let [_, pushed, ..] = mix.motor_thrusts();
        assert!((pushed - rear_right * MOTOR_THRUST_LIMIT_N / FULL_COUNTS).abs() < 1e-9);
    }
}

#[test]
fn mellinger_follows_a_fast_circle_by_its_acceleration_and_the_cascade_does_not() {
    let omega = 2.0;
    let at = |secs: f64| {
        let (sine, cosine) = (omega * secs).sin_cos();
        Vector3::new(cosine, sine, 0.0) * 0.75
    };
    let start = still(at(0.0));
    let moving = |secs: f64| {
        let place = at(secs);
        Setpoint { velocity: Vector3::new(-place.y, place.x, 0.0) * omega, ..Setpoint::at(place) }
    };
    let (mut cascade, mut mellinger) = (Cascade::begun(&start), Mellinger::new(CF2X.mass));
    let led = flown(start, |state, secs| mellinger.mix(state, &moving(secs), &(at(secs) * -omega * omega)));
    let lagging = flown(start, |state, secs| cascade.mix(state, &moving(secs)));
    assert!((led.position - at(10.0)).norm() < 0.05, "{}", led.position);
    assert!((lagging.position - at(10.0)).norm() > 0.5, "{}", lagging.position);
}

#[test]
fn a_duty_gives_the_thrust_that_was_asked_for_at_any_voltage() {
    for (propellers, [a, b, c, d]) in [
        (Propellers::Plus, [-0.024_765_379, 0.065_237_935, -0.026_792_505, 0.006_776_789]),
        (Propellers::Legacy, [-0.014_830_745, 0.047_244_652, -0.018_473_644, 0.005_960_924]),
    ] {
        let motor = MotorVoltage::new(propellers);
        for counts in [8_000.0_f64, 30_000.0, 50_000.0, 65_000.0] {
            for battery in [3.3, 3.7, 4.2] {
                let volts = motor.duty(counts, battery) * battery;
                let thrust = a + volts * (b + volts * (c + volts * d));
                assert!((thrust - counts / FULL_COUNTS * MOTOR_THRUST_LIMIT_N).abs() < 1e-6, "{counts}");
            }
        }
        assert_eq!(motor.duty(2_000.0, 4.0), 0.0);
        assert_eq!(motor.duty(65_535.0, 2.5), 1.0);
    }
}

proptest! {
    #[test]
    fn angles_wrap_to_half_a_turn(turns in -1_i32..=1, degrees in -179.0_f64..179.0) {
        prop_assert!((wrapped(degrees + 360.0 * f64::from(turns)) - degrees).abs() < 1e-9);
    }
}
