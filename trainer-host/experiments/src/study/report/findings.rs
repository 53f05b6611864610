//! What was found, section by section.

mod steps;

use super::NONE_YET;
use super::comparison::{Comparison, comparisons};
use super::notation::{
    bytes, hundredths_estimate, number_estimate, p_value, percent, percent_estimate, ratio_estimate,
};
use super::summary::{MethodSummary, Summary};
use super::table::Table;
use super::threshold::Learning;
use crate::statistics::bootstrap::Estimate;
use crate::study::data::{Method, MethodKind, PublishedValue, StudyData};

/// The method that changes nothing, when a study has it: a second reference beside the first method.
const PLAIN: &str = "none";

/// Stages that a table has room for, besides the first.
const STAGES_SHOWN: usize = 5;

/// Everything that the sections draw on.
pub(super) struct Findings<'a> {
    pub(super) data: &'a StudyData,
    pub(super) summary: &'a Summary,
    pub(super) learnings: &'a [Learning],
    /// Files of the pictures that were drawn.
    pub(super) pictures: Vec<&'static str>,
    /// What stands before their names in a link.
    pub(super) prefix: &'a str,
}

impl Findings<'_> {
    /// The methods that have runs, with what they achieved.
    fn methods(&self) -> impl Iterator<Item = (&Method, &MethodSummary)> {
        self.data.manifest.methods.iter().zip(&self.summary.methods).filter(|(_, found)| found.runs > 0)
    }

    fn label(&self, method: usize) -> &str {
        &self.data.manifest.methods[method].label
    }

    fn picture(&self, file: &str, about: &str) -> String {
        let drawn = self.pictures.contains(&file);
        if drawn { format!("![{about}]({}{file})\n\n", self.prefix) } else { String::new() }
    }

    /// The best sequence beside the reference and the upper bounds.
    pub(super) fn in_short(&self) -> String {
        let by_mean = |kind: MethodKind| {
            let of_kind =
                self.methods().filter(move |(method, found)| method.kind == kind && found.mean.is_some());
            of_kind.max_by(|first, second| mean(first.1).total_cmp(&mean(second.1)))
        };
        let sentence = |(method, found): (&Method, &MethodSummary)| {
            format!("* **{}**: {}{}\n", method.label, percent_estimate(found.mean), seeds_of(found))
        };
        let Some(best) = MethodKind::ALL.into_iter().find_map(by_mean) else {
            return format!("## In short\n\n{NONE_YET}\n");
        };
        let mut lines = vec![best];
        let first = self.methods().next();
        lines.extend(first.into_iter().filter(|first| first.0.name != best.0.name));
        lines.extend(by_mean(MethodKind::Joint).into_iter().chain(by_mean(MethodKind::Experts)));
        lines.dedup_by(|first, second| first.0.name == second.0.name);
        let lines: String = lines.into_iter().map(sentence).collect();
        format!(
            "## In short\n\nMean success in all tasks after the last one was trained, with 95 % intervals over seeds; the best \
             that learns task by task comes first:\n\n{lines}"
        )
    }

    pub(super) fn finals(&self) -> String {
        let mut table = Table::new([
            "method",
            "runs",
            "seeds",
            "mean success",
            "interquartile mean",
            "worst task",
            &format!("shortfall below {}", percent(self.data.manifest.success_threshold)),
            "mean return",
            "normalised return",
        ]);
        for (method, found) in self.methods() {
            table.row([
                method.label.clone(),
                found.runs.to_string(),
                found.mean.map_or(0, |mean| mean.units).to_string(),
                percent_estimate(found.mean),
                percent_estimate(found.interquartile_mean),
                percent_estimate(found.worst),
                hundredths_estimate(found.shortfall),
                number_estimate(found.episode_return),
                ratio_estimate(found.normalised),
            ]);
        }
        let picture = self.picture("final.svg", "Success after the last task");
        format!("## After the last task\n\n{picture}{}", table.text())
    }

    pub(super) fn retention(&self) -> String {
        let mut table = Table::new([
            "method",
            "forgetting",
            "backward transfer",
            "plasticity",
            "zero-shot transfer",
            "forward transfer",
            "joint gap",
            "of the experts",
        ]);
        for (method, found) in self.methods() {
            table.row([
                method.label.clone(),
                hundredths_estimate(found.forgetting),
                hundredths_estimate(found.backward_transfer),
                percent_estimate(found.plasticity),
                hundredths_estimate(found.zero_shot),
                ratio_estimate(found.forward_transfer),
                percent_estimate(found.of_joint.map(one_less)),
                percent_estimate(found.of_experts),
            ]);
        }
        let picture = self.picture("so-far.svg", "Success in the tasks so far");
        format!(
            "## Retention and transfer\n\nForgetting and transfers are in percentage points of success, forward transfer is a \
             ratio; the [definitions](#definitions) say what each is. Sequences alone have them.\n\n{}{}{picture}",
            table.text(),
            self.so_far()
        )
        .trim_end()
        .to_owned()
            + "\n"
    }

    /// How success falls as tasks are added, at no more than [`STAGES_SHOWN`] stages.
    fn so_far(&self) -> String {
        let count = self.summary.columns.len();
        let stages: Vec<usize> = (1..=count).filter(|stage| stage_is_shown(*stage, count)).collect();
        let after = |stage: &usize| if *stage == 1 { "1 task".to_owned() } else { format!("{stage} tasks") };
        let mut table = Table::new(std::iter::once("method".to_owned()).chain(stages.iter().map(after)));
        for (method, found) in self.methods().filter(|(_, found)| !found.so_far.is_empty()) {
            let cells = stages.iter().map(|stage| percent_estimate(found.so_far[stage - 1]));
            table.row(std::iter::once(method.label.clone()).chain(cells));
        }
        format!("\nSuccess in the tasks learned so far:\n\n{}\n", table.text())
    }

    /// Success beside return, task by task.
    pub(super) fn tasks(&self) -> String {
        let success = self.success_by_task();
        let tasks = &self.data.manifest.tasks;
        let headings = tasks.iter().map(|task| task.name.clone()).chain(["average".to_owned()]);
        let headings: Vec<String> = std::iter::once("method".to_owned()).chain(headings).collect();
        let mut returns = Table::new(&headings);
        let mut lengths = Table::new(&headings[..headings.len() - 1]);
        for (method, found) in self.methods() {
            let label = || std::iter::once(method.label.clone());
            let cells = found.tasks.iter().map(|task| number_estimate(task.episode_return));
            returns.row(label().chain(cells).chain([number_estimate(found.episode_return)]));
            lengths.row(label().chain(found.tasks.iter().map(|task| number_estimate(task.length_secs))));
        }
        format!(
            "{success}\nReturn of the same flights: a reward can pay more for hovering than for arriving, so read it beside the \
             success.\n\n{}\nMean length of the same flights [s]:\n\n{}",
            returns.text(),
            lengths.text()
        )
    }

    pub(super) fn success_by_task(&self) -> String {
        let tasks = self.data.manifest.tasks.iter().map(|task| task.name.as_str());
        let mut table = Table::new(["method"].into_iter().chain(tasks).chain(["average"]));
        for (method, found) in self.methods() {
            let cells = found.tasks.iter().map(|task| percent_estimate(task.success));
            table.row([method.label.clone()].into_iter().chain(cells).chain([percent_estimate(found.mean)]));
        }
        format!("## Task by task\n\nSuccess after the last task:\n\n{}", table.text())
    }

    /// Whether a method learned one task after the other.
    pub(super) fn is_sequential(&self) -> bool {
        self.methods().any(|(method, _)| method.kind == MethodKind::Sequential)
    }

    /// Whether steps until the threshold were counted.
    pub(super) fn has_thresholds(&self) -> bool {
        !self.learnings.is_empty()
    }

    pub(super) fn matrices(&self) -> String {
        let columns = 0..self.summary.columns.len();
        let names: Vec<String> = columns.map(|column| self.summary.columns.name(self.data, column)).collect();
        let what = match self.data.manifest.orders.len() {
            1 => "Columns are the tasks as they are trained.",
            _ => "Orders differ, so columns are places in the order: `task 1` is the first that was trained.",
        };
        let mut text = format!(
            "## Success after every stage\n\n{what} Entries are mean success [%] over seeds and orders, with 95 % intervals; n is \
             the number of seeds.\n\n{}",
            self.picture("matrix.svg", "Success in each task after each stage")
        );
        for (method, found) in self.methods() {
            let heading = format!("{}, n = {}", method.label, found.mean.map_or(0, |mean| mean.units));
            let mut table = Table::new(std::iter::once(&heading).chain(&names));
            for (stage, row) in found.matrix.iter().enumerate().filter(|(_, row)| row.iter().any(Option::is_some))
            {
                let cells = row.iter().map(|estimate| hundredths_estimate(*estimate));
                table.row(std::iter::once(stage_name(method.kind, stage)).chain(cells));
            }
            text += &table.text();
            text.push('\n');
        }
        text.trim_end().to_owned() + "\n"
    }

    pub(super) fn comparisons(&self) -> String {
        let plain = self.data.manifest.methods.iter().position(|method| method.name == PLAIN);
        let references = [0].into_iter().chain(plain.filter(|plain| *plain != 0));
        let sections = references.filter(|reference| self.summary.methods[*reference].runs > 0);
        let text: String = sections.map(|reference| self.compared_with(reference)).collect();
        if text.is_empty() { text } else { format!("## Comparisons\n\n{text}").trim_end().to_owned() + "\n" }
    }

    fn compared_with(&self, reference: usize) -> String {
        let found = comparisons(self.data, self.summary, reference);
        if found.is_empty() {
            return String::new();
        }
        let mut table = Table::new([
            "method",
            "probability of improvement",
            "difference of mean success [points]",
            "seeds",
            "p",
            "p, Holm",
        ]);
        for Comparison { method, improvement, difference, p, corrected } in found {
            table.row([
                self.label(method).to_owned(),
                percent_estimate(improvement),
                hundredths_estimate(difference),
                difference.map_or(0, |difference| difference.units).to_string(),
                p_value(p),
                p_value(corrected),
            ]);
        }
        format!("Against **{}**, paired by seed:\n\n{}\n", self.label(reference), table.text())
    }

    pub(super) fn profile(&self) -> String {
        match self.picture("profile.svg", "Performance profile").trim_end() {
            "" => String::new(),
            picture => format!(
                "## Performance profile\n\n{picture}\n\nHow many of all runs and tasks end with more success than the \
                 horizontal axis says, with 95 % bands. A method whose line is above another's everywhere is better at every \
                 standard.\n"
            ),
        }
    }

    pub(super) fn curves(&self) -> String {
        match self.picture("curves.svg", "Learning curves").trim_end() {
            "" => "## Learning curves\n\nNo run has left a curve.\n".to_owned(),
            picture => format!("## Learning curves\n\n{picture}\n"),
        }
    }

    pub(super) fn memory(&self) -> String {
        match self.picture("memory.svg", "Memory against final success").trim_end() {
            "" => String::new(),
            picture => {
                let mut table =
                    Table::new(["method", "bytes kept", "bytes in training", "mean success", "forgetting"]);
                for (method, found) in self.methods() {
                    table.row([
                        method.label.clone(),
                        bytes(method.stored_bytes),
                        bytes(method.training_bytes),
                        percent_estimate(found.mean),
                        hundredths_estimate(found.forgetting),
                    ]);
                }
                format!("## Memory\n\n{picture}\n\n{}", table.text())
            }
        }
    }

    /// Somebody else's table beside what this study has of the same shape.
    pub(super) fn published(&self) -> String {
        let Some(published) = &self.data.manifest.published else { return String::new() };
        let mut table =
            Table::new(std::iter::once("published").chain(published.columns.iter().map(String::as_str)));
        for row in &published.rows {
            let cells = row.values.iter().map(|value| match value {
                PublishedValue::Number(number) => number.to_string(),
                PublishedValue::NeverReached => "DNE".to_owned(),
            });
            table.row(std::iter::once(row.label.clone()).chain(cells));
        }
        let tasks = &self.data.manifest.tasks;
        let headings = tasks.iter().map(|task| task.name.as_str()).chain(["average return", "average success"]);
        let mut ours = Table::new(std::iter::once("this study").chain(headings));
        for (method, found) in self.methods() {
            let returns = found.tasks.iter().map(|task| number_estimate(task.episode_return));
            let averages = [number_estimate(found.episode_return), percent_estimate(found.mean)];
            ours.row(std::iter::once(method.label.clone()).chain(returns).chain(averages));
        }
        let notes: String = published.notes.iter().map(|note| ["* ", note, "\n"].concat()).collect();
        format!(
            "## Beside the published table\n\n{}\n\n{}\nThis study's returns after the last task, with 95 % intervals:\n\n{}\n{}{notes}",
            published.title,
            table.text(),
            ours.text(),
            self.picture("returns.svg", "Learning curves in returns")
        )
    }
}

/// The first stage, the last, and others evenly between.
fn stage_is_shown(stage: usize, count: usize) -> bool {
    stage == 1 || (count - stage).is_multiple_of(count.div_ceil(STAGES_SHOWN).max(1))
}

fn mean(found: &MethodSummary) -> f64 {
    found.mean.map_or(0.0, |mean| mean.value)
}

fn seeds_of(found: &MethodSummary) -> String {
    let seeds = found.mean.map_or(0, |mean| mean.units);
    format!(" ({} runs of {seeds} seed{})", found.runs, if seeds == 1 { "" } else { "s" })
}

fn stage_name(kind: MethodKind, stage: usize) -> String {
    match (kind, stage) {
        (_, 0) => "untrained".to_owned(),
        (MethodKind::Sequential, stage) => format!("after stage {stage}"),
        (MethodKind::Joint | MethodKind::Averaged, _) => "trained".to_owned(),
        (MethodKind::Experts, stage) => format!("expert {stage}"),
    }
}

fn one_less(estimate: Estimate) -> Estimate {
    let interval = estimate.interval.map(|[low, high]| [1.0 - high, 1.0 - low]);
    Estimate { value: 1.0 - estimate.value, interval, ..estimate }
}
