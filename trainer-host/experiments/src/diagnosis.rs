//! Why a run may not have learned its task: what its figures, its rewards and the baselines say together.
//!
//! Every check looks for one kind of mistake and says how sure it is; the two surest are shown. None of them proves
//! anything: they are where somebody who knows the trainer would look first.

use core::fmt;

use kestrel_core::observation::ObservationLayout;
use kestrel_learn::ppo::PpoSettings;
use kestrel_sim::outcome::Ending;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::simulation::Simulation;
use serde::Deserialize;

use crate::evaluation::{Evaluation, Flyer};
use crate::experiment_config::Experiment;
use crate::results::EvaluationReport;
use crate::run_config::Subject;
use crate::run_directory::metrics::read_rows;
use crate::run_directory::{RunDirectory, RunDirectoryError};

/// A policy that succeeds so often has learned its task.
const LEARNED: f64 = 0.9;

/// Most causes that are shown.
const SHOWN: usize = 2;

/// Who is lost so soon \[s\] has not flown.
const SOON_SECS: f64 = 0.4;

/// Fewer updates than this are too few to learn anything by.
const FEW_UPDATES: usize = 20;

/// Starts that are looked at.
const STARTS: usize = 64;

/// Rewards that are the same wherever the goal is.
const INDIFFERENT: [&str; 13] = [
    "alive",
    "velocity",
    "body_rates",
    "tilt",
    "action",
    "action_change",
    "failure",
    "clearance",
    "energy",
    "jerk",
    "yaw_rate",
    "heading_error",
    "orientation",
];

/// Rewards that are paid at the end of a way, and not on it.
const AT_THE_END: [&str; 5] = ["success", "landing", "landing_v2", "touch_landing_zone", "enter_area"];

/// What a run says of an update, as far as it is needed here; nothing where PPO's figures have no meaning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
struct UpdateRow {
    /// Divergence of the policy from that of the rollout \[nat\].
    approx_kl: Option<f32>,
    /// Share of samples whose ratio left the clip range.
    clip_fraction: Option<f32>,
    /// Logarithm of the actions' standard deviation, mean over the actions.
    log_std: Option<f32>,
    /// Length of the gradient before it was limited.
    gradient_norm: Option<f32>,
    /// Mean return of the episodes that ended.
    episode_return: Option<f32>,
    /// Share of them that succeeded.
    success_rate: Option<f32>,
}

/// One likely cause, and what to change.
#[derive(Clone, Debug, PartialEq)]
pub struct Cause {
    /// How sure it is, from 0 to 1: only to put causes in an order.
    sureness: f64,
    says: String,
    /// The key of the experiment file to change.
    pub key: String,
    change: &'static str,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} `{}`", self.says, self.change, self.key)
    }
}

/// The likely causes of a run that was judged; none where it has several tasks, of which none says alone why.
///
/// # Errors
/// When the run's metrics cannot be read.
pub fn of_run(
    subject: &Subject<'_>,
    directory: &RunDirectory,
    reports: &[EvaluationReport],
) -> Result<Vec<Cause>, RunDirectoryError> {
    let ([experiment], [report]) = (subject.tasks, reports) else { return Ok(Vec::new()) };
    Ok(likely_causes(experiment, &read_rows(&directory.metrics())?, report))
}

/// The most likely causes, the likeliest first, at most two; none where the policy of the report's first row has learned
/// its task.
fn likely_causes(experiment: &Experiment, updates: &[UpdateRow], report: &EvaluationReport) -> Vec<Cause> {
    let row = |flyer: Flyer<'_>| report.rows.iter().find(|row| row.pilot == flyer.name());
    let (Some(policy), Some(scripted), Some(nothing)) =
        (report.rows.first(), row(Flyer::Scripted), row(Flyer::Nothing))
    else {
        return Vec::new();
    };
    if policy.success_rate >= LEARNED {
        return Vec::new();
    }
    let evidence = Evidence { experiment, updates, policy, scripted, nothing };
    let mut causes: Vec<Cause> = CHECKS.iter().filter_map(|check| check(&evidence)).collect();
    causes.sort_by(|one, other| other.sureness.total_cmp(&one.sureness));
    causes.dedup_by(|next, before| next.key == before.key);
    causes.truncate(SHOWN);
    causes
}

