use kestrel_core::airframe::CRAZYFLIE_2_1;
use kestrel_core::attitude::Attitude;

use super::*;
use crate::drone::{ThrustCurve, drone_of};
use crate::flight::CommandRecord;

/// The voltage at which a motor hovers on the curve of the firmware, that of the real drone nearly: between them the
/// cascade still has thrust to climb with.
const CURVE: ThrustCurve = ThrustCurve { idle_share: 0.0, full_volts: 4.3, delay_secs: 0.0 };

/// A climb, and then a point on a circle, a hundred times a second, as it was `secs` before.
fn circle(secs: f64) -> Vec<SetPoint> {
    let at = |row: i32| {
        let time = 0.01 * f64::from(row) - secs;
        let (height, angle) = (0.4 * time.clamp(0.0, 2.5), (time - 4.0).max(0.0));
        let position = Vector3::new(0.8 * angle.sin(), 0.8 - 0.8 * angle.cos(), height);
        SetPoint { position, yaw: 0.0 }
    };
    (0..2000).map(at).collect()
}

/// A flight of our own drone along these set-points, in which these others are noted.
fn flight(drone: &Drone, followed: &[SetPoint], noted: Vec<SetPoint>) -> Flight {
    let rows = followed.len();
    let motion = Motion {
        positions: vec![Vector3::new(0.0, 0.0, 0.05); rows],
        attitudes: vec![Attitude::level(); rows],
        velocities: vec![Vector3::zeros(); rows],
    };
    let mut flight = Flight {
        name: "circle".to_owned(),
        start_secs: 0.0,
        period_secs: 0.01,
        measured: vec![true; rows],
        commands: vec![[0.5; 4]; rows],
        command_record: CommandRecord::Sampled,
        rotor_speeds: None,
        body_rates: vec![Vector3::zeros(); rows],
        specific_forces: None,
        motion: Some(motion),
        battery_volts: Some(vec![3.9; rows]),
        set_points: Some(noted),
    };
    let repetition = Repetition::of(&flight, drone, StockController::Cascade).unwrap();
    let (mut flyer, mut flown) = (repetition.flyer(), Vec::new());
    for set_point in followed {
        flown.push((flyer.position(), *flyer.plant.state()));
        for _ in 0..repetition.steps_per_row() {
            flyer.step(set_point, 3.9);
        }
    }
    flight.motion = Some(Motion {
        positions: flown.iter().map(|(position, _)| *position).collect(),
        attitudes: flown.iter().map(|(_, state)| state.world_from_body.map(f64::from)).collect(),
        velocities: flown.iter().map(|(_, state)| state.velocity.cast()).collect(),
    });
    flight
}

#[test]
fn our_own_flight_is_repeated_whatever_the_clock_of_its_set_points() {
    let drone = Drone { thrust_curve: CURVE, ..drone_of(&CRAZYFLIE_2_1) };
    for early in [-0.07, 0.0, 0.12] {
        let flight = flight(&drone, &circle(0.3), circle(0.3 - early));
        let finding = TrackingFinding::of(&flight, &drone).unwrap();
        assert!((finding.early_secs - early).abs() < 1e-9, "{early}: {}", finding.early_secs);
        assert!(finding.passed() && (finding.ratio() - 1.0).abs() < 0.01, "{finding:?}");
        assert!((finding.ours.lag_secs - finding.real.lag_secs).abs() < 0.003, "{finding:?}");
        assert!((0.45..0.65).contains(&finding.real.lag_secs), "{finding:?}");
    }
}

#[test]
fn another_drone_is_told_apart() {
    let ours = Drone { thrust_curve: CURVE, ..drone_of(&CRAZYFLIE_2_1) };
    let mut dragged = ours;
    dragged.airframe.drag_coefficients.planar *= 4.0;
    let flight = flight(&dragged, &circle(0.3), circle(0.3));
    let finding = TrackingFinding::of(&flight, &ours).unwrap();
    assert!(!finding.passed(), "{finding:?}");
}

#[test]
fn a_point_that_follows_has_the_lag_and_the_chord() {
    for late in [0.13, 0.5, 0.94] {
        let positions: Vec<Vector3<f64>> = circle(late).iter().map(|point| point.position).collect();
        let set_points = circle(0.0);
        let judged = (0..2000).map(|row| row >= 700).collect();
        let error = Track { positions: &positions, set_points: &set_points, judged }.error(0.01);
        assert!((error.lag_secs - late).abs() < 2e-3, "{late}: {}", error.lag_secs);
        assert!((error.rms_m - 1.6 * (0.5 * late).sin()).abs() < 1e-9, "{late}: {}", error.rms_m);
    }
}
