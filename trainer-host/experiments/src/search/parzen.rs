//! Densities of one dimension, estimated from places: what the tree of Parzen estimators compares.

use super::sampler::Draws;

/// Least bandwidth as a share of the interval, whatever the number of places (as Bergstra's hyperopt has it).
const NARROWEST: f64 = 0.01;

/// A density on \[0, 1\].
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Density {
    /// A uniform prior and a Gaussian, cut off at the ends, around every place: equal parts.
    Parzen {
        /// Means and standard deviations.
        bells: Vec<[f64; 2]>,
    },
    /// A probability for each of several equal parts of the interval.
    Options(Vec<f64>),
}

impl Density {
    /// Of a dimension with so many options, or of numbers.
    pub(super) fn estimate(places: &[f64], options: Option<usize>) -> Self {
        match options {
            None => Self::Parzen { bells: bells(places) },
            Some(count) => Self::Options(shares(places, count)),
        }
    }

    /// At a place.
    pub(super) fn at(&self, place: f64) -> f64 {
        match self {
            Self::Parzen { bells } => {
                let sum: f64 = bells.iter().map(|bell| cut_bell(*bell, place)).sum();
                (1.0 + sum) / (1 + bells.len()) as f64
            }
            Self::Options(shares) => shares[part(place, shares.len())] * shares.len() as f64,
        }
    }

    /// A place drawn from it.
    pub(super) fn draw(&self, draws: &mut Draws) -> f64 {
        match self {
            Self::Parzen { bells } => match draws.below(1 + bells.len()).checked_sub(1) {
                None => draws.uniform(),
                Some(bell) => draw_cut_bell(bells[bell], draws),
            },
            Self::Options(shares) => {
                let mut left = draws.uniform();
                let drawn = shares.iter().position(|share| {
                    left -= share;
                    left < 0.0
                });
                (drawn.unwrap_or(shares.len() - 1) as f64 + 0.5) / shares.len() as f64
            }
        }
    }
}

/// Around each place, as wide as the way to the farther of its neighbours (Bergstra et al. 2011, section 4.1).
fn bells(places: &[f64]) -> Vec<[f64; 2]> {
    let mut sorted = places.to_vec();
    sorted.sort_by(f64::total_cmp);
    let narrowest = (1.0 / (1 + sorted.len()) as f64).max(NARROWEST);
    let mut bells = Vec::new();
    for (index, &place) in sorted.iter().enumerate() {
        let left = if index == 0 { 0.0 } else { sorted[index - 1] };
        let right = sorted.get(index + 1).copied().unwrap_or(1.0);
        bells.push([place, (place - left).max(right - place).clamp(narrowest, 1.0)]);
    }
    bells
}

/// How often each option was seen, and once more.
fn shares(places: &[f64], count: usize) -> Vec<f64> {
    let mut seen = vec![1.0; count];
    for &place in places {
        seen[part(place, count)] += 1.0;
    }
    let all = (places.len() + count) as f64;
    seen.into_iter().map(|seen| seen / all).collect()
}

fn part(place: f64, count: usize) -> usize {
    ((place * count as f64) as usize).min(count - 1)
}

/// Density of a Gaussian that is cut off outside \[0, 1\].
fn cut_bell([mean, deviation]: [f64; 2], place: f64) -> f64 {
    let scaled = |value: f64| (value - mean) / deviation;
    let below = |value: f64| 0.5 * libm::erfc(-scaled(value) * std::f64::consts::FRAC_1_SQRT_2);
    let height =
        libm::exp(-0.5 * scaled(place) * scaled(place)) / (deviation * (2.0 * std::f64::consts::PI).sqrt());
    height / (below(1.0) - below(0.0))
}

/// Draws again until one is inside: with its mean inside and at most 1 wide, about every third is at worst.
fn draw_cut_bell([mean, deviation]: [f64; 2], draws: &mut Draws) -> f64 {
    loop {
        let place = mean + deviation * draws.normal();
        if (0.0..=1.0).contains(&place) {
            return place;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kestrel_sim::seed::Seed;

    const CELLS: usize = 2000;

    fn middle(cell: usize) -> f64 {
        (cell as f64 + 0.5) / CELLS as f64
    }

    #[test]
    fn densities_integrate_to_one() {
        for (places, options) in [(&[][..], None), (&[0.0, 0.5, 0.52, 1.0], None), (&[0.1, 0.9, 0.9], Some(3))] {
            let density = Density::estimate(places, options);
            let integral: f64 = (0..CELLS).map(|cell| density.at(middle(cell)) / CELLS as f64).sum();
            assert!((integral - 1.0).abs() < 1e-3, "{places:?}: {integral}");
        }
    }

    #[test]
    fn draws_follow_the_density() {
        for (places, options) in [(&[0.05, 0.5, 0.52, 0.97][..], None), (&[0.1, 0.9, 0.9], Some(3))] {
            let density = Density::estimate(places, options);
            let mut draws = Draws::new(Seed(3), 0);
            let mut counts = [0.0; 3];
            for _ in 0..30_000 {
                counts[part(density.draw(&mut draws), 3)] += 1.0 / 30_000.0;
            }
            for (third, found) in counts.into_iter().enumerate() {
                let cells = (0..CELLS).filter(|&cell| part(middle(cell), 3) == third);
                let expected: f64 = cells.map(|cell| density.at(middle(cell)) / CELLS as f64).sum();
                assert!((found - expected).abs() < 0.015, "{places:?}: {found} {expected}");
            }
        }
    }

    #[test]
    fn bells_reach_to_the_farther_neighbour() {
        let found = bells(&[0.9, 0.2]);
        assert_eq!(found[0], [0.2, 0.9 - 0.2]);
        assert_eq!(found[1], [0.9, 0.9 - 0.2]);
        assert_eq!(bells(&[0.5; 9])[4], [0.5, 0.1], "however close neighbours are");
    }
}