type Check = fn(&Evidence<'_>) -> Option<Cause>;

const CHECKS: [Check; 16] = [
    no_reward_for_the_goal,
    measures_in_vain,
    nothing_on_the_way,
    lost_at_the_start,
    steps_too_long,
    steps_too_short,
    explores_too_little,
    explores_too_much,
    shortsighted,
    paid_for_something_else,
    crashing_pays,
    failing_costs_too_much,
    position_scale,
    no_time,
    few_updates,
    still_learning,
];

/// What is known of a run.
struct Evidence<'a> {
    experiment: &'a Experiment,
    updates: &'a [UpdateRow],
    policy: &'a Evaluation,
    scripted: &'a Evaluation,
    nothing: &'a Evaluation,
}

impl Evidence<'_> {
    fn scenario(&self) -> &Scenario {
        &self.experiment.scenario
    }

    /// The settings of PPO, where the run was trained by it.
    fn ppo(&self) -> Option<&PpoSettings> {
        let training = &self.experiment.training;
        if training.analytic.is_some() { None } else { Some(&training.ppo) }
    }

    /// The median of a figure over the updates in which it is a number.
    fn median(&self, figure: fn(&UpdateRow) -> Option<f32>) -> Option<f64> {
        let mut values: Vec<f32> =
            self.updates.iter().filter_map(figure).filter(|value| value.is_finite()).collect();
        values.sort_by(f32::total_cmp);
        values.get(values.len() / 2).map(|value| f64::from(*value))
    }

    /// The mean of a figure from one share of the training to another, both 0 to 1.
    fn mean(&self, figure: fn(&UpdateRow) -> Option<f32>, [from, to]: [f64; 2]) -> Option<f64> {
        let count = self.updates.len() as f64;
        let rows = &self.updates[(from * count) as usize..(to * count) as usize];
        let values: Vec<f64> = rows.iter().filter_map(figure).map(f64::from).collect();
        if values.is_empty() { None } else { Some(values.iter().sum::<f64>() / values.len() as f64) }
    }

    /// Key of the reward with this index.
    fn reward_key(&self, index: usize) -> String {
        format!("scenario.rewards[{index}].{}.weight", self.scenario().rewards[index].name())
    }

    fn pays_for(&self, names: &[&str]) -> bool {
        self.scenario().rewards.iter().any(|term| term.weight() != 0.0 && names.contains(&term.name()))
    }
}

/// Share of the episodes that ended so.
fn share(row: &Evaluation, is: fn(Ending) -> bool) -> f64 {
    let count: usize = row.endings.iter().filter(|(ending, _)| is(*ending)).map(|(_, count)| count).sum();
    count as f64 / row.episodes.max(1) as f64
}

fn out_of_time(ending: Ending) -> bool {
    matches!(ending, Ending::TimeLimit | Ending::Overdue | Ending::OutOfFuel)
}

fn lost(ending: Ending) -> bool {
    ending.is_failure() && !out_of_time(ending)
}

fn no_reward_for_the_goal(evidence: &Evidence<'_>) -> Option<Cause> {
    let rewards = &evidence.scenario().rewards;
    let indifferent = rewards.iter().all(|term| term.weight() == 0.0 || INDIFFERENT.contains(&term.name()));
    indifferent.then(|| Cause {
        sureness: 1.0,
        says: "no reward depends on where the goal is".to_owned(),
        key: "scenario.rewards".to_owned(),
        change: "add `progress`, `advance` or `proximity` to",
    })
}

/// Sensors that the observation leaves out.
fn measures_in_vain(evidence: &Evidence<'_>) -> Option<Cause> {
    let Scenario { sensors, observation, .. } = evidence.scenario();
    let blind = matches!(observation, ObservationLayout::Pilot(_) | ObservationLayout::PilotFor(_));
    (blind && !sensors.is_empty()).then(|| Cause {
        sureness: 0.96,
        says: "the policy does not see what its sensors measure: the observation `pilot` leaves them out"
            .to_owned(),
        key: "scenario.observation".to_owned(),
        change: "take `pilot_measured` or `body` for",
    })
}

fn nothing_on_the_way(evidence: &Evidence<'_>) -> Option<Cause> {
    let dense = evidence.scenario().rewards.iter().any(|term| {
        term.weight() != 0.0 && !INDIFFERENT.contains(&term.name()) && !AT_THE_END.contains(&term.name())
    });
    let never = evidence.updates.iter().all(|row| row.success_rate.unwrap_or(0.0) < 0.01);
    (!dense && never && evidence.pays_for(&AT_THE_END)).then(|| Cause {
        sureness: 0.95,
        says: "only the end of the way is paid, and training never came there".to_owned(),
        key: "scenario.rewards".to_owned(),
        change: "let starts be on the way, too, or add `progress` or `advance` to",
    })
}

