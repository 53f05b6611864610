//! The search file: what is varied, in which study, how long, and what for.

mod study_space;
#[cfg(test)]
pub(crate) mod tests;

use std::path::Path;

use kestrel_sim::config::{ConfigError, Document, Field, Limits, schema_of};
use kestrel_sim::seed::Seed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::halving::rung_seeds;
use super::objective::Objective;
use super::sampler::Algorithm;
use super::space::Dimension;
use super::{Search, Trial};
use crate::config_file::ConfigFile;
use crate::experiment_config::check_name;
use crate::study::Study;
use crate::study::config::StudyConfig;

pub use study_space::{RangeConfig, SpaceConfig, ValuesConfig, WholeRangeConfig};

/// Version of the file format that this program reads.
pub const VERSION: u32 = 1;

/// Most trials: each has a directory.
const TRIAL_LIMIT: u64 = 10_000;

/// Most trials that are under way together: each has a lock that is held.
const BATCH_LIMIT: u64 = 256;

/// Written above every resolved search.
const RESOLVED_HEADER: &str =
    "# Complete description of a search, with every import resolved and every default filled in.\n";

/// One search as users write it.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SearchConfig {
    /// Version of this file format: 1.
    pub version: u32,
    /// Short name: letters, digits, `-` and `_`.
    pub name: String,
    /// What the search asks, in a sentence or two.
    #[serde(default)]
    pub about: String,
    /// The study whose settings are varied, usually imported; its `seeds` are not used.
    pub study: StudyConfig,
    /// What is varied: dotted keys of the study, such as `training.clip_range`, and their values.
    pub space: SpaceConfig,
    /// How many points are tried.
    #[serde(default = "trials")]
    pub trials: u64,
    /// How many of them are proposed, and halved, together.
    #[serde(default = "batch")]
    pub batch: u64,
    /// How points are proposed.
    #[serde(default)]
    pub algorithm: AlgorithmConfig,
    /// What the proposals follow from.
    #[serde(default)]
    pub seed: u64,
    /// What is to be as great as possible.
    #[serde(default)]
    pub objective: ObjectiveConfig,
    /// With which seeds trials are trained.
    #[serde(default)]
    pub seeds: SearchSeedsConfig,
    /// Whether bad trials get fewer seeds.
    #[serde(default)]
    pub halving: HalvingConfig,
}

fn trials() -> u64 {
    32
}

fn batch() -> u64 {
    8
}

/// How points are proposed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AlgorithmConfig {
    /// Independently of what was found.
    Random,
    /// Where good trials are dense and bad ones are not: the tree of Parzen estimators (Bergstra et al. 2011).
    #[default]
    Tpe,
}

/// What is to be as great as possible.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObjectiveConfig {
    /// Success rate after the last stage, mean over tasks.
    #[default]
    FinalSuccess,
    /// Return after the last stage, mean over tasks.
    FinalReturn,
    /// Area under the curve of success while it trains, as a share of the budget.
    Area,
}

/// With which seeds trials are trained.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SearchSeedsConfig {
    /// The first seed; left out: the one after the study's last, so that what is found is not judged by what found it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first: Option<u64>,
    /// How many, one after the other.
    pub count: u64,
}

impl Default for SearchSeedsConfig {
    fn default() -> Self {
        Self { first: None, count: 4 }
    }
}

/// Successive halving.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct HalvingConfig {
    /// Shares of the seeds with which a trial has been trained after each rung, rising to 1; `[1]` halves nothing.
    pub rungs: Vec<f64>,
    /// Share of the trials of a batch that go on to the next rung.
    pub keep: f64,
}

impl Default for HalvingConfig {
    fn default() -> Self {
        Self { rungs: vec![0.25, 0.5, 1.0], keep: 0.5 }
    }
}

/// The search in the file at `path`, after `overrides` such as `trials=8`.
///
/// # Errors
/// The first thing that is wrong, with its line or override, what was found and what was expected.
pub fn load(path: &Path, overrides: &[String]) -> Result<Search, ConfigError> {
    from_document(Document::read(path)?, overrides)
}

fn from_document(document: Document, overrides: &[String]) -> Result<Search, ConfigError> {
    let document = SearchConfig::overridden(document, overrides)?;
    document.decode::<SearchConfig>()?.check(&document)
}

