//! Levenberg–Marquardt over the windows of all flights (Marquardt 1963), with differences for derivatives, Huber's
//! weights against outliers, and what is known beforehand as one more observation of each number.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use rayon::prelude::*;

use crate::drone::{Drone, Trim};
use crate::parameter::{Parameter, TrimPart};
use crate::residual::Residuals;

/// Errors beyond this many sizes count linearly (Huber 1964).
const OUTLIER: f64 = 2.0;

/// Share of the errors that is news: windows overlap twice, and five errors in a row say nearly the same. It weighs
/// the errors against what is known beforehand; the intervals follow from the scatter of whole stretches.
const NEWS: f64 = 0.05;

/// Steps of one search; most need eight.
const STEPS_LIMIT: usize = 25;

/// Share of the cost that a step must still gain for another one to be worth it.
const WORTHWHILE: f64 = 1e-6;

/// Damping at which a search that finds nothing better ends.
const DAMPING_LIMIT: f64 = 1e8;

/// Farthest that one step moves a number, in what is known beforehand of it.
const LONGEST_STEP: f64 = 0.7;

/// The drone and the trim of each flight.
#[derive(Clone, Debug)]
pub(crate) struct Estimate {
    pub(crate) drone: Drone,
    pub(crate) trims: Vec<Trim>,
}

/// An estimate, and the sum of squares that it leaves.
struct Fit {
    estimate: Estimate,
    cost: f64,
}

/// What is known of a number before the windows are read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    /// Most likely value.
    pub(crate) value: f64,
    /// Standard deviation on the number's scale.
    pub(crate) deviation: f64,
}

/// A number that is searched.
#[derive(Clone, Copy, Debug)]
enum Unknown {
    Drone(Parameter, Prior),
    Trim { flight: usize, part: TrimPart },
}

impl Unknown {
    fn moved(self, estimate: &Estimate, change: f64) -> Estimate {
        let mut moved = estimate.clone();
        match self {
            Self::Drone(parameter, _) => {
                let value = parameter.moved(parameter.value(&moved.drone), change);
                parameter.set(&mut moved.drone, value);
            }
            Self::Trim { flight, part } => *part.place(&mut moved.trims[flight]) += change,
        }
        moved
    }

    const fn step(self) -> f64 {
        match self {
            Self::Drone(parameter, _) => parameter.scale().step(),
            Self::Trim { part, .. } => part.step(),
        }
    }

    /// Distance from what is known beforehand, and its standard deviation.
    fn prior(self, estimate: &Estimate) -> (f64, f64) {
        match self {
            Self::Drone(parameter, prior) => {
                (parameter.distance(parameter.value(&estimate.drone), prior.value), prior.deviation)
            }
            Self::Trim { flight, part } => (*part.place(&mut estimate.trims[flight].clone()), part.spread()),
        }
    }
}

/// The sum of squares near an estimate.
struct Normal {
    /// Weighted `JᵀJ` and what is known beforehand: Fisher's information.
    information: Mat<f64>,
    /// Half the gradient.
    gradient: Vec<f64>,
    /// Half-gradients of the stretches, whose scatter says how far the errors go together.
    stretches: Vec<Vec<f64>>,
}

/// The numbers that are searched in these flights.
pub(crate) struct Search<'a> {
    residuals: &'a [Residuals<'a>],
    unknowns: Vec<Unknown>,
}

/// How well the numbers are known.
#[derive(Clone, Debug)]
pub(crate) struct Uncertainty {
    /// Standard deviation of each parameter on its scale.
    pub(crate) deviations: Vec<f64>,
    /// By Fisher's information, in the same order.
    pub(crate) correlations: Vec<Vec<f64>>,
}

/// Why a search ended before its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Interrupted;