fn lost_at_the_start(evidence: &Evidence<'_>) -> Option<Cause> {
    let pilots = [evidence.policy, evidence.scripted, evidence.nothing];
    let at_once = pilots.iter().all(|row| share(row, lost) > 0.9 && row.length_secs < SOON_SECS);
    let (ending, _) = evidence.policy.endings.iter().max_by_key(|(_, count)| *count)?;
    at_once.then(|| Cause {
        sureness: 0.98,
        says: format!(
            "whoever flies ends after {:.0} control periods, by {}",
            evidence.policy.steps,
            ending.name()
        ),
        key: "scenario.start".to_owned(),
        change: "look at `scenario.terminations` and at",
    })
}

fn steps_too_long(evidence: &Evidence<'_>) -> Option<Cause> {
    evidence.ppo()?;
    let (kl, clipped) = (evidence.median(|row| row.approx_kl)?, evidence.median(|row| row.clip_fraction)?);
    (kl > 0.08 || clipped > 0.4).then(|| Cause {
        sureness: 0.9,
        says: format!(
            "an update changes the policy too much (KL {kl:.2}, {:.0} % of the samples clipped)",
            100.0 * clipped
        ),
        key: "training.learning_rate".to_owned(),
        change: "lower `training.epochs` or",
    })
}

fn steps_too_short(evidence: &Evidence<'_>) -> Option<Cause> {
    let ppo = evidence.ppo()?;
    if ppo.epochs == 1 && ppo.minibatch >= ppo.environments * ppo.steps_per_rollout {
        return None; // the divergence is measured before the only step, where it is none
    }
    let (kl, clipped) = (evidence.median(|row| row.approx_kl)?, evidence.median(|row| row.clip_fraction)?);
    if kl > 3e-4 || clipped > 0.002 {
        return None;
    }
    let (length, limit) = (evidence.median(|row| row.gradient_norm)?, f64::from(ppo.gradient_norm_limit));
    let [key, change] = if length > 30.0 * limit {
        ["training.gradient_norm_limit", "raise"]
    } else if ppo.minibatch * 4 > ppo.environments * ppo.steps_per_rollout {
        ["training.minibatch", "raise `training.learning_rate` or lower"]
    } else {
        ["training.learning_rate", "raise"]
    };
    Some(Cause {
        sureness: 0.92,
        says: format!("an update hardly changes the policy (KL {kl:.1e})"),
        key: key.to_owned(),
        change,
    })
}

fn explores_too_little(evidence: &Evidence<'_>) -> Option<Cause> {
    let ppo = evidence.ppo()?;
    if ppo.initial_log_std < -2.2 {
        return Some(Cause {
            sureness: 0.88,
            says: format!(
                "it began with a standard deviation of {:.2} of the actions, and tried hardly anything",
                ppo.initial_log_std.exp()
            ),
            key: "training.initial_log_std".to_owned(),
            change: "raise",
        });
    }
    let early = evidence.mean(|row| row.log_std, [0.3, 0.5])?;
    (early < -2.4 && evidence.policy.success_rate < 0.5).then(|| Cause {
        sureness: 0.75,
        says: format!("exploration was over before half of the training (standard deviation {:.2})", early.exp()),
        key: "training.entropy_weight".to_owned(),
        change: "raise",
    })
}

fn explores_too_much(evidence: &Evidence<'_>) -> Option<Cause> {
    let ppo = evidence.ppo()?;
    let late = evidence.mean(|row| row.log_std, [0.9, 1.0])?;
    let grew = late > f64::from(ppo.initial_log_std) + 0.3 && late > -0.3;
    let [key, change] = if ppo.entropy_weight > 0.0 {
        ["training.entropy_weight", "lower"]
    } else {
        ["training.highest_log_std", "lower"]
    };
    grew.then(|| Cause {
        sureness: 0.85,
        says: format!("exploration grew while it learned (standard deviation {:.2} of the actions)", late.exp()),
        key: key.to_owned(),
        change,
    })
}

fn shortsighted(evidence: &Evidence<'_>) -> Option<Cause> {
    let ppo = evidence.ppo()?;
    let periods = 1.0 / (1.0 - f64::from(ppo.discount)).max(1e-9);
    let secs = periods * f64::from(evidence.scenario().physics.control_secs());
    (periods < 12.0).then(|| Cause {
        sureness: 0.87,
        says: format!("it looks {secs:.2} s ahead, where a flight takes {:.1} s", evidence.scripted.length_secs),
        key: "training.discount".to_owned(),
        change: "raise",
    })
}

