//! What a study found, for readers who know nothing else of it: `report.md` and its pictures.

mod claims;
mod comparison;
mod definitions;
mod figure;
mod findings;
mod notation;
mod page;
mod score;
mod setting;
mod summary;
mod table;
#[cfg(test)]
mod tests;
mod threshold;
mod wrap;

use std::fs;
use std::path::Path;

use super::data::{Method, StudyData, StudyError};
use crate::atomic_file::{FileError, write_atomically};
use figure::{Figure, figures};
use findings::Findings;
use notation::{bytes, hundredths_estimate, percent, percent_estimate};
pub use page::{NoPage, Page, page};
use summary::{MethodSummary, Summary};

/// What stands for findings when there are none.
const NONE_YET: &str = "No job has finished yet.";

/// Folder of the pictures beside `report.md`.
const PICTURES: &str = "report";

/// Writes `report.md` and `report/*.svg` into the study's directory, each file whole or not at all.
///
/// # Errors
/// When a file cannot be written.
pub fn write(directory: &Path, data: &StudyData) -> Result<(), StudyError> {
    let summary = Summary::new(data);
    let learnings = threshold::learnings(data, &summary);
    let figures = figures(data, &summary, &learnings);
    let folder = directory.join(PICTURES);
    fs::create_dir_all(&folder).map_err(|cause| FileError::new("create", &folder, cause))?;
    for Figure { file, drawing } in &figures {
        write_atomically(&folder.join(file), drawing.svg().as_bytes())?;
    }
    let pictures = figures.iter().map(|figure| figure.file).collect();
    let prefix = format!("{PICTURES}/");
    let findings = Findings { data, summary: &summary, learnings: &learnings, pictures, prefix: &prefix };
    Ok(write_atomically(&directory.join("report.md"), text(&findings).as_bytes())?)
}

/// The most important numbers as a table for the terminal, a line per method.
pub fn headline(data: &StudyData) -> String {
    let summary = Summary::new(data);
    let labels = data.manifest.methods.iter().map(|method| method.label.chars().count());
    let width = labels.max().unwrap_or(0).max("method".len());
    let mut lines = vec![
        format!("{}: success after the last task, 95 % intervals over seeds", data.manifest.name),
        format!(
            "{:<width$}  {:>5}  {:<22} {:<22} {:<22} {:<20} {:>9}",
            "method", "runs", "mean", "interquartile mean", "worst task", "forgetting", "stored"
        ),
    ];
    let methods = data.manifest.methods.iter().zip(&summary.methods);
    lines.extend(methods.map(|(method, found)| headline_row(method, found, width)));
    if !data.missing.is_empty() {
        lines.push(format!("{} of {} jobs are missing", data.missing.len(), data.manifest.jobs().len()));
    }
    lines.join("\n") + "\n"
}

fn headline_row(method: &Method, found: &MethodSummary, width: usize) -> String {
    format!(
        "{:<width$}  {:>5}  {:<22} {:<22} {:<22} {:<20} {:>9}",
        method.label,
        found.runs,
        percent_estimate(found.mean),
        percent_estimate(found.interquartile_mean),
        percent_estimate(found.worst),
        hundredths_estimate(found.forgetting),
        bytes(method.stored_bytes)
    )
}

fn text(findings: &Findings<'_>) -> String {
    let data = findings.data;
    let sections = [
        format!("# {}\n\n{}\n", data.manifest.name, data.manifest.about),
        findings.in_short(),
        findings.claims(),
        setting::missing(data),
        setting::tasks(data),
        setting::methods(data),
        setting::procedure(data),
        findings.finals(),
        findings.retention(),
        findings.tasks(),
        findings.matrices(),
        findings.comparisons(),
        findings.profile(),
        findings.curves(),
        findings.memory(),
        findings.thresholds(),
        findings.published(),
        definitions::how_to_read(data),
        definitions::definitions(&percent(data.manifest.success_threshold)),
    ];
    let written: Vec<String> = sections.into_iter().filter(|section| !section.is_empty()).collect();
    written.join("\n")
}
