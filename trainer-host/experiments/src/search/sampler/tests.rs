use super::*;
use crate::search::space::Values;

/// Repetitions with seeds of their own.
const SEEDS: u64 = 20;

fn numbers(count: usize) -> Vec<Dimension> {
    let dimension =
        |index| Dimension { key: format!("x{index}"), values: Values::Uniform { low: 0.0, high: 1.0 } };
    (0..count).map(dimension).collect()
}

/// The best that a search of `trials` trials finds.
fn best(algorithm: Algorithm, space: &[Dimension], seed: u64, trials: usize, worth: fn(&[f64]) -> f64) -> f64 {
    let mut known: Vec<Trial> = Vec::new();
    for number in 0..trials {
        let point = algorithm.propose(space, &known, Seed(seed), number);
        let objective = worth(&point);
        known.push(Trial { number, point, rungs: 1, seeds: 1, objective });
    }
    known.iter().map(|trial| trial.objective).fold(f64::NEG_INFINITY, f64::max)
}

/// In how many of twenty seeds each algorithm finds more than the other, and their mean finds: TPE first.
fn duel(space: &[Dimension], worth: fn(&[f64]) -> f64) -> ([usize; 2], [f64; 2]) {
    let (mut wins, mut means) = ([0, 0], [0.0, 0.0]);
    for seed in 0..SEEDS {
        let found = [Algorithm::Tpe, Algorithm::Random].map(|algorithm| best(algorithm, space, seed, 60, worth));
        wins[0] += usize::from(found[0] > found[1]);
        wins[1] += usize::from(found[1] > found[0]);
        means[0] += found[0] / SEEDS as f64;
        means[1] += found[1] / SEEDS as f64;
    }
    (wins, means)
}

/// A paraboloid with its top aside.
fn bowl(point: &[f64]) -> f64 {
    -point.iter().zip([0.3, 0.8, 0.55, 0.1]).map(|(place, top)| (place - top) * (place - top)).sum::<f64>()
}

/// Branin's function, upside down; its three tops are at −0.397887.
fn branin(point: &[f64]) -> f64 {
    use std::f64::consts::PI;
    let (x, y) = (15.0 * point[0] - 5.0, 15.0 * point[1]);
    let bent = y - 5.1 / (4.0 * PI * PI) * x * x + 5.0 / PI * x - 6.0;
    -(bent * bent + 10.0 * (1.0 - 1.0 / (8.0 * PI)) * libm::cos(x) + 10.0)
}

/// One of eight options is right, and helps only where a number is right too.
fn option_and_number(point: &[f64]) -> f64 {
    let right = (point[0] * 8.0) as usize == 5;
    f64::from(u8::from(right)) - (point[1] - 0.7).abs()
}

/// Two-sided sign test: with 16 wins of 20 by chance p = 0.012.
const SIGNIFICANT: usize = 16;

#[test]
fn tpe_beats_random_search_on_a_bowl() {
    let (wins, means) = duel(&numbers(4), bowl);
    assert!(wins[0] >= SIGNIFICANT && means[0] > means[1], "{wins:?} {means:?}");
}

#[test]
fn tpe_beats_random_search_on_branins_function() {
    let (wins, means) = duel(&numbers(2), branin);
    assert!(wins[0] >= SIGNIFICANT && means[0] > means[1], "{wins:?} {means:?}");
    assert!(means[0] < -0.397_887);
}

#[test]
fn tpe_beats_random_search_with_options() {
    let options = Values::Choice((0..8).map(|index| index.to_string()).collect());
    let mut space = numbers(2);
    space[0] = Dimension { key: "kind".to_owned(), values: options };
    let (wins, means) = duel(&space, option_and_number);
    assert!(wins[0] >= SIGNIFICANT && means[0] > means[1], "{wins:?} {means:?}");
}

#[test]
fn a_proposal_depends_on_seed_number_and_what_is_known_alone() {
    let space = numbers(3);
    let propose = |seed, number| Algorithm::Random.propose(&space, &[], Seed(seed), number);
    assert_eq!(propose(1, 2), propose(1, 2));
    assert!(propose(1, 2) != propose(1, 3) && propose(1, 2) != propose(2, 2));
    let first = |trials| best(Algorithm::Tpe, &space, 5, trials, bowl);
    assert_eq!(first(STARTUP), best(Algorithm::Random, &space, 5, STARTUP, bowl), "both begin alike");
}

#[test]
fn places_are_uniform_without_knowledge() {
    let space = numbers(1);
    let mut counts = [0; 4];
    for number in 0..4000 {
        counts[(Algorithm::Random.propose(&space, &[], Seed(7), number)[0] * 4.0) as usize % 4] += 1;
    }
    assert!(counts.iter().all(|count| (900..1100).contains(count)), "{counts:?}");
}
