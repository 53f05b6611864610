//! Turning from flights whose rotor speeds were measured: the rotors' moments, explained by the motion.
//!
//! A hundred times a second, by radio, rotor speeds are late and noisy, and there is air that no model knows of; the
//! gyroscope is clean. Whoever explains the motion by such moments finds gains that are too small (Fuller 1987,
//! Measurement error models), and a drone with several times its inertia. So the moments are explained by the motion:
//!
//! ```text
//! Σ yᵢ Fᵢ − (J_z − J_y) ω_y ω_z = J_x ω̇_x + D_x ω_x − c_f ΣΩ w_y
//! −Σ xᵢ Fᵢ − (J_x − J_z) ω_z ω_x = J_y ω̇_y + D_y ω_y + c_f ΣΩ w_x
//! ```
//!
//! About z a rotor's reaction is so strong that noise matters less, and both reactions explain the motion:
//! `J_z ω̇_z = k_m Σ sᵢ Ωᵢ² + J_r Σ sᵢ Ω̇ᵢ − D_z ω_z`.

use kestrel_core::airframe::{Airframe, Layout};
use nalgebra::{SMatrix, SVector, Vector3};

use crate::course::{Course, Part};
use crate::flight::Flight;
use crate::least_squares::{Estimate, Prior};
use crate::parameter::Parameter;
use crate::smoothing::{derivative, gaussian_of_vectors};

/// The band in which the motion explains \[Hz\]. Below, the air is stronger than what turns the drone: wakes that it meets
/// again, and a flapping moment that falls with the climb. Above, differences of rates a hundredth of a second apart lose
/// more than a tenth.
const EXPLAINED_HERTZ: [f64; 2] = [1.0, 8.0];

/// Farthest that rotor speeds may be late or early \[s\].
const REACH_SECS: f64 = 0.04;

/// Step of the search for it \[s\], between which a parabola interpolates.
const TIMING_STEP_SECS: f64 = 0.005;

/// Length of the stretches whose scatter says how certain the numbers are \[s\].
const STRETCH_SECS: f64 = 4.0;

/// Fewest stretches: five numbers about x and y, twice.
const FEWEST_STRETCHES: usize = 10;

/// Deviation of the logarithm that each number has at least: what noise in the gyroscope takes away does not scatter
/// (`recovery 100 speeds`).
const LEAST_DEVIATION: f64 = 0.04;

/// Numbers about x and y, in the order of the unknowns.
const TILTING: [Parameter; 5] = [
    Parameter::InertiaX,
    Parameter::InertiaY,
    Parameter::RateDampingX,
    Parameter::RateDampingY,
    Parameter::FlappingMoment,
];

/// Numbers about z, in the order of the unknowns.
const YAWING: [Parameter; 3] = [Parameter::RotorInertia, Parameter::RateDampingZ, Parameter::TorqueCoefficient];

