//! `metrics.jsonl`: one JSON object per update, appended.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::RunDirectoryError;
use crate::atomic_file::{FileError, write_atomically};

/// What messages show of a row that is none \[characters\].
const EXCERPT_LEN: usize = 40;

/// The metrics of a run, open for appending.
#[derive(Debug)]
pub struct MetricsLog {
    file: File,
    path: PathBuf,
}

/// The part of a row by which rows are told apart.
#[derive(serde::Deserialize)]
struct RowNumber {
    updates: u64,
}

impl MetricsLog {
    /// Starts or continues the log at `path` after `updates` updates (0 for a new run): rows of later updates, which
    /// a resumed run makes again, are removed.
    ///
    /// Each row must have a field `updates`.
    ///
    /// # Errors
    /// A row that is none, or the system's reason.
    pub fn continue_after(path: &Path, updates: u64) -> Result<Self, RunDirectoryError> {
        keep_rows_until(path, updates)?;
        let opened = OpenOptions::new().append(true).create(true).open(path);
        let file = opened.map_err(|cause| FileError::new("open", path, cause))?;
        Ok(Self { file, path: path.to_owned() })
    }

    /// Appends one row in one write, so that it is in the file when this returns; NaN becomes `null`.
    ///
    /// # Errors
    /// The system's reason.
    ///
    /// # Panics
    /// When `row` is no JSON value.
    pub fn append(&mut self, row: &impl Serialize) -> Result<(), FileError> {
        let mut line = serde_json::to_vec(row).expect("metrics are JSON values");
        line.push(b'\n');
        self.file.write_all(&line).map_err(|cause| FileError::new("write", &self.path, cause))
    }
}

/// All complete rows of the log at `path`, as far as `T` has fields for them; none when there is no log.
///
/// # Errors
/// A row that is no `T`, with its line, or the system's reason.
pub fn read_rows<T: DeserializeOwned>(path: &Path) -> Result<Vec<T>, RunDirectoryError> {
    parse_rows(path, &read_complete_lines(path)?)
}

fn keep_rows_until(path: &Path, updates: u64) -> Result<(), RunDirectoryError> {
    let text = read_complete_lines(path)?;
    let numbers: Vec<RowNumber> = parse_rows(path, &text)?;
    let rows = text.split_inclusive('\n').zip(numbers);
    let kept: String = rows.filter(|(_, row)| row.updates <= updates).map(|(line, _)| line).collect();
    Ok(write_atomically(path, kept.as_bytes())?)
}

/// The text up to the last newline: what follows was cut off while it was written.
fn read_complete_lines(path: &Path) -> Result<String, FileError> {
    let mut text = match fs::read(path) {
        Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
        Err(cause) if cause.kind() == std::io::ErrorKind::NotFound => String::new(),
        Err(cause) => return Err(FileError::new("read", path, cause)),
    };
    text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
    Ok(text)
}

fn parse_rows<T: DeserializeOwned>(path: &Path, text: &str) -> Result<Vec<T>, RunDirectoryError> {
    let parse = |(index, line): (usize, &str)| {
        serde_json::from_str(line).map_err(|cause: serde_json::Error| RunDirectoryError::Row {
            path: path.to_owned(),
            line: index + 1,
            found: format!("{:?} ({cause})", line.chars().take(EXCERPT_LEN).collect::<String>()),
        })
    };
    text.lines().enumerate().map(parse).collect()
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Row {
        updates: u64,
        policy_loss: Option<f32>,
    }

    fn row(updates: u64) -> Row {
        Row { updates, policy_loss: Some(0.1 * updates as f32) }
    }

    fn rows(path: &Path) -> Vec<Row> {
        read_rows(path).unwrap()
    }

    #[test]
    fn every_row_is_in_the_file_at_once() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("metrics.jsonl");
        let mut log = MetricsLog::continue_after(&path, 0).unwrap();
        for updates in 1..=3 {
            log.append(&row(updates)).unwrap();
            assert_eq!(rows(&path).len() as u64, updates);
        }
        assert_eq!(fs::read_to_string(&path).unwrap().lines().next(), Some(r#"{"updates":1,"policy_loss":0.1}"#));
    }

    #[test]
    fn a_resumed_run_repeats_no_row() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("metrics.jsonl");
        let mut log = MetricsLog::continue_after(&path, 0).unwrap();
        (1..=5).for_each(|updates| log.append(&row(updates)).unwrap());
        drop(log);
        let mut log = MetricsLog::continue_after(&path, 3).unwrap();
        (4..=6).for_each(|updates| log.append(&row(updates)).unwrap());
        assert_eq!(rows(&path), (1..=6).map(row).collect::<Vec<_>>());
    }

    #[test]
    fn a_row_that_was_cut_off_is_dropped() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("metrics.jsonl");
        fs::write(&path, "{\"updates\":1,\"policy_loss\":null}\n{\"updates\":2,\"pol").unwrap();
        let mut log = MetricsLog::continue_after(&path, 9).unwrap();
        log.append(&row(2)).unwrap();
        assert_eq!(rows(&path), [Row { updates: 1, policy_loss: None }, row(2)]);
    }

    #[test]
    fn nan_is_written_as_null() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("metrics.jsonl");
        let mut log = MetricsLog::continue_after(&path, 0).unwrap();
        log.append(&Row { updates: 1, policy_loss: Some(f32::NAN) }).unwrap();
        assert_eq!(rows(&path), [Row { updates: 1, policy_loss: None }]);
    }

    #[test]
    fn a_damaged_row_is_named_with_its_line() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("metrics.jsonl");
        fs::write(&path, "{\"updates\":1}\nupdates: 2\n{\"updates\":3}\n").unwrap();
        let error = MetricsLog::continue_after(&path, 3).unwrap_err().to_string();
        let start = format!("{} line 2: expected a JSON object with the metrics of an update, ", path.display());
        assert!(error.starts_with(&start), "{error}");
    }

    #[test]
    fn a_run_without_metrics_has_no_rows() {
        assert_eq!(rows(Path::new("/nowhere/metrics.jsonl")), []);
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_one_clear_error() {
        let mut log = MetricsLog {
            file: OpenOptions::new().write(true).open("/dev/full").unwrap(),
            path: PathBuf::from("metrics.jsonl"),
        };
        let error = log.append(&row(1)).unwrap_err().to_string();
        assert!(error.starts_with("cannot write metrics.jsonl: No space left on device"), "{error}");
    }
}
