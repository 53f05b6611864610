//! Lists of cases: `index.json` of a recording, every case with its line.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;

use super::error::RecordingError;
use super::file::{line_of, text_of};
use super::motion::Clock;

/// Fastest physics that is believed \[Hz\].
const FREQUENCY_LIMIT: u64 = 1_000_000;

/// A JSON text whose parts know their lines.
#[derive(Clone, Debug)]
pub(super) struct Json {
    path: PathBuf,
    text: String,
}

/// One part of a [`Json`] text.
#[derive(Clone, Debug)]
pub(super) struct Part<'a> {
    json: &'a Json,
    /// What messages call it; empty for the whole.
    name: String,
    range: Range<usize>,
}

#[derive(Deserialize)]
struct Listing<'a> {
    #[serde(borrow)]
    cases: Vec<&'a RawValue>,
}

#[derive(Deserialize)]
struct Heading {
    id: String,
    kind: Option<String>,
}

/// One entry of a list of cases.
#[derive(Clone, Debug)]
pub(super) struct Case<'a> {
    pub(super) id: String,
    pub(super) kind: Option<String>,
    pub(super) part: Part<'a>,
}

impl Json {
    /// Reads a file.
    ///
    /// # Errors
    /// When it cannot be had as text.
    pub(super) fn read(path: &Path) -> Result<Self, RecordingError> {
        Ok(Self { path: path.to_owned(), text: text_of(path)? })
    }

    /// All of it.
    pub(super) fn whole(&self) -> Part<'_> {
        Part { json: self, name: String::new(), range: 0..self.text.len() }
    }

    /// The entries of its list `cases`.
    ///
    /// # Errors
    /// When there is none, or an entry has no proper `id`.
    pub(super) fn cases(&self) -> Result<Vec<Case<'_>>, RecordingError> {
        let refuse = |error: serde_json::Error| RecordingError::json(&self.path, 1, "", &error);
        let listing: Listing<'_> = serde_json::from_str(&self.text).map_err(refuse)?;
        listing.cases.into_iter().map(|raw| self.case(raw)).collect()
    }

    fn case(&self, raw: &RawValue) -> Result<Case<'_>, RecordingError> {
        let mut part = self.part("", raw);
        let Heading { id, kind } = part.decode()?;
        part.name.clone_from(&id);
        let plain = |letter: char| letter.is_alphanumeric() || matches!(letter, '-' | '_' | '+' | '.');
        if id.is_empty() || id.starts_with('.') || !id.chars().all(plain) {
            return Err(part.refuse(format_args!("the id {id:?}"), "one that can name a file"));
        }
        Ok(Case { id, kind, part })
    }

    /// The part that a raw value borrowed from [`Self::text`] is.
    fn part(&self, name: &str, raw: &RawValue) -> Part<'_> {
        let start = raw.get().as_ptr() as usize - self.text.as_ptr() as usize;
        Part { json: self, name: name.to_owned(), range: start..start + raw.get().len() }
    }
}

impl<'a> Part<'a> {
    /// The text.
    pub(super) fn text(&self) -> &'a str {
        &self.json.text[self.range.clone()]
    }

    /// What messages call it.
    pub(super) fn name(&self) -> &str {
        &self.name
    }

    fn line(&self) -> usize {
        line_of(self.json.text.as_bytes(), self.range.start)
    }

    /// As a type.
    ///
    /// # Errors
    /// When it is something else.
    pub(super) fn decode<T: DeserializeOwned>(&self) -> Result<T, RecordingError> {
        serde_json::from_str(self.text())
            .map_err(|error| RecordingError::json(&self.json.path, self.line(), &self.name, &error))
    }

    /// The values of a mapping by their keys.
    ///
    /// # Errors
    /// When it is something else.
    pub(super) fn entries(&self) -> Result<Vec<(String, Part<'a>)>, RecordingError> {
        let text = self.text();
        let entries: std::collections::BTreeMap<String, &RawValue> = serde_json::from_str(text)
            .map_err(|error| RecordingError::json(&self.json.path, self.line(), &self.name, &error))?;
        Ok(entries.into_iter().map(|(key, raw)| (key.clone(), self.json.part(&key, raw))).collect())
    }

    /// The message that `found` is here instead of `expected`.
    pub(super) fn refuse(
        &self,
        found: impl std::fmt::Display,
        expected: impl std::fmt::Display,
    ) -> RecordingError {
        let of_case = if self.name.is_empty() { String::new() } else { format!(" (case `{}`)", self.name) };
        RecordingError::at(format_args!("{}:{}{of_case}", self.json.path.display(), self.line()), found, expected)
    }

    /// The clock of two rates \[Hz\].
    ///
    /// # Errors
    /// When the physics does not run a whole number of times per control step.
    pub(super) fn clock(&self, physics: u64, control: u64) -> Result<Clock, RecordingError> {
        let whole = control > 0 && physics >= control && physics.is_multiple_of(control);
        if !whole || physics > FREQUENCY_LIMIT {
            let found = format!("{physics} physics and {control} control steps per second");
            return Err(self.refuse(found, "a whole number of physics steps per control step, at most 1 MHz"));
        }
        Ok(Clock { step_secs: 1.0 / physics as f64, substeps: (physics / control) as usize })
    }
}
