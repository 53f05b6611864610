//! Where earlier tasks led to: a mixture of normal distributions over observations, of a size that never grows.
//!
//! A new task is taken in by drawing from the mixture what it knows of the earlier ones and fitting another to these
//! draws and to the new observations. It is fitted by k-means (Lloyd 1982, begun as k-means++, Arthur & Vassilvitskii
//! 2007), each part with the mean and covariance of its members.

use kestrel_core::seed::Stream;
use serde::{Deserialize, Serialize};

/// Passes of k-means; later ones move hardly anything.
const PASSES: usize = 12;

/// Smallest spread of a value within a part, relative to the whole spread: covariances stay positive.
const LEAST_SPREAD: f32 = 1e-3;

/// Distribution of observations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct StateModel {
    parts: Vec<Part>,
    /// Each value of an observation lies between these.
    low: Vec<f32>,
    high: Vec<f32>,
}

/// A normal distribution.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Part {
    /// Share of this part and of all before it.
    up_to: f32,
    mean: Vec<f32>,
    /// Lower triangle of the covariance's Cholesky factor, row after row.
    root: Vec<f32>,
}

impl StateModel {
    /// Numbers of a model with `parts` of observations of `inputs` values.
    pub(super) fn numbers(parts: usize, inputs: usize) -> usize {
        parts * (1 + inputs + inputs * (inputs + 1) / 2) + 2 * inputs
    }

    /// Fitted to `samples`, observations of `inputs` values one after the other, with at most so many parts.
    ///
    /// # Panics
    /// When there are none.
    pub(super) fn fit(samples: &[f32], inputs: usize, parts: usize, stream: &mut Stream) -> Self {
        assert!(!samples.is_empty(), "a model is fitted to observations");
        let rows = || samples.chunks_exact(inputs);
        let bound = |bound: fn(f32, f32) -> f32, from: f32| {
            let start = vec![from; inputs];
            rows().fold(start, |so_far, row| so_far.iter().zip(row).map(|(a, b)| bound(*a, *b)).collect())
        };
        let (low, high) = (bound(f32::min, f32::INFINITY), bound(f32::max, f32::NEG_INFINITY));
        let spread = spread(samples, inputs);
        let scaled: Vec<f32> =
            rows().flat_map(|row| row.iter().zip(&spread).map(|(value, spread)| value / spread)).collect();
        let belongs = clusters(&scaled, inputs, parts, stream);
        let mut model = Self { parts: Vec::new(), low, high };
        let mut before = 0;
        for cluster in 0..parts {
            let members: Vec<&[f32]> =
                rows().zip(&belongs).filter(|(_, of)| **of == cluster).map(|(row, _)| row).collect();
            if !members.is_empty() {
                before += members.len();
                let up_to = before as f32 / belongs.len() as f32;
                model.parts.push(Part::of(&members, &spread, up_to));
            }
        }
        model
    }

    /// Draws an observation.
    pub(super) fn draw(&self, stream: &mut Stream) -> Vec<f32> {
        let share = stream.uniform();
        let part = self.parts.iter().find(|part| share < part.up_to).unwrap_or(&self.parts[self.parts.len() - 1]);
        let noise: Vec<f32> = part.mean.iter().map(|_| stream.normal()).collect();
        let mut state = part.mean.clone();
        let mut root = part.root.as_slice();
        for (row, value) in state.iter_mut().enumerate() {
            let (of_row, rest) = root.split_at(row + 1);
            *value += of_row.iter().zip(&noise).map(|(factor, noise)| factor * noise).sum::<f32>();
            *value = value.clamp(self.low[row], self.high[row]);
            root = rest;
        }
        state
    }
}

