//! The flights and the training progress of a job, as CSV.
//!
//! `rows/METHOD/ORDER-SEED.csv` has a row for every flight, `curves/METHOD/ORDER-SEED.csv` one for every time that the
//! policy was tried while it learned. Numbers are written with the digits that give the same `f32` again.

use std::collections::BTreeSet;
use std::fmt::Display;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::data::{MethodKind, StudyError, StudyManifest};
use crate::atomic_file::read;

const EPISODE_HEADER: &str = "method,order,seed,stage,task,episode,success,episode_return,length_secs";
const CURVE_HEADER: &str = "method,order,seed,stage,steps,success_rate,episode_return";

/// One run of a method.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Job {
    /// The method's name.
    pub method: String,
    /// Which of the study's orders, from 0.
    pub order: usize,
    /// What everything random in it follows from.
    pub seed: u64,
}

/// One flight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeRow {
    /// 0 before training, i after the i-th stage.
    pub stage: usize,
    /// Which of the study's tasks, from 0; the file has its name.
    pub task: usize,
    /// Number of the start, from 0.
    pub episode: u32,
    /// Whether the task's goal was reached.
    pub success: bool,
    /// Undiscounted return, finite.
    pub episode_return: f32,
    /// Length \[s\].
    pub length_secs: f32,
}

/// Test flights in the midst of training.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CurveRow {
    /// The stage that trains, from 1.
    pub stage: usize,
    /// Environment steps since the stage began.
    pub steps: u64,
    /// Share of successes in \[0, 1\], in the task that trains, or over all tasks in joint training.
    pub success_rate: f32,
    /// Mean return of the same flights, finite.
    pub episode_return: f32,
}

impl Job {
    /// The file of its flights.
    pub fn rows_path(&self, directory: &Path) -> PathBuf {
        directory.join("rows").join(&self.method).join(self.file())
    }

    /// The file of its training progress.
    pub fn curve_path(&self, directory: &Path) -> PathBuf {
        directory.join("curves").join(&self.method).join(self.file())
    }

    /// The file of the boundaries that it found, where nobody tells.
    pub fn boundaries_path(&self, directory: &Path) -> PathBuf {
        directory.join("boundaries").join(&self.method).join(self.file())
    }

    /// The folder of its policy, or of its policies by task.
    pub fn policies_path(&self, directory: &Path) -> PathBuf {
        directory.join("policies").join(&self.method).join(format!("{}-{}", self.order, self.seed))
    }

    fn file(&self) -> String {
        format!("{}-{}.csv", self.order, self.seed)
    }
}

/// Writes the flights of a job: stage by stage and task by task, each with episodes from 0.
///
/// # Errors
/// What `out` reports.
///
/// # Panics
/// When a task is not one of the study's.
pub fn write_episodes(
    out: &mut impl Write,
    manifest: &StudyManifest,
    job: &Job,
    rows: &[EpisodeRow],
) -> io::Result<()> {
    writeln!(out, "{EPISODE_HEADER}")?;
    for row in rows {
        let task = &manifest.tasks[row.task].name;
        let success = u8::from(row.success);
        writeln!(
            out,
            "{},{},{},{},{task},{},{success},{},{}",
            job.method, job.order, job.seed, row.stage, row.episode, row.episode_return, row.length_secs
        )?;
    }
    out.flush()
}

/// Writes the training progress of a job: stages and, within each, steps rise.
///
/// # Errors
/// What `out` reports.
pub fn write_curve(out: &mut impl Write, job: &Job, rows: &[CurveRow]) -> io::Result<()> {
    writeln!(out, "{CURVE_HEADER}")?;
    for row in rows {
        let Job { method, order, seed } = job;
        let CurveRow { stage, steps, success_rate, episode_return } = row;
        writeln!(out, "{method},{order},{seed},{stage},{steps},{success_rate},{episode_return}")?;
    }
    out.flush()
}

/// Writes the stages, from 1, and their steps at which a job found that its task was another one.
///
/// # Errors
/// What `out` reports.
pub fn write_boundaries(out: &mut impl Write, job: &Job, found: &[(usize, u64)]) -> io::Result<()> {
    writeln!(out, "method,order,seed,stage,steps")?;
    for (stage, steps) in found {
        writeln!(out, "{},{},{},{stage},{steps}", job.method, job.order, job.seed)?;
    }
    out.flush()
}

