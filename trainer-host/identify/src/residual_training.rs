//! How a residual network is learned: from windows of the fitted flights, as long as it helps predictions of stretches that
//! it does not learn from.

use kestrel_core::seed::{Purpose, Seed, Stream};
use kestrel_learn::adam::Adam;
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::course::Course;
use crate::drone::Trim;
use crate::error::LogError;
use crate::horizon::{Horizon, Predictor, Signal, horizons};
use crate::identification::IdentifyError;
use crate::least_squares::{Estimate, Interrupted};
use crate::residual_gradient::{Half, LearnedFlight, Learning};
use crate::residual_network::{BoundedMlp, INPUTS, ResidualNetwork};

/// Fewest windows that teach anything, twenty a second.
const FEWEST_WINDOWS: usize = 100;

/// Of so many flights one is not learned from.
const CHECKED_FLIGHT: usize = 4;

/// Bound over the root mean square of what is missing: normally distributed, 0.3 % of it lies beyond.
const BOUND: f64 = 3.0;

/// Windows of an update, of one flight.
const MINIBATCH: usize = 32;

/// Updates between two checks.
const UPDATES: usize = 100;

/// Most checks.
const CHECKS: usize = 40;

/// Checks without a better one after which learning ends.
const PATIENCE: usize = 8;

/// Adam's.
const LEARNING_RATE: f32 = 2e-3;

/// Share of the errors in stretches that are not learned from that a network must take away: less is chance.
const LEAST_GAIN: f64 = 0.02;

/// Steps of the horizon by whose errors a network is chosen.
const CHECKED_STEPS: [usize; 2] = [10, 50];

/// Learns what `estimate` lacks from the fitted parts of the flights; `go_on` is asked before each check. A half that helps
/// nowhere but where it was learned is left out.
///
/// # Errors
/// When the flights show too little of either half, or `go_on` says no.
pub(crate) fn learned(
    courses: &[Course<'_>],
    estimate: &Estimate,
    seed: Seed,
    go_on: &dyn Fn() -> bool,
) -> Result<ResidualNetwork, IdentifyError> {
    let Split { training, checking, estimate } = Split::of(courses, estimate);
    let learners =
        [Half::Linear, Half::Angular].map(|half| (half, Learner::new(half, &training, &estimate, seed)));
    let most = learners.iter().map(|(_, learner)| learner.windows()).max().unwrap_or(0);
    if most < FEWEST_WINDOWS {
        let found = format!("{most} windows to learn from");
        let expected = format!("{FEWEST_WINDOWS} or more: about ten seconds of fitted flight");
        return Err(LogError::at("--residual", found, expected).into());
    }
    let check = Check::new(&checking, &estimate);
    let mut network = ResidualNetwork::default();
    for (half, learner) in learners {
        match half {
            Half::Linear => network.linear = best(learner, half, &check, go_on)?,
            Half::Angular => network.angular = best(learner, half, &check, go_on)?,
        }
    }
    Ok(network)
}

/// Fitted flights, in two parts.
struct Split<'a> {
    /// What is learned from is fitted.
    training: Vec<Course<'a>>,
    /// What a network is chosen by is held out.
    checking: Vec<Course<'a>>,
    /// With the trims of these flights.
    estimate: Estimate,
}

impl<'a> Split<'a> {
    /// Every fourth flight is chosen by, so that what belongs to one flight alone teaches nothing; of fewer than four
    /// flights, a quarter of each.
    fn of(courses: &[Course<'a>], estimate: &Estimate) -> Self {
        let fitted = courses.iter().zip(&estimate.trims).filter(|(course, _)| !course.is_held_out());
        let (fitted, trims): (Vec<&Course<'a>>, Vec<Trim>) = fitted.map(|(course, trim)| (course, *trim)).unzip();
        let whole = fitted.len() >= CHECKED_FLIGHT;
        let part =
            |(index, course): (usize, &&Course<'a>)| match (whole, (index + 1).is_multiple_of(CHECKED_FLIGHT)) {
                (true, true) => (course.holding_out(|_| true), course.holding_out(|row| course.is_fitted(row))),
                (true, false) => ((*course).clone(), course.holding_out(|_| false)),
                (false, _) => (
                    course.holding_out(|row| !course.is_fitted(row) || course.is_in_quarter(row)),
                    course.holding_out(|row| course.is_fitted(row) && course.is_in_quarter(row)),
                ),
            };
        let (training, checking) = fitted.iter().enumerate().map(part).unzip();
        Self { training, checking, estimate: Estimate { drone: estimate.drone, trims } }
    }
}

/// The network with the least share of errors left; `None` if none takes enough of them away.
fn best(
    mut learner: Learner<'_>,
    half: Half,
    check: &Check<'_>,
    go_on: &dyn Fn() -> bool,
) -> Result<Option<BoundedMlp>, Interrupted> {
    if learner.windows() < FEWEST_WINDOWS {
        return Ok(None);
    }
    let (mut least, mut best, mut since) = (1.0 - LEAST_GAIN, None, 0);
    for _ in 0..CHECKS {
        if !go_on() {
            return Err(Interrupted);
        }
        for _ in 0..UPDATES {
            learner.update();
        }
        let share = check.share(half, &learner.network);
        since += 1;
        if share < least {
            (least, best, since) = (share, Some(learner.network.clone()), 0);
        }
        if since == PATIENCE {
            break;
        }
    }
    Ok(best)
}

/// Predictions of what is not learned from, without a network.
struct Check<'a> {
    courses: &'a [Course<'a>],
    estimate: &'a Estimate,
    without: Vec<Horizon>,
}

