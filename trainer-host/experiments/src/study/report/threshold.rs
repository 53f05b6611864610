//! How soon a task is learned: steps of training until the success rate first reaches the threshold.

use super::summary::Summary;
use crate::statistics::bootstrap::Estimate;
use crate::statistics::correction::holm;
use crate::statistics::survival::{Duration, Durations, LogRank, log_rank};
use crate::study::data::{MethodKind, Run, StudyData};
use crate::study::rows::CurveRow;

/// The steps that one method needed.
pub(super) struct Learning {
    pub(super) method: usize,
    /// By task.
    pub(super) tasks: Vec<Durations>,
    pub(super) overall: LearningSummary,
    pub(super) by_task: Vec<LearningSummary>,
    /// By task: its restricted mean as a multiple of that of the first method with curves.
    pub(super) multiples: Vec<Option<Estimate>>,
    /// Against the first method that has curves, task by task; none for that method itself.
    pub(super) test: Option<LogRank>,
    /// Its p-value, corrected for the number of methods (Holm).
    pub(super) corrected: Option<f64>,
}

/// Steps until the threshold.
pub(super) struct LearningSummary {
    /// Stages watched.
    pub(super) stages: usize,
    /// Share of them that reached the threshold.
    pub(super) reached: Option<Estimate>,
    /// Half have reached it by then.
    pub(super) median: Option<f64>,
    /// Mean steps within the budget; over all tasks the mean of theirs.
    pub(super) restricted_mean: Option<Estimate>,
}

/// What a sequence pays for a task together with all that it learned before.
pub(super) struct Totals {
    pub(super) method: usize,
    /// By task: mean steps within the budgets, summed over the stages until it.
    pub(super) steps: Vec<Option<Estimate>>,
    /// Methods that learn each task alone, with their means as multiples of those sums, by task.
    pub(super) alone: Vec<(usize, Vec<Option<Estimate>>)>,
}

/// The methods that learn task by task and have curves, in the order of the manifest.
pub(super) fn learnings(data: &StudyData, summary: &Summary) -> Vec<Learning> {
    let by_task = |method: &usize| !data.manifest.methods[*method].kind.learns_at_once();
    let methods = (0..data.manifest.methods.len()).filter(by_task);
    let mut learnings: Vec<Learning> = methods.filter_map(|method| learning(data, summary, method)).collect();
    let Some((first, others)) = learnings.split_first_mut() else { return learnings };
    let budget = data.manifest.steps_per_stage as f64;
    for other in others.iter_mut() {
        other.test = log_rank(other.tasks.iter().zip(&first.tasks));
        let pairs = other.tasks.iter().zip(&first.tasks);
        other.multiples = pairs.map(|(mine, theirs)| multiple(summary, &[mine], &[theirs], budget)).collect();
    }
    let mut tested: Vec<&mut Learning> = others.iter_mut().filter(|other| other.test.is_some()).collect();
    let p_values: Vec<f64> = tested.iter().filter_map(|other| Some(other.test?.p)).collect();
    for (other, corrected) in tested.iter_mut().zip(holm(&p_values)) {
        other.corrected = Some(corrected);
    }
    learnings
}

/// Whether any stage reached the threshold.
pub(super) fn anybody_got_there(learnings: &[Learning]) -> bool {
    learnings.iter().any(|learning| learning.overall.reached.is_some_and(|share| share.value > 0.0))
}

