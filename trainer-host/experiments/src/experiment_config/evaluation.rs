//! How the trained policy is judged.

use kestrel_sim::config::{ConfigError, EPISODE_LIMITS, Field, ScenarioConfig, StartConfig};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the trained policy is judged: without exploration, from starts it was not trained on.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Episodes flown, each from another start.
    pub episodes: u64,
    /// What the starts follow from.
    pub seed: u64,
    /// How episodes begin, if not as in training.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<StartConfig>,
    /// Time after which an episode is cut off, if not as in training.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub episode_secs: Option<f64>,
}

/// How the trained policy is judged, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluationSettings {
    /// Episodes flown.
    pub episodes: usize,
    /// What the starts follow from.
    pub seed: Seed,
    /// The task with the starts and the episode length of the evaluation.
    pub scenario: Scenario,
}

impl Default for EvaluationConfig {
    fn default() -> Self {
        Self { episodes: 1024, seed: 0, start: None, episode_secs: None }
    }
}

impl EvaluationConfig {
    /// The evaluation of `scenario`, which came from `written`; `root` is the top level of the document.
    ///
    /// # Errors
    /// When a number is out of range or a start would end its episode at once.
    pub fn check(
        &self,
        written: &ScenarioConfig,
        scenario: &Scenario,
        root: &Field<'_>,
    ) -> Result<EvaluationSettings, ConfigError> {
        let field = root.at("evaluation");
        let episodes = field.at("episodes").whole(self.episodes, 1..=1_000_000)?;
        let mut scenario = scenario.clone();
        if let Some(start) = &self.start {
            let Scenario { aviary, airframe, terminations, agents, goals, .. } = &scenario;
            let goals = goals.first(&aviary.goal, agents.count);
            scenario.start = start.check(aviary, airframe, terminations, &goals, &field.at("start"))?;
        }
        if let Some(secs) = self.episode_secs {
            scenario.episode_secs = field.at("episode_secs").number(secs, &EPISODE_LIMITS)?;
            let success = root.at("scenario").at("success");
            written.success.check(&scenario.aviary, secs, &scenario.terminations, &success)?;
        }
        Ok(EvaluationSettings { episodes: episodes as usize, seed: Seed(self.seed), scenario })
    }
}
