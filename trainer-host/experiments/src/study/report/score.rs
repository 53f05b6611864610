//! What one run is worth: numbers of its own, before anything is averaged over seeds.

use crate::study::data::{Cell, MethodKind, Run, StudyData};
use crate::study::rows::CurveRow;

/// A finished run within its study.
#[derive(Clone, Copy)]
pub(super) struct Score<'a> {
    data: &'a StudyData,
    pub(super) run: &'a Run,
}

impl<'a> Score<'a> {
    pub(super) fn new(data: &'a StudyData, run: &'a Run) -> Self {
        Self { data, run }
    }

    /// Each task with the flights at the end.
    pub(super) fn finals(self) -> Vec<(usize, Cell)> {
        let tasks = self.data.order(self.run).iter();
        tasks.filter_map(|&task| Some((task, *self.data.final_cell(self.run, task)?))).collect()
    }

    /// The lowest final success of its tasks.
    pub(super) fn worst(self) -> Option<f64> {
        self.finals().iter().map(|(_, cell)| cell.success).min_by(f64::total_cmp)
    }

    /// Mean of the best success that each task but the last ever had, less that at the end.
    pub(super) fn forgetting(self) -> Option<f64> {
        let last = self.last_stage()?;
        self.mean_over(0..last - 1, |task, _| {
            let best = (1..=last).filter_map(|stage| self.success(stage, task)).max_by(f64::total_cmp)?;
            Some(best - self.success(last, task)?)
        })
    }

    /// Mean of the success at the end, less that right after the task was trained, of all tasks but the last.
    pub(super) fn backward_transfer(self) -> Option<f64> {
        let last = self.last_stage()?;
        self.mean_over(0..last - 1, |task, trained| Some(self.success(last, task)? - self.success(trained, task)?))
    }

    /// Mean of the success right before a task is trained, less that of the untrained policy, of all tasks but the
    /// first.
    pub(super) fn zero_shot(self) -> Option<f64> {
        let last = self.last_stage()?;
        self.mean_over(1..last, |task, trained| Some(self.success(trained - 1, task)? - self.success(0, task)?))
    }

    /// Mean of the success right after each task was trained.
    pub(super) fn plasticity(self) -> Option<f64> {
        self.mean_over(0..self.last_stage()?, |task, trained| self.success(trained, task))
    }

    /// Mean success after a stage of a sequence in the tasks trained until then.
    pub(super) fn so_far(self, stage: usize) -> Option<f64> {
        let learned = self.last_stage().filter(|last| stage <= *last).map(|_| stage)?;
        self.mean_over(0..learned, |task, _| self.success(stage, task))
    }

    /// Stages of a sequence; none for other kinds.
    fn last_stage(self) -> Option<usize> {
        let sequential = self.data.manifest.methods[self.run.method].kind == MethodKind::Sequential;
        sequential.then(|| self.data.order(self.run).len())
    }

    fn success(self, stage: usize, task: usize) -> Option<f64> {
        self.run.cell(stage, task).map(|cell| cell.success)
    }

    /// Mean over positions of the order of a function of the task and of the stage that trains it; `None` when it is
    /// missing for one of them, or there is none.
    fn mean_over(
        self,
        positions: std::ops::Range<usize>,
        value: impl Fn(usize, usize) -> Option<f64>,
    ) -> Option<f64> {
        let order = self.data.order(self.run);
        let values: Vec<f64> =
            positions.map(|position| value(order[position], position + 1)).collect::<Option<_>>()?;
        (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
    }
}

/// Share of the test flights of a point that succeeded.
pub(super) fn success(point: &CurveRow) -> f64 {
    f64::from(point.success_rate)
}

/// Mean return of the test flights of a point.
pub(super) fn episode_return(point: &CurveRow) -> f64 {
    f64::from(point.episode_return)
}

/// A quantity after `steps` of a stage, between the points where flights tried it; flat before the first and after the
/// last.
///
/// # Panics
/// When there is no point.
pub(super) fn after(points: &[&CurveRow], steps: f64, quantity: fn(&CurveRow) -> f64) -> f64 {
    let next = points.partition_point(|point| (point.steps as f64) < steps);
    let at = |index: usize| (points[index].steps as f64, quantity(points[index]));
    match next {
        0 => at(0).1,
        past if past == points.len() => at(past - 1).1,
        inside => {
            let ((from, low), (to, high)) = (at(inside - 1), at(inside));
            low + (high - low) * (steps - from) / (to - from)
        }
    }
}

/// Mean success over a stage of `budget` steps: the area under its curve. `None` without a curve.
pub(super) fn area_under_curve(run: &Run, stage: usize, budget: u64) -> Option<f64> {
    let points: Vec<&CurveRow> = run.curve_of(stage).collect();
    let end = points.last()?.steps.max(budget) as f64;
    let mut corners = vec![0.0];
    corners.extend(points.iter().map(|point| point.steps as f64));
    corners.push(end);
    let trapezoid = |sides: &[f64]| {
        (sides[1] - sides[0]) * 0.5 * (after(&points, sides[0], success) + after(&points, sides[1], success))
    };
    (end > 0.0).then(|| corners.windows(2).map(trapezoid).sum::<f64>() / end)
}