impl Part {
    fn of(members: &[&[f32]], spread: &[f32], up_to: f32) -> Self {
        let (inputs, count) = (spread.len(), members.len() as f64);
        let mut mean = vec![0.0; inputs];
        for member in members {
            for (mean, value) in mean.iter_mut().zip(*member) {
                *mean += f64::from(*value) / count;
            }
        }
        let mut covariance = vec![0.0; inputs * (inputs + 1) / 2];
        for member in members {
            let away: Vec<f64> = member.iter().zip(&mean).map(|(value, mean)| f64::from(*value) - mean).collect();
            let pairs = (0..inputs).flat_map(|row| (0..=row).map(move |column| (row, column)));
            for (value, (row, column)) in covariance.iter_mut().zip(pairs) {
                *value += away[row] * away[column] / count;
            }
        }
        for (row, spread) in spread.iter().enumerate() {
            covariance[row * (row + 3) / 2] += f64::from(LEAST_SPREAD * spread).powi(2);
        }
        cholesky(&mut covariance, inputs);
        let single = |values: Vec<f64>| values.into_iter().map(|value| value as f32).collect();
        Self { up_to, mean: single(mean), root: single(covariance) }
    }
}

/// Standard deviation of each value, one where it does not vary.
fn spread(samples: &[f32], inputs: usize) -> Vec<f32> {
    let count = (samples.len() / inputs) as f64;
    let mut sums = vec![(0.0, 0.0); inputs];
    for row in samples.chunks_exact(inputs) {
        for ((sum, squares), value) in sums.iter_mut().zip(row.iter().copied().map(f64::from)) {
            *sum += value;
            *squares += value * value;
        }
    }
    let deviation = |(sum, squares): (f64, f64)| (squares / count - (sum / count).powi(2)).max(0.0).sqrt() as f32;
    sums.into_iter().map(deviation).map(|spread| if spread > 1e-6 { spread } else { 1.0 }).collect()
}

/// To which of at most `parts` clusters each sample belongs.
fn clusters(samples: &[f32], inputs: usize, parts: usize, stream: &mut Stream) -> Vec<usize> {
    let rows = || samples.chunks_exact(inputs);
    let count = samples.len() / inputs;
    let row = |index: usize| samples[index * inputs..(index + 1) * inputs].to_vec();
    let mut centers = vec![row(stream.below(count as u32) as usize)];
    let mut nearest: Vec<f32> = rows().map(|row| distance(row, &centers[0])).collect();
    while centers.len() < parts.min(count) {
        // The next center is a sample, drawn in proportion to its squared distance from those there are.
        let mut left = stream.uniform() * nearest.iter().sum::<f32>();
        let chosen = nearest.iter().position(|distance| {
            left -= distance;
            left < 0.0
        });
        let center = row(chosen.unwrap_or(count - 1));
        for (nearest, row) in nearest.iter_mut().zip(rows()) {
            *nearest = nearest.min(distance(row, &center));
        }
        centers.push(center);
    }
    let mut belongs = vec![0; count];
    for _ in 0..PASSES {
        let mut sums = vec![(0.0_f32, vec![0.0_f32; inputs]); centers.len()];
        for (cluster, row) in belongs.iter_mut().zip(rows()) {
            let to = |index: &usize| distance(row, &centers[*index]);
            *cluster = (0..centers.len()).min_by(|a, b| to(a).total_cmp(&to(b))).unwrap_or(0);
            let (members, sum) = &mut sums[*cluster];
            *members += 1.0;
            sum.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
        }
        for (center, (members, sum)) in centers.iter_mut().zip(sums).filter(|(_, (members, _))| *members > 0.0) {
            *center = sum.into_iter().map(|value| value / members).collect();
        }
    }
    belongs
}

