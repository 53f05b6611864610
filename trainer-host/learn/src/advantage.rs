//! How much better an action turned out than the critic expected.

use kestrel_core::outcome::Outcome;

/// One environment batch's rollout as columns: `[steps][environments]` each.
#[derive(Clone, Copy, Debug)]
pub struct Columns<'a> {
    /// Scaled rewards.
    pub rewards: &'a [f32],
    /// The critic's values of the observations acted upon.
    pub values: &'a [f32],
    /// How each step ended.
    pub outcomes: &'a [Outcome],
    /// Where a step was truncated, the critic's value of the observation before the reset.
    pub truncated_values: &'a [f32],
    /// `[environments]`: the critic's values of the observations after the last step.
    pub last_values: &'a [f32],
}

/// Generalised advantage estimation (Schulman et al. 2016, eq. 16), written into `advantages`
/// `[steps][environments]`.
pub fn gae(columns: &Columns<'_>, discount: f32, lambda: f32, advantages: &mut [f32]) {
    let environments = columns.last_values.len();
    let mut next_values = columns.last_values;
    let mut following = vec![0.0; environments];
    for (step, advantages) in advantages.chunks_exact_mut(environments).enumerate().rev() {
        let range = step * environments..(step + 1) * environments;
        let values = &columns.values[range.clone()];
        let truncated_values = &columns.truncated_values[range.clone()];
        let (rewards, outcomes) = (&columns.rewards[range.clone()], &columns.outcomes[range]);
        for index in 0..environments {
            let (next_value, later) = match outcomes[index] {
                Outcome::Running => (next_values[index], following[index]),
                // The clock ended it: the future still has worth, but is not seen.
                Outcome::Truncated => (truncated_values[index], 0.0),
                Outcome::Terminated => (0.0, 0.0),
            };
            let td_error = rewards[index] + discount * next_value - values[index];
            following[index] = td_error + discount * lambda * later;
        }
        advantages.copy_from_slice(&following);
        next_values = values;
    }
}

/// Mean and spread of a batch, summed in order and in `f64`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    /// Takes in `values`.
    pub fn add(&mut self, values: &[f32]) {
        for value in values.iter().copied().map(f64::from) {
            self.count += 1.0;
            self.sum += value;
            self.squares += value * value;
        }
    }

    /// Mean; zero of nothing.
    pub fn mean(&self) -> f64 {
        self.sum / self.count.max(1.0)
    }

    /// Mean squared deviation from the mean.
    pub fn variance(&self) -> f64 {
        (self.squares / self.count.max(1.0) - self.mean() * self.mean()).max(0.0)
    }
}

/// Subtracts the batch's mean and divides by its standard deviation.
pub fn normalise(advantages: &mut [f32], moments: &Moments) {
    // As in `CleanRL` and Stable-Baselines3: keeps a batch without any spread finite.
    const SMALLEST_STD: f64 = 1e-8;
    let scale = (1.0 / (moments.variance().sqrt() + SMALLEST_STD)) as f32;
    let mean = moments.mean() as f32;
    for advantage in advantages {
        *advantage = (*advantage - mean) * scale;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Outcome::{Running, Terminated, Truncated};
    use proptest::prelude::*;

    const DISCOUNT: f32 = 0.5;
    const LAMBDA: f32 = 0.5;

    fn estimate(outcomes: [Outcome; 3]) -> [f32; 3] {
        let columns = Columns {
            rewards: &[1.0, 2.0, 3.0],
            values: &[4.0, 8.0, 16.0],
            outcomes: &outcomes,
            truncated_values: &[100.0, 200.0, 400.0],
            last_values: &[32.0],
        };
        let mut advantages = [0.0; 3];
        gae(&columns, DISCOUNT, LAMBDA, &mut advantages);
        advantages
    }

    #[test]
    fn a_running_column_bootstraps_from_the_last_value() {
        // TD errors 1 + 4 - 4 = 1, 2 + 8 - 8 = 2, 3 + 16 - 16 = 3, each adding a quarter of what follows.
        assert_eq!(estimate([Running; 3]), [1.0 + (2.0 + 0.75) / 4.0, 2.0 + 0.75, 3.0]);
    }

    #[test]
    fn a_terminated_step_has_no_future() {
        // Its td_error is 2 + 0 - 8, and nothing of the next episode leaks back.
        assert_eq!(estimate([Running, Terminated, Running]), [1.0 - 1.5, -6.0, 3.0]);
    }

    #[test]
    fn a_truncated_step_is_worth_its_final_observation() {
        // Its td_error is 2 + 0.5 * 200 - 8, and nothing of the next episode leaks back.
        assert_eq!(estimate([Running, Truncated, Running]), [1.0 + 23.5, 94.0, 3.0]);
    }

    #[test]
    fn the_last_step_may_end_an_episode() {
        assert_eq!(estimate([Running, Running, Terminated])[2], 3.0 - 16.0);
        assert_eq!(estimate([Running, Running, Truncated])[2], 3.0 + 200.0 - 16.0);
    }

    #[test]
    fn environments_do_not_mix() {
        let columns = Columns {
            rewards: &[1.0, 5.0, 2.0, 5.0, 3.0, 5.0],
            values: &[4.0, 0.0, 8.0, 0.0, 16.0, 0.0],
            outcomes: &[Running, Terminated, Running, Terminated, Running, Terminated],
            truncated_values: &[0.0; 6],
            last_values: &[32.0, 7.0],
        };
        let mut advantages = [0.0; 6];
        gae(&columns, DISCOUNT, LAMBDA, &mut advantages);
        assert_eq!(advantages, [1.6875, 5.0, 2.75, 5.0, 3.0, 5.0]);
    }

    #[test]
    fn normalised_advantages_have_mean_zero_and_unit_spread() {
        let mut advantages = [1.0, 2.0, 3.0, 4.0];
        let mut moments = Moments::default();
        moments.add(&advantages);
        normalise(&mut advantages, &moments);
        let deviation = 1.0 / libm::sqrtf(1.25);
        for (advantage, expected) in advantages.iter().zip([-1.5, -0.5, 0.5, 1.5]) {
            assert!((advantage - expected * deviation).abs() < 1e-6);
        }
        let mut flat = [2.0; 3];
        let mut moments = Moments::default();
        moments.add(&flat);
        normalise(&mut flat, &moments);
        assert_eq!(flat, [0.0; 3]);
    }

    proptest! {
        #[test]
        fn with_lambda_one_the_advantage_is_the_discounted_return_less_the_value(
            rewards in prop::collection::vec(-1.0_f32..1.0, 1..20), last in -1.0_f32..1.0,
        ) {
            let steps = rewards.len();
            let values = vec![0.25; steps];
            let outcomes = vec![Running; steps];
            let columns = Columns {
                rewards: &rewards, values: &values, outcomes: &outcomes,
                truncated_values: &vec![0.0; steps], last_values: &[last],
            };
            let mut advantages = vec![0.0; steps];
            gae(&columns, 0.9, 1.0, &mut advantages);
            let discounted = rewards.iter().rev().fold(last, |following, reward| reward + 0.9 * following);
            prop_assert!((advantages[0] - (discounted - 0.25)).abs() < 1e-4);
        }
    }
}
