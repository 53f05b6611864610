//! How far predictions of held-out windows are off, over time, beside holding the state.

use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::alignment::rotation_vector;
use crate::course::{Course, Part, Windows};
use crate::drone::Trim;
use crate::least_squares::Estimate;
use crate::motion::{Driven, Moved};
use crate::residual_network::ResidualNetwork;

/// Length of the windows \[s\].
const HORIZON_SECS: f64 = 0.5;

/// Time between the starts of two windows \[s\].
const STRIDE_SECS: f64 = 0.05;

/// One step of the horizon \[s\], as the published benchmarks have it.
pub const STEP_SECS: f64 = 0.01;

/// What is predicted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signal {
    /// Body rates about x and y: norm of the error \[rad/s\].
    Tilting,
    /// Body rate about z: size of the error \[rad/s\].
    Yawing,
    /// Velocity: norm of the error \[m/s\].
    Velocity,
    /// Position: norm of the error \[m\].
    Position,
    /// Attitude: angle of the rotation between \[rad\].
    Attitude,
    /// All body rates: norm of the error \[rad/s\].
    BodyRates,
}

impl Signal {
    /// Those of windows in which the motion is given where turning is followed, and the attitude where the motion is.
    pub const GIVEN: [Self; 4] = [Self::Tilting, Self::Yawing, Self::Velocity, Self::Position];

    /// Those of windows in which nothing is given but the start and the rotors.
    pub const FLOWN: [Self; 4] = [Self::Position, Self::Velocity, Self::Attitude, Self::BodyRates];

    /// As in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tilting => "roll and pitch rate [rad/s]",
            Self::Yawing => "yaw rate [rad/s]",
            Self::Velocity => "velocity [m/s]",
            Self::Position => "position [m]",
            Self::Attitude => "attitude [rad]",
            Self::BodyRates => "body rates [rad/s]",
        }
    }
}

/// Mean errors of one signal over the horizon.
#[derive(Clone, Debug, PartialEq)]
pub struct Horizon {
    /// Of what.
    pub signal: Signal,
    /// Number of windows.
    pub windows: usize,
    /// Mean error after 1, 2, … steps of holding the state, and then of each model.
    pub curves: Vec<Vec<f64>>,
}

impl Horizon {
    /// Mean error of a curve after a number of steps, from one on.
    pub fn after(&self, curve: usize, steps: usize) -> f64 {
        self.curves[curve][(steps - 1).min(self.curves[curve].len() - 1)]
    }
}

/// What predicts: an estimate, alone or with what a network adds to its accelerations.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Predictor<'a> {
    pub(crate) estimate: &'a Estimate,
    pub(crate) residual: Option<&'a ResidualNetwork>,
}

impl<'a> From<&'a Estimate> for Predictor<'a> {
    fn from(estimate: &'a Estimate) -> Self {
        Self { estimate, residual: None }
    }
}

/// Errors of the held-out windows by holding the state and by each predictor; signals without windows are left out.
pub(crate) fn horizons(courses: &[Course<'_>], predictors: &[Predictor<'_>]) -> Vec<Horizon> {
    summed(courses, predictors, Signal::GIVEN, |course, drivens, sums| {
        add_rotation(course, drivens, sums);
        add_translation(course, drivens, sums);
    })
}

/// Errors of windows from every row of the flights that are wholly held out, where nothing is given but the state at the
/// start and the measured rotor speeds, by holding the state and by each predictor.
pub(crate) fn flown_horizons(courses: &[Course<'_>], predictors: &[Predictor<'_>]) -> Vec<Horizon> {
    summed(courses, predictors, Signal::FLOWN, |course, drivens, sums| {
        if course.is_held_out() {
            add_flown(course, drivens, sums);
        }
    })
}

