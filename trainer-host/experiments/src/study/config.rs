//! The study file: which tasks, in which orders, learned by which methods, how often.

pub mod claim;
mod method;
pub mod multi_task;
#[cfg(test)]
pub(crate) mod tests;

use std::path::Path;

use kestrel_sim::config::{ConfigError, Document, Field, Limits, schema_of};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use method::{ExpertsConfig, MethodConfig, ProcedureConfig, SequentialConfig, SharingConfig};

use super::Study;
use super::procedure::{Method, Procedure};
use claim::Claim;
use kestrel_learn::regulariser::RegulariserSettings;

use crate::config_file::ConfigFile;
use crate::experiment_config::{
    Experiment, ExperimentConfig, TrainingConfig, check_name, is_false, refuse_broken_batches,
    refuse_unsuited_training, refuse_without_derivatives,
};
use crate::learner::LearnerSettings;

/// Version of the file format that this program reads.
pub const VERSION: u32 = 1;

/// Most jobs of a study: each leaves two files.
const JOB_LIMIT: u64 = 100_000;

/// Most tasks of which all orders are tried.
const ALL_ORDERS_LIMIT: usize = 5;

/// Written above every resolved study.
const RESOLVED_HEADER: &str =
    "# Complete description of a study, with every import resolved and every default filled in.\n";

/// One study as users write it.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StudyConfig {
    /// Version of this file format: 1.
    pub version: u32,
    /// Short name: letters, digits, `-` and `_`.
    pub name: String,
    /// What the study asks, in a sentence or two.
    #[serde(default)]
    pub about: String,
    /// The tasks: experiments, usually imported. Their `training` is not used.
    pub tasks: Vec<ExperimentConfig>,
    /// In which orders they are learned.
    #[serde(default)]
    pub orders: OrdersConfig,
    /// How often each method learns each order.
    #[serde(default)]
    pub seeds: SeedsConfig,
    /// How each task is trained; `total_steps` is for one task, `seed` is not used.
    #[serde(default)]
    pub training: TrainingConfig,
    /// How policies are judged.
    #[serde(default)]
    pub evaluation: StudyEvaluationConfig,
    /// Who learns.
    pub methods: Vec<MethodConfig>,
    /// Numbers from elsewhere that the report shows beside ours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<PublishedTable>,
    /// What is expected of the results; the report says of each whether it holds.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub claims: Vec<Claim>,
}

/// In which orders tasks are learned.
#[derive(Clone, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum OrdersConfig {
    /// As listed.
    #[default]
    Listed,
    /// In all orders.
    All,
    /// In these: lists of the tasks' names.
    These(Vec<Vec<String>>),
}

/// How often each method learns each order.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SeedsConfig {
    /// The first seed.
    pub first: u64,
    /// How many, one after the other.
    pub count: u64,
}

impl Default for SeedsConfig {
    fn default() -> Self {
        Self { first: 0, count: 16 }
    }
}

/// How policies are judged: the mean action, from starts that no training sees.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StudyEvaluationConfig {
    /// Episodes of each task after each stage.
    pub episodes: u64,
    /// What their starts follow from, the same for all.
    pub seed: u64,
    /// How often during a stage the policy flies the present task, for curves.
    pub flights_per_stage: u64,
    /// Episodes of such a flight.
    pub flight_episodes: u64,
    /// A stage ends early once the success rate of such a flight is at least this, in the worst of the stage's tasks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop_at_success: Option<f64>,
    /// Whether a stage also begins with such a flight, and is over without an update where that reaches `stop_at_success`.
    #[serde(skip_serializing_if = "is_false")]
    pub skip_solved: bool,
}

impl Default for StudyEvaluationConfig {
    fn default() -> Self {
        Self {
            episodes: 100,
            seed: 0,
            flights_per_stage: 10,
            flight_episodes: 32,
            stop_at_success: None,
            skip_solved: false,
        }
    }
}

/// A table from elsewhere, shown as it is.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PublishedTable {
    /// What it is and where it comes from.
    pub title: String,
    /// Names of the columns, without that of the rows' names.
    pub columns: Vec<String>,
    /// Each row: its name and its cells.
    pub rows: Vec<PublishedRow>,
    /// What one should know before comparing.
    #[serde(default)]
    pub notes: String,
}

