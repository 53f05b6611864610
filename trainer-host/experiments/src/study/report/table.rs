//! Tables in Markdown.

/// A table whose first column is text and whose others are numbers.
pub(super) struct Table {
    columns: usize,
    text: String,
}

impl Table {
    pub(super) fn new<S: AsRef<str>>(headings: impl IntoIterator<Item = S>) -> Self {
        let mut table = Self { columns: 0, text: String::new() };
        table.columns = table.push(headings);
        let rule = vec!["---:"; table.columns.saturating_sub(1)];
        table.text.extend(["|---|", &rule.join("|"), "|\n"]);
        table
    }

    /// Adds a row.
    ///
    /// # Panics
    /// When it has not as many cells as the headings.
    pub(super) fn row<S: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = S>) {
        let cells = self.push(cells);
        assert_eq!(cells, self.columns, "rows are as long as the headings");
    }

    pub(super) fn text(self) -> String {
        self.text
    }

    /// Returns the number of cells.
    fn push<S: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = S>) -> usize {
        let cells: Vec<String> = cells.into_iter().map(|cell| escaped(cell.as_ref())).collect();
        self.text.extend(["| ", &cells.join(" | "), " |\n"]);
        cells.len()
    }
}

/// What would end a cell, a row or open a tag must not.
fn escaped(text: &str) -> String {
    text.replace('|', "\\|").replace('<', "&lt;").replace(['\n', '\r'], " ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_has_a_rule_and_escaped_cells() {
        let mut table = Table::new(["method", "p"]);
        table.row(["a|b", "< 0.001"]);
        assert_eq!(table.text(), "| method | p |\n|---|---:|\n| a\\|b | &lt; 0.001 |\n");
    }
}