/// What `add` says of each flight, summed in the order of the flights.
fn summed(
    courses: &[Course<'_>],
    predictors: &[Predictor<'_>],
    signals: [Signal; 4],
    add: impl Fn(&Course<'_>, &[Driven<'_>], &mut [Sum]) + Sync,
) -> Vec<Horizon> {
    let none = || signals.map(|signal| Sum::new(signal, predictors.len() + 1));
    let of_flight = |(index, course)| {
        let driven = |predictor: &Predictor<'_>| {
            let trim = trim_of(courses, index, predictor.estimate);
            Driven::new(course, &predictor.estimate.drone, &trim).with_residual(predictor.residual)
        };
        let mut sums = none();
        add(course, &predictors.iter().map(driven).collect::<Vec<_>>(), &mut sums);
        sums
    };
    let flights: Vec<[Sum; 4]> = courses.par_iter().enumerate().map(of_flight).collect();
    let mut sums = none();
    for flight in &flights {
        for (sum, flight) in sums.iter_mut().zip(flight) {
            sum.join(flight);
        }
    }
    sums.into_iter().filter(|sum| sum.windows > 0).map(Sum::horizon).collect()
}

/// Of a flight that was not fitted, the mean of those that were.
fn trim_of(courses: &[Course<'_>], index: usize, estimate: &Estimate) -> Trim {
    let fitted = |course: &Course<'_>| {
        !course.rotation(Part::Fitted).starts.is_empty() || !course.translation(Part::Fitted).starts.is_empty()
    };
    if fitted(&courses[index]) {
        return estimate.trims[index];
    }
    let fitted: Vec<&Trim> =
        courses.iter().zip(&estimate.trims).filter(|(course, _)| fitted(course)).map(|(_, trim)| trim).collect();
    let count = fitted.len().max(1) as f64;
    let tilt = [0, 1].map(|axis| fitted.iter().map(|trim| trim.tilt[axis]).sum::<f64>() / count);
    let torque = fitted.iter().map(|trim| trim.torque).sum::<Vector3<f64>>() / count;
    Trim { torque, tilt, ..Trim::default() }
}

fn add_flown(course: &Course<'_>, drivens: &[Driven<'_>], sums: &mut [Sum]) {
    let (flight, Some(motion)) = (course.flight, &course.flight.motion) else { return };
    let (rows, stride) = (flight.rows_in(HORIZON_SECS), flight.rows_in(STEP_SECS));
    let whole = |start: &usize| flight.measured[*start..=start + rows].iter().all(|measured| *measured);
    let starts: Vec<usize> = (0..flight.rows().saturating_sub(rows)).filter(whole).collect();
    let mut add = |curve: usize, step: usize, start: usize, predicted: &State<f64>| {
        let row = start + (step + 1) * stride;
        let turned = rotation_angle(&predicted.world_from_body, &motion.attitudes[row]);
        sums[0].add(curve, step, (predicted.position - motion.positions[row]).norm());
        sums[1].add(curve, step, (predicted.velocity - motion.velocities[row]).norm());
        sums[2].add(curve, step, turned);
        sums[3].add(curve, step, (predicted.body_rates - flight.body_rates[row]).norm());
    };
    for start in &starts {
        let held = State {
            position: motion.positions[*start],
            world_from_body: motion.attitudes[*start],
            velocity: motion.velocities[*start],
            body_rates: flight.body_rates[*start],
            rotor_speeds: [0.0; 4],
        };
        for step in 0..rows / stride {
            add(0, step, *start, &held);
        }
    }
    for (model, driven) in drivens.iter().enumerate() {
        for (start, states) in starts.iter().zip(driven.flown(&starts, rows)) {
            for (step, state) in states.iter().skip(stride - 1).step_by(stride).enumerate() {
                add(model + 1, step, *start, state);
            }
        }
    }
    for sum in sums {
        sum.windows += starts.len();
    }
}

