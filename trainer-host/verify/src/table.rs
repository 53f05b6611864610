//! Tables of numbers in CSV files, their columns named in the first line.

use std::path::{Path, PathBuf};

use super::error::RecordingError;
use super::file::text_of;
use super::motion::Logged;

/// Columns of a motion, before the step number that some end in.
const MOTION: [&str; 13] = ["px", "py", "pz", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz"];

/// Columns of the rotor speeds \[RPM\].
pub(super) const RPM: [&str; 4] = ["m0", "m1", "m2", "m3"];

/// A CSV file of finite numbers; `nan` stands for an absent one.
#[derive(Clone, Debug)]
pub(super) struct Table {
    path: PathBuf,
    header: Vec<String>,
    rows: Vec<Row>,
}

/// One line of a table.
#[derive(Clone, Debug)]
pub(super) struct Row {
    line: usize,
    cells: Vec<f64>,
}

/// Where some columns are.
pub(super) type Columns<const N: usize> = [usize; N];

impl Row {
    /// The numbers in some columns, absent ones as NaN.
    pub(super) fn pick<const N: usize>(&self, columns: &Columns<N>) -> [f64; N] {
        columns.map(|column| self.cells[column])
    }

    /// The motion in its columns.
    pub(super) fn motion(&self, columns: &Columns<13>) -> Logged {
        Logged(self.pick(columns))
    }

    /// The numbers in any columns.
    pub(super) fn list(&self, columns: &[usize]) -> Vec<f64> {
        columns.iter().map(|column| self.cells[*column]).collect()
    }

    /// For messages: its line in the file.
    pub(super) fn name(&self) -> String {
        format!("line {}", self.line)
    }
}

impl Table {
    /// Reads a file.
    ///
    /// # Errors
    /// When it cannot be had as text, has no header, a column twice, a row of another length, or a cell that is
    /// neither a finite number nor `nan`.
    pub(super) fn read(path: &Path) -> Result<Self, RecordingError> {
        let text = text_of(path)?;
        let mut lines = text.trim_end().lines();
        let header = lines.next().unwrap_or_default().trim_start_matches('\u{feff}');
        let header: Vec<String> = header.split(',').map(|name| name.trim().to_owned()).collect();
        let mut table = Self { path: path.to_owned(), header, rows: Vec::new() };
        table.check_header()?;
        for (index, line) in lines.enumerate() {
            let row = table.row(index + 2, line)?;
            table.rows.push(row);
        }
        Ok(table)
    }

    fn check_header(&self) -> Result<(), RecordingError> {
        if let Some(cell) = self.header.iter().find(|cell| cell.is_empty() || cell.parse::<f64>().is_ok()) {
            return Err(self.refuse(1, format_args!("`{cell}`"), "names of columns"));
        }
        let twice = (1..self.header.len()).find(|index| self.header[..*index].contains(&self.header[*index]));
        twice.map_or(Ok(()), |index| {
            Err(self.refuse(1, format_args!("the column `{}` a second time", self.header[index]), "each once"))
        })
    }

    fn row(&self, line: usize, text: &str) -> Result<Row, RecordingError> {
        let mut cells = Vec::with_capacity(self.header.len());
        for cell in text.split(',') {
            match cell.trim().parse::<f64>() {
                Ok(number) if !number.is_infinite() => cells.push(number),
                Ok(_) | Err(_) => {
                    let column = self.header.get(cells.len()).map_or("beyond the header", String::as_str);
                    let shown: String = cell.chars().take(40).collect();
                    return Err(self.refuse(
                        line,
                        format_args!("`{shown}` in column {column}"),
                        "a number or `nan`",
                    ));
                }
            }
        }
        if cells.len() == self.header.len() {
            return Ok(Row { line, cells });
        }
        Err(self.refuse(line, format_args!("{} cells", cells.len()), format_args!("{}", self.header.len())))
    }

    /// The rows in the order of the file.
    pub(super) fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// The message that `found` stands in a line instead of `expected`.
    pub(super) fn refuse(
        &self,
        line: usize,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> RecordingError {
        RecordingError::at(format_args!("{}:{line}", self.path.display()), found, expected)
    }

    /// The message that `found` stands in a row instead of `expected`.
    pub(super) fn refuse_row(
        &self,
        row: &Row,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> RecordingError {
        self.refuse(row.line, found, expected)
    }

    fn position(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|column| column == name)
    }

    /// Whether there is a column of that name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.position(name).is_some()
    }

    /// Where the columns are.
    ///
    /// # Errors
    /// The first that is missing.
    pub(super) fn columns<const N: usize>(&self, names: [&str; N]) -> Result<Columns<N>, RecordingError> {
        let mut columns = [0; N];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = self.column(name)?;
        }
        Ok(columns)
    }

    /// Where one column is.
    ///
    /// # Errors
    /// When it is missing.
    pub(super) fn column(&self, name: &str) -> Result<usize, RecordingError> {
        self.position(name).ok_or_else(|| self.refuse(1, format_args!("no column `{name}`"), "one"))
    }

    /// Where the columns are, if the first of them is there.
    ///
    /// # Errors
    /// When one of the others is missing then.
    pub(super) fn optional<const N: usize>(&self, names: [&str; N]) -> Result<Option<Columns<N>>, RecordingError> {
        if names.first().is_some_and(|name| self.has(name)) { self.columns(names).map(Some) } else { Ok(None) }
    }

    /// Where a motion is, whose columns end in `suffix`.
    ///
    /// # Errors
    /// The first column that is missing.
    pub(super) fn motion(&self, suffix: &str) -> Result<Columns<13>, RecordingError> {
        let mut columns = [0; 13];
        for (column, name) in columns.iter_mut().zip(MOTION) {
            *column = self.column(&format!("{name}{suffix}"))?;
        }
        Ok(columns)
    }

    /// The columns of a matrix of four rows, `a0` to `a15`.
    ///
    /// # Errors
    /// The first column that is missing.
    pub(super) fn sixteen(&self, prefix: &str) -> Result<Columns<16>, RecordingError> {
        let mut columns = [0; 16];
        for (index, column) in columns.iter_mut().enumerate() {
            *column = self.column(&format!("{prefix}{index}"))?;
        }
        Ok(columns)
    }

    /// The columns `a0`, `a1`, … of a prefix, as many as there are.
    pub(super) fn numbered(&self, prefix: &str) -> Vec<usize> {
        (0..).map_while(|index| self.position(&format!("{prefix}{index}"))).collect()
    }

    /// The columns that begin with `prefix`, in the order of the file, with the rest of their names.
    pub(super) fn prefixed(&self, prefix: &str) -> Vec<(usize, &str)> {
        let rest = |(index, name): (usize, &'_ String)| name.strip_prefix(prefix).map(|_| index);
        let found = self.header.iter().enumerate().filter_map(rest);
        found.map(|index| (index, &self.header[index][prefix.len()..])).collect()
    }

    /// Numbers that a comparison starts from: none may be absent.
    ///
    /// # Errors
    /// The first that is.
    pub(super) fn given<const N: usize>(
        &self,
        row: &Row,
        columns: &Columns<N>,
    ) -> Result<[f64; N], RecordingError> {
        match columns.iter().find(|column| row.cells[**column].is_nan()) {
            None => Ok(row.pick(columns)),
            Some(column) => {
                Err(self.refuse_row(row, format_args!("`nan` in column {}", self.header[*column]), "a number"))
            }
        }
    }

    /// As [`Self::given`], of any number of columns.
    ///
    /// # Errors
    /// The first number that is absent.
    pub(super) fn given_list(&self, row: &Row, columns: &[usize]) -> Result<Vec<f64>, RecordingError> {
        columns.iter().map(|column| self.given(row, &[*column]).map(|[number]| number)).collect()
    }

    /// A motion that a flight starts from.
    ///
    /// # Errors
    /// When a number is absent or the quaternion is none.
    pub(super) fn start(&self, row: &Row, columns: &Columns<13>) -> Result<Logged, RecordingError> {
        let logged = Logged(self.given(row, columns)?);
        let norm = logged.quaternion_norm();
        if (norm - 1.0).abs() < 1e-6 {
            return Ok(logged);
        }
        Err(self.refuse_row(row, format_args!("a quaternion of norm {norm}"), "one of norm 1"))
    }

    /// A whole number from zero, such as a step.
    ///
    /// # Errors
    /// When it is something else.
    pub(super) fn whole(&self, row: &Row, column: usize) -> Result<usize, RecordingError> {
        let number = row.cells[column];
        if number >= 0.0 && number.fract() == 0.0 && number < 1e9 {
            return Ok(number as usize);
        }
        let found = format_args!("{number} in column {}", self.header[column]).to_string();
        Err(self.refuse_row(row, found, "a whole number, zero or more"))
    }

    /// A truth, written 0 or 1.
    ///
    /// # Errors
    /// When it is something else.
    pub(super) fn truth(&self, row: &Row, column: usize) -> Result<bool, RecordingError> {
        match self.whole(row, column)? {
            0 => Ok(false),
            1 => Ok(true),
            other => {
                let found = format!("{other} in column {}", self.header[column]);
                Err(self.refuse_row(row, found, "0 or 1"))
            }
        }
    }
}
