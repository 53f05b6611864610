//! The flapping moment from flights whose commands were sampled: what holds the drone against the air, on the average.
//!
//! Between two samples the controller gave commands that nobody knows, so that turning cannot be followed. Over half a
//! second they average out: what the rotors' mean torque leaves of the mean angular acceleration is the moment of the
//! air.

use nalgebra::Vector3;

use crate::course::{Course, Part};
use crate::drone::{Drone, Trim};
use crate::flight::CommandRecord;
use crate::least_squares::{Estimate, Prior};
use crate::motion::Driven;
use crate::parameter::Parameter;
use crate::smoothing::{derivative, gaussian_of_vectors};

/// Deviation of the averages \[s\]: they pass 0.8 Hz, where a controller of 500 Hz has averaged 400 commands.
const AVERAGE_SECS: f64 = 0.2;

/// Fewest flights whose scatter says how certain their mean is.
const FEWEST_FLIGHTS: usize = 3;

/// Relative deviation that a mean has at least: the thrust curve, which the moment is measured by, is no better known.
const CURVE_DEVIATION: f64 = 0.05;

/// What the averages say of the flapping moment.
pub(crate) fn flapping_moment(courses: &[&Course<'_>], estimate: &Estimate) -> Option<Prior> {
    let mut drone = estimate.drone;
    Parameter::FlappingMoment.set(&mut drone, 0.0);
    let of_course = |(course, trim): (&&Course<'_>, &Trim)| sums(course, &drone, trim);
    let sums: Vec<Sums> = courses.iter().zip(&estimate.trims).filter_map(of_course).collect();
    let total = sums.iter().fold(Sums::default(), |total, one| Sums {
        product: total.product + one.product,
        square: total.square + one.square,
    });
    let moment = total.product / total.square;
    if sums.len() < FEWEST_FLIGHTS || moment.is_nan() || moment <= 0.0 {
        return None;
    }
    let scatter = |one: &Sums| (one.square / total.square * (one.product / one.square - moment)).powi(2);
    let flights = sums.len() as f64;
    let deviation = (flights / (flights - 1.0) * sums.iter().map(scatter).sum::<f64>()).sqrt() / moment;
    Some(Prior { value: moment, deviation: deviation.hypot(CURVE_DEVIATION) })
}

/// Of one flight: moment of the air times what a unit of flapping gives, and that squared.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    product: f64,
    square: f64,
}

fn sums(course: &Course<'_>, drone: &Drone, trim: &Trim) -> Option<Sums> {
    let flight = course.flight;
    let turned = flight.rotor_speeds.is_some() || flight.command_record == CommandRecord::Complete;
    if flight.motion.is_none() || turned {
        return None;
    }
    let rows = AVERAGE_SECS / flight.period_secs;
    let driven = Driven::new(course, drone, trim);
    let turned = derivative(&flight.body_rates, flight.period_secs);
    let explained: Vec<Vector3<f64>> = (0..flight.rows() - 1).map(|row| driven.turning_at(row)).collect();
    let left: Vec<Vector3<f64>> =
        turned.iter().zip(&explained).map(|(turned, explained)| turned - explained).collect();
    let [jx, jy, _] = drone.airframe.inertia;
    let flapping = |row: usize| {
        let (speed, air) = driven.air_at(row);
        Vector3::new(speed * air.y / jx, -speed * air.x / jy, 0.0)
    };
    let flapping: Vec<Vector3<f64>> = (0..flight.rows() - 1).map(flapping).collect();
    let (left, flapping) = (gaussian_of_vectors(&left, rows), gaussian_of_vectors(&flapping, rows));
    let margin = flight.rows_in(3.0 * AVERAGE_SECS);
    let windows = course.windows(Part::Fitted, 6.0 * AVERAGE_SECS, flight.period_secs);
    let middles: Vec<usize> = windows.starts.iter().map(|start| start + margin).collect();
    let count = middles.len() as f64;
    let mean = |column: &[Vector3<f64>]| middles.iter().map(|row| column[*row]).sum::<Vector3<f64>>() / count;
    let (left_mean, flapping_mean) = (mean(&left), mean(&flapping));
    // In units of torque, so that both axes count alike.
    let torque = Vector3::new(jx, jy, 0.0);
    let mut sums = Sums::default();
    for row in middles {
        let left = (left[row] - left_mean).component_mul(&torque);
        let flapping = (flapping[row] - flapping_mean).component_mul(&torque);
        sums.product += left.dot(&flapping);
        sums.square += flapping.dot(&flapping);
    }
    (sums.square > 0.0).then_some(sums)
}