/// The angle from one attitude to the other \[rad\].
fn rotation_angle(from: &Attitude<f64>, to: &Attitude<f64>) -> f64 {
    let dot = from.w * to.w + from.x * to.x + from.y * to.y + from.z * to.z;
    let between = rotation_vector(from, to).norm() * 0.5;
    2.0 * between.atan2(dot.abs())
}

fn add_rotation(course: &Course<'_>, drivens: &[Driven<'_>], sums: &mut [Sum]) {
    let flight = course.flight;
    if course.rotation(Part::HeldOut).starts.is_empty() {
        return;
    }
    let Windows { starts, rows, .. } = course.windows(Part::HeldOut, HORIZON_SECS, STRIDE_SECS);
    let stride = flight.rows_in(STEP_SECS);
    let mut add = |curve: usize, start: usize, predicted: &[Vector3<f64>]| {
        for (step, rates) in predicted.iter().enumerate() {
            let error = rates - flight.body_rates[start + (step + 1) * stride];
            sums[0].add(curve, step, error.xy().norm());
            sums[1].add(curve, step, error.z.abs());
        }
    };
    for start in &starts {
        add(0, *start, &vec![course.start_rates[*start]; rows / stride]);
    }
    for (model, driven) in drivens.iter().enumerate() {
        for (start, turned) in starts.iter().zip(driven.turned(&starts, rows, stride)) {
            add(model + 1, *start, &turned);
        }
    }
    for sum in &mut sums[..2] {
        sum.windows += starts.len();
    }
}

fn add_translation(course: &Course<'_>, drivens: &[Driven<'_>], sums: &mut [Sum]) {
    let (flight, Some(motion)) = (course.flight, &course.flight.motion) else { return };
    let Windows { starts, rows, .. } = course.windows(Part::HeldOut, HORIZON_SECS, STRIDE_SECS);
    let stride = flight.rows_in(STEP_SECS);
    let mut add = |curve: usize, start: usize, predicted: &[Moved]| {
        for (step, moved) in predicted.iter().enumerate() {
            let row = start + (step + 1) * stride;
            sums[2].add(curve, step, (moved.velocity - motion.velocities[row]).norm());
            sums[3].add(curve, step, (moved.position - motion.positions[row]).norm());
        }
    };
    for start in &starts {
        let held = Moved { position: motion.positions[*start], velocity: motion.velocities[*start] };
        add(0, *start, &vec![held; rows / stride]);
    }
    for (model, driven) in drivens.iter().enumerate() {
        for (start, moved) in starts.iter().zip(driven.moved(&starts, rows, stride)) {
            add(model + 1, *start, &moved);
        }
    }
    for sum in &mut sums[2..] {
        sum.windows += starts.len();
    }
}

/// Sums of errors, a curve each model.
struct Sum {
    signal: Signal,
    windows: usize,
    curves: Vec<Vec<(f64, usize)>>,
}

impl Sum {
    fn new(signal: Signal, curves: usize) -> Self {
        Self { signal, windows: 0, curves: vec![Vec::new(); curves] }
    }

    fn add(&mut self, curve: usize, step: usize, error: f64) {
        let curve = &mut self.curves[curve];
        if curve.len() <= step {
            curve.resize(step + 1, (0.0, 0));
        }
        curve[step].0 += error;
        curve[step].1 += 1;
    }

    fn join(&mut self, other: &Self) {
        self.windows += other.windows;
        for (curve, other) in self.curves.iter_mut().zip(&other.curves) {
            curve.resize(curve.len().max(other.len()), (0.0, 0));
            for ((sum, count), (other_sum, other_count)) in curve.iter_mut().zip(other) {
                *sum += other_sum;
                *count += other_count;
            }
        }
    }

    fn horizon(self) -> Horizon {
        let mean = |(sum, count): (f64, usize)| sum / count.max(1) as f64;
        let curves = self.curves.into_iter().map(|curve| curve.into_iter().map(mean).collect()).collect();
        Horizon { signal: self.signal, windows: self.windows, curves }
    }
}
