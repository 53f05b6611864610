//! What an update reports, under the names of Stable-Baselines3 and `CleanRL`.

use serde::Serialize;

use crate::environment::Episode;

/// One update's figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct UpdateMetrics {
    /// Environment steps since the start of training.
    pub steps: u64,
    /// Updates since the start of training.
    pub updates: u64,
    /// Whether the rollout was of another task than the one before, where a regulariser looks for that.
    #[serde(skip)]
    pub boundary: bool,
    /// Negative clipped surrogate, mean over all minibatches; by gradients through the environment the negative mean
    /// reward of a step.
    pub policy_loss: f32,
    /// Mean squared error of the critic, mean over all minibatches.
    pub value_loss: f32,
    /// Entropy of the policy after the update \[nat\].
    pub entropy: f32,
    /// Divergence of the policy from that of the rollout \[nat\], mean over the last epoch.
    pub approx_kl: f32,
    /// Share of samples whose ratio left the clip range, mean over all minibatches.
    pub clip_fraction: f32,
    /// Share of the returns' variance that the critic foresaw; zero when they have none.
    pub explained_variance: f32,
    /// Step size that was used.
    pub learning_rate: f32,
    /// Logarithm of the standard deviation, mean over the actions, after the update.
    pub log_std: f32,
    /// Length of the gradient before it was limited, mean over all minibatches.
    pub gradient_norm: f32,
    /// Episodes that ended during the rollout.
    pub episodes: u64,
    /// Mean undiscounted, unscaled return of these episodes.
    pub episode_return: Option<f32>,
    /// Mean length of these episodes \[steps\].
    pub episode_length: Option<f32>,
    /// Share of these episodes that succeeded, where the task has successes.
    pub success_rate: Option<f32>,
    /// Mean return of each reward term in these episodes, in the task's order; empty without episodes.
    pub episode_terms: Vec<f32>,
    /// Wall time of the rollout \[s\].
    pub rollout_secs: f64,
    /// Wall time of advantages and optimisation \[s\].
    pub update_secs: f64,
}

impl UpdateMetrics {
    /// NaN where there is no critic, no distribution and no surrogate.
    pub fn without_ppo() -> Self {
        let nothing = f32::NAN;
        Self {
            value_loss: nothing,
            entropy: nothing,
            approx_kl: nothing,
            clip_fraction: nothing,
            explained_variance: nothing,
            log_std: nothing,
            ..Self::default()
        }
    }

    /// What several learners report together: means, and sums of steps, episodes and times; reward terms are left out,
    /// because they may be others. None for no learner.
    pub fn together(learners: &[Self]) -> Option<Self> {
        let count = learners.len() as f32;
        let mean = |value: fn(&Self) -> f32| learners.iter().map(value).sum::<f32>() / count;
        let mean_of_some = |value: fn(&Self) -> Option<f32>| {
            let some: Vec<f32> = learners.iter().filter_map(value).collect();
            (!some.is_empty()).then(|| some.iter().sum::<f32>() / some.len() as f32)
        };
        Some(Self {
            steps: learners.iter().map(|learner| learner.steps).sum(),
            updates: learners.first()?.updates,
            boundary: learners.iter().any(|each| each.boundary),
            policy_loss: mean(|learner| learner.policy_loss),
            value_loss: mean(|learner| learner.value_loss),
            entropy: mean(|learner| learner.entropy),
            approx_kl: mean(|learner| learner.approx_kl),
            clip_fraction: mean(|learner| learner.clip_fraction),
            explained_variance: mean(|learner| learner.explained_variance),
            learning_rate: mean(|learner| learner.learning_rate),
            log_std: mean(|learner| learner.log_std),
            gradient_norm: mean(|learner| learner.gradient_norm),
            episodes: learners.iter().map(|learner| learner.episodes).sum(),
            episode_return: mean_of_some(|learner| learner.episode_return),
            episode_length: mean_of_some(|learner| learner.episode_length),
            success_rate: mean_of_some(|learner| learner.success_rate),
            episode_terms: Vec::new(),
            rollout_secs: learners.iter().map(|learner| learner.rollout_secs).sum(),
            update_secs: learners.iter().map(|learner| learner.update_secs).sum(),
        })
    }

    /// Environment steps per second of this update, from its `steps_in_update`.
    pub fn steps_per_second(&self, steps_in_update: usize) -> f64 {
        steps_in_update as f64 / (self.rollout_secs + self.update_secs)
    }

    /// Fills in what the ended episodes say.
    pub(crate) fn describe(&mut self, episodes: &[Episode]) {
        self.episodes = episodes.len() as u64;
        if episodes.is_empty() {
            return;
        }
        let mean = |value: &dyn Fn(&Episode) -> f64| {
            Some((episodes.iter().map(value).sum::<f64>() / episodes.len() as f64) as f32)
        };
        self.episode_return = mean(&|episode| f64::from(episode.total_reward));
        self.episode_length = mean(&|episode| f64::from(episode.steps));
        if episodes.iter().any(|episode| episode.success.is_some()) {
            self.success_rate = mean(&|episode| f64::from(u8::from(episode.success == Some(true))));
        }
        let terms = 0..episodes[0].terms.len();
        self.episode_terms = terms.filter_map(|term| mean(&|episode| f64::from(episode.terms[term]))).collect();
    }
}
