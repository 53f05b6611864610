//! What the model gets wrong along the windows of a flight, in units of how much it usually gets wrong.

use crate::course::{Course, Part, Windows};
use crate::drone::{Drone, Trim};
use crate::motion::Driven;
use crate::parameter::TrimPart;

/// Signals of which the errors have one size each: body rates, specific force, velocity.
const SIGNALS: usize = 7;

/// First of each kind of signal.
const RATES: usize = 0;
const LIFT: usize = 3;
const VELOCITY: usize = 4;

/// Stretch of a flight whose errors go together \[s\]: what the model lacks changes no faster.
const TOGETHER_SECS: f64 = 1.0;

/// Errors smaller than this share of the typical one count as that: a signal without any has no infinite weight.
const SMALLEST_ERROR: [f64; SIGNALS] = [1e-3, 1e-3, 1e-3, 1e-2, 1e-4, 1e-4, 1e-4];

/// The windows of a flight that are fitted, and the size of its errors.
pub(crate) struct Residuals<'a> {
    pub(crate) course: &'a Course<'a>,
    rotation: Windows,
    translation: Windows,
    lift: Vec<usize>,
    /// Signal of each row of the errors.
    signals: Vec<u8>,
    /// Stretch of each row.
    pub(crate) stretches: Vec<u32>,
    /// Size of the errors of each signal, in its unit.
    sizes: [f64; SIGNALS],
}

impl<'a> Residuals<'a> {
    pub(crate) fn new(course: &'a Course<'a>, part: Part) -> Self {
        let rotation = course.rotation(part);
        let (translation, lift) = (course.translation(part), course.lift_rows(part));
        let mut residuals = Self {
            course,
            rotation,
            translation,
            lift,
            signals: Vec::new(),
            stretches: Vec::new(),
            sizes: [1.0; SIGNALS],
        };
        residuals.describe();
        residuals
    }

    /// Number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.signals.len()
    }

    /// Parts of the trim that this flight has.
    pub(crate) fn trim_parts(&self) -> Vec<TrimPart> {
        let flight = self.course.flight;
        let mut parts = Vec::new();
        if !self.rotation.starts.is_empty() {
            parts.extend([0, 1, 2].map(TrimPart::Torque));
        }
        if !self.translation.starts.is_empty() {
            parts.extend([0, 1].map(TrimPart::Tilt));
        }
        if flight.battery_volts.is_none() && flight.rotor_speeds.is_none() && self.rows() > 0 {
            parts.extend([TrimPart::Charge, TrimPart::Discharge]);
        }
        parts
    }

    /// Errors in units of their sizes.
    pub(crate) fn of(&self, drone: &Drone, trim: &Trim) -> Vec<f64> {
        let mut errors = self.raw(drone, trim);
        for (error, signal) in errors.iter_mut().zip(&self.signals) {
            *error /= self.sizes[usize::from(*signal)];
        }
        errors
    }

    /// Takes the root mean square of the present errors of all flights as each signal's size: what one flight shows of a
    /// signal that it hardly moves says nothing about how well the model follows it.
    pub(crate) fn resize_all(flights: &mut [Self], drone: &Drone, trims: &[Trim]) {
        let mut sums = [(0.0, 0.0); SIGNALS];
        for (flight, trim) in flights.iter().zip(trims) {
            for (error, signal) in flight.raw(drone, trim).into_iter().zip(&flight.signals) {
                let (squares, count) = &mut sums[usize::from(*signal)];
                *squares += error * error;
                *count += 1.0;
            }
        }
        let size = |signal: usize| {
            let (squares, count): (f64, f64) = sums[signal];
            (squares / count.max(1.0)).sqrt().max(SMALLEST_ERROR[signal])
        };
        let sizes = std::array::from_fn(size);
        for flight in flights {
            flight.sizes = sizes;
        }
    }

    /// Lists signal and stretch of each row in the order of [`Self::raw`].
    fn describe(&mut self) {
        let flight = self.course.flight;
        let stretch = |row: usize| (row as f64 * flight.period_secs / TOGETHER_SECS) as u32;
        let mut rows = Vec::new();
        for (windows, first) in [(&self.rotation, RATES), (&self.translation, VELOCITY)] {
            for start in &windows.starts {
                let count = windows.rows / windows.stride;
                rows.extend((0..3 * count).map(|index| ((first + index % 3) as u8, stretch(*start))));
            }
        }
        rows.extend(self.lift.iter().map(|row| (LIFT as u8, stretch(*row))));
        (self.signals, self.stretches) = rows.into_iter().unzip();
    }

    fn raw(&self, drone: &Drone, trim: &Trim) -> Vec<f64> {
        let driven = Driven::new(self.course, drone, trim);
        let flight = self.course.flight;
        let mut errors = Vec::with_capacity(self.rows());
        let Windows { starts, rows, stride } = &self.rotation;
        for (start, turned) in starts.iter().zip(driven.turned(starts, *rows, *stride)) {
            for (index, rates) in turned.into_iter().enumerate() {
                errors.extend((rates - flight.body_rates[start + (index + 1) * stride]).iter());
            }
        }
        let Windows { starts, rows, stride } = &self.translation;
        if let Some(motion) = &flight.motion {
            for (start, moved) in starts.iter().zip(driven.moved(starts, *rows, *stride)) {
                for (index, moved) in moved.into_iter().enumerate() {
                    errors.extend((moved.velocity - motion.velocities[start + (index + 1) * stride]).iter());
                }
            }
        }
        if let Some(lift) = &self.course.lift {
            errors.extend(self.lift.iter().map(|row| driven.lift(*row) - lift[*row]));
        }
        errors
    }
}
