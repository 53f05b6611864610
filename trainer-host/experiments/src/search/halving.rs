//! Successive halving (Jamieson and Talwalkar 2016): more seeds for the better part of the trials.

use super::Trial;

/// Seeds of training after each rung, from shares of all `seeds`: at least one, rounded up.
pub fn rung_seeds(shares: &[f64], seeds: u64) -> Vec<u64> {
    // A share such as 0.1 of ten seeds must not become two by a rounding error.
    shares.iter().map(|share| ((share * seeds as f64 - 1e-9).ceil() as u64).max(1)).collect()
}

/// Numbers of the trials that climb to the next rung: the best part of those that are on this one, at least one.
///
/// Ascending; among equals the earlier climbs.
pub fn promoted(trials: &[&Trial], keep: f64) -> Vec<usize> {
    let mut ranked = trials.to_vec();
    ranked.sort_by(|one, other| one.by_rank(other));
    ranked.truncate(((keep * trials.len() as f64 - 1e-9).ceil() as usize).max(1));
    let mut numbers: Vec<usize> = ranked.into_iter().map(|trial| trial.number).collect();
    numbers.sort_unstable();
    numbers
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn trial(number: usize, objective: f64) -> Trial {
        Trial { number, point: Vec::new(), rungs: 1, seeds: 1, objective }
    }

    #[test]
    fn shares_become_numbers_of_seeds() {
        assert_eq!(rung_seeds(&[0.25, 0.5, 1.0], 8), [2, 4, 8]);
        assert_eq!(rung_seeds(&[0.1, 0.3, 1.0], 10), [1, 3, 10]);
        assert_eq!(rung_seeds(&[0.01, 1.0], 5), [1, 5]);
    }

    #[test]
    fn among_equals_the_earlier_climbs() {
        let trials: Vec<Trial> = (0..4).map(|number| trial(number, 0.5)).collect();
        assert_eq!(promoted(&trials.iter().collect::<Vec<_>>(), 0.5), [0, 1]);
    }

    proptest! {
        #[test]
        fn nobody_climbs_past_a_better_one(
            objectives in prop::collection::vec(-5_i8..5, 1..40),
            keep in 0.01_f64..1.0,
        ) {
            let trials: Vec<Trial> = objectives
                .iter()
                .enumerate()
                .map(|(number, &objective)| trial(number, f64::from(objective)))
                .collect();
            let climbed = promoted(&trials.iter().collect::<Vec<_>>(), keep);
            prop_assert!(!climbed.is_empty() && climbed.len() <= trials.len());
            let worst = climbed.iter().map(|&number| trials[number].objective).fold(f64::INFINITY, f64::min);
            for trial in trials.iter().filter(|trial| !climbed.contains(&trial.number)) {
                prop_assert!(trial.objective <= worst);
            }
        }
    }
}
