//! A flight made ready for the fit: where it may begin to be followed, and what is given along the way.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use crate::flight::{CommandRecord, Flight, Motion};
use crate::smoothing::{derivative, gaussian, gaussian_of_vectors, parabola};

/// Longest step of the integration \[s\]: a twentieth of a rotor's time constant, by the midpoint rule.
const LONGEST_STEP_SECS: f64 = 0.0025;

/// Length of a window in which turning is followed \[s\]: three time constants of the rate damping.
const ROTATION_SECS: f64 = 0.4;

/// Length of a window in which the motion is followed \[s\].
const TRANSLATION_SECS: f64 = 0.5;

/// Time between the starts of two windows \[s\].
const ROTATION_STRIDE_SECS: f64 = 0.2;

/// Time between the starts of two windows \[s\].
const TRANSLATION_STRIDE_SECS: f64 = 0.25;

/// Time between the rows at which a window, or the specific force, is compared \[s\].
const COMPARISON_SECS: f64 = 0.02;

/// Greatest body rate of a window \[rad/s\]: gyroscopes measure 2000 °/s.
const RATE_LIMIT: f64 = 34.0;

/// Mean command over 0.3 s below which a drone stands or falls.
const FLYING_COMMAND: f64 = 0.25;

/// Time after which a quarter comes again that is not learned from \[s\]: two seconds, four windows.
const CYCLE_SECS: f64 = 8.0;

/// Time before a window in which it must already fly, so that the rotors' lag has forgotten the start \[s\].
const SETTLING_SECS: f64 = 0.3;

/// Height under which the ground cushions the rotors \[m\]: twelve propeller radii of a Crazyflie.
const GROUND_HEIGHT_M: f64 = 0.3;

/// Deviation of the filter over accelerometers \[s\]: they shake with the rotors at 100 Hz and more.
const SHAKING_SECS: f64 = 0.006;

/// Longest period of which the noise of a row is smoothed away \[s\]: beyond, five rows hold turns that commands made, and
/// a start that is wrong together with the commands would pass for a delay.
const SMOOTHED_PERIOD_SECS: f64 = 0.002;

/// Which windows of a flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    /// Those that are fitted.
    Fitted,
    /// Those that are kept for the report.
    HeldOut,
}

/// How the air speed is known while turning is followed.
#[derive(Clone, Debug)]
pub(crate) enum Air {
    /// By the motion itself.
    Motion(Vec<MeasuredMotion>),
    /// By the rotors' drag, the planar specific force \[m/s²\] at each row: no velocity was measured.
    Drag(Vec<Vector3<f64>>),
    /// It is not: taken as still.
    Unknown,
}

/// Attitude and velocity in the middle of a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MeasuredMotion {
    pub(crate) attitude: Attitude<f64>,
    /// World \[m/s\].
    pub(crate) velocity: Vector3<f64>,
}

/// A flight and what follows from it before any parameter is known.
#[derive(Clone, Debug)]
pub(crate) struct Course<'a> {
    pub(crate) flight: &'a Flight,
    /// Steps of a row.
    pub(crate) steps_per_row: usize,
    /// [s].
    pub(crate) step_secs: f64,
    /// Body rates without the noise of one row \[rad/s\]: where windows begin.
    pub(crate) start_rates: Vec<Vector3<f64>>,
    pub(crate) air: Air,
    /// Specific force along body z without the rotors' shaking \[m/s²\].
    pub(crate) lift: Option<Vec<f64>>,
    usable: Vec<bool>,
    held_out: Vec<bool>,
}

/// Windows of one length.
#[derive(Clone, Debug, Default)]
pub(crate) struct Windows {
    pub(crate) starts: Vec<usize>,
    pub(crate) rows: usize,
    /// Rows between two comparisons.
    pub(crate) stride: usize,
}

impl<'a> Course<'a> {
    pub(crate) fn new(flight: &'a Flight, held_out: Vec<bool>) -> Self {
        let steps_per_row = (flight.period_secs / LONGEST_STEP_SECS).ceil().max(1.0) as usize;
        let fine = flight.period_secs <= SMOOTHED_PERIOD_SECS;
        let start_rates = if fine { parabola(&flight.body_rates) } else { flight.body_rates.clone() };
        Self {
            flight,
            steps_per_row,
            step_secs: flight.period_secs / steps_per_row as f64,
            air: air(flight, steps_per_row),
            lift: flight.motion.is_none().then(|| lift(flight)).flatten(),
            usable: usable(flight),
            start_rates,
            held_out,
        }
    }

    /// The flight with other rows held out.
    pub(crate) fn holding_out(&self, held_out: impl Fn(usize) -> bool) -> Self {
        Self { held_out: (0..self.held_out.len()).map(held_out).collect(), ..self.clone() }
    }

    /// Whether a row is fitted.
    pub(crate) fn is_fitted(&self, row: usize) -> bool {
        !self.held_out[row]
    }

    /// Whether a row lies in the last quarter of its cycle.
    pub(crate) fn is_in_quarter(&self, row: usize) -> bool {
        (row as f64 * self.flight.period_secs) % CYCLE_SECS >= 0.75 * CYCLE_SECS
    }

    /// Whether nothing of the flight is fitted.
    pub(crate) fn is_held_out(&self) -> bool {
        self.held_out.iter().all(|held_out| *held_out)
    }

    /// Windows in which turning is followed; none where commands are missing.
    pub(crate) fn rotation(&self, part: Part) -> Windows {
        match self.flight.command_record {
            CommandRecord::Sampled => Windows::default(),
            CommandRecord::Complete => self.windows(part, ROTATION_SECS, ROTATION_STRIDE_SECS),
        }
    }

