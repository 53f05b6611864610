//! Which point is tried next: at random, or by the tree of Parzen estimators (Bergstra et al. 2011).

use kestrel_sim::seed::{Seed, philox};

use super::Trial;
use super::parzen::Density;
use super::space::Dimension;

/// Share of the trials that count as good (γ in section 4 of Bergstra et al. 2011, with their value).
const GOOD_SHARE: f64 = 0.15;

/// Trials at random before there is anything to learn from.
pub const STARTUP: usize = 10;

/// Candidates in each dimension (as many as hyperopt draws).
const CANDIDATES: usize = 24;

/// Sets the draws of a search apart from all others of the same seed.
const DOMAIN: u32 = 0x7365_6172;

/// How points are proposed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Algorithm {
    /// Independently of what was found.
    Random,
    /// Where good trials are dense and bad ones are not.
    Tpe,
}

impl Algorithm {
    /// How many of the first trials are independent of what was found.
    pub fn random_trials(self, trials: usize) -> usize {
        match self {
            Self::Random => trials,
            Self::Tpe => trials.min(STARTUP),
        }
    }

    /// The point of trial `number`, after `known` trials.
    pub fn propose(self, space: &[Dimension], known: &[Trial], seed: Seed, number: usize) -> Vec<f64> {
        let mut draws = Draws::new(seed, number as u32);
        let split = match self {
            Self::Tpe if number >= STARTUP && !known.is_empty() => Some(split(known)),
            Self::Tpe | Self::Random => None,
        };
        let place = |(index, dimension): (usize, &Dimension)| {
            let place = match &split {
                None => draws.uniform(),
                Some([good, bad]) => {
                    let density = |trials: &[&Trial]| {
                        let places: Vec<f64> = trials.iter().map(|trial| trial.point[index]).collect();
                        Density::estimate(&places, dimension.options())
                    };
                    most_promising(&density(good), &density(bad), &mut draws)
                }
            };
            dimension.settled(place)
        };
        space.iter().enumerate().map(place).collect()
    }
}

/// The good ones and the others.
fn split(known: &[Trial]) -> [Vec<&Trial>; 2] {
    let mut ranked: Vec<&Trial> = known.iter().collect();
    ranked.sort_by(|one, other| one.by_rank(other));
    let bad = ranked.split_off((GOOD_SHARE * known.len() as f64).ceil() as usize);
    [ranked, bad]
}

/// Of several places drawn from the good ones' density, that where the expected improvement is greatest: where the
/// ratio of the densities is (equation 9 there).
fn most_promising(good: &Density, bad: &Density, draws: &mut Draws) -> f64 {
    let candidates: Vec<f64> = (0..CANDIDATES).map(|_| good.draw(draws)).collect();
    let ratio = |place: &f64| good.at(*place) / bad.at(*place);
    candidates
        .into_iter()
        .reduce(|best, next| if ratio(&next) > ratio(&best) { next } else { best })
        .unwrap_or(0.5)
}

/// The random numbers of one trial.
#[derive(Clone, Debug)]
pub(super) struct Draws {
    key: [u32; 2],
    trial: u32,
    count: u32,
}

impl Draws {
    pub(super) fn new(seed: Seed, trial: u32) -> Self {
        Self { key: [seed.0 as u32, (seed.0 >> 32) as u32], trial, count: 0 }
    }

    /// Uniform in \[0, 1), a multiple of 2⁻⁵³.
    pub(super) fn uniform(&mut self) -> f64 {
        let [high, low, ..] = philox([self.count, self.trial, DOMAIN, 0], self.key);
        self.count += 1;
        ((u64::from(high) << 32 | u64::from(low)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform among `0..count`.
    pub(super) fn below(&mut self, count: usize) -> usize {
        ((self.uniform() * count as f64) as usize).min(count - 1)
    }

    /// Standard normal (Box and Muller 1958).
    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * libm::log(1.0 - self.uniform())).sqrt();
        radius * libm::cos(2.0 * std::f64::consts::PI * self.uniform())
    }
}

#[cfg(test)]
mod tests;
