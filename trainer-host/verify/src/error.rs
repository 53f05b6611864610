//! What is wrong with a recording, said once: where, what was found, what was expected.

use std::fmt::Display;
use std::path::Path;

/// A recording that cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{place}: found {found}, expected {expected}")]
pub struct RecordingError {
    place: String,
    found: String,
    expected: String,
}

impl RecordingError {
    /// About a whole file or folder.
    pub(super) fn about(path: &Path, found: impl Display, expected: impl Display) -> Self {
        Self::at(path.display(), found, expected)
    }

    /// About a place that is already in words, such as `index.json:12`.
    pub(super) fn at(place: impl Display, found: impl Display, expected: impl Display) -> Self {
        Self { place: place.to_string(), found: found.to_string(), expected: expected.to_string() }
    }

    /// What `serde_json` says about a text that begins at `first_line` of `file`, in the words of the other messages.
    pub(super) fn json(file: &Path, first_line: usize, case: &str, error: &serde_json::Error) -> Self {
        let line = first_line + error.line().saturating_sub(1);
        let message = error.to_string();
        let said = message.split_once(" at line ").map_or(message.as_str(), |(said, _)| said);
        let (found, expected) = in_words(said);
        let of_case = if case.is_empty() { String::new() } else { format!(" (case `{case}`)") };
        Self::at(format_args!("{}:{line}{of_case}", file.display()), found, expected)
    }
}

/// Found and expected, as far as the parser tells them apart.
fn in_words(said: &str) -> (String, String) {
    if let Some(field) = said.strip_prefix("missing field ") {
        return (format!("no key {field}"), "one".to_owned());
    }
    let plain = ["invalid type: ", "invalid value: ", "invalid length ", "unknown variant "];
    let known = plain.iter().find_map(|prefix| Some((prefix, said.strip_prefix(prefix)?)));
    match known.and_then(|(prefix, rest)| Some((prefix, rest.split_once(", expected ")?))) {
        Some((&"invalid length ", (found, expected))) => (format!("a length of {found}"), expected.to_owned()),
        Some((_, (found, expected))) => (found.to_owned(), expected.to_owned()),
        None => (format!("a syntax error ({said})"), "JSON".to_owned()),
    }
}