/// A row of such a table.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PublishedRow {
    /// Its name.
    pub name: String,
    /// Its cells, as text.
    pub cells: Vec<String>,
}

/// How policies are judged, checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StudyEvaluation {
    /// Episodes of each task after each stage.
    pub episodes: usize,
    /// What their starts follow from.
    pub seed: Seed,
    /// How often during a stage the policy flies the present task.
    pub flights_per_stage: u64,
    /// Episodes of such a flight.
    pub flight_episodes: usize,
    /// A stage ends early once the success rate of such a flight is at least this, in the worst of the stage's tasks.
    pub stop_at_success: Option<f64>,
    /// Whether a stage whose tasks are flown so well before it is over at once.
    pub skip_solved: bool,
}

/// The study in the file at `path`, after `overrides` such as `seeds.count=3`.
///
/// # Errors
/// The first thing that is wrong, with its line or override, what was found and what was expected.
pub fn load(path: &Path, overrides: &[String]) -> Result<Study, ConfigError> {
    from_document(Document::read(path)?, overrides)
}

fn from_document(document: Document, overrides: &[String]) -> Result<Study, ConfigError> {
    let document = StudyConfig::overridden(document, overrides)?;
    document.decode::<StudyConfig>()?.check(&document.root())
}

/// The JSON schema of the study file, for editors.
pub fn schema() -> String {
    schema_of::<StudyConfig>()
}

impl ConfigFile for StudyConfig {
    const VERSION: u32 = VERSION;
    const HEADER: &'static str = RESOLVED_HEADER;
}

impl StudyConfig {
    /// The study at `root`, checked.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub(crate) fn check(&self, root: &Field<'_>) -> Result<Study, ConfigError> {
        check_name(&self.name, &root.at("name"))?;
        let tasks = check_tasks(&self.tasks, &root.at("tasks"))?;
        let orders = self.orders.check(&tasks, &root.at("orders"))?;
        let training = self.check_training(&tasks, &root.at("training"), &root.at("tasks"))?;
        let methods = self.check_methods(&root.at("methods"), &tasks, &training)?;
        let count = root.at("seeds").at("count").whole(self.seeds.count, 1..=10_000)?;
        let jobs = count * (methods.len() * orders.len()) as u64;
        if jobs > JOB_LIMIT {
            let found = format!("{jobs} jobs (methods · orders · seeds)");
            return Err(root.at("seeds").reject(found, format!("at most {JOB_LIMIT}")));
        }
        Ok(Study {
            name: self.name.clone(),
            about: self.about.clone(),
            tasks,
            orders,
            seeds: (0..count).map(|index| Seed(self.seeds.first.wrapping_add(index))).collect(),
            training,
            evaluation: self.evaluation.check(&root.at("evaluation"))?,
            methods,
            published: self.check_published(&root.at("published"))?,
            claims: self.check_claims(&root.at("claims"))?,
            resolved_yaml: self.resolved(),
        })
    }

    /// How all tasks are trained; where each is trained as its file says, that this can be.
    fn check_training(
        &self,
        tasks: &[Experiment],
        field: &Field<'_>,
        of_tasks: &Field<'_>,
    ) -> Result<LearnerSettings, ConfigError> {
        let own = |method: &MethodConfig| {
            matches!(method.learn, ProcedureConfig::Experts(ExpertsConfig { own_training: true }))
        };
        let training = self.training.for_teams(teams(tasks)).check(field)?;
        if self.methods.iter().any(own) {
            for (index, task) in tasks.iter().enumerate() {
                let field = of_tasks.at(index).at("training");
                refuse_unfit(std::slice::from_ref(task), &task.training, &field)?;
            }
        }
        if !self.methods.iter().all(own) {
            refuse_other_layouts(tasks, of_tasks)?;
            refuse_unfit(tasks, &training, field)?;
        }
        Ok(training)
    }

    fn check_methods(
        &self,
        field: &Field<'_>,
        tasks: &[Experiment],
        training: &LearnerSettings,
    ) -> Result<Vec<Method>, ConfigError> {
        if self.methods.is_empty() {
            return Err(field.refuse("", "at least one method"));
        }
        let mut methods: Vec<Method> = Vec::new();
        for (index, method) in self.methods.iter().enumerate() {
            let field = field.at(index);
            check_name(&method.name, &field.at("name"))?;
            if methods.iter().any(|other| other.name == method.name) {
                return Err(field.at("name").refuse(&method.name, "a name that no other method has"));
            }
            let checked = method.check(&field, tasks)?;
            if let Some(training) = &checked.training {
                refuse_unfit(tasks, training, &field.at("training"))?;
            }
            refuse_lost_images(tasks, &checked.procedure, &field.at("learn"))?;
            let training = checked.training.as_ref().unwrap_or(training);
            refuse_lost_memory(training, &checked.procedure, &field.at("learn"))?;
            refuse_unshared(training, &checked.procedure, &field.at("learn"))?;
            refuse_few_drones(training, &checked.procedure, &field.at("learn"))?;
            methods.push(checked);
        }
        Ok(methods)
    }

    fn check_published(&self, field: &Field<'_>) -> Result<Option<PublishedTable>, ConfigError> {
        let Some(table) = &self.published else { return Ok(None) };
        let columns = table.columns.len();
        match table.rows.iter().enumerate().find(|(_, row)| row.cells.len() != columns) {
            None => Ok(Some(table.clone())),
            Some((index, row)) => {
                let expected = format!("{columns}: one for each column");
                Err(field.at("rows").at(index).at("cells").refuse(row.cells.len(), expected))
            }
        }
    }

    fn check_claims(&self, field: &Field<'_>) -> Result<Vec<Claim>, ConfigError> {
        let methods: Vec<&str> = self.methods.iter().map(|method| method.name.as_str()).collect();
        for (index, claim) in self.claims.iter().enumerate() {
            claim.check(&methods, &field.at(index))?;
        }
        Ok(self.claims.clone())
    }
}