/// The scripted pilot succeeds more often and is paid less: what the policy gets more of than it is to blame.
fn paid_for_something_else(evidence: &Evidence<'_>) -> Option<Cause> {
    let (policy, scripted) = (evidence.policy, evidence.scripted);
    let better = scripted.success_rate > policy.success_rate + 0.3;
    if !better || policy.episode_return < scripted.episode_return {
        return None;
    }
    let more = policy.terms.iter().zip(&scripted.terms).map(|(mine, its)| mine - its);
    let (index, _) = more.enumerate().max_by(|(_, one), (_, other)| one.total_cmp(other))?;
    let key = evidence.reward_key(index);
    Some(Cause {
        sureness: 0.97,
        says: format!(
            "the rewards ask for something else: failing pays {:.1}, the scripted pilot's success {:.1}, above all by `{}`",
            policy.episode_return,
            scripted.episode_return,
            evidence.scenario().rewards[index].name()
        ),
        key,
        change: "change",
    })
}

/// It ends sooner than who does nothing, and is paid more for that.
fn crashing_pays(evidence: &Evidence<'_>) -> Option<Cause> {
    let (policy, other) = (evidence.policy, evidence.nothing);
    let sooner = share(policy, lost) > 0.7 && policy.steps < 0.8 * other.steps;
    if !sooner || policy.episode_return < other.episode_return {
        return None;
    }
    let rewards = evidence.scenario().rewards.iter();
    let costs =
        policy.terms.iter().zip(rewards).map(|(paid, term)| if term.name() == "failure" { 0.0 } else { *paid });
    let (index, cost) = costs.enumerate().min_by(|(_, one), (_, other)| one.total_cmp(other))?;
    (cost < 0.0).then(|| Cause {
        sureness: 0.86,
        says: format!(
            "crashing early pays more than flying: {:.1} s of flight cost {:.1} by `{}`",
            policy.length_secs,
            -cost,
            evidence.scenario().rewards[index].name()
        ),
        key: evidence.reward_key(index),
        change: "bring nearer to zero",
    })
}

/// It waits, where to try costs more than to arrive brings.
fn failing_costs_too_much(evidence: &Evidence<'_>) -> Option<Cause> {
    let (index, failure) =
        evidence.scenario().rewards.iter().enumerate().find(|(_, term)| term.name() == "failure")?;
    let waits = share(evidence.policy, out_of_time) > 0.7 && evidence.policy.success_rate < 0.1;
    let dear = -failure.weight() > 0.5 * evidence.scripted.episode_return.max(0.0);
    (waits && dear && evidence.scripted.success_rate > 0.5).then(|| Cause {
        sureness: 0.84,
        says: format!(
            "it waits until the time is over: a failure costs {:.1}, the scripted pilot's success pays {:.1}",
            -failure.weight(),
            evidence.scripted.episode_return
        ),
        key: evidence.reward_key(index),
        change: "bring nearer to zero",
    })
}

fn position_scale(evidence: &Evidence<'_>) -> Option<Cause> {
    let (name, scale) = match &evidence.scenario().observation {
        ObservationLayout::Pilot(layout) => ("pilot", layout.position_scale_m),
        ObservationLayout::PilotMeasured(layout) => ("pilot_measured", layout.scales.position_scale_m),
        ObservationLayout::PilotFor(layout) => ("pilot", layout.scales.position_scale_m),
        ObservationLayout::Body(layout) => ("body", layout.scales.position_scale_m),
        ObservationLayout::Reference(_)
        | ObservationLayout::Kinematic(_)
        | ObservationLayout::Measured(_)
        | ObservationLayout::Px4Neural(_) => return None,
    };
    let distance = farthest_start_m(evidence.experiment);
    let ratio = f64::from(scale) / distance.max(0.01);
    (!(0.03..20.0).contains(&ratio)).then(|| Cause {
        sureness: 0.89,
        says: format!(
            "the goal is up to {distance:.1} m away at the start, and {scale} m read as one: {}",
            if ratio < 1.0 { "only its direction is seen" } else { "it is hardly seen" }
        ),
        key: format!("scenario.observation.{name}.position_scale_m"),
        change: "change",
    })
}

/// Of some starts, the one farthest from its goal \[m\].
fn farthest_start_m(experiment: &Experiment) -> f64 {
    let simulation = Simulation::<8>::new(&experiment.scenario, experiment.seed, 0, STARTS);
    let distance = |row| (simulation.state(row).position - simulation.goal(row)).norm();
    (0..simulation.rows()).map(distance).fold(0.0, f32::max).into()
}

fn no_time(evidence: &Evidence<'_>) -> Option<Cause> {
    let pilots = [evidence.policy, evidence.scripted];
    let over = pilots.iter().all(|row| share(row, out_of_time) > 0.8 && row.success_rate < 0.2);
    over.then(|| Cause {
        sureness: 0.8,
        says: format!("the scripted pilot, too, runs out of time after {:.1} s", evidence.scripted.length_secs),
        key: "scenario.episode_secs".to_owned(),
        change: "look at `scenario.success` and raise",
    })
}

