//! How the trained policy is judged.

use std::sync::Arc;

use kestrel_sim::config::{ConfigError, EPISODE_LIMITS, Field, ScenarioConfig, StartConfig, WorldsConfig};
use kestrel_sim::rooms::{RoomRange, Rooms};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Test flights of a training run that does not say how many.
const TESTS: u64 = 20;

/// Worlds of an evaluation that does not say how many.
const UNSEEN_WORLDS: u32 = 200;

/// How the trained policy is judged: without exploration, from starts it was not trained on.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EvaluationConfig {
    /// Episodes flown, each from another start.
    pub episodes: u64,
    /// What the starts follow from.
    pub seed: u64,
    /// How often a training run flies its policy from 256 starts to see whether it is the best so far; 20 times where this is left
    /// out. The last update is always followed by such a test.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tests: Option<u64>,
    /// How episodes begin, if not as in training.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<StartConfig>,
    /// Time after which an episode is cut off, if not as in training.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub episode_secs: Option<f64>,
    /// In which worlds, where every episode draws one (`scenario.aviary.drawn`): none of those of training. Left out, the
    /// 200 after those.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub worlds: Option<WorldsConfig>,
    /// In the worlds of training instead: how well those are known, which says nothing of others.
    #[serde(skip_serializing_if = "is_false")]
    pub trained_worlds: bool,
}

/// Whether a key that is left out when it says no is left out.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde passes it")]
pub(crate) fn is_false(value: &bool) -> bool {
    !value
}

/// How the trained policy is judged, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct EvaluationSettings {
    /// Episodes flown.
    pub episodes: usize,
    /// What the starts follow from.
    pub seed: Seed,
    /// Test flights of a training run.
    pub tests: u64,
    /// The task with the starts, the episode length and the worlds of the evaluation.
    pub scenario: Scenario,
    /// The same in the worlds of training, where every episode draws one: in them policies are selected.
    pub seen: Option<Scenario>,
}

impl EvaluationSettings {
    /// The task in which policies are selected and calibrated: that of the evaluation, but in worlds of training.
    pub fn selection(&self) -> &Scenario {
        self.seen.as_ref().unwrap_or(&self.scenario)
    }
}

impl Default for EvaluationConfig {
    fn default() -> Self {
        Self {
            episodes: 1024,
            seed: 0,
            tests: None,
            start: None,
            episode_secs: None,
            worlds: None,
            trained_worlds: false,
        }
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
        let tests = field.at("tests").whole(self.tests.unwrap_or(TESTS), 1..=1_000)?;
        let mut scenario = scenario.clone();
        if let Some(start) = &self.start {
            let Scenario { aviary, airframe, terminations, agents, goals, .. } = &scenario;
            let goals = goals.first(&aviary.goal, agents.count);
            let field = field.at("start");
            scenario.start = match &scenario.drawn {
                None => start.check(aviary, airframe, terminations, &goals, &field)?,
                Some(rooms) => start.check_in_rooms(rooms, airframe, terminations, &goals, &field)?,
            };
        }
        if let Some(secs) = self.episode_secs {
            scenario.episode_secs = field.at("episode_secs").number(secs, &EPISODE_LIMITS)?;
            let success = root.at("scenario").at("success");
            written.success.check(&scenario.aviary, secs, &scenario.terminations, &success)?;
        }
        let (scenario, seen) = match self.unseen_worlds(&scenario, &field)? {
            None => (scenario, None),
            Some(rooms) => (scenario.in_rooms(&Arc::new(rooms)), Some(scenario)),
        };
        Ok(EvaluationSettings { episodes: episodes as usize, seed: Seed(self.seed), tests, scenario, seen })
    }

    /// The worlds in which the policy is judged, where training draws its own.
    fn unseen_worlds(&self, scenario: &Scenario, field: &Field<'_>) -> Result<Option<Rooms>, ConfigError> {
        let field = field.at("worlds");
        let Some(rooms) = &scenario.drawn else {
            if self.trained_worlds {
                return Err(field.reject("`trained_worlds`", "none: only a task with `aviary.drawn` has several"));
            }
            let refused = |_| field.reject("worlds", "none: only a task with `aviary.drawn` has several");
            return self.worlds.map_or(Ok(None), |worlds| Err(refused(worlds)));
        };
        if self.trained_worlds {
            let refused = |_| field.reject("worlds beside `trained_worlds`", "one of both");
            return self.worlds.map_or(Ok(None), |worlds| Err(refused(worlds)));
        }
        let training = rooms.range();
        let range = match self.worlds {
            Some(worlds) => worlds.check(&field)?,
            None => RoomRange { first: training.first + training.count, count: UNSEEN_WORLDS, ..training },
        };
        if range.overlaps(&training) {
            return Err(field.reject(shown(range), format!("none of the worlds of training, {}", shown(training))));
        }
        Ok(Some(rooms.elsewhere(range)))
    }
}

/// The range in words.
fn shown(RoomRange { seed, first, count }: RoomRange) -> String {
    format!("numbers {first} to {} of seed {}", u64::from(first) + u64::from(count) - 1, seed.0)
}