/// The tasks, each of its own name.
fn check_tasks(configs: &[ExperimentConfig], field: &Field<'_>) -> Result<Vec<Experiment>, ConfigError> {
    if configs.is_empty() {
        return Err(field.refuse("", "at least one task"));
    }
    let mut tasks: Vec<Experiment> = Vec::new();
    for (index, task) in configs.iter().enumerate() {
        let field = field.at(index);
        let task = task.check(&field)?;
        if tasks.iter().any(|other| other.name == task.name) {
            return Err(field.at("name").refuse(&task.name, "a name that no other task has"));
        }
        tasks.push(task);
    }
    Ok(tasks)
}

/// Refuses a way to learn that keeps states of tasks whose images it would lose.
fn refuse_lost_images(tasks: &[Experiment], procedure: &Procedure, learn: &Field<'_>) -> Result<(), ConfigError> {
    if tasks[0].scenario.camera.is_none() || !procedure.keeps_states() {
        return Ok(());
    }
    let expected = "`sequential` without a consolidator, `joint`, `sharing` or `experts`: what the others keep of a task \
                    has no images";
    Err(learn.reject("tasks with a camera", expected))
}

/// Refuses a memory where methods of continual learning would show the policy single observations.
fn refuse_lost_memory(
    training: &LearnerSettings,
    procedure: &Procedure,
    learn: &Field<'_>,
) -> Result<(), ConfigError> {
    let keeps_it = match procedure {
        Procedure::Joint
        | Procedure::Experts { .. }
        | Procedure::Sequential { regulariser: RegulariserSettings::None, .. } => true,
        // What PPO remembers of a flight are the hidden states at the beginnings of windows.
        Procedure::Sequential { regulariser: RegulariserSettings::CompactCoreset(_), .. } => {
            training.analytic.is_some()
        }
        Procedure::Sequential { .. } | Procedure::Sharing { .. } | Procedure::Distil { .. } => false,
    };
    if training.ppo.memory.is_none() || keeps_it {
        return Ok(());
    }
    let expected = "`joint`, `experts`, `sequential` without a consolidator or, by gradients, with `compact_coreset`: \
                    other methods do not carry a hidden state";
    Err(learn.reject("policies with a memory", expected))
}

