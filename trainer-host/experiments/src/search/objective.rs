//! What a trial is worth: one number, the greater the better, from the runs of its study.

use crate::study::Study;
use crate::study::data::{Cell, Run, StudyData};

/// What is to be as great as possible, as a mean over all runs of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objective {
    /// Success rate after the last stage, mean over the tasks of the order.
    FinalSuccess,
    /// Return after the last stage, mean over the tasks of the order.
    FinalReturn,
    /// Area under the curve of the success rate while it trains, as a share of the budget, mean over stages.
    Area,
}

impl Objective {
    /// Of a study whose jobs are done.
    ///
    /// # Panics
    /// When none is.
    pub fn of(self, study: &Study, data: &StudyData) -> f64 {
        let of_run = |run: &Run| match self {
            Self::FinalSuccess => mean_of_tasks(data, run, |cell| cell.success),
            Self::FinalReturn => mean_of_tasks(data, run, |cell| cell.episode_return),
            Self::Area => area(study, data, run),
        };
        mean(data.runs.iter().map(of_run)).expect("a trial that was run has runs")
    }

    /// What it is called where it is shown.
    pub fn name(self) -> &'static str {
        match self {
            Self::FinalSuccess => "success rate after the last stage",
            Self::FinalReturn => "return after the last stage",
            Self::Area => "area under the curve of success",
        }
    }
}

fn mean_of_tasks(data: &StudyData, run: &Run, value: fn(&Cell) -> f64) -> f64 {
    let cells = data.order(run).iter().filter_map(|task| data.final_cell(run, *task));
    mean(cells.map(value)).unwrap_or(0.0)
}

/// What a flight finds is taken to hold since the one before; what the last one of a stage that ended early found, to
/// the end of its budget.
fn area(study: &Study, data: &StudyData, run: &Run) -> f64 {
    let tasks = data.order(run).len();
    let stages = study.methods[run.method].procedure.stages(tasks);
    let budget = (study.training_of(run.method).total_steps() * tasks as u64 / stages as u64) as f64;
    let of_stage = |stage: usize| {
        let (mut sum, mut since, mut last) = (0.0, 0.0, 0.0);
        for row in run.curve_of(stage) {
            let until = (row.steps as f64 / budget).min(1.0);
            last = f64::from(row.success_rate);
            sum += (until - since) * last;
            since = until;
        }
        sum + (1.0 - since) * last
    };
    mean((1..=stages).map(of_stage)).unwrap_or(0.0)
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::config::tests::tiny;
    use crate::study::directory::StudyDirectory;
    use crate::study::{
        JobId,
        job::JobResult,
        rows::{CurveRow, EpisodeRow},
    };

    /// A study of one run in which only `high`, learned last, succeeds, at every second flight.
    fn data(study: &Study) -> StudyData {
        let place = tempfile::tempdir().unwrap();
        let directory = StudyDirectory::open_trial(study, place.path()).unwrap();
        let row = |stage: usize, task: usize, episode: u32| EpisodeRow {
            stage,
            task,
            episode,
            success: task == 1 && episode == 0,
            episode_return: task as f32,
            length_secs: 1.0,
        };
        let rows = (0..3)
            .flat_map(|stage| (0..2).flat_map(move |task| (0..2).map(move |episode| row(stage, task, episode))));
        let point = |stage, steps, success_rate| CurveRow { stage, steps, success_rate, episode_return: 0.0 };
        let curve = vec![point(1, 4096, 0.5), point(1, 8192, 1.0), point(2, 2048, 1.0)];
        let result = JobResult {
            rows: rows.collect(),
            curve,
            stored_bytes: 0,
            training_bytes: 0,
            parameters: 1,
            boundaries: vec![],
        };
        directory.leave_job(JobId { seed: 0, order: 0, method: 0 }, &result).unwrap();
        StudyData::load(place.path()).unwrap()
    }

    #[test]
    fn each_objective_is_what_it_says() {
        let study = tiny(&[]);
        let data = data(&study);
        assert_eq!(Objective::FinalSuccess.of(&study, &data), 0.25);
        assert_eq!(Objective::FinalReturn.of(&study, &data), 0.5);
        // The first stage is half at 0.5 and half at 1, the second ended early at 1.
        assert_eq!(Objective::Area.of(&study, &data), 0.5 * (0.75 + 1.0));
    }
}