/// The JSON schema of the search file, for editors.
pub fn schema() -> String {
    schema_of::<SearchConfig>()
}

impl ConfigFile for SearchConfig {
    const VERSION: u32 = VERSION;
    const HEADER: &'static str = RESOLVED_HEADER;
}

impl SearchConfig {
    fn check(&self, document: &Document) -> Result<Search, ConfigError> {
        let root = document.root();
        check_name(&self.name, &root.at("name"))?;
        let study = self.study.check(&root.at("study"))?;
        let count = root.at("seeds").at("count").whole(self.seeds.count, 1..=10_000)?;
        let search = Search {
            name: self.name.clone(),
            about: self.about.clone(),
            space: self.space.check(&root.at("space"))?,
            trials: root.at("trials").whole(self.trials, 1..=TRIAL_LIMIT)? as usize,
            batch: root.at("batch").whole(self.batch, 1..=BATCH_LIMIT)? as usize,
            algorithm: self.algorithm.into(),
            seed: Seed(self.seed),
            rungs: self.halving.check(count, &root.at("halving"))?,
            keep: root.at("halving").at("keep").real(self.halving.keep, &Limits::above(0.0, 1.0, ""))?,
            first_seed: self.seeds.first.unwrap_or_else(|| after_all(&study)),
            objective: self.objective.into(),
            resolved_yaml: self.resolved(),
            document: document.clone(),
        };
        study_space::check_values(&search, &root.at("space"))?;
        Ok(search)
    }
}

/// The seed after the last of a study.
fn after_all(study: &Study) -> u64 {
    study.seeds.last().map_or(0, |seed| seed.0.wrapping_add(1))
}

impl HalvingConfig {
    /// Numbers of seeds after each rung.
    fn check(&self, seeds: u64, field: &Field<'_>) -> Result<Vec<u64>, ConfigError> {
        let field = field.at("rungs");
        for (index, share) in self.rungs.iter().enumerate() {
            field.at(index).real(*share, &Limits::above(0.0, 1.0, ""))?;
        }
        if self.rungs.last() != Some(&1.0) {
            return Err(field.reject("no 1 at the end", "shares that rise to 1"));
        }
        let mut rungs = rung_seeds(&self.rungs, seeds);
        if !self.rungs.is_sorted_by(|one, next| one < next) {
            return Err(field.reject("shares that do not rise", "shares that rise to 1"));
        }
        // Few seeds have fewer rungs.
        rungs.dedup();
        Ok(rungs)
    }
}

impl Search {
    /// The study of a trial at `point`, with the first `seeds` of the search's seeds.
    ///
    /// # Errors
    /// When the study does not take the values.
    pub fn study(&self, point: &[f64], seeds: u64) -> Result<Study, ConfigError> {
        self.study_with(self.space.iter().zip(point.iter().copied()), seeds)
    }

    /// As [`Self::study`], with values of some dimensions; the others are as the file says.
    fn study_with<'a>(
        &self,
        places: impl IntoIterator<Item = (&'a Dimension, f64)>,
        seeds: u64,
    ) -> Result<Study, ConfigError> {
        let mut document = self.document.clone();
        document.set(&format!("study.seeds={{first: {}, count: {seeds}}}", self.first_seed))?;
        for (dimension, place) in places {
            document.set(&format!("study.{}={}", dimension.key, dimension.value(place)))?;
        }
        document.decode::<SearchConfig>()?.study.check(&document.root().at("study"))
    }

    /// A trial's values, as YAML, in the order of the space.
    pub fn values(&self, trial: &Trial) -> Vec<String> {
        self.space.iter().zip(&trial.point).map(|(dimension, place)| dimension.value(*place)).collect()
    }
}

impl From<AlgorithmConfig> for Algorithm {
    fn from(config: AlgorithmConfig) -> Self {
        match config {
            AlgorithmConfig::Random => Self::Random,
            AlgorithmConfig::Tpe => Self::Tpe,
        }
    }
}

impl From<ObjectiveConfig> for Objective {
    fn from(config: ObjectiveConfig) -> Self {
        match config {
            ObjectiveConfig::FinalSuccess => Self::FinalSuccess,
            ObjectiveConfig::FinalReturn => Self::FinalReturn,
            ObjectiveConfig::Area => Self::Area,
        }
    }
}