impl<'a> Search<'a> {
    /// For `parameters`, each with what is known of it, and the trims.
    pub(crate) fn new(residuals: &'a [Residuals<'a>], parameters: &[(Parameter, Prior)]) -> Self {
        let drone = parameters.iter().map(|(parameter, prior)| Unknown::Drone(*parameter, *prior));
        let trims = residuals.iter().enumerate().flat_map(|(flight, residuals)| {
            residuals.trim_parts().into_iter().map(move |part| Unknown::Trim { flight, part })
        });
        Self { residuals, unknowns: drone.chain(trims).collect() }
    }

    /// The estimate with the least sum of squares near `estimate`; `go_on` is asked before each step.
    pub(crate) fn run(&self, estimate: Estimate, go_on: &dyn Fn() -> bool) -> Result<Estimate, Interrupted> {
        let mut damping = 1e-3;
        let mut fit = Fit { cost: self.cost(&estimate), estimate };
        for _ in 0..STEPS_LIMIT {
            if !go_on() {
                return Err(Interrupted);
            }
            let normal = self.normal(&fit.estimate);
            let Some(better) = self.step(&normal, &fit, &mut damping) else { break };
            let gain = (fit.cost - better.cost) / fit.cost;
            fit = better;
            if gain < WORTHWHILE {
                break;
            }
        }
        Ok(fit.estimate)
    }

    /// A step that lowers the cost, with as much damping as it needs.
    fn step(&self, normal: &Normal, from: &Fit, damping: &mut f64) -> Option<Fit> {
        while *damping < DAMPING_LIMIT {
            let moved = self.moved(normal, &from.estimate, *damping);
            match moved.map(|estimate| Fit { cost: self.cost(&estimate), estimate }) {
                Some(better) if better.cost < from.cost => {
                    *damping = (*damping * 0.1).max(1e-9);
                    return Some(better);
                }
                Some(_) | None => *damping *= 5.0,
            }
        }
        None
    }

    fn moved(&self, normal: &Normal, estimate: &Estimate, damping: f64) -> Option<Estimate> {
        let count = self.unknowns.len();
        let mut damped = normal.information.clone();
        for index in 0..count {
            damped[(index, index)] *= 1.0 + damping;
        }
        let factor = damped.llt(Side::Lower).ok()?;
        let gradient = Mat::from_fn(count, 1, |row, _| -normal.gradient[row]);
        let change = factor.solve(&gradient);
        let spread = |index: usize| self.unknowns[index].prior(estimate).1;
        let longest = (0..count).map(|index| change[(index, 0)].abs() / spread(index)).fold(0.0, f64::max);
        let share = (LONGEST_STEP / longest).min(1.0);
        let moves = self.unknowns.iter().enumerate();
        let moved = moves
            .fold(estimate.clone(), |moved, (index, unknown)| unknown.moved(&moved, share * change[(index, 0)]));
        Some(moved)
    }

    fn cost(&self, estimate: &Estimate) -> f64 {
        let of_flight = |(residuals, trim): (&Residuals<'_>, &Trim)| -> f64 {
            residuals.of(&estimate.drone, trim).into_iter().map(loss).sum()
        };
        let windows: f64 =
            self.residuals.par_iter().zip(&estimate.trims).map(of_flight).collect::<Vec<_>>().iter().sum();
        let known = self.unknowns.iter().map(|unknown| {
            let (distance, deviation) = unknown.prior(estimate);
            0.5 * (distance / deviation).powi(2)
        });
        windows + known.sum::<f64>()
    }

    fn normal(&self, estimate: &Estimate) -> Normal {
        let count = self.unknowns.len();
        let mut normal =
            Normal { information: Mat::zeros(count, count), gradient: vec![0.0; count], stretches: Vec::new() };
        for (flight, residuals) in self.residuals.iter().enumerate() {
            self.add_flight(flight, residuals, estimate, &mut normal);
        }
        for (index, unknown) in self.unknowns.iter().enumerate() {
            let (distance, deviation) = unknown.prior(estimate);
            normal.information[(index, index)] += 1.0 / (deviation * deviation);
            normal.gradient[index] += distance / (deviation * deviation);
        }
        normal
    }

    fn add_flight(&self, flight: usize, residuals: &Residuals<'_>, estimate: &Estimate, normal: &mut Normal) {
        let concerns = |unknown: &Unknown| match unknown {
            Unknown::Drone(..) => true,
            Unknown::Trim { flight: of, .. } => *of == flight,
        };
        let mine: Vec<usize> = (0..self.unknowns.len()).filter(|index| concerns(&self.unknowns[*index])).collect();
        let errors = residuals.of(&estimate.drone, &estimate.trims[flight]);
        let slopes = |index: &usize| -> Vec<f64> {
            let unknown = self.unknowns[*index];
            let moved = unknown.moved(estimate, unknown.step());
            let after = residuals.of(&moved.drone, &moved.trims[flight]);
            after.iter().zip(&errors).map(|(after, before)| (after - before) / unknown.step()).collect()
        };
        let columns: Vec<Vec<f64>> = mine.par_iter().map(slopes).collect();
        let weights: Vec<f64> = errors.iter().map(|error| NEWS * (OUTLIER / error.abs()).min(1.0)).collect();
        for (a, column) in columns.iter().enumerate() {
            for (b, other) in columns.iter().enumerate().take(a + 1) {
                let product: f64 = (0..errors.len()).map(|row| weights[row] * column[row] * other[row]).sum();
                normal.information[(mine[a], mine[b])] += product;
                if a != b {
                    normal.information[(mine[b], mine[a])] += product;
                }
            }
        }
        let count = self.unknowns.len();
        let mut last = None;
        for row in 0..errors.len() {
            if last != Some(residuals.stretches[row]) {
                last = Some(residuals.stretches[row]);
                normal.stretches.push(vec![0.0; count]);
            }
            let Some(stretch) = normal.stretches.last_mut() else { continue };
            for (column, index) in columns.iter().zip(&mine) {
                let part = weights[row] * column[row] * errors[row];
                stretch[*index] += part;
                normal.gradient[*index] += part;
            }
        }
    }

    /// How well the numbers at the least sum of squares are known: Fisher's information, corrected for errors that go
    /// together within a stretch (White 1982, with the stretches as clusters).
    pub(crate) fn uncertainty(&self, estimate: &Estimate) -> Option<Uncertainty> {
        let normal = self.normal(estimate);
        let count = self.unknowns.len();
        let inverse = normal.information.llt(Side::Lower).ok()?.solve(Mat::<f64>::identity(count, count));
        let mut scatter = Mat::<f64>::zeros(count, count);
        for stretch in &normal.stretches {
            for a in 0..count {
                for b in 0..count {
                    scatter[(a, b)] += stretch[a] * stretch[b];
                }
            }
        }
        for (index, unknown) in self.unknowns.iter().enumerate() {
            scatter[(index, index)] += 1.0 / unknown.prior(estimate).1.powi(2);
        }
        let stretches = normal.stretches.len() as f64;
        let few = stretches / (stretches - count as f64).max(1.0);
        let covariance = &inverse * scatter * &inverse;
        let parameters = self.unknowns.iter().filter(|unknown| matches!(unknown, Unknown::Drone(..))).count();
        let correlation = |a: usize, b: usize| inverse[(a, b)] / (inverse[(a, a)] * inverse[(b, b)]).sqrt();
        Some(Uncertainty {
            deviations: (0..parameters).map(|index| (few * covariance[(index, index)]).sqrt()).collect(),
            correlations: (0..parameters).map(|a| (0..parameters).map(|b| correlation(a, b)).collect()).collect(),
        })
    }
}

/// Huber's loss, weighed.
fn loss(error: f64) -> f64 {
    let size = error.abs();
    NEWS * if size <= OUTLIER { 0.5 * size * size } else { OUTLIER * (size - 0.5 * OUTLIER) }
}
