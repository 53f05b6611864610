//! What a run came to, in a line, and in what the configurations of several runs differ.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use kestrel_sim::config::ConfigError;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::evaluation::Evaluation;
use crate::results::EvaluationReport;
use crate::run_config::{RunConfig, Subject};
use crate::run_directory::metrics::read_rows;
use crate::run_directory::{RunDirectory, RunDirectoryError};

/// A run in a line.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RunSummary {
    /// Its directory.
    pub path: PathBuf,
    /// Name of its experiment.
    pub name: String,
    /// What all randomness followed from.
    pub seed: u64,
    /// Environment steps so far.
    pub steps: u64,
    /// Time spent in training \[s\].
    pub training_secs: f64,
    /// How its policy flew each of its tasks, once it has been judged.
    pub evaluations: Vec<Evaluation>,
    /// Its resolved configuration, as dotted keys and values.
    #[serde(skip)]
    config: BTreeMap<String, String>,
}

/// Why a run has no summary.
#[derive(Debug, thiserror::Error)]
pub enum RunSummaryError {
    /// It is no run, or its metrics are damaged.
    #[error(transparent)]
    Directory(#[from] RunDirectoryError),
    /// Its configuration is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Its report is damaged.
    #[error("{}: found no report of an evaluation: {cause}", path.display())]
    Report {
        /// The file.
        path: PathBuf,
        /// Why.
        cause: String,
    },
}

/// A key whose value differs, and its value in each run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Dotted, as in `--set`.
    pub key: String,
    /// In the order of the runs; nothing where a run has no such key.
    pub values: Vec<Option<String>>,
}

/// Of a row of the metrics.
#[derive(Clone, Copy, Deserialize)]
struct Progress {
    steps: u64,
    training_secs: f64,
}

impl RunSummary {
    /// Of the run in a directory.
    ///
    /// # Errors
    /// When it is no run, or a file of it is damaged.
    pub fn read(path: &Path) -> Result<Self, RunSummaryError> {
        let directory = RunDirectory::open(path)?;
        let config = RunConfig::load(&directory.config(), &[])?;
        let progress = read_rows::<Progress>(&directory.metrics())?.last().copied();
        let Subject { name, seed, .. } = config.subject();
        Ok(Self {
            path: path.to_owned(),
            name: name.to_owned(),
            seed: seed.0,
            steps: progress.map_or(0, |progress| progress.steps),
            training_secs: progress.map_or(0.0, |progress| progress.training_secs),
            evaluations: evaluations(&directory.evaluation_report())?,
            config: flat(config.resolved_yaml()),
        })
    }

    /// The runs at `path`: the one there, or those in the folder, by name.
    pub fn found(path: &Path) -> Vec<PathBuf> {
        if RunDirectory::config_in(path).exists() {
            return vec![path.to_owned()];
        }
        let entries = fs::read_dir(path).into_iter().flatten().flatten();
        let mut runs: Vec<PathBuf> =
            entries.map(|entry| entry.path()).filter(|path| RunDirectory::config_in(path).exists()).collect();
        runs.sort();
        runs
    }

    /// Mean share of successes over its tasks.
    pub fn success_rate(&self) -> Option<f64> {
        let rates = self.evaluations.iter().map(|evaluation| evaluation.success_rate);
        (!self.evaluations.is_empty()).then(|| rates.sum::<f64>() / self.evaluations.len() as f64)
    }
}

/// In what the configurations of runs differ.
pub fn differences(runs: &[RunSummary]) -> Vec<Difference> {
    let mut keys: Vec<&String> = runs.iter().flat_map(|run| run.config.keys()).collect();
    keys.sort_unstable();
    keys.dedup();
    let values = |key: &String| runs.iter().map(|run| run.config.get(key).cloned()).collect::<Vec<_>>();
    let all = keys.into_iter().map(|key| Difference { values: values(key), key: key.clone() });
    all.filter(|found| found.values.windows(2).any(|pair| pair[0] != pair[1])).collect()
}

/// Rows of the policy in the report at `path`; none where there is no report.
fn evaluations(path: &Path) -> Result<Vec<Evaluation>, RunSummaryError> {
    let damaged =
        |cause: serde_json::Error| RunSummaryError::Report { path: path.to_owned(), cause: cause.to_string() };
    let reports = EvaluationReport::read(path).map_err(damaged)?;
    Ok(reports.into_iter().filter_map(|report| report.rows.into_iter().next()).collect())
}

/// Dotted keys of a YAML mapping, and what stands there.
pub(crate) fn flat(yaml: &str) -> BTreeMap<String, String> {
    let mut found = BTreeMap::new();
    if let Ok(value) = serde_yaml::from_str::<Value>(yaml) {
        flatten(String::new(), &value, &mut found);
    }
    found
}

fn flatten(key: String, value: &Value, found: &mut BTreeMap<String, String>) {
    let below = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match value {
        Value::Object(fields) => fields.iter().for_each(|(name, value)| flatten(below(name), value, found)),
        Value::Array(items) if items.iter().any(|item| item.is_object() || item.is_array()) => {
            items.iter().enumerate().for_each(|(index, item)| flatten(below(&index.to_string()), item, found));
        }
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) | Value::Array(_) => {
            let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            found.insert(key, text);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(yaml: &str) -> RunSummary {
        RunSummary {
            path: PathBuf::new(),
            name: String::new(),
            seed: 0,
            steps: 0,
            training_secs: 0.0,
            evaluations: Vec::new(),
            config: flat(yaml),
        }
    }

    #[test]
    fn what_differs_is_named_by_dotted_keys() {
        let runs = [
            run("training: { seed: 1, epochs: 2 }\nrewards: [{ alive: { weight: 1 } }]\nhidden: [64, 64]"),
            run(
                "training: { seed: 3, epochs: 2 }\nrewards: [{ alive: { weight: 1 } }, { energy: {} }]\nhidden: [32]",
            ),
        ];
        let found = differences(&runs);
        let keys: Vec<&str> = found.iter().map(|difference| difference.key.as_str()).collect();
        assert_eq!(keys, ["hidden", "training.seed"]);
        assert_eq!(found[0].values, [Some("[64,64]".to_owned()), Some("[32]".to_owned())]);
        assert_eq!(differences(&runs[..1]), []);
    }
}
