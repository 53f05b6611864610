//! Which of two methods is better.

use kestrel_sim::seed::philox;

use super::sample::Sample;

/// Above this many pairs, signs are drawn instead of enumerated.
const ENUMERATED_PAIRS: usize = 16;

/// Draws of signs: the smallest p-value that they can show is 1/65537.
const DRAWN_SIGNS: u32 = 1 << 16;

/// Mann–Whitney's U: pairs in which a value of `first` exceeds one of `second`, ties as halves.
pub fn mann_whitney_u(first: &[f64], second: &[f64]) -> f64 {
    let of = |values: &[f64]| Sample::new(values.iter().map(|value| (0, *value)));
    let share = probability_of_improvement(&of(first), &of(second), &[1]).unwrap_or(0.0);
    share * (first.len() * second.len()) as f64
}

/// Chance that a value of `first` exceeds one of `second`, ties as halves: U/(nm) (Agarwal et al. 2021, eq. 1), with
/// both samples' units drawn as often as `counts` say. `None` when either has no value then.
pub fn probability_of_improvement(first: &Sample, second: &Sample, counts: &[u16]) -> Option<f64> {
    let drawn =
        |sample: &Sample| -> f64 { sample.sorted().iter().map(|(_, unit)| f64::from(counts[*unit])).sum() };
    let pairs = drawn(first) * drawn(second);
    let mut others = second.sorted().iter().peekable();
    let (mut wins, mut below, mut value_of_tie, mut tied) = (0.0, 0.0, f64::NEG_INFINITY, 0.0);
    for (value, unit) in first.sorted() {
        if *value > value_of_tie {
            below += tied;
            (value_of_tie, tied) = (*value, 0.0);
        }
        while let Some((other, unit)) = others.next_if(|(other, _)| other <= value) {
            *(if other < value { &mut below } else { &mut tied }) += f64::from(counts[*unit]);
        }
        wins += f64::from(counts[*unit]) * (below + 0.5 * tied);
    }
    (pairs > 0.0).then(|| wins / pairs)
}

/// Two-sided p-value that paired `differences` are symmetric about zero, by flipping their signs (Fisher 1935):
/// exact up to 16 pairs, from 65,536 draws above. `None` without a difference.
pub fn sign_flip_p(differences: &[f64], seed: u64) -> Option<f64> {
    let observed = differences.iter().sum::<f64>().abs();
    // Rounding must not make an arrangement look smaller than the same one in another order.
    let limit = observed - 1e-9 * differences.iter().map(|value| value.abs()).sum::<f64>();
    let extreme = |signs: &dyn Fn(usize) -> bool| {
        let sum: f64 =
            differences.iter().enumerate().map(|(index, value)| if signs(index) { -value } else { *value }).sum();
        sum.abs() >= limit
    };
    let pairs = differences.len();
    match pairs {
        0 => None,
        1..=ENUMERATED_PAIRS => {
            let arrangements = 1_u32 << pairs;
            let count = (0..arrangements).filter(|bits| extreme(&|index| bits >> index & 1 == 1)).count();
            Some(count as f64 / f64::from(arrangements))
        }
        _ => {
            let count = (0..DRAWN_SIGNS).filter(|draw| extreme(&|index| drawn_sign(seed, *draw, index))).count();
            Some((count + 1) as f64 / f64::from(DRAWN_SIGNS + 1))
        }
    }
}

fn drawn_sign(seed: u64, draw: u32, index: usize) -> bool {
    let words = philox([(index / 128) as u32, draw, 1, 0], [seed as u32, (seed >> 32) as u32]);
    words[index / 32 % 4] >> (index % 32) & 1 == 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::statistics::bootstrap::Resamples;

    /// Heights of Darwin's maize, crossed less self-fertilised \[eighths of an inch\] (Fisher 1935, table 3).
    const MAIZE: [f64; 15] =
        [49.0, -67.0, 8.0, 16.0, 6.0, 23.0, 28.0, 41.0, 14.0, 29.0, 56.0, 24.0, 75.0, 60.0, -48.0];

    #[test]
    fn u_matches_published_examples() {
        // Hollander and Wolfe 1973, p. 69 (permeability of placentas), as in R's wilcox.test: W = 35.
        let at_term = [0.80, 0.83, 1.89, 1.04, 1.45, 1.38, 1.91, 1.64, 0.73, 1.46];
        let early = [1.15, 0.88, 0.90, 0.74, 1.21];
        assert!((mann_whitney_u(&at_term, &early) - 35.0).abs() < 1e-12);
        assert!((mann_whitney_u(&early, &at_term) - 15.0).abs() < 1e-12);
        // Wikipedia, "Mann–Whitney U test": tortoises and hares finish THHHHHTTTTTH, U = 11 and 25.
        let (tortoises, hares) = ([12.0, 6.0, 5.0, 4.0, 3.0, 2.0], [11.0, 10.0, 9.0, 8.0, 7.0, 1.0]);
        assert!((mann_whitney_u(&tortoises, &hares) - 11.0).abs() < 1e-12);
        assert!((mann_whitney_u(&hares, &tortoises) - 25.0).abs() < 1e-12);
    }

    #[test]
    fn ties_are_halves() {
        assert_eq!(mann_whitney_u(&[1.0, 1.0, 2.0], &[1.0, 0.0, 2.0, 2.0]), 0.5 + 1.0 + 0.5 + 1.0 + 2.0 + 1.0);
        assert_eq!(mann_whitney_u(&[1.0; 3], &[1.0; 5]), 7.5);
        assert_eq!(mann_whitney_u(&[], &[1.0]), 0.0);
    }

    #[test]
    fn the_chance_follows_the_draws() {
        let of = |low: f64, high: f64| Sample::new((0..4).map(|unit| (unit, if unit < 2 { low } else { high })));
        let (first, second) = (of(1.0, 3.0), of(2.0, 2.5));
        assert_eq!(probability_of_improvement(&first, &second, &[1; 4]), Some(0.5));
        assert_eq!(probability_of_improvement(&first, &second, &[0, 0, 2, 2]), Some(1.0));
        assert_eq!(probability_of_improvement(&first, &Sample::default(), &[1; 4]), None);
        let estimate = Resamples::new(&[4], 1000, 0)
            .estimate(4, |counts| probability_of_improvement(&first, &second, counts))
            .unwrap();
        assert_eq!(estimate.interval, Some([0.0, 1.0]));
    }

    #[test]
    fn the_sign_test_matches_fishers_count() {
        // Fisher 1935, section 21: 863 of 32768 arrangements have a sum of at least 314, so 1726 on both sides.
        assert_eq!(sign_flip_p(&MAIZE, 0), Some(1726.0 / 32768.0));
    }

    #[test]
    fn drawn_signs_agree_with_all_of_them() {
        // Two zeroes make seventeen pairs without changing any sum.
        let padded: Vec<f64> = MAIZE.into_iter().chain([0.0, 0.0]).collect();
        let p = sign_flip_p(&padded, 4).unwrap();
        assert!((p - 1726.0 / 32768.0).abs() < 0.004, "{p}");
    }

    #[test]
    fn equal_pairs_are_no_evidence() {
        assert_eq!(sign_flip_p(&[0.0; 8], 0), Some(1.0));
        assert_eq!(sign_flip_p(&[0.3], 0), Some(1.0));
        assert_eq!(sign_flip_p(&[], 0), None);
        assert_eq!(sign_flip_p(&[0.1; 10], 0), Some(2.0 / 1024.0));
    }
}
