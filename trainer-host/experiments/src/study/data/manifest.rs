//! `study.json`: what was to be run.

use std::collections::BTreeSet;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::StudyError;
use crate::atomic_file::{read, write_atomically};
use crate::evaluation::Flyer;
use crate::study::config::claim::Claim;
use crate::study::rows::Job;

/// Name of the file in the study's directory.
const FILE: &str = "study.json";

/// A study before anything has flown.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyManifest {
    /// Short name.
    pub name: String,
    /// What it is to find out, in a sentence or two.
    pub about: String,
    /// What is learned.
    pub tasks: Vec<Task>,
    /// In which orders, each a list of indices of tasks.
    pub orders: Vec<Vec<usize>>,
    /// By what; the first is the one that others are compared with.
    pub methods: Vec<Method>,
    /// One run per method, order and seed.
    pub seeds: Vec<u64>,
    /// Environment steps of training per task, at most.
    pub steps_per_stage: u64,
    /// What trivial pilots achieve.
    pub baselines: Vec<Baseline>,
    /// Success rate in \[0, 1\] from which a task counts as learned.
    pub success_threshold: f64,
    /// A published table to be shown beside the study's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<Published>,
    /// What it is expected to show.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub claims: Vec<Claim>,
}

/// One task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Task {
    /// Name in rows and tables.
    pub name: String,
    /// Time limit of an episode \[s\].
    pub episode_secs: f64,
}

/// One way of learning several tasks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Method {
    /// Name in rows and of the directory.
    pub name: String,
    /// Name for readers.
    pub label: String,
    /// What its stages are.
    pub kind: MethodKind,
    /// Most bytes beyond the policy that it holds while it trains.
    pub training_bytes: u64,
    /// Bytes beyond the policy that it keeps from task to task.
    pub stored_bytes: u64,
    /// Number of the policy's parameters.
    pub parameters: u64,
    /// How it works, in a sentence.
    pub description: String,
}

/// What the stages of a method are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MethodKind {
    /// One policy learns the order's tasks one after the other, a stage each.
    Sequential,
    /// One policy learns all tasks at once, in one stage.
    Joint,
    /// Each task is learned by a policy of its own, and the policies are averaged now and then, in one stage.
    Averaged,
    /// Each task has a policy of its own; stage i trains that of the order's i-th task from scratch.
    Experts,
}

/// What a trivial pilot achieves in a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    /// The task's name.
    pub task: String,
    /// `do nothing`, `random` or `scripted pilot`.
    pub pilot: String,
    /// Share of flights that were a success.
    pub success_rate: f64,
    /// Mean return.
    pub episode_return: f64,
    /// Number of flights.
    pub episodes: usize,
}

/// A table that somebody else has published.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Where it comes from and what its numbers are.
    pub title: String,
    /// Names of the columns of numbers.
    pub columns: Vec<String>,
    /// Its rows.
    pub rows: Vec<PublishedRow>,
    /// What a reader must know to compare.
    #[serde(default)]
    pub notes: Vec<String>,
}

/// A row of a published table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedRow {
    /// Its first column.
    pub label: String,
    /// One per column.
    pub values: Vec<PublishedValue>,
}

/// An entry of a published table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(into = "serde_json::Value", try_from = "serde_json::Value")]
pub enum PublishedValue {
    /// A number.
    Number(f64),
    /// `"DNE"`: the run never got there.
    NeverReached,
}

impl From<PublishedValue> for serde_json::Value {
    fn from(value: PublishedValue) -> Self {
        match value {
            PublishedValue::Number(number) => Self::from(number),
            PublishedValue::NeverReached => Self::from("DNE"),
        }
    }
}

impl TryFrom<serde_json::Value> for PublishedValue {
    type Error = String;

    fn try_from(value: serde_json::Value) -> Result<Self, String> {
        match (value.as_f64(), value.as_str()) {
            (Some(number), _) => Ok(Self::Number(number)),
            (_, Some("DNE")) => Ok(Self::NeverReached),
            _ => Err(format!("found {value}, expected a number or \"DNE\"")),
        }
    }
}

impl MethodKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Sequential, Self::Joint, Self::Averaged, Self::Experts];

    /// Number of stages for an order of `tasks` tasks.
    pub fn stages(self, tasks: usize) -> usize {
        match self {
            Self::Sequential | Self::Experts => tasks,
            Self::Joint | Self::Averaged => 1,
        }
    }

    /// Whether it has one stage, in which it learns all tasks.
    pub fn learns_at_once(self) -> bool {
        self.stages(2) == 1
    }
}

impl StudyManifest {
    /// Reads `study.json` of a study's directory.
    ///
    /// # Errors
    /// When it is unreadable or contradicts itself.
    pub fn load(directory: &Path) -> Result<Self, StudyError> {
        let path = directory.join(FILE);
        let manifest: Self = serde_json::from_slice(&read(&path)?).map_err(|error| StudyError::Json {
            path: path.clone(),
            line: error.line(),
            message: error.to_string(),
        })?;
        manifest.check(&path)?;
        Ok(manifest)
    }

    /// Writes `study.json` into a study's directory.
    ///
    /// # Errors
    /// When the study contradicts itself or the file cannot be written.
    pub fn save(&self, directory: &Path) -> Result<(), StudyError> {
        let path = directory.join(FILE);
        self.check(&path)?;
        let json = |error: serde_json::Error| StudyError::Json {
            path: path.clone(),
            line: error.line(),
            message: error.to_string(),
        };
        let mut text = serde_json::to_string_pretty(self).map_err(json)?;
        text.push('\n');
        Ok(write_atomically(&path, text.as_bytes())?)
    }

