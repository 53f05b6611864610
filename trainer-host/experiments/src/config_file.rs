//! What experiment, study and search files have in common: versions, overrides, and their resolved form.

use kestrel_sim::config::{ConfigError, Document};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// A kind of configuration file.
pub(crate) trait ConfigFile: DeserializeOwned + Serialize {
    /// Version of the file format that this program reads.
    const VERSION: u32;

    /// Written above the resolved form.
    const HEADER: &'static str;

    /// The whole configuration as YAML, with every import resolved and every default filled in.
    fn resolved(&self) -> String {
        let yaml = serde_yaml::to_string(self).expect("plain structs of numbers and names are YAML");
        format!("{}{yaml}", Self::HEADER)
    }

    /// The resolved form, as this program writes it, of one that an earlier program may have written: with defaults of
    /// keys that are new, and under their new names. What is no such file stays as it is.
    fn resolved_again(saved: &str) -> String {
        let config = Document::parse("saved", saved).and_then(|document| document.decode::<Self>());
        config.map_or_else(|_| saved.to_owned(), |config| config.resolved())
    }

    /// The document after `overrides` such as `training.epochs=3`.
    ///
    /// # Errors
    /// For another version, or an override that is none.
    fn overridden(mut document: Document, overrides: &[String]) -> Result<Document, ConfigError> {
        document.require_version(Self::VERSION)?;
        for assignment in overrides {
            document.set(assignment)?;
        }
        document.require_version(Self::VERSION)?;
        Ok(document)
    }
}