fn distance(one: &[f32], other: &[f32]) -> f32 {
    one.iter().zip(other).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Replaces the lower triangle of a positive matrix by that of its Cholesky factor.
fn cholesky(lower: &mut [f64], size: usize) {
    let place = |row: usize, column: usize| row * (row + 1) / 2 + column;
    for row in 0..size {
        for column in 0..=row {
            let known: f64 = (0..column).map(|index| lower[place(row, index)] * lower[place(column, index)]).sum();
            let rest = lower[place(row, column)] - known;
            lower[place(row, column)] = if row == column {
                rest.max(f64::MIN_POSITIVE).sqrt()
            } else {
                rest / lower[place(column, column)]
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kestrel_core::seed::{Purpose, Seed};

    const INPUTS: usize = 3;

    fn stream(index: u32) -> Stream {
        Stream::new(Seed(1), index, Purpose::Rehearsal)
    }

    /// Two clouds: one wide with its values bound together, one narrow and far away; the third value never varies.
    fn observations(count: usize) -> Vec<f32> {
        let mut stream = stream(0);
        let draw = |index: usize| {
            let [first, second] = [(); 2].map(|()| stream.normal());
            if index.is_multiple_of(4) {
                [10.0 + 0.1 * first, -5.0 + 0.1 * second, 2.0]
            } else {
                [first, 0.8 * first + 0.3 * second, 2.0]
            }
        };
        (0..count).flat_map(draw).collect()
    }

    fn drawn(model: &StateModel, count: usize) -> Vec<f32> {
        let mut stream = stream(7);
        (0..count).flat_map(|_| model.draw(&mut stream)).collect()
    }

    /// Means of the values and of all products of two.
    fn moments(samples: &[f32]) -> Vec<f64> {
        let mut sums = vec![0.0; INPUTS + INPUTS * INPUTS];
        for row in samples.chunks_exact(INPUTS) {
            let products = row.iter().flat_map(|one| row.iter().map(move |other| one * other));
            for (sum, value) in sums.iter_mut().zip(row.iter().copied().chain(products)) {
                *sum += f64::from(value) / (samples.len() / INPUTS) as f64;
            }
        }
        sums
    }

    #[test]
    fn draws_have_the_moments_and_bounds_of_what_was_fitted_generation_after_generation() {
        let samples = observations(4000);
        let mut model = StateModel::fit(&samples, INPUTS, 6, &mut stream(1));
        for generation in 0..6 {
            let draws = drawn(&model, 4000);
            for (found, expected) in moments(&draws).into_iter().zip(moments(&samples)) {
                let tolerance = 0.12 * expected.abs() + 0.1;
                assert!((found - expected).abs() < tolerance, "{generation}: {found}, not {expected}");
            }
            let far = draws.chunks_exact(INPUTS).filter(|row| row[0] > 8.0).count() as f64 / 4000.0;
            assert!((far - 0.25).abs() < 0.04, "{generation}: {far} of the draws in the far cloud");
            let between = draws.chunks_exact(INPUTS).filter(|row| (4.5..8.0).contains(&row[0])).count();
            assert!(between < 20, "{generation}: {between} draws where nothing is");
            assert!(draws.chunks_exact(INPUTS).all(|row| row[2] == 2.0 && row[0] < 11.0));
            model = StateModel::fit(&draws, INPUTS, 6, &mut stream(2 + generation));
        }
    }

    #[test]
    fn fewer_observations_than_parts_and_equal_ones_are_fitted() {
        for samples in [vec![1.0, 2.0, 3.0], vec![0.5; 30]] {
            let model = StateModel::fit(&samples, INPUTS, 8, &mut stream(1));
            let expected: Vec<f32> = samples[..INPUTS].to_vec();
            assert_eq!(model.draw(&mut stream(2)), expected);
        }
    }

    #[test]
    fn a_model_has_the_numbers_that_it_is_said_to_have() {
        let model = StateModel::fit(&observations(400), INPUTS, 5, &mut stream(1));
        let parts: usize = model.parts.iter().map(|part| 1 + part.mean.len() + part.root.len()).sum();
        assert_eq!(parts + model.low.len() + model.high.len(), StateModel::numbers(5, INPUTS));
    }

    #[test]
    fn a_root_times_itself_is_the_matrix() {
        let matrix = [4.0, 2.0, 5.0, 0.4, -1.0, 3.0];
        let mut root = matrix;
        cholesky(&mut root, 3);
        let at = |row: usize, column: usize| if column > row { 0.0 } else { root[row * (row + 1) / 2 + column] };
        for row in 0..3 {
            for column in 0..=row {
                let product: f64 = (0..3).map(|index| at(row, index) * at(column, index)).sum();
                assert!((product - matrix[row * (row + 1) / 2 + column]).abs() < 1e-12, "{row}, {column}");
            }
        }
    }
}
