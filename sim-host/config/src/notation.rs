//! Files that are not YAML, as the tree that they would be in YAML.

use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;

use crate::document::parsed;
use crate::error::{ConfigError, Place, Source};
use crate::node::Node;

/// What configurations are written in beside YAML.
pub trait Notations {
    /// The tree in a text, if its notation is not YAML.
    fn text(_source: &Arc<Source>) -> Option<Result<Node, ConfigError>> {
        None
    }

    /// The tree of an imported file that is no such text, and how long that is \[bytes\].
    ///
    /// # Errors
    /// When the file is damaged or cannot be imported there.
    fn file(_file: &ImportedFile<'_>) -> Result<Option<(Node, usize)>, ConfigError> {
        Ok(None)
    }
}

/// Nothing beside YAML.
#[derive(Clone, Copy, Debug)]
pub struct Yaml;

impl Notations for Yaml {}

/// A file that is imported at a place of a configuration.
#[derive(Clone, Copy, Debug)]
pub struct ImportedFile<'a> {
    /// Where it is.
    pub path: &'a Path,
    /// Where the path stands.
    pub importer: &'a Place,
    /// Dotted path of the key `import`, for messages.
    pub key: &'a str,
    /// The key of the mapping that imports it; none at the top level.
    pub mapping_key: Option<&'a str>,
}

impl ImportedFile<'_> {
    /// Refuses the file, where its path stands.
    pub fn refuse(&self, found: impl Display, expected: impl Display) -> ConfigError {
        ConfigError::at(self.importer, self.key, format!("{found} ({})", self.path.display()), expected)
    }

    /// The beginning of the file: where the values stand that are read from it as a whole.
    pub fn beginning(&self) -> Place {
        let name = self.path.display().to_string();
        let source = Source::File { name, text: String::new(), importer: Some(self.importer.clone()) };
        Place { source: Arc::new(source), line: 1, column: 1 }
    }
}

/// The values in a text.
pub(crate) fn tree_of<N: Notations>(source: &Arc<Source>) -> Result<Node, ConfigError> {
    N::text(source).unwrap_or_else(|| parsed(source).map_err(|fault| fault.in_file(source)))
}
