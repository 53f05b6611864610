//! Markdown in lines of a hundred columns.

/// Widest line, except of tables, headings and pictures.
pub(super) const COLUMNS: usize = 100;

/// Breaks the paragraphs and list items that are too long for a line.
pub(super) fn wrapped(text: &str) -> String {
    text.split_inclusive('\n').map(line).collect()
}

fn line(line: &str) -> String {
    if line.trim_end().chars().count() <= COLUMNS || line.starts_with(['|', '#', '!']) {
        return line.to_owned();
    }
    let indent = if line.starts_with("* ") { "  " } else { "" };
    let (mut wrapped, mut column) = (String::new(), 0);
    for word in line.split(' ') {
        let len = word.trim_end().chars().count();
        if column > 0 && column + 1 + len > COLUMNS {
            wrapped.extend(["\n", indent]);
            column = indent.len();
        } else if column > 0 {
            wrapped.push(' ');
            column += 1;
        }
        wrapped += word;
        column += len;
    }
    wrapped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paragraphs_and_items_are_broken_and_tables_are_not() {
        let words = "ten lines ".repeat(20);
        let text = format!("# {words}\n\n{words}end\n* {words}end\n| {words} |\n");
        let wrapped = wrapped(&text);
        let long: Vec<&str> = wrapped.lines().filter(|line| line.chars().count() > COLUMNS).collect();
        assert_eq!(long, [&format!("# {words}"), &format!("| {words} |")]);
        assert_eq!(wrapped.split_whitespace().collect::<Vec<_>>(), text.split_whitespace().collect::<Vec<_>>());
        assert!(wrapped.contains("\n  "), "{wrapped}");
        assert_eq!(super::wrapped(&wrapped), wrapped);
    }
}
