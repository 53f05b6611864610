//! Who teaches a policy while it does not know the way.

use kestrel_sim::config::{ConfigError, Field, Limits};
use kestrel_sim::scenario::Scenario;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::teacher::Teacher;
use kestrel_learn::ppo::TeacherSettings;

/// The scripted pilot says in every state of the training what it would do on the shortest free way to the goal, which it
/// knows, and the policy pays for its divergence from that (kickstarting, Schmitt et al. 2018). For tasks with the reward
/// `advance`, drawn worlds, or goals that are `gates`. Only training knows the way; the policy flies and is judged without.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TeacherConfig {
    /// Weight of the divergence \[nat\] in the loss at the start.
    pub weight: f64,
    /// Share of the training, above 0 to 1, over which the weight falls to zero in a straight line.
    pub until: f64,
}

impl Default for TeacherConfig {
    fn default() -> Self {
        Self { weight: 1.0, until: 0.5 }
    }
}

impl TeacherConfig {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<TeacherSettings, ConfigError> {
        Ok(TeacherSettings {
            weight: field.at("weight").number(self.weight, &Limits::above(0.0, 1e3, ""))?,
            until: field.at("until").number(self.until, &Limits::above(0.0, 1.0, ""))?,
        })
    }
}

/// Refuses a teacher where the task has no map for it; `field` is the training's.
pub(super) fn refuse_lost_teacher(
    teacher: Option<TeacherSettings>,
    task: &Scenario,
    field: &Field<'_>,
) -> Result<(), ConfigError> {
    if teacher.is_none() || Teacher::of(task).is_some() {
        return Ok(());
    }
    let found = format!("a teacher for {}, which has no reward `advance`", task.name);
    Err(field.at("teacher").reject(
        found,
        "tasks with that reward, drawn worlds, or goals that are `gates`: there the teacher knows the way",
    ))
}