    /// Windows in which the motion is followed; none where it was not measured.
    pub(crate) fn translation(&self, part: Part) -> Windows {
        match &self.flight.motion {
            None => Windows::default(),
            Some(_) => self.windows(part, TRANSLATION_SECS, TRANSLATION_STRIDE_SECS),
        }
    }

    /// Rows at which the specific force along body z is compared.
    pub(crate) fn lift_rows(&self, part: Part) -> Vec<usize> {
        match &self.lift {
            None => Vec::new(),
            Some(_) => self.windows(part, COMPARISON_SECS, COMPARISON_SECS).starts,
        }
    }

    /// Windows of `secs`, one each `stride_secs`, wholly in `part`.
    pub(crate) fn windows(&self, part: Part, secs: f64, stride_secs: f64) -> Windows {
        let flight = self.flight;
        let (rows, stride) = (flight.rows_in(secs), flight.rows_in(stride_secs));
        let settling = flight.rows_in(SETTLING_SECS);
        let wanted = |row: usize| self.held_out[row] == (part == Part::HeldOut);
        let fits = |start: &usize| {
            (*start..=start + rows).all(wanted)
                && self.usable[start - settling..=start + rows].iter().all(|ok| *ok)
        };
        let last = flight.rows().saturating_sub(rows + 1);
        let starts = (settling..last).step_by(stride).filter(fits).collect();
        Windows { starts, rows, stride: flight.rows_in(COMPARISON_SECS) }
    }
}

/// Rows in which the drone flies, above the ground's cushion, and everything was measured.
fn usable(flight: &Flight) -> Vec<bool> {
    let mean: Vec<f64> = flight.commands.iter().map(|motors| motors.iter().sum::<f64>() / 4.0).collect();
    let mean = gaussian(&mean, (0.1 / flight.period_secs).max(1.0));
    let high = |row: usize| flight.motion.as_ref().is_none_or(|motion| motion.positions[row].z > GROUND_HEIGHT_M);
    let turning = |row: usize| flight.body_rates[row].amax() < RATE_LIMIT;
    (0..flight.rows())
        .map(|row| flight.measured[row] && mean[row] > FLYING_COMMAND && high(row) && turning(row))
        .collect()
}

fn air(flight: &Flight, steps_per_row: usize) -> Air {
    match (&flight.motion, &flight.specific_forces) {
        (Some(motion), _) => Air::Motion(in_steps(motion, steps_per_row)),
        (None, Some(forces)) => Air::Drag(planar_forces(flight, forces)),
        (None, None) => Air::Unknown,
    }
}

/// Motion in the middle of each step, on straight lines between the rows.
fn in_steps(motion: &Motion, steps_per_row: usize) -> Vec<MeasuredMotion> {
    let between = |row: usize, step: usize| {
        let share = (step as f64 + 0.5) / steps_per_row as f64;
        let (a, b) = (&motion.attitudes[row], &motion.attitudes[row + 1]);
        let sign = (a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z).signum();
        let mix = |a: f64, b: f64| a * (1.0 - share) + sign * b * share;
        let attitude = Attitude { w: mix(a.w, b.w), x: mix(a.x, b.x), y: mix(a.y, b.y), z: mix(a.z, b.z) };
        let velocity = motion.velocities[row] * (1.0 - share) + motion.velocities[row + 1] * share;
        MeasuredMotion { attitude: attitude.normalized(), velocity }
    };
    let rows = motion.attitudes.len() - 1;
    (0..rows).flat_map(|row| (0..steps_per_row).map(move |step| between(row, step))).collect()
}

fn filter_rows(flight: &Flight) -> f64 {
    (SHAKING_SECS / flight.period_secs).max(0.5)
}

fn lift(flight: &Flight) -> Option<Vec<f64>> {
    let forces = flight.specific_forces.as_ref()?;
    let along: Vec<f64> = forces.iter().map(|force| force.z).collect();
    Some(gaussian(&along, filter_rows(flight)))
}

/// What the accelerometer would show at the centre of mass, across the thrust: an accelerometer above or below it feels
/// angular acceleration as well, which tells the height by itself.
fn planar_forces(flight: &Flight, forces: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let rows = filter_rows(flight);
    let turning = gaussian_of_vectors(&derivative(&flight.body_rates, flight.period_secs), rows);
    let forces = gaussian_of_vectors(forces, rows);
    let height = accelerometer_height(flight, &forces, &turning);
    let at_centre = |(force, turning): (&Vector3<f64>, &Vector3<f64>)| {
        Vector3::new(force.x - height * turning.y, force.y + height * turning.x, 0.0)
    };
    forces.iter().zip(&turning).map(at_centre).collect()
}

/// Height of the accelerometer above the centre of mass \[m\], by least squares in the band from 3 to 10 Hz: drag is
/// slower, shaking faster.
fn accelerometer_height(flight: &Flight, forces: &[Vector3<f64>], turning: &[Vector3<f64>]) -> f64 {
    let band = |column: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
        let rows = |hertz: f64| 1.0 / (std::f64::consts::TAU * hertz * flight.period_secs);
        let slow = gaussian_of_vectors(column, rows(3.0));
        let fast = gaussian_of_vectors(column, rows(10.0).max(0.5));
        fast.iter().zip(&slow).map(|(fast, slow)| fast - slow).collect()
    };
    let (forces, turning, usable) = (band(forces), band(turning), usable(flight));
    let (mut product, mut square) = (0.0, 0.0);
    for row in (0..flight.rows()).filter(|row| usable[*row]) {
        let (force, turning) = (&forces[row], &turning[row]);
        product += force.x * turning.y - force.y * turning.x;
        square += turning.x * turning.x + turning.y * turning.y;
    }
    product / square.max(1e-9)
}