/// Refuses to find boundaries in the few drones of a window by gradients: by chance these have met as different things before.
fn refuse_few_drones(
    training: &LearnerSettings,
    procedure: &Procedure,
    learn: &Field<'_>,
) -> Result<(), ConfigError> {
    if procedure.finds_boundaries() && training.analytic.is_some() {
        let expected = "PPO, whose rollouts have drones enough to tell";
        return Err(learn.reject("`boundaries: found` beside `analytic`", expected));
    }
    Ok(())
}

/// Refuses a training that learners whose policies are averaged do not have.
fn refuse_unshared(
    training: &LearnerSettings,
    procedure: &Procedure,
    learn: &Field<'_>,
) -> Result<(), ConfigError> {
    let refuse = |found| {
        Err(learn.reject(format!("`sharing` beside {found}"), "PPO from random weights, or another way to learn"))
    };
    match procedure {
        Procedure::Sharing { .. } if training.analytic.is_some() => refuse("`analytic`"),
        Procedure::Sharing { .. } if training.initial_policy.is_some() => refuse("`initial_policy`"),
        Procedure::Sharing { .. }
        | Procedure::Sequential { .. }
        | Procedure::Joint
        | Procedure::Experts { .. }
        | Procedure::Distil { .. } => Ok(()),
    }
}

/// Drones of each task that fly together.
fn teams(tasks: &[Experiment]) -> impl Iterator<Item = usize> {
    tasks.iter().map(|task| task.scenario.agents.count as usize)
}

/// One policy flies all tasks.
fn refuse_other_layouts(tasks: &[Experiment], field: &Field<'_>) -> Result<(), ConfigError> {
    let mut others = tasks.iter().enumerate().skip(1);
    others.try_for_each(|(index, task)| refuse_other_layout(&tasks[0], task, &field.at(index)))
}

/// Refuses a task that does not agree with the first in what a policy sees and commands.
fn refuse_other_layout(first: &Experiment, task: &Experiment, field: &Field<'_>) -> Result<(), ConfigError> {
    let field = field.at("scenario");
    let expected = |what: &str| format!("the {what} of the task {:?}: one policy flies them all", first.name);
    // First: sensors count control periods.
    let rate_hz = task.scenario.physics.control_rate_hz;
    if rate_hz != first.scenario.physics.control_rate_hz {
        let expected = expected(&format!("control rate {}", first.scenario.physics.control_rate_hz));
        return Err(field.at("physics").at("control_rate_hz").refuse(rate_hz, expected));
    }
    if task.scenario.observation != first.scenario.observation {
        return Err(field.at("observation").reject("another observation", expected("observation")));
    }
    if task.scenario.sensors != first.scenario.sensors {
        return Err(field.at("sensors").reject("other sensors", expected("sensors")));
    }
    if task.scenario.camera != first.scenario.camera {
        return Err(field.at("camera").reject("another camera", expected("camera")));
    }
    if task.scenario.action != first.scenario.action {
        return Err(field.at("action").reject("another action", expected("action")));
    }
    if task.scenario.critic != first.scenario.critic {
        return Err(field.at("critic").reject("another critic", expected("critic")));
    }
    Ok(())
}

/// Refuses a training that cannot be that of these tasks.
fn refuse_unfit(tasks: &[Experiment], training: &LearnerSettings, field: &Field<'_>) -> Result<(), ConfigError> {
    refuse_other_teams(tasks, training, field)?;
    refuse_unsuited(tasks, training, field)
}

/// Refuses a training that some task does not suit.
fn refuse_unsuited(
    tasks: &[Experiment],
    training: &LearnerSettings,
    field: &Field<'_>,
) -> Result<(), ConfigError> {
    tasks.iter().try_for_each(|task| {
        refuse_unsuited_training(training, &task.scenario, field)?;
        match training.analytic {
            Some(_) => refuse_without_derivatives(&task.scenario, &field.at("analytic")),
            None => Ok(()),
        }
    })
}

