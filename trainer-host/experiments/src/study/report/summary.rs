//! Every number of the report, once.

use rayon::prelude::*;

use super::score::{Score, area_under_curve};
use crate::statistics::bootstrap::{Estimate, REPETITIONS, Resamples};
use crate::statistics::sample::Sample;
use crate::study::data::{Cell, MethodKind, Run, StudyData};

/// What the resamples follow from: a report of the same rows is the same to the bit.
const SEED: u64 = 2021;

/// Repetitions of statistics that visit every value, of comparisons and of bands.
const COSTLY_REPETITIONS: usize = 5_000;

/// Normalised scores are cut at this much: an expert's equal has 1.
const NORMALISED_LIMIT: f64 = 1.2;

/// The study in estimates.
pub(super) struct Summary {
    /// Draws of seeds for the tables.
    pub(super) resamples: Resamples,
    /// Fewer draws, for what costs more.
    pub(super) few: Resamples,
    /// One per method, as in the manifest.
    pub(super) methods: Vec<MethodSummary>,
    /// What the columns of the matrices are.
    pub(super) columns: Columns,
}

/// What a method has achieved, over all seeds and orders.
pub(super) struct MethodSummary {
    pub(super) runs: usize,
    pub(super) mean: Option<Estimate>,
    pub(super) interquartile_mean: Option<Estimate>,
    pub(super) worst: Option<Estimate>,
    pub(super) shortfall: Option<Estimate>,
    pub(super) episode_return: Option<Estimate>,
    pub(super) normalised: Option<Estimate>,
    pub(super) forgetting: Option<Estimate>,
    pub(super) backward_transfer: Option<Estimate>,
    pub(super) zero_shot: Option<Estimate>,
    pub(super) forward_transfer: Option<Estimate>,
    pub(super) plasticity: Option<Estimate>,
    pub(super) of_joint: Option<Estimate>,
    pub(super) of_experts: Option<Estimate>,
    /// By task, at the end.
    pub(super) tasks: Vec<TaskSummary>,
    /// Success in the tasks trained so far, after the first, the second and so on; empty unless it is a sequence.
    pub(super) so_far: Vec<Option<Estimate>>,
    /// `[stage][column]`, success.
    pub(super) matrix: Vec<Vec<Option<Estimate>>>,
}

/// A task at the end.
pub(super) struct TaskSummary {
    pub(super) success: Option<Estimate>,
    pub(super) episode_return: Option<Estimate>,
    pub(super) length_secs: Option<Estimate>,
}

/// Columns of the matrices.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Columns {
    /// One order: its tasks.
    Tasks(Vec<usize>),
    /// Several orders: the first task of each, the second and so on.
    Positions(usize),
}

impl Summary {
    pub(super) fn new(data: &StudyData) -> Self {
        let resamples = Resamples::new(&[data.manifest.seeds.len()], REPETITIONS, SEED);
        let few = resamples.first(COSTLY_REPETITIONS);
        let columns = Columns::of(data);
        let estimator = Estimator { data, resamples: &resamples, few: &few, columns: &columns };
        let methods = (0..data.manifest.methods.len()).into_par_iter().map(|method| estimator.method(method));
        Self { methods: methods.collect(), columns, few, resamples: resamples.clone() }
    }
}

impl Columns {
    fn of(data: &StudyData) -> Self {
        match &data.manifest.orders[..] {
            [order] => Self::Tasks(order.clone()),
            orders => Self::Positions(orders.iter().map(Vec::len).max().unwrap_or(0)),
        }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Self::Tasks(tasks) => tasks.len(),
            Self::Positions(count) => *count,
        }
    }

    /// Heading of a column.
    pub(super) fn name(&self, data: &StudyData, column: usize) -> String {
        match self {
            Self::Tasks(tasks) => data.manifest.tasks[tasks[column]].name.clone(),
            Self::Positions(_) => format!("task {}", column + 1),
        }
    }

    /// The task that a run has there; none in a shorter order.
    fn task(&self, data: &StudyData, run: &Run, column: usize) -> Option<usize> {
        match self {
            Self::Tasks(tasks) => tasks.get(column).copied(),
            Self::Positions(_) => data.order(run).get(column).copied(),
        }
    }
}