impl<'a> Check<'a> {
    fn new(courses: &'a [Course<'a>], estimate: &'a Estimate) -> Self {
        Self { courses, estimate, without: horizons(courses, &[Predictor::from(estimate)]) }
    }

    /// Mean share of the errors that a network leaves; more than any where nothing shows them.
    fn share(&self, half: Half, network: &BoundedMlp) -> f64 {
        let network = Some(network.clone());
        let (signals, network) = match half {
            Half::Linear => {
                ([Signal::Velocity, Signal::Position], ResidualNetwork { linear: network, angular: None })
            }
            Half::Angular => {
                ([Signal::Tilting, Signal::Yawing], ResidualNetwork { linear: None, angular: network })
            }
        };
        let predictor = Predictor { estimate: self.estimate, residual: Some(&network) };
        let with = horizons(self.courses, &[predictor]);
        let pairs = self.without.iter().zip(&with).filter(|(without, _)| signals.contains(&without.signal));
        let shares: Vec<f64> = pairs
            .flat_map(|(without, with)| CHECKED_STEPS.map(|steps| with.after(1, steps) / without.after(1, steps)))
            .collect();
        if shares.is_empty() { f64::INFINITY } else { shares.iter().sum::<f64>() / shares.len() as f64 }
    }
}

/// A network on its way.
struct Learner<'a> {
    flights: Vec<LearnedFlight<'a>>,
    /// Typical error of each axis without a network.
    sizes: Vector3<f64>,
    network: BoundedMlp,
    adam: Adam,
    stream: Stream,
    learning: Learning,
}

impl<'a> Learner<'a> {
    fn new(half: Half, courses: &'a [Course<'a>], estimate: &Estimate, seed: Seed) -> Self {
        let flights: Vec<LearnedFlight<'a>> = courses
            .par_iter()
            .zip(&estimate.trims)
            .map(|(course, trim)| LearnedFlight::new(half, course, &estimate.drone, trim))
            .filter(|flight| !flight.starts.is_empty())
            .collect();
        let (seen, missing): (Vec<[f64; INPUTS]>, Vec<Vector3<f64>>) =
            flights.iter().flat_map(LearnedFlight::missing).unzip();
        let squares: Vec<(Vector3<f64>, f64)> = flights.par_iter().map(LearnedFlight::squares).collect();
        let count = squares.iter().map(|(_, count)| count).sum::<f64>().max(1.0);
        let squares: Vector3<f64> = squares.iter().map(|(squares, _)| squares).sum();
        let missing: Vector3<f64> = missing.iter().map(|missing| missing.component_mul(missing)).sum();
        let bounds = (missing / seen.len().max(1) as f64).map(f64::sqrt) * BOUND;
        let shape = BoundedMlp::shape();
        // The outputs begin at zero: what is not learned is not added.
        let parameters = shape.initialise(0.0, &mut Stream::new(seed, half as u32, Purpose::Weights));
        Self {
            flights,
            sizes: (squares / count).map(|square| square.sqrt().max(f64::MIN_POSITIVE)),
            network: BoundedMlp::new(&seen, bounds, parameters),
            adam: Adam::new(shape.parameter_count()),
            stream: Stream::new(seed, half as u32, Purpose::Shuffle),
            learning: Learning::new(MINIBATCH),
        }
    }

    /// Number of windows.
    fn windows(&self) -> usize {
        self.flights.iter().map(|flight| flight.starts.len()).sum()
    }

    /// A step of Adam along the gradient of some windows of a flight; long flights come more often.
    fn update(&mut self) {
        let mut window = self.stream.below(self.windows() as u32) as usize;
        let mut flights = self.flights.iter();
        let Some(flight) = flights.find(|flight| match window.checked_sub(flight.starts.len()) {
            Some(beyond) => {
                window = beyond;
                false
            }
            None => true,
        }) else {
            return;
        };
        let count = flight.starts.len() as u32;
        let starts: [usize; MINIBATCH] = std::array::from_fn(|_| flight.starts[self.stream.below(count) as usize]);
        self.learning.gradient.fill(0.0);
        flight.add_gradient(&self.network, &starts, &self.sizes, &mut self.learning);
        let scale = 1.0 / MINIBATCH as f32;
        self.adam.step(&mut self.network.parameters, &self.learning.gradient, scale, LEARNING_RATE);
    }
}
