//! What a run says of each update: a row of `metrics.jsonl`, and the same for `TensorBoard` under the tags of
//! Stable-Baselines3, so that both stand in the same charts.

use std::collections::BTreeMap;

use kestrel_learn::ppo::UpdateMetrics;
use serde::Serialize;

use crate::atomic_file::read;
use crate::evaluation::Evaluation;
use crate::run_directory::metrics::MetricsLog;
use crate::run_directory::{RunDirectory, RunDirectoryError};
use crate::run_summary::flat;
use crate::tensorboard::EventFile;

/// Both logs of a run, open for appending.
#[derive(Debug)]
pub(crate) struct RunLog {
    metrics: MetricsLog,
    events: EventFile,
}

/// A row of `metrics.jsonl`.
#[derive(Serialize)]
pub(crate) struct MetricsRow<'a> {
    #[serde(flatten)]
    pub(crate) update: &'a UpdateMetrics,
    pub(crate) steps_per_second: f64,
    pub(crate) training_secs: f64,
    /// The test that followed, if one did.
    #[serde(flatten)]
    pub(crate) test: Option<TestRow>,
    /// Success rate of the test flights after this update, where there were any, by task.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) flights: BTreeMap<&'a str, f32>,
}

/// What a test found, with the mean action from starts of its own.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct TestRow {
    #[serde(rename = "eval_success_rate")]
    pub(crate) success_rate: f64,
    /// 95 % of confidence.
    #[serde(rename = "eval_success_interval")]
    pub(crate) success_interval: [f64; 2],
    /// Mean return.
    #[serde(rename = "eval_mean_reward")]
    pub(crate) mean_reward: f64,
    /// Mean length in control periods.
    #[serde(rename = "eval_mean_ep_length")]
    pub(crate) mean_ep_length: f64,
    /// Whether the policy was the best so far.
    #[serde(rename = "eval_kept")]
    pub(crate) kept: bool,
}

impl TestRow {
    pub(crate) fn of(test: &Evaluation, kept: bool) -> Self {
        Self {
            success_rate: test.success_rate,
            success_interval: test.success_interval,
            mean_reward: test.episode_return,
            mean_ep_length: test.steps,
            kept,
        }
    }

    fn scalars(&self) -> [(String, f32); 3] {
        [
            ("success_rate", self.success_rate),
            ("mean_reward", self.mean_reward),
            ("mean_ep_length", self.mean_ep_length),
        ]
        .map(|(name, value)| (format!("eval/{name}"), value as f32))
    }
}

impl RunLog {
    /// Starts or continues the logs of a run that has done so many updates and environment steps.
    pub(crate) fn continue_after(
        directory: &RunDirectory,
        updates: u64,
        steps: u64,
    ) -> Result<Self, RunDirectoryError> {
        let metrics = MetricsLog::continue_after(&directory.metrics(), updates)?;
        let mut events = EventFile::create(directory.path(), steps)?;
        let config = String::from_utf8_lossy(&read(&directory.config())?).into_owned();
        events.write_text("config", &in_markdown(&config))?;
        let mut settings = flat(&config);
        settings.retain(|key, _| key.starts_with("training."));
        events.write_settings(&settings)?;
        Ok(Self { metrics, events })
    }

    /// Appends an update; `more` are scalars for `TensorBoard` alone.
    pub(crate) fn append(
        &mut self,
        row: &MetricsRow<'_>,
        more: Vec<(String, f32)>,
    ) -> Result<(), RunDirectoryError> {
        self.metrics.append(row)?;
        let flights = row.flights.iter().map(|(task, share)| (format!("eval/success_rate/{task}"), *share));
        let speed = ("time/fps".to_owned(), row.steps_per_second as f32);
        let test = row.test.iter().flat_map(TestRow::scalars);
        let all: Vec<_> =
            scalars(row.update).into_iter().chain([speed]).chain(more).chain(test).chain(flights).collect();
        let all: Vec<(&str, f32)> = all.iter().map(|(tag, value)| (tag.as_str(), *value)).collect();
        Ok(self.events.write_scalars(row.update.steps, &all)?)
    }
}

/// As code, which is an indented text.
fn in_markdown(yaml: &str) -> String {
    yaml.lines().flat_map(|line| ["    ", line, "\n"]).collect()
}

fn scalars(update: &UpdateMetrics) -> Vec<(String, f32)> {
    let nothing = f32::NAN;
    [
        ("rollout/ep_rew_mean", update.episode_return.unwrap_or(nothing)),
        ("rollout/ep_len_mean", update.episode_length.unwrap_or(nothing)),
        ("rollout/success_rate", update.success_rate.unwrap_or(nothing)),
        ("train/policy_gradient_loss", update.policy_loss),
        ("train/value_loss", update.value_loss),
        ("train/entropy_loss", -update.entropy),
        ("train/approx_kl", update.approx_kl),
        ("train/clip_fraction", update.clip_fraction),
        ("train/explained_variance", update.explained_variance),
        ("train/learning_rate", update.learning_rate),
        ("train/std", update.log_std.exp()),
        ("train/gradient_norm", update.gradient_norm),
    ]
    .map(|(tag, value)| (tag.to_owned(), value))
    .into()
}