fn few_updates(evidence: &Evidence<'_>) -> Option<Cause> {
    let updates = evidence.updates.len();
    (updates < FEW_UPDATES).then(|| Cause {
        sureness: 0.83,
        says: format!("the training ended after {updates} updates"),
        key: total_steps_key(evidence),
        change: "raise",
    })
}

fn still_learning(evidence: &Evidence<'_>) -> Option<Cause> {
    let figure = |row: &UpdateRow| row.episode_return;
    let [begin, before, end] = [[0.0, 0.1], [0.6, 0.75], [0.85, 1.0]].map(|part| evidence.mean(figure, part));
    let (begin, before, end) = (begin?, before?, end?);
    let rise = (end - before) / (end - begin).abs().max(1e-9);
    let felt = 0.02 * end.abs().max(before.abs());
    (end > before + felt && rise > 0.05).then(|| Cause {
        sureness: if rise > 0.12 { 0.82 } else { 0.6 },
        says: format!("the return was still rising at the end, from {before:.1} to {end:.1}"),
        key: total_steps_key(evidence),
        change: "raise",
    })
}

fn total_steps_key(evidence: &Evidence<'_>) -> String {
    let key = if evidence.ppo().is_some() { "training.total_steps" } else { "training.analytic.total_steps" };
    key.to_owned()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::experiment_config::{load_to_train, schema};

    fn flown(pilot: &str, success_rate: f64, episode_return: f64, ending: Ending) -> Evaluation {
        Evaluation {
            pilot: pilot.to_owned(),
            episodes: 10,
            success_rate,
            success_interval: [0.0, 1.0],
            episode_return,
            return_interval: [episode_return; 2],
            length_secs: 10.0,
            steps: 500.0,
            endings: vec![(ending, 10)],
            hits: Vec::new(),
            terms: vec![episode_return, 0.0, 0.0],
        }
    }

    #[test]
    fn who_waits_because_failing_is_dear_is_told_so() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/aviaries/incremental-cross-1.yaml");
        let rewards = |failure| {
            format!(
                "scenario.rewards=[advance: {{weight: 2}}, success: {{weight: 10}}, failure: {{weight: {failure}}}]"
            )
        };
        let causes = |failure| {
            let experiment = load_to_train(&path, &[rewards(failure)]).unwrap();
            let rows = vec![
                flown("fixed16", 0.0, 3.0, Ending::TimeLimit),
                flown(Flyer::Scripted.name(), 1.0, 20.0, Ending::Success),
                flown(Flyer::Nothing.name(), 0.0, 0.0, Ending::TimeLimit),
            ];
            let report = EvaluationReport { name: "cross".to_owned(), seed: 0, rows, worlds: None };
            likely_causes(&experiment, &[UpdateRow::default(); 100], &report)
        };
        let dear: Vec<String> = causes(-200).into_iter().map(|cause| cause.key).collect();
        assert_eq!(dear, ["scenario.rewards[2].failure.weight"]);
        assert_eq!(causes(-2), []);
    }

    #[test]
    fn one_step_for_each_rollout_is_not_called_too_short() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/examples/hover-by-a2c.yaml");
        let figures = UpdateRow { approx_kl: Some(0.0), clip_fraction: Some(0.0), ..UpdateRow::default() };
        let still = UpdateRow { gradient_norm: Some(1.0), ..figures };
        let keys = |overrides: &[&str]| -> Vec<String> {
            let overrides: Vec<String> = overrides.iter().map(ToString::to_string).collect();
            let experiment = load_to_train(&path, &overrides).unwrap();
            let pilots = ["fixed16", Flyer::Scripted.name(), Flyer::Nothing.name()];
            let rows = pilots.map(|pilot| flown(pilot, 0.0, 1.0, Ending::Collision)).to_vec();
            let report = EvaluationReport { name: "hover".to_owned(), seed: 0, rows, worlds: None };
            likely_causes(&experiment, &[still; 100], &report).into_iter().map(|cause| cause.key).collect()
        };
        assert_eq!(keys(&[]), [""; 0]);
        assert_eq!(keys(&["training.minibatch=1024"]), ["training.learning_rate"]);
    }

    #[test]
    fn rewards_that_are_named_here_exist() {
        let schema = schema();
        for name in INDIFFERENT.iter().chain(&AT_THE_END) {
            assert!(schema.contains(&format!("\"{name}\"")), "{name}");
        }
    }
}
