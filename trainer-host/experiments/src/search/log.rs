//! `trials.csv`: every trial with its point, as far as it has climbed.

use std::path::{Path, PathBuf};

use super::space::Dimension;
use super::{Search, Trial};
use crate::atomic_file::{FileError, read, write_atomically};

/// Name of the file in the search's directory.
pub const FILE: &str = "trials.csv";

/// Columns before the dimensions'.
const COLUMNS: [&str; 4] = ["trial", "rungs", "seeds", "objective"];

/// A log cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// The system refuses.
    #[error(transparent)]
    File(#[from] FileError),
    /// A line is not what the program writes.
    #[error("{}:{line}: found `{found}`, expected {expected}: run the search again to write it anew", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What it says.
        found: String,
        /// What it could say.
        expected: String,
    },
}

/// Writes all trials, whole or not at all.
///
/// # Errors
/// The system's reason.
pub fn write(directory: &Path, search: &Search, trials: &[Trial]) -> Result<(), FileError> {
    let line = |trial: &Trial| {
        let Trial { number, rungs, seeds, objective, .. } = trial;
        let fields = [number.to_string(), rungs.to_string(), seeds.to_string(), objective.to_string()];
        fields
            .into_iter()
            .chain(search.values(trial).iter().map(|value| field(value)))
            .collect::<Vec<_>>()
            .join(",")
    };
    let lines: Vec<String> = std::iter::once(header(search)).chain(trials.iter().map(line)).collect();
    write_atomically(&directory.join(FILE), (lines.join("\n") + "\n").as_bytes())
}

/// Reads all trials.
///
/// # Errors
/// When the file is unreadable, or a line is not one of the search.
pub fn load(directory: &Path, search: &Search) -> Result<Vec<Trial>, LogError> {
    let path = directory.join(FILE);
    let bytes = read(&path)?;
    let text = String::from_utf8_lossy(&bytes);
    let wrong = |line: usize, found: &str, expected: &str| {
        let (found, expected) = (found.to_owned(), expected.to_owned());
        LogError::Line { path: path.clone(), line, found, expected }
    };
    let mut lines = text.lines();
    let (found, expected) = (lines.next().unwrap_or_default(), header(search));
    if found != expected {
        return Err(wrong(1, found, &format!("`{expected}`")));
    }
    let expected = "a trial of this search, one after the other";
    let trial =
        |(number, line)| parsed(line, &search.space, number).ok_or_else(|| wrong(number + 2, line, expected));
    lines.enumerate().map(trial).collect()
}

fn header(search: &Search) -> String {
    let keys = search.space.iter().map(|dimension| field(&dimension.key));
    COLUMNS.map(str::to_owned).into_iter().chain(keys).collect::<Vec<_>>().join(",")
}

fn parsed(line: &str, space: &[Dimension], number: usize) -> Option<Trial> {
    let fields = fields(line);
    let ([trial, rungs, seeds, objective], values) = fields.split_first_chunk()?;
    if values.len() != space.len() || trial.parse() != Ok(number) {
        return None;
    }
    let places = space.iter().zip(values).map(|(dimension, value)| dimension.place(value));
    Some(Trial {
        number,
        point: places.collect::<Option<_>>()?,
        rungs: rungs.parse().ok()?,
        seeds: seeds.parse().ok()?,
        objective: objective.parse().ok().filter(|objective: &f64| objective.is_finite())?,
    })
}

/// A text as one field of CSV.
fn field(text: &str) -> String {
    if text.contains([',', '"']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// The fields of a line of CSV.
fn fields(line: &str) -> Vec<String> {
    let mut fields = vec![String::new()];
    let mut quoted = false;
    let mut letters = line.chars().peekable();
    while let Some(letter) = letters.next() {
        match letter {
            '"' if quoted && letters.next_if_eq(&'"').is_some() => push(&mut fields, '"'),
            '"' => quoted = !quoted,
            ',' if !quoted => fields.push(String::new()),
            other => push(&mut fields, other),
        }
    }
    fields
}

fn push(fields: &mut [String], letter: char) {
    if let Some(last) = fields.last_mut() {
        last.push(letter);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::search::config::tests::search;

    fn trials(search: &Search) -> Vec<Trial> {
        let trial = |number: usize| {
            let place = (number as f64 + 0.5) / 4.0;
            let point = search.space.iter().map(|dimension| dimension.settled(place)).collect();
            Trial { number, point, rungs: 1 + number % 2, seeds: 2, objective: 0.1 * number as f64 }
        };
        (0..4).map(trial).collect()
    }

    #[test]
    fn trials_are_read_as_they_were_written() {
        let place = tempfile::tempdir().unwrap();
        let search = search(&[]);
        write(place.path(), &search, &trials(&search)).unwrap();
        assert_eq!(load(place.path(), &search).unwrap(), trials(&search));
    }

    #[test]
    fn values_with_commas_and_quotes_are_one_field() {
        for text in ["plain", "{a: 1, b: 2}", "say \"yes\", twice", ""] {
            assert_eq!(fields(&format!("1,{},2", field(text))), ["1", text, "2"]);
        }
    }

    #[test]
    fn damaged_lines_are_named() {
        let place = tempfile::tempdir().unwrap();
        let search = search(&[]);
        write(place.path(), &search, &trials(&search)).unwrap();
        let path = place.path().join(FILE);
        let whole = std::fs::read_to_string(&path).unwrap();
        for (right, wrong, line) in
            [("trial,rungs", "trial,rang", 1), ("\n1,2,2,", "\n1,2,x,", 3), ("\n3,", "\n4,", 5)]
        {
            std::fs::write(&path, whole.replacen(right, wrong, 1)).unwrap();
            let message = load(place.path(), &search).unwrap_err().to_string();
            assert!(message.contains(&format!("trials.csv:{line}: found `")), "{message}");
        }
    }
}