/// What the moments say of each number, as something known beforehand; nothing where they say nothing.
pub(crate) fn told(courses: &[&Course<'_>], estimate: &Estimate) -> Vec<(Parameter, Prior)> {
    let airframe = &estimate.drone.airframe;
    let columns: Vec<Columns> = courses.iter().filter_map(|course| Columns::of(course, airframe)).collect();
    let tilting: Vec<Sums<5>> =
        columns.iter().flat_map(|columns| columns.sums(airframe, Columns::tilting)).collect();
    let yawing: Vec<Sums<3>> =
        columns.iter().flat_map(|columns| columns.sums(airframe, Columns::yawing)).collect();
    let as_they_are = |unknowns: &SVector<f64, 5>| *unknowns;
    let sign = airframe.torque_coefficient.signum();
    let of_rotor = |unknowns: &SVector<f64, 3>| {
        unknowns.component_mul(&SVector::from([1.0, 1.0, sign])) * airframe.inertia[2]
    };
    let mut told = known(&TILTING, &tilting, &as_they_are);
    told.extend(known(&YAWING, &yawing, &of_rotor));
    told
}

/// The flight with its rotor speeds on the clock of its gyroscope, where they were measured: as late or early as leaves
/// least of the rotors' moments unexplained.
pub(crate) fn timed(flight: &Flight, airframe: &Airframe) -> Flight {
    let Some(speeds) = flight.rotor_speeds.clone() else { return flight.clone() };
    let course = Course::new(flight, vec![false; flight.rows()]);
    let Some(mut columns) = Columns::of(&course, airframe) else { return flight.clone() };
    let mut unexplained = |late: f64| {
        columns.moments = band(&moments(&shifted(&speeds, late), airframe), EXPLAINED_HERTZ, flight);
        columns.unexplained(airframe)
    };
    let step = TIMING_STEP_SECS / flight.period_secs;
    let reach = (REACH_SECS / TIMING_STEP_SECS) as i32;
    let shares: Vec<f64> = (-reach..=reach).map(|steps| unexplained(f64::from(steps) * step)).collect();
    let best = (0..shares.len()).min_by(|a, b| shares[*a].total_cmp(&shares[*b])).unwrap_or(0);
    if best == 0 || best + 1 == shares.len() || !shares[best].is_finite() {
        return flight.clone();
    }
    let [before, least, after] = [shares[best - 1], shares[best], shares[best + 1]];
    let offset = 0.5 * (before - after) / (before - 2.0 * least + after);
    let late = (best as f64 - f64::from(reach) + offset) * step;
    Flight { rotor_speeds: Some(shifted(&speeds, late)), ..flight.clone() }
}

/// Least squares over the stretches: normal matrix and right side of one.
#[derive(Clone, Copy)]
struct Sums<const N: usize> {
    matrix: SMatrix<f64, N, N>,
    side: SVector<f64, N>,
    /// Of what is explained, squared.
    square: f64,
}

impl<const N: usize> Sums<N> {
    fn none() -> Self {
        Self { matrix: SMatrix::zeros(), side: SVector::zeros(), square: 0.0 }
    }

    fn add(&mut self, regressors: &SVector<f64, N>, explained: f64) {
        self.matrix += regressors * regressors.transpose();
        self.side += regressors * explained;
        self.square += explained * explained;
    }

    fn total(stretches: &[Self]) -> Self {
        let add = |sum: Self, one: &Self| Self {
            matrix: sum.matrix + one.matrix,
            side: sum.side + one.side,
            square: sum.square + one.square,
        };
        stretches.iter().fold(Self::none(), add)
    }
}

/// The numbers that all stretches give together, each with the deviation of its logarithm by leaving out one stretch
/// after the other (Tukey 1958).
fn known<const N: usize>(
    parameters: &[Parameter; N],
    stretches: &[Sums<N>],
    numbers: &dyn Fn(&SVector<f64, N>) -> SVector<f64, N>,
) -> Vec<(Parameter, Prior)> {
    let total = Sums::total(stretches);
    let solved = |without: Option<&Sums<N>>| {
        let none = Sums::none();
        let left_out = without.unwrap_or(&none);
        let inverse = (total.matrix - left_out.matrix).try_inverse()?;
        Some(numbers(&(inverse * (total.side - left_out.side))))
    };
    let (Some(whole), true) = (solved(None), stretches.len() >= FEWEST_STRETCHES) else { return Vec::new() };
    let parts: Vec<SVector<f64, N>> = stretches.iter().filter_map(|stretch| solved(Some(stretch))).collect();
    let count = parts.len() as f64;
    let prior = |index: usize| {
        let distances = parts.iter().map(|part| (part[index] / whole[index]).ln());
        let square = distances.map(|distance| distance * distance).sum::<f64>();
        let prior = Prior {
            value: whole[index],
            deviation: ((count - 1.0) / count * square).sqrt().hypot(LEAST_DEVIATION),
        };
        prior.deviation.is_finite().then_some((parameters[index], prior))
    };
    (0..N).filter_map(prior).collect()
}

/// What is known at each row of a flight, in the band that explains.
struct Columns {
    stretches: Vec<std::ops::Range<usize>>,
    /// Of the rotors about x and y \[N m\]; about z `Σ sᵢ Ωᵢ²` \[rad²/s²\].
    moments: Vec<Vector3<f64>>,
    /// `Σ sᵢ Ω̇ᵢ` \[rad/s²\] as z.
    spin_up: Vec<Vector3<f64>>,
    /// \[rad/s\].
    rates: Vec<Vector3<f64>>,
    /// \[rad/s²\].
    turning: Vec<Vector3<f64>>,
    /// Products of rates that Euler's equation takes \[rad²/s²\]: `ω_y ω_z`, `ω_z ω_x`, `ω_x ω_y`.
    products: Vec<Vector3<f64>>,
    /// Summed rotor speed times air velocity, body \[rad m/s²\].
    flapping: Vec<Vector3<f64>>,
}

impl Columns {
    /// `None` of a flight whose rotor speeds or motion were not measured.
    fn of(course: &Course<'_>, airframe: &Airframe) -> Option<Self> {
        let flight = course.flight;
        let (speeds, motion) = (flight.rotor_speeds.as_ref()?, flight.motion.as_ref()?);
        let turning = derivative(&flight.body_rates, flight.period_secs);
        let signed = |row: &[f64; 4]| Layout::TORQUE_SIGNS.iter().zip(row).map(|(sign, speed)| sign * speed).sum();
        let along_z: Vec<Vector3<f64>> = speeds.iter().map(|row| Vector3::new(0.0, 0.0, signed(row))).collect();
        let flapping = |(row, speeds): (usize, &[f64; 4])| {
            motion.attitudes[row].rotate_inverse(motion.velocities[row]) * speeds.iter().sum::<f64>()
        };
        let flapping: Vec<Vector3<f64>> = speeds.iter().enumerate().map(flapping).collect();
        let product = |rates: &Vector3<f64>| rates.yzx().component_mul(&rates.zxy());
        let products: Vec<Vector3<f64>> = flight.body_rates.iter().map(product).collect();
        let felt = |column: &[Vector3<f64>]| band(column, EXPLAINED_HERTZ, flight);
        let windows = course.windows(Part::Fitted, STRETCH_SECS, STRETCH_SECS);
        Some(Self {
            stretches: windows.starts.iter().map(|start| *start..start + windows.rows).collect(),
            moments: felt(&moments(speeds, airframe)),
            spin_up: felt(&derivative(&along_z, flight.period_secs)),
            rates: felt(&flight.body_rates),
            turning: felt(&turning),
            products: felt(&products),
            flapping: felt(&flapping),
        })
    }

    /// Sums of each stretch. What is constant in a flight is its trim and explains nothing.
    fn sums<const N: usize, const M: usize>(
        &self,
        airframe: &Airframe,
        equations: fn(&Self, usize, &Airframe) -> [Equation<N>; M],
    ) -> Vec<Sums<N>> {
        let rows = || self.stretches.iter().flat_map(Clone::clone);
        let count = rows().count().max(1) as f64;
        let mut means = [Equation::none(); M];
        for row in rows() {
            for (mean, equation) in means.iter_mut().zip(equations(self, row, airframe)) {
                mean.regressors += equation.regressors / count;
                mean.explained += equation.explained / count;
            }
        }
        let of_stretch = |stretch: &std::ops::Range<usize>| {
            let mut sums = Sums::none();
            for row in stretch.clone() {
                for (mean, equation) in means.iter().zip(equations(self, row, airframe)) {
                    sums.add(&(equation.regressors - mean.regressors), equation.explained - mean.explained);
                }
            }
            sums
        };
        self.stretches.iter().map(of_stretch).collect()
    }

    /// Share of the moments about x and y that the motion does not explain.
    fn unexplained(&self, airframe: &Airframe) -> f64 {
        let total = Sums::total(&self.sums(airframe, Self::tilting));
        let explained = total.matrix.try_inverse().map(|inverse| (inverse * total.side).dot(&total.side));
        explained.map_or(f64::INFINITY, |explained| 1.0 - explained / total.square)
    }

    fn tilting(&self, row: usize, airframe: &Airframe) -> [Equation<5>; 2] {
        let [jx, jy, jz] = airframe.inertia;
        let (rates, turning, flapping) = (&self.rates[row], &self.turning[row], &self.flapping[row]);
        let (moment, product) = (&self.moments[row], &self.products[row]);
        [
            Equation {
                regressors: SVector::from([turning.x, 0.0, rates.x, 0.0, -flapping.y]),
                explained: moment.x - (jz - jy) * product.x,
            },
            Equation {
                regressors: SVector::from([0.0, turning.y, 0.0, rates.y, flapping.x]),
                explained: moment.y - (jx - jz) * product.y,
            },
        ]
    }

    fn yawing(&self, row: usize, airframe: &Airframe) -> [Equation<3>; 1] {
        let sign = airframe.torque_coefficient.signum();
        let regressors =
            SVector::from([sign * self.spin_up[row].z, -self.rates[row].z, sign * self.moments[row].z]);
        [Equation { regressors, explained: self.turning[row].z }]
    }
}

/// A row of least squares.
#[derive(Clone, Copy)]
struct Equation<const N: usize> {
    regressors: SVector<f64, N>,
    explained: f64,
}

impl<const N: usize> Equation<N> {
    fn none() -> Self {
        Self { regressors: SVector::zeros(), explained: 0.0 }
    }
}

/// Of the rotors at each row: about x and y \[N m\], about z the signed squares \[rad²/s²\].
fn moments(speeds: &[[f64; 4]], airframe: &Airframe) -> Vec<Vector3<f64>> {
    let positions = airframe.rotor_positions();
    let of_row = |row: &[f64; 4]| {
        let mut moment = Vector3::zeros();
        for ((speed, [x, y]), sign) in row.iter().zip(positions).zip(Layout::TORQUE_SIGNS) {
            let square = speed * speed;
            let thrust = airframe.thrust_coefficient * square;
            moment += Vector3::new(y * thrust, -x * thrust, sign * square);
        }
        moment
    };
    speeds.iter().map(of_row).collect()
}

/// The deviation in rows of a Gaussian that halves the power at a frequency, near enough.
fn rows_of(hertz: f64, flight: &Flight) -> f64 {
    (1.0 / (std::f64::consts::TAU * hertz * flight.period_secs)).max(0.5)
}

/// What a column has between two frequencies.
fn band(column: &[Vector3<f64>], hertz: [f64; 2], flight: &Flight) -> Vec<Vector3<f64>> {
    let [slow, fast] = hertz.map(|hertz| gaussian_of_vectors(column, rows_of(hertz, flight)));
    fast.iter().zip(&slow).map(|(fast, slow)| fast - slow).collect()
}

/// The column `late` rows earlier, on straight lines between the rows; its ends held.
fn shifted<const N: usize>(column: &[[f64; N]], late: f64) -> Vec<[f64; N]> {
    let last = column.len() - 1;
    let at = |row: usize| {
        let place = (row as f64 + late).clamp(0.0, last as f64);
        let (before, share) = (&column[place as usize], place.fract());
        let after = &column[(place as usize + 1).min(last)];
        std::array::from_fn(|part| before[part] + (after[part] - before[part]) * share)
    };
    (0..column.len()).map(at).collect()
}