/// A statistic of one run.
type OfRun<'a> = &'a dyn Fn(Score<'_>) -> Option<f64>;

struct Estimator<'a> {
    data: &'a StudyData,
    resamples: &'a Resamples,
    few: &'a Resamples,
    columns: &'a Columns,
}

impl Estimator<'_> {
    fn method(&self, method: usize) -> MethodSummary {
        let finals = final_success(self.data, method);
        let units = finals.units();
        let threshold = self.data.manifest.success_threshold;
        MethodSummary {
            runs: self.data.runs_of(method).count(),
            mean: self.resamples.estimate(units, |counts| finals.mean(counts)),
            interquartile_mean: self.resamples.estimate(units, |counts| finals.interquartile_mean(counts)),
            shortfall: self.resamples.estimate(units, |counts| finals.optimality_gap(counts, threshold)),
            worst: self.mean_of_runs(method, &|score| score.worst()),
            episode_return: self
                .mean_of_runs(method, &|score| mean(score.finals().iter().map(|(_, cell)| cell.episode_return))),
            normalised: self.normalised(method),
            forgetting: self.mean_of_runs(method, &|score| score.forgetting()),
            backward_transfer: self.mean_of_runs(method, &|score| score.backward_transfer()),
            zero_shot: self.mean_of_runs(method, &|score| score.zero_shot()),
            forward_transfer: self.forward_transfer(method),
            plasticity: self.mean_of_runs(method, &|score| score.plasticity()),
            of_joint: self.ratio(method, MethodKind::Joint),
            of_experts: self.ratio(method, MethodKind::Experts),
            tasks: (0..self.data.manifest.tasks.len()).map(|task| self.task(method, task)).collect(),
            so_far: self.so_far(method),
            matrix: self.matrix(method),
        }
    }

    fn mean_of_runs(&self, method: usize, value: OfRun<'_>) -> Option<Estimate> {
        let runs = self.data.runs_of(method);
        let sample = Sample::new(runs.filter_map(|run| Some((run.seed, value(Score::new(self.data, run))?))));
        self.resamples.estimate(sample.units(), |counts| sample.mean(counts))
    }

    fn task(&self, method: usize, task: usize) -> TaskSummary {
        let of = |value: fn(&Cell) -> f64| {
            let runs = self.data.runs_of(method);
            let values = runs.filter_map(|run| Some((run.seed, value(self.data.final_cell(run, task)?))));
            let sample = Sample::new(values);
            self.resamples.estimate(sample.units(), |counts| sample.mean(counts))
        };
        TaskSummary {
            success: of(|cell| cell.success),
            episode_return: of(|cell| cell.episode_return),
            length_secs: of(|cell| cell.length_secs),
        }
    }

    fn so_far(&self, method: usize) -> Vec<Option<Estimate>> {
        let stages = match self.data.manifest.methods[method].kind {
            MethodKind::Sequential => self.columns.len(),
            MethodKind::Joint | MethodKind::Averaged | MethodKind::Experts => 0,
        };
        (1..=stages).map(|stage| self.mean_of_runs(method, &|score| score.so_far(stage))).collect()
    }

    fn matrix(&self, method: usize) -> Vec<Vec<Option<Estimate>>> {
        let kind = self.data.manifest.methods[method].kind;
        let cell = |stage: usize, column: usize| {
            self.mean_of_runs(method, &|score| {
                let task = self.columns.task(self.data, score.run, column)?;
                score.run.cell(stage, task).map(|cell| cell.success)
            })
        };
        let row = |stage: usize| (0..self.columns.len()).map(|column| cell(stage, column)).collect();
        (0..=kind.stages(self.columns.len())).map(row).collect()
    }

    /// Mean final success over that of the first method of a kind; `None` for that method itself.
    fn ratio(&self, method: usize, kind: MethodKind) -> Option<Estimate> {
        let other = self.data.manifest.methods.iter().position(|method| method.kind == kind)?;
        let (mine, theirs) = (final_success(self.data, method), final_success(self.data, other));
        let ratio = |counts: &[u16]| {
            let reference = theirs.mean(counts).filter(|mean| *mean > 0.0)?;
            Some(mine.mean(counts)? / reference)
        };
        let units = mine.units().min(theirs.units());
        if other == method { None } else { self.resamples.estimate(units, ratio) }
    }

    /// Final returns between the random pilot's and the experts', cut to [0, 1.2], averaged over tasks.
    fn normalised(&self, method: usize) -> Option<Estimate> {
        let tasks = self.data.manifest.tasks.len();
        let ranges: Vec<Option<[f64; 2]>> = (0..tasks).map(|task| normalisation(self.data, task)).collect();
        self.mean_of_runs(method, &|score| {
            let finals = score.finals().into_iter();
            let scores: Vec<f64> = finals
                .map(|(task, cell)| ranges[task].map(|[low, high]| (cell.episode_return - low) / (high - low)))
                .collect::<Option<_>>()?;
            mean(scores.into_iter().map(|score| score.clamp(0.0, NORMALISED_LIMIT)))
        })
    }

    /// Area under the learning curves above the experts', of what is left above the experts'.
    fn forward_transfer(&self, method: usize) -> Option<Estimate> {
        let methods = &self.data.manifest.methods;
        let experts = methods.iter().position(|method| method.kind == MethodKind::Experts)?;
        if methods[method].kind != MethodKind::Sequential {
            return None;
        }
        let areas = |method| -> Vec<Sample> {
            (0..self.data.manifest.tasks.len()).map(|task| areas(self.data, method, task)).collect()
        };
        let (mine, theirs) = (areas(method), areas(experts));
        let pairs: Vec<(&Sample, &Sample)> =
            mine.iter().zip(&theirs).filter(|(mine, theirs)| !mine.is_empty() && !theirs.is_empty()).collect();
        let units = pairs.iter().map(|(mine, theirs)| mine.units().min(theirs.units())).min()?;
        let transfer = |counts: &[u16], (mine, theirs): &(&Sample, &Sample)| {
            let reference = theirs.mean(counts).filter(|area| *area < 1.0 - 1e-9)?;
            Some((mine.mean(counts)? - reference) / (1.0 - reference))
        };
        self.few.estimate(units, |counts| {
            let values: Option<Vec<f64>> = pairs.iter().map(|pair| transfer(counts, pair)).collect();
            mean(values?.into_iter())
        })
    }
}

