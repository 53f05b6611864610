//! What was run.

use std::path::Path;

use super::notation::{NONE, bytes, number, percent, seeds};
use super::table::Table;
use crate::progress::amount;
use crate::statistics::proportion::wilson;
use crate::study::data::{Baseline, MethodKind, StudyData};
use crate::study::rows::Job;

/// More missing jobs than these are counted and not named.
const NAMED_JOBS: usize = 12;

/// What an incomplete study lacks; empty for a complete one.
pub(super) fn missing(data: &StudyData) -> String {
    if data.missing.is_empty() {
        return String::new();
    }
    let all = data.manifest.jobs().len();
    let name = |job: &Job| format!("`{}`", job.rows_path(Path::new("")).display());
    let mut named: Vec<String> = data.missing.iter().take(NAMED_JOBS).map(name).collect();
    if data.missing.len() > NAMED_JOBS {
        named.push(format!("and {} more", data.missing.len() - NAMED_JOBS));
    }
    format!(
        "> **This study is incomplete:** {} of {all} jobs have not left their rows yet ({}). Every number below is \
         about the others.\n",
        data.missing.len(),
        named.join(", ")
    )
}

/// The tasks and what trivial pilots achieve in them.
pub(super) fn tasks(data: &StudyData) -> String {
    let pilots = pilots(&data.manifest.baselines);
    let headings = pilots.iter().flat_map(|pilot| [format!("{pilot}: success"), format!("{pilot}: return")]);
    let fixed = ["task".to_owned(), "episode".to_owned()];
    let mut table = Table::new(fixed.into_iter().chain(headings));
    for (index, task) in data.manifest.tasks.iter().enumerate() {
        let mut cells = vec![task.name.clone(), format!("{} s", number(task.episode_secs))];
        for pilot in &pilots {
            cells.extend(baseline_cells(data.manifest.baseline(index, pilot)));
        }
        table.row(cells);
    }
    let about = if pilots.is_empty() {
        "Trivial pilots were not flown."
    } else {
        "What a pilot achieves that has learned nothing: success with its 95 % interval over flights (Wilson), and mean return."
    };
    format!("## Tasks\n\n{about}\n\n{}", table.text())
}

fn baseline_cells(baseline: Option<&Baseline>) -> [String; 2] {
    let Some(baseline) = baseline else { return [NONE.to_owned(), NONE.to_owned()] };
    let flights = baseline.episodes as f64;
    let success = if baseline.episodes == 0 {
        percent(baseline.success_rate)
    } else {
        let [low, high] =
            wilson(baseline.success_rate * flights, flights).map(|end| format!("{:.1}", 100.0 * end));
        format!("{} [{low}, {high}], n = {}", percent(baseline.success_rate), baseline.episodes)
    };
    [success, number(baseline.episode_return)]
}

/// Names of the trivial pilots, in the order of the manifest.
fn pilots(baselines: &[Baseline]) -> Vec<String> {
    let mut pilots: Vec<String> = Vec::new();
    for baseline in baselines {
        if !pilots.contains(&baseline.pilot) {
            pilots.push(baseline.pilot.clone());
        }
    }
    pilots
}

/// The methods and their bytes.
pub(super) fn methods(data: &StudyData) -> String {
    let mut table =
        Table::new(["method", "name in the rows", "learns", "parameters", "bytes in training", "bytes kept"]);
    for method in &data.manifest.methods {
        table.row([
            method.label.clone(),
            format!("`{}`", method.name),
            learns(method.kind).to_owned(),
            method.parameters.to_string(),
            bytes(method.training_bytes),
            bytes(method.stored_bytes),
        ]);
    }
    let described = data.manifest.methods.iter().filter(|method| !method.description.is_empty());
    let lines: Vec<String> =
        described.map(|method| format!("* **{}**: {}\n", method.label, method.description)).collect();
    format!(
        "## Methods\n\nBytes are those beyond the policy itself: the most that is held while a task trains, and what is \
         kept from task to task.\n\n{}\n{}",
        table.text(),
        lines.concat()
    )
}

fn learns(kind: MethodKind) -> &'static str {
    match kind {
        MethodKind::Sequential => "one task after the other",
        MethodKind::Joint => "all tasks at once",
        MethodKind::Averaged => "all tasks at once, by policies that are averaged",
        MethodKind::Experts => "a policy per task",
    }
}

/// Orders, seeds and budget.
pub(super) fn procedure(data: &StudyData) -> String {
    let manifest = &data.manifest;
    let names = |order: &[usize]| {
        order.iter().map(|task| manifest.tasks[*task].name.as_str()).collect::<Vec<_>>().join(" → ")
    };
    let orders: Vec<String> = manifest.orders.iter().map(|order| names(order)).collect();
    let orders = match &orders[..] {
        [order] => format!("* One order: {order}.\n"),
        orders => format!("* {} orders: {}.\n", orders.len(), orders.join("; ")),
    };
    format!(
        "## Procedure\n\n{orders}* {} seed{}: {}.\n* {} environment steps of training per task, at most.\n* {}\n* {} of {} jobs are \
         finished.\n",
        manifest.seeds.len(),
        if manifest.seeds.len() == 1 { "" } else { "s" },
        seeds(&manifest.seeds),
        amount(manifest.steps_per_stage as f64),
        flights(data),
        manifest.jobs().len() - data.missing.len(),
        manifest.jobs().len()
    )
}

/// How many flights are behind a number.
fn flights(data: &StudyData) -> String {
    let cells = data.runs.iter().flat_map(|run| {
        let tasks = 0..data.manifest.tasks.len();
        tasks.filter_map(|task| data.final_cell(run, task)).map(|cell| cell.episodes)
    });
    let counts: Vec<usize> = cells.collect();
    match (counts.iter().min(), counts.iter().max()) {
        (Some(least), Some(most)) if least == most => {
            format!("After every stage, every policy flies {least} test flights in each task.")
        }
        (Some(least), Some(most)) => {
            format!("After every stage, every policy flies {least} to {most} test flights in each task.")
        }
        _ => "No test flight has been flown yet.".to_owned(),
    }
}