    /// The jobs of a complete study. Joint training and experts know no order and are run in the first alone.
    pub fn jobs(&self) -> Vec<Job> {
        let needed = |place: &[usize; 3]| match self.methods[place[0]].kind {
            MethodKind::Sequential => true,
            MethodKind::Joint | MethodKind::Averaged | MethodKind::Experts => place[1] == 0,
        };
        self.possible_jobs().into_iter().filter(|(_, place)| needed(place)).map(|(job, _)| job).collect()
    }

    /// Every method in every order with every seed, and the indices of the three.
    pub(super) fn possible_jobs(&self) -> Vec<(Job, [usize; 3])> {
        let mut jobs = Vec::new();
        for (method, Method { name, .. }) in self.methods.iter().enumerate() {
            for order in 0..self.orders.len() {
                for (seed, &number) in self.seeds.iter().enumerate() {
                    jobs.push((Job { method: name.clone(), order, seed: number }, [method, order, seed]));
                }
            }
        }
        jobs
    }

    /// The method of that name.
    pub fn method(&self, name: &str) -> Option<&Method> {
        self.methods.iter().find(|method| method.name == name)
    }

    /// What a trivial pilot achieves in a task.
    pub fn baseline(&self, task: usize, pilot: &str) -> Option<&Baseline> {
        self.baselines.iter().find(|row| row.task == self.tasks[task].name && row.pilot == pilot)
    }

    /// What doing nothing earns in a task.
    pub fn return_of_nothing(&self, task: usize) -> Option<f64> {
        self.baseline(task, Flyer::Nothing.name()).map(|baseline| baseline.episode_return)
    }

    fn check(&self, path: &Path) -> Result<(), StudyError> {
        match self.contradictions().into_iter().next() {
            None => Ok(()),
            Some((field, found, expected)) => {
                Err(StudyError::Manifest { path: path.to_owned(), field, found, expected: expected.to_owned() })
            }
        }
    }

    /// Field, found and expected of everything that is wrong.
    fn contradictions(&self) -> Vec<(String, String, &'static str)> {
        let mut wrong = Vec::new();
        wrong.extend(names("tasks", self.tasks.iter().map(|task| task.name.as_str())));
        wrong.extend(names("methods", self.methods.iter().map(|method| method.name.as_str())));
        wrong.extend(self.wrong_orders());
        wrong.extend(self.wrong_baselines());
        if self.seeds.is_empty() || self.seeds.iter().collect::<BTreeSet<_>>().len() < self.seeds.len() {
            wrong.push(("seeds".to_owned(), format!("{:?}", self.seeds), "at least one seed, each once"));
        }
        if !(0.0..=1.0).contains(&self.success_threshold) {
            wrong.push(("success_threshold".to_owned(), self.success_threshold.to_string(), "0 to 1"));
        }
        for (index, claim) in self.claims.iter().enumerate() {
            for name in claim.methods().filter(|name| self.method(name).is_none()) {
                wrong.push((format!("claims[{index}]"), format!("`{name}`"), "the name of a method"));
            }
        }
        for row in self.published.iter().flat_map(|published| &published.rows) {
            if Some(row.values.len()) != self.published.as_ref().map(|published| published.columns.len()) {
                let field = format!("published.rows: {}", row.label);
                wrong.push((field, format!("{} values", row.values.len()), "one per column"));
            }
        }
        wrong
    }

    fn wrong_orders(&self) -> Vec<(String, String, &'static str)> {
        let mut wrong = Vec::new();
        if self.orders.is_empty() {
            wrong.push(("orders".to_owned(), "none".to_owned(), "at least one"));
        }
        for (index, order) in self.orders.iter().enumerate() {
            let distinct: BTreeSet<usize> = order.iter().copied().collect();
            let known = distinct.iter().all(|task| *task < self.tasks.len());
            if order.is_empty() || distinct.len() < order.len() || !known {
                let expected = "indices of tasks, at least one, each at most once";
                wrong.push((format!("orders[{index}]"), format!("{order:?}"), expected));
            }
        }
        wrong
    }

    fn wrong_baselines(&self) -> Vec<(String, String, &'static str)> {
        let mut wrong = Vec::new();
        for (index, baseline) in self.baselines.iter().enumerate() {
            if self.tasks.iter().all(|task| task.name != baseline.task) {
                let field = format!("baselines[{index}].task");
                wrong.push((field, format!("`{}`", baseline.task), "the name of a task"));
            }
            if !(0.0..=1.0).contains(&baseline.success_rate) || !baseline.episode_return.is_finite() {
                let found = format!("{} and {}", baseline.success_rate, baseline.episode_return);
                wrong.push((format!("baselines[{index}]"), found, "a share and a finite return"));
            }
        }
        wrong
    }
}

/// What is wrong with names that appear in rows and paths.
fn names<'a>(list: &str, names: impl Iterator<Item = &'a str>) -> Vec<(String, String, &'static str)> {
    let allowed = |letter: char| letter.is_alphanumeric() || "-_.+ ".contains(letter);
    let mut seen = BTreeSet::new();
    let mut wrong = Vec::new();
    for (index, name) in names.enumerate() {
        let plain = !name.is_empty() && !name.starts_with('.') && name.trim() == name && name.chars().all(allowed);
        if !plain {
            let expected = "letters, digits, `-`, `_`, `+`, and inside also `.` and spaces";
            wrong.push((format!("{list}[{index}].name"), format!("`{name}`"), expected));
        }
        if !seen.insert(name) {
            wrong.push((format!("{list}[{index}].name"), format!("`{name}` again"), "each name once"));
        }
    }
    if seen.is_empty() {
        wrong.push((list.to_owned(), "none".to_owned(), "at least one"));
    }
    wrong
}
