//! What a run says of each update: a row of `metrics.jsonl`, and the same for `TensorBoard`.

use std::collections::BTreeMap;

use kestrel_learn::ppo::UpdateMetrics;
use serde::Serialize;

use crate::run_directory::metrics::MetricsLog;
use crate::run_directory::{RunDirectory, RunDirectoryError};
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
    /// Success rate of the test flights after this update, where there were any, by task.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) flights: BTreeMap<&'a str, f32>,
}

impl RunLog {
    /// Starts or continues the logs of a run that has done so many updates and environment steps.
    pub(crate) fn continue_after(
        directory: &RunDirectory,
        updates: u64,
        steps: u64,
    ) -> Result<Self, RunDirectoryError> {
        let metrics = MetricsLog::continue_after(&directory.metrics(), updates)?;
        Ok(Self { metrics, events: EventFile::create(directory.path(), steps)? })
    }

    /// Appends an update; `more` are scalars for `TensorBoard` alone.
    pub(crate) fn append(
        &mut self,
        row: &MetricsRow<'_>,
        more: Vec<(String, f32)>,
    ) -> Result<(), RunDirectoryError> {
        self.metrics.append(row)?;
        let flights = row.flights.iter().map(|(task, share)| (format!("eval/success_rate/{task}"), *share));
        let speed = ("steps_per_second".to_owned(), row.steps_per_second as f32);
        let all: Vec<_> = scalars(row.update).into_iter().chain([speed]).chain(more).chain(flights).collect();
        let all: Vec<(&str, f32)> = all.iter().map(|(tag, value)| (tag.as_str(), *value)).collect();
        Ok(self.events.write_scalars(row.update.steps, &all)?)
    }
}

fn scalars(update: &UpdateMetrics) -> Vec<(String, f32)> {
    let nothing = f32::NAN;
    [
        ("policy_loss", update.policy_loss),
        ("value_loss", update.value_loss),
        ("entropy", update.entropy),
        ("approx_kl", update.approx_kl),
        ("clip_fraction", update.clip_fraction),
        ("explained_variance", update.explained_variance),
        ("learning_rate", update.learning_rate),
        ("log_std", update.log_std),
        ("gradient_norm", update.gradient_norm),
        ("episode_return", update.episode_return.unwrap_or(nothing)),
        ("episode_length", update.episode_length.unwrap_or(nothing)),
        ("success_rate", update.success_rate.unwrap_or(nothing)),
    ]
    .map(|(tag, value)| (tag.to_owned(), value))
    .into()
}