/// Of the first sequence that has curves; none where orders differ, for then the tasks before a task do.
pub(super) fn totals(data: &StudyData, summary: &Summary, learnings: &[Learning]) -> Option<Totals> {
    let [order] = &data.manifest.orders[..] else { return None };
    let kind = |learning: &Learning| data.manifest.methods[learning.method].kind;
    let sequence = learnings.iter().find(|learning| kind(learning) == MethodKind::Sequential)?;
    let budget = data.manifest.steps_per_stage as f64;
    let tasks = 0..data.manifest.tasks.len();
    let until = |task: usize| -> Vec<&Durations> {
        let place = order.iter().position(|trained| *trained == task);
        order.iter().take(place.map_or(0, |place| place + 1)).map(|task| &sequence.tasks[*task]).collect()
    };
    let steps = tasks.clone().map(|task| {
        let stages = until(task);
        let units = stages.iter().map(|stage| stage.units()).min()?;
        summary.few.estimate(units, |counts| sum(&stages, counts, budget))
    });
    let multiples = |learning: &Learning| {
        let of_task = |task: usize| multiple(summary, &[&learning.tasks[task]], &until(task), budget);
        (learning.method, tasks.clone().map(of_task).collect())
    };
    let experts = learnings.iter().filter(|learning| kind(learning) == MethodKind::Experts);
    Some(Totals { method: sequence.method, steps: steps.collect(), alone: experts.map(multiples).collect() })
}

fn learning(data: &StudyData, summary: &Summary, method: usize) -> Option<Learning> {
    let tasks: Vec<Durations> = (0..data.manifest.tasks.len()).map(|task| durations(data, method, task)).collect();
    let watched: Vec<&Durations> = tasks.iter().filter(|durations| !durations.is_empty()).collect();
    let budget = data.manifest.steps_per_stage as f64;
    let by_task = tasks.iter().map(|durations| learning_summary(summary, &[durations], budget)).collect();
    let overall = learning_summary(summary, &watched, budget);
    let any = !watched.is_empty();
    any.then_some(Learning { method, overall, by_task, tasks, multiples: Vec::new(), test: None, corrected: None })
}

fn learning_summary(summary: &Summary, tasks: &[&Durations], budget: f64) -> LearningSummary {
    let units = tasks.iter().map(|durations| durations.units()).min().unwrap_or(0);
    let mean = |values: Option<Vec<f64>>| -> Option<f64> {
        values.filter(|values| !values.is_empty()).map(|values| values.iter().sum::<f64>() / values.len() as f64)
    };
    let restricted_mean = |counts: &[u16]| {
        mean(tasks.iter().map(|task| Some(task.curve(counts)?.restricted_mean(budget))).collect())
    };
    let reached = |counts: &[u16]| mean(tasks.iter().map(|task| task.share_reached(counts)).collect());
    let together = Durations::merged(tasks);
    LearningSummary {
        stages: together.len(),
        reached: summary.few.estimate(units, reached),
        median: together.curve(&summary.few.once()).and_then(|curve| curve.median()),
        restricted_mean: summary.few.estimate(units, restricted_mean),
    }
}

/// How many times the steps of other stages are needed, all counted within the budget.
pub(super) fn multiple(
    summary: &Summary,
    mine: &[&Durations],
    theirs: &[&Durations],
    budget: f64,
) -> Option<Estimate> {
    let units = mine.iter().chain(theirs).map(|stage| stage.units()).min()?;
    summary.few.estimate(units, |counts| {
        let reference = sum(theirs, counts, budget)?;
        (reference > 0.0).then_some(sum(mine, counts, budget)? / reference)
    })
}

/// Mean steps within the budget of each of the stages, summed.
fn sum(stages: &[&Durations], counts: &[u16], budget: f64) -> Option<f64> {
    stages.iter().map(|stage| Some(stage.curve(counts)?.restricted_mean(budget))).sum()
}

fn durations(data: &StudyData, method: usize, task: usize) -> Durations {
    let threshold = data.manifest.success_threshold;
    Durations::new(data.runs_of(method).filter_map(|run| {
        let stage = 1 + data.order(run).iter().position(|trained| *trained == task)?;
        Some((run.seed, duration(run, stage, threshold)?))
    }))
}

/// `None` when the stage has no curve.
fn duration(run: &Run, stage: usize, threshold: f64) -> Option<Duration> {
    let last = run.curve_of(stage).last()?;
    // A rate of 0.8 is a little more or less than 0.8 in single precision.
    let there = |point: &&CurveRow| f64::from(point.success_rate) >= threshold - 1e-6;
    let first = run.curve_of(stage).find(there);
    Some(first.map_or(Duration::Censored(last.steps as f64), |point| Duration::Reached(point.steps as f64)))
}