/// Final success of every run and task of a method.
pub(super) fn final_success(data: &StudyData, method: usize) -> Sample {
    let of_run = |run: &Run| {
        let finals = Score::new(data, run).finals();
        let seed = run.seed;
        finals.into_iter().map(move |(_, cell)| (seed, cell.success))
    };
    Sample::new(data.runs_of(method).flat_map(of_run))
}

/// Final success of every run of a method in one task.
pub(super) fn final_success_in(data: &StudyData, method: usize, task: usize) -> Sample {
    let runs = data.runs_of(method);
    Sample::new(runs.filter_map(|run| Some((run.seed, data.final_cell(run, task)?.success))))
}

/// Areas under the learning curves of a task.
fn areas(data: &StudyData, method: usize, task: usize) -> Sample {
    let budget = data.manifest.steps_per_stage;
    Sample::new(data.runs_of(method).filter_map(|run| {
        let stage = 1 + data.order(run).iter().position(|trained| *trained == task)?;
        Some((run.seed, area_under_curve(run, stage, budget)?))
    }))
}

/// The random pilot's return and the experts' interquartile mean in a task; none unless the experts are better.
fn normalisation(data: &StudyData, task: usize) -> Option<[f64; 2]> {
    let low = data.manifest.baseline(task, "random")?.episode_return;
    let experts = data.manifest.methods.iter().position(|method| method.kind == MethodKind::Experts)?;
    let finals = data.runs_of(experts).filter_map(|run| Some((0, data.final_cell(run, task)?.episode_return)));
    let high = Sample::new(finals).interquartile_mean(&[1])?;
    (high > low).then_some([low, high])
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
