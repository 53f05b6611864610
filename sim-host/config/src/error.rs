//! What is wrong with a configuration, said once: where, what was found, what was expected.

use std::fmt;
use std::sync::Arc;

/// Longest line that is quoted in a message \[characters\].
const EXCERPT_LIMIT: usize = 160;

/// A configuration that cannot be used; the message is complete and meant for people.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be had as text.
    #[error("{path}: found {found}, expected {expected}")]
    Unreadable {
        /// The file as the user named it.
        path: String,
        /// What is there instead.
        found: String,
        /// What should be there.
        expected: String,
    },
    /// The text is not a configuration that makes sense.
    #[error("{place}: {key}found {found}, expected {expected}{excerpt}", key = prefix(key))]
    Invalid {
        /// `file:line:column`, or the override.
        place: String,
        /// Dotted path of the key, empty at the top level.
        key: String,
        /// What was written.
        found: String,
        /// What should have been.
        expected: String,
        /// The line in question with a mark below it and the imports that led to it, or nothing; starts with a line
        /// break.
        excerpt: String,
    },
}

fn prefix(key: &str) -> String {
    if key.is_empty() { String::new() } else { format!("{key}: ") }
}

impl ConfigError {
    /// The message that `found` is at a place, under a dotted path of keys, instead of `expected`.
    pub fn at(place: &Place, key: &str, found: impl fmt::Display, expected: impl fmt::Display) -> Self {
        Self::Invalid {
            place: place.to_string(),
            key: place.source.shown_key(key),
            found: found.to_string(),
            expected: expected.to_string(),
            excerpt: place.context(),
        }
    }
}

/// A text that configuration comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// A file.
    File {
        /// What messages call it.
        name: String,
        /// All of it; empty where messages cannot quote it.
        text: String,
        /// Where the path stands through which it was imported.
        importer: Option<Place>,
    },
    /// `key=value` from the command line.
    Override {
        /// As it was written.
        assignment: String,
        /// What stands before the first `=`.
        key: String,
    },
}

impl Source {
    /// Where this file was imported, if it was.
    fn importer(&self) -> Option<&Place> {
        match self {
            Self::File { importer, .. } => importer.as_ref(),
            Self::Override { .. } => None,
        }
    }

    /// An override already names its key: repeating it would not help.
    fn shown_key(&self, key: &str) -> String {
        match self {
            Self::Override { key: own, .. } if own == key => String::new(),
            Self::Override { .. } | Self::File { .. } => key.to_owned(),
        }
    }
}

/// A position in a [`Source`]; lines and columns count from one.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// The text.
    pub source: Arc<Source>,
    /// From one.
    pub line: usize,
    /// From one \[characters\].
    pub column: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &*self.source {
            Source::File { name, .. } => write!(formatter, "{name}:{}:{}", self.line, self.column),
            Source::Override { assignment, .. } => write!(formatter, "--set {assignment}"),
        }
    }
}

impl Place {
    /// Places of the imports through which the file came, the nearest first.
    fn importers(&self) -> impl Iterator<Item = &Self> {
        std::iter::successors(self.source.importer(), |place| place.source.importer())
    }

    /// Whether the file was imported.
    pub(crate) fn is_imported(&self) -> bool {
        self.source.importer().is_some()
    }

    /// Whether the file came through the import at `import`.
    pub(crate) fn came_through(&self, import: &Self) -> bool {
        let at = |place: &Self| (place.line, place.column);
        self.importers().any(|place| Arc::ptr_eq(&place.source, &import.source) && at(place) == at(import))
    }

    /// The quoted line and the chain of imports that led there.
    fn context(&self) -> String {
        self.importers().fold(self.excerpt(), |text, place| format!("{text}\n  imported by {place}"))
    }

    /// The quoted line with a mark below the column; nothing where that would not help.
    fn excerpt(&self) -> String {
        let Source::File { text, .. } = &*self.source else { return String::new() };
        let Some(line) = text.lines().nth(self.line.saturating_sub(1)) else { return String::new() };
        if line.trim().is_empty() || line.chars().count() > EXCERPT_LIMIT {
            return String::new();
        }
        let line: String = line.chars().map(|each| if each.is_control() { ' ' } else { each }).collect();
        let number = self.line.to_string();
        let margin = " ".repeat(number.len());
        let indent = " ".repeat(self.column.saturating_sub(1));
        format!("\n  {number} | {}\n  {margin} | {indent}^", line.trim_end())
    }
}
