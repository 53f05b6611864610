//! How many steps of training the tasks cost.

use super::Findings;
use crate::progress::amount;
use crate::statistics::bootstrap::Estimate;
use crate::study::report::notation::{NONE, p_value, percent, percent_estimate, ratio_estimate, steps_estimate};
use crate::study::report::table::Table;
use crate::study::report::threshold::{LearningSummary, Totals, anybody_got_there, totals};

impl Findings<'_> {
    pub(in crate::study::report) fn thresholds(&self) -> String {
        let threshold = percent(self.data.manifest.success_threshold);
        let heading = format!("## Steps until {threshold} success");
        let Some(first) = self.learnings.first() else {
            return format!("{heading}\n\nNo run has left a curve.\n");
        };
        let budget = amount(self.data.manifest.steps_per_stage as f64);
        if !anybody_got_there(self.learnings) {
            return format!("{heading}\n\nNo stage of any method gets there within its {budget} steps.\n");
        }
        format!(
            "{heading}\n\n{}Training steps of a stage until its test flights first reach {threshold}. A stage that never does \
             is censored at its end; it is not left out. The restricted mean counts it with the whole budget of {budget} \
             steps. p is that of a log-rank test against **{}**, task by task.\n\n{}\nMean steps within the budget, task by \
             task (share that got there):\n\n{}{}{}",
            self.picture("threshold.svg", "Steps until the threshold"),
            self.label(first.method),
            self.threshold_table(),
            self.threshold_table_by_task(),
            self.multiples(),
            self.totals()
        )
    }

    /// Who is how much slower than the first method; nothing when there is only one.
    fn multiples(&self) -> String {
        let Some((first, others)) = self.learnings.split_first().filter(|(_, others)| !others.is_empty()) else {
            return String::new();
        };
        let rows = others.iter().map(|learning| (learning.method, &learning.multiples[..]));
        format!(
            "\nThe same means as multiples of those of **{}** (above 1: it is the faster):\n\n{}",
            self.label(first.method),
            self.by_task(rows, ratio_estimate)
        )
    }

    /// What the tasks cost with all that was learned before them, and what they cost alone beside it.
    fn totals(&self) -> String {
        let Some(Totals { method, steps, alone }) = totals(self.data, self.summary, self.learnings) else {
            return String::new();
        };
        let name = self.label(method);
        let sums = self.by_task([(method, &steps[..])], steps_estimate);
        let text = format!("\nThe means of **{name}** summed over the tasks until then:\n\n{sums}");
        if alone.is_empty() {
            return text;
        }
        let rows = alone.iter().map(|(method, multiples)| (*method, &multiples[..]));
        format!(
            "{text}\nWho learns the task alone, as multiples of those sums (above 1: learning the others first pays even when \
             they count):\n\n{}",
            self.by_task(rows, ratio_estimate)
        )
    }

    /// A row per method, a column per task.
    fn by_task<'a>(
        &self,
        rows: impl IntoIterator<Item = (usize, &'a [Option<Estimate>])>,
        shown: fn(Option<Estimate>) -> String,
    ) -> String {
        let mut table = self.table_by_task();
        for (method, estimates) in rows {
            let cells = estimates.iter().map(|estimate| shown(*estimate));
            table.row(std::iter::once(self.label(method).to_owned()).chain(cells));
        }
        table.text()
    }

    fn table_by_task(&self) -> Table {
        let tasks = self.data.manifest.tasks.iter().map(|task| task.name.as_str());
        Table::new(std::iter::once("method").chain(tasks))
    }

    fn threshold_table(&self) -> String {
        let mut table = Table::new(["method", "stages", "reached", "median", "restricted mean", "p", "p, Holm"]);
        for learning in self.learnings {
            let LearningSummary { stages, reached, median, restricted_mean } = &learning.overall;
            table.row([
                self.label(learning.method).to_owned(),
                stages.to_string(),
                percent_estimate(*reached),
                median.map_or("not reached by half".to_owned(), amount),
                steps_estimate(*restricted_mean),
                p_value(learning.test.map(|test| test.p)),
                p_value(learning.corrected),
            ]);
        }
        table.text()
    }

    fn threshold_table_by_task(&self) -> String {
        let mut table = self.table_by_task();
        for learning in self.learnings {
            let cells = learning.by_task.iter().map(|task| match task.reached {
                None => NONE.to_owned(),
                Some(reached) => format!("{} ({})", steps_estimate(task.restricted_mean), percent(reached.value)),
            });
            table.row(std::iter::once(self.label(learning.method).to_owned()).chain(cells));
        }
        table.text()
    }
}