/// Reads the flights of a job, which cover every stage and every task of its order.
///
/// # Errors
/// When the file is unreadable, or a row is wrong, missing or there twice.
pub fn read_episodes(
    directory: &Path,
    manifest: &StudyManifest,
    job: &Job,
) -> Result<Vec<EpisodeRow>, StudyError> {
    let table = Table::read(&job.rows_path(directory), EPISODE_HEADER)?;
    let stages = kind(manifest, job).stages(manifest.orders[job.order].len());
    let mut rows = Vec::new();
    let mut sequence = Sequence::default();
    for mut line in table.lines() {
        line.take_job(job)?;
        let row = EpisodeRow {
            stage: line.take("stage", &format!("0 to {stages}"), |stage| *stage <= stages)?,
            task: line.take_task(manifest)?,
            episode: line.take("episode", "a number from 0", |_| true)?,
            success: line.take("success", "0 or 1", |success: &u8| *success <= 1)? == 1,
            episode_return: line.take("episode_return", "a finite number", |value: &f32| value.is_finite())?,
            length_secs: line.take("length_secs", "seconds", |value: &f32| value.is_finite() && *value >= 0.0)?,
        };
        line.finish()?;
        sequence.admit(&line, row)?;
        rows.push(row);
    }
    sequence.finish(&table, manifest, job)?;
    Ok(rows)
}

/// Reads the training progress of a job.
///
/// # Errors
/// When the file is unreadable, or a row is wrong or out of order.
pub fn read_curve(directory: &Path, manifest: &StudyManifest, job: &Job) -> Result<Vec<CurveRow>, StudyError> {
    let table = Table::read(&job.curve_path(directory), CURVE_HEADER)?;
    let stages = kind(manifest, job).stages(manifest.orders[job.order].len());
    let mut rows: Vec<CurveRow> = Vec::new();
    for mut line in table.lines() {
        line.take_job(job)?;
        let row = CurveRow {
            stage: line.take("stage", &format!("1 to {stages}"), |stage| (1..=stages).contains(stage))?,
            steps: line.take("steps", "a number", |_| true)?,
            success_rate: line.take("success_rate", "0 to 1", |share: &f32| (0.0..=1.0).contains(share))?,
            episode_return: line.take("episode_return", "a finite number", |value: &f32| value.is_finite())?,
        };
        line.finish()?;
        if let Some(last) = rows.last().filter(|last| (last.stage, last.steps) >= (row.stage, row.steps)) {
            let expected = format!("more than {} of stage {}", last.steps, last.stage);
            return Err(line.wrong("steps", &format!("{} of stage {}", row.steps, row.stage), &expected));
        }
        rows.push(row);
    }
    Ok(rows)
}

fn kind(manifest: &StudyManifest, job: &Job) -> MethodKind {
    manifest.method(&job.method).map_or(MethodKind::Sequential, |method| method.kind)
}

/// The text of a file of rows below its header.
struct Table {
    path: PathBuf,
    text: String,
}

impl Table {
    fn read(path: &Path, header: &str) -> Result<Self, StudyError> {
        let bytes = read(path)?;
        let table = |text: String| Self { path: path.to_owned(), text };
        let Ok(text) = String::from_utf8(bytes) else {
            return Err(table(String::new()).wrong(1, "file", "bytes that are no text", "CSV in UTF-8"));
        };
        let found = text.lines().next().unwrap_or_default();
        if found != header {
            return Err(table(String::new()).wrong(1, "header", &format!("`{found}`"), &format!("`{header}`")));
        }
        let table = table(text);
        if !table.text.ends_with('\n') {
            return Err(table.wrong(table.text.lines().count(), "line", "no end of line", "a whole row"));
        }
        Ok(table)
    }

    fn lines(&self) -> impl Iterator<Item = Line<'_>> {
        let numbered = self.text.lines().enumerate().skip(1);
        numbered.map(|(index, text)| Line { table: self, number: index + 1, fields: text.split(',') })
    }

    fn wrong(&self, line: usize, field: &'static str, found: &str, expected: &str) -> StudyError {
        StudyError::Row {
            path: self.path.clone(),
            line,
            field,
            found: found.to_owned(),
            expected: expected.to_owned(),
        }
    }
}

/// A row that is being read, field by field.
struct Line<'a> {
    table: &'a Table,
    number: usize,
    fields: std::str::Split<'a, char>,
}