/// Refuses tasks whose teams this training cannot have side by side.
fn refuse_other_teams(
    tasks: &[Experiment],
    training: &LearnerSettings,
    field: &Field<'_>,
) -> Result<(), ConfigError> {
    if training.analytic.is_some() {
        return Ok(());
    }
    let scenarios: Vec<Scenario> = tasks.iter().map(|task| task.scenario.clone()).collect();
    refuse_broken_batches(&scenarios, training.ppo.environments, field)?;
    let read = |scenario: &Scenario| training.ppo.critic_scope.agents(scenario.agents.count as usize);
    match scenarios.iter().find(|scenario| read(scenario) != read(&scenarios[0])) {
        None => Ok(()),
        Some(other) => {
            let found = format!("`team` beside teams of {} and {}", scenarios[0].agents.count, other.agents.count);
            Err(field
                .at("critic_scope")
                .reject(found, "`own`, or tasks of equally many drones: one critic reads them all"))
        }
    }
}

impl OrdersConfig {
    /// Orders as indices of tasks.
    fn check(&self, tasks: &[Experiment], field: &Field<'_>) -> Result<Vec<Vec<usize>>, ConfigError> {
        match self {
            Self::Listed => Ok(vec![(0..tasks.len()).collect()]),
            Self::All if tasks.len() > ALL_ORDERS_LIMIT => {
                let expected =
                    format!("`all` for up to {ALL_ORDERS_LIMIT} tasks, `listed` or `these` for {}", tasks.len());
                Err(field.refuse("all", expected))
            }
            Self::All => Ok(permutations(tasks.len())),
            Self::These(orders) => {
                let field = field.at("these");
                if orders.is_empty() {
                    return Err(field.refuse("", "at least one order"));
                }
                let order = |(index, names): (usize, &Vec<String>)| {
                    if orders[..index].contains(names) {
                        return Err(field.at(index).reject(names.join(", ") + " again", "each order once"));
                    }
                    order_of(names, tasks, &field.at(index))
                };
                orders.iter().enumerate().map(order).collect()
            }
        }
    }
}

fn order_of(names: &[String], tasks: &[Experiment], field: &Field<'_>) -> Result<Vec<usize>, ConfigError> {
    let known = || tasks.iter().map(|task| task.name.as_str()).collect::<Vec<_>>().join(", ");
    let index = |(place, name): (usize, &String)| {
        let found = tasks.iter().position(|task| task.name == *name);
        found.ok_or_else(|| field.at(place).refuse(name, format!("one of the tasks: {}", known())))
    };
    let order = names.iter().enumerate().map(index).collect::<Result<Vec<usize>, _>>()?;
    if order.is_empty() {
        return Err(field.refuse("", "at least one task"));
    }
    for (place, task) in order.iter().enumerate() {
        if order[..place].contains(task) {
            return Err(field.at(place).refuse(&names[place], "each task once"));
        }
    }
    Ok(order)
}

/// All orders of `count` things, in lexical order.
fn permutations(count: usize) -> Vec<Vec<usize>> {
    let mut orders = vec![Vec::new()];
    for _ in 0..count {
        let longer = |order: Vec<usize>| {
            let free: Vec<usize> = (0..count).filter(|next| !order.contains(next)).collect();
            free.into_iter().map(move |next| [order.as_slice(), &[next]].concat())
        };
        orders = orders.into_iter().flat_map(longer).collect();
    }
    orders
}

impl StudyEvaluationConfig {
    fn check(&self, field: &Field<'_>) -> Result<StudyEvaluation, ConfigError> {
        let share = Limits::above(0.0, 1.0, "");
        let stop = self.stop_at_success.map(|share_of| field.at("stop_at_success").real(share_of, &share));
        if self.skip_solved && self.stop_at_success.is_none() {
            return Err(field.at("skip_solved").refuse("true", "false, or `stop_at_success` beside it"));
        }
        Ok(StudyEvaluation {
            episodes: field.at("episodes").whole(self.episodes, 1..=100_000)? as usize,
            seed: Seed(self.seed),
            flights_per_stage: field.at("flights_per_stage").whole(self.flights_per_stage, 1..=10_000)?,
            flight_episodes: field.at("flight_episodes").whole(self.flight_episodes, 1..=100_000)? as usize,
            stop_at_success: stop.transpose()?,
            skip_solved: self.skip_solved,
        })
    }
}