impl<'a> Line<'a> {
    fn take_text(&mut self, field: &'static str, expected: &str) -> Result<&'a str, StudyError> {
        self.fields.next().ok_or_else(|| self.wrong(field, "the end of the row", expected))
    }

    fn take<T: FromStr>(
        &mut self,
        field: &'static str,
        expected: &str,
        sound: impl Fn(&T) -> bool,
    ) -> Result<T, StudyError> {
        let text = self.take_text(field, expected)?;
        let value = text.parse().ok().filter(sound);
        value.ok_or_else(|| self.wrong(field, &format!("`{text}`"), expected))
    }

    fn take_equal(&mut self, field: &'static str, expected: impl Display) -> Result<(), StudyError> {
        let expected = expected.to_string();
        let text = self.take_text(field, &expected)?;
        let equal = text == expected;
        if equal { Ok(()) } else { Err(self.wrong(field, &format!("`{text}`"), &format!("`{expected}`"))) }
    }

    fn take_job(&mut self, job: &Job) -> Result<(), StudyError> {
        self.take_equal("method", &job.method)?;
        self.take_equal("order", job.order)?;
        self.take_equal("seed", job.seed)
    }

    fn take_task(&mut self, manifest: &StudyManifest) -> Result<usize, StudyError> {
        let text = self.take_text("task", "a task")?;
        let index = manifest.tasks.iter().position(|task| task.name == text);
        index.ok_or_else(|| {
            let names: Vec<&str> = manifest.tasks.iter().map(|task| task.name.as_str()).collect();
            self.wrong("task", &format!("`{text}`"), &format!("one of `{}`", names.join("`, `")))
        })
    }

    fn finish(&mut self) -> Result<(), StudyError> {
        match self.fields.next() {
            None => Ok(()),
            Some(more) => Err(self.wrong("row", &format!("`{more}`"), "the end of the row")),
        }
    }

    fn wrong(&self, field: &'static str, found: &str, expected: &str) -> StudyError {
        self.table.wrong(self.number, field, found, expected)
    }
}

/// Sees to it that every stage and task has the same number of episodes, each once.
#[derive(Default)]
struct Sequence {
    /// Stages and tasks so far.
    groups: BTreeSet<(usize, usize)>,
    last: Option<EpisodeRow>,
    /// Episodes of the first group, once it is whole.
    episodes: Option<u32>,
}

impl Sequence {
    fn admit(&mut self, line: &Line<'_>, row: EpisodeRow) -> Result<(), StudyError> {
        let group = (row.stage, row.task);
        let last = self.last.replace(row);
        let follows = last.filter(|last| (last.stage, last.task) == group);
        if follows.is_none() {
            self.close(last, line)?;
            if !self.groups.insert(group) {
                return Err(line.wrong("task", "a stage and task again", "each once"));
            }
        }
        let expected = follows.map_or(0, |last| last.episode + 1);
        if row.episode == expected {
            Ok(())
        } else {
            Err(line.wrong("episode", &format!("`{}`", row.episode), &format!("`{expected}`")))
        }
    }

    /// The group that ended with `last` has as many episodes as the first.
    fn close(&mut self, last: Option<EpisodeRow>, line: &Line<'_>) -> Result<(), StudyError> {
        let Some(last) = last else { return Ok(()) };
        let found = last.episode + 1;
        let expected = *self.episodes.get_or_insert(found);
        if found == expected {
            return Ok(());
        }
        Err(line.wrong(
            "episode",
            &format!("{found} flights before this row"),
            &format!("{expected} as of the first task"),
        ))
    }

    fn finish(&mut self, table: &Table, manifest: &StudyManifest, job: &Job) -> Result<(), StudyError> {
        let end = Line { table, number: table.text.lines().count(), fields: "".split(',') };
        self.close(self.last, &end)?;
        let expected = expected_groups(manifest, job).into_iter().find(|group| !self.groups.contains(group));
        expected.map_or(Ok(()), |(stage, task)| {
            let name = &manifest.tasks[task].name;
            Err(end.wrong("task", "the end of the file", &format!("flights of `{name}` after stage {stage}")))
        })
    }
}

/// Stages and tasks without which a job is not finished. Flights before training are welcome, not needed.
fn expected_groups(manifest: &StudyManifest, job: &Job) -> Vec<(usize, usize)> {
    let order = &manifest.orders[job.order];
    let kind = kind(manifest, job);
    let all = |stage: usize| order.iter().map(move |task| (stage, *task));
    match kind {
        MethodKind::Sequential | MethodKind::Joint | MethodKind::Averaged => {
            (1..=kind.stages(order.len())).flat_map(all).collect()
        }
        MethodKind::Experts => order.iter().enumerate().map(|(index, task)| (index + 1, *task)).collect(),
    }
}
