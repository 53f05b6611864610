//! Configurations in YAML: every value knows its line, any mapping may import a file, and overrides come on top.
//!
//! A [`Document`] is a file with what it imports, changed by overrides such as `training.epochs=3`. It is decoded into a
//! type of serde, whose values are then checked through a [`Field`]: what is wrong becomes a [`ConfigError`] that names
//! file, line and key, what was found and what was expected. [`schema_of`] writes the JSON schema for editors.
//!
//! ```
//! use kestrel_config::{ConfigError, Document, Limits};
//!
//! #[derive(serde::Deserialize)]
//! #[serde(deny_unknown_fields)]
//! struct Room {
//!     width_m: f64,
//! }
//!
//! fn width(document: &Document) -> Result<f32, ConfigError> {
//!     let room: Room = document.decode()?;
//!     document.root().at("width_m").number(room.width_m, &Limits::above(0.0, 100.0, "m"))
//! }
//!
//! let mut document: Document = Document::parse("room.yaml", "width_m: 4")?;
//! assert_eq!(width(&document)?, 4.0);
//! document.set("width_m=-1")?;
//! let message = width(&document).unwrap_err().to_string();
//! assert_eq!(message, "--set width_m=-1: found -1, expected a number above 0, at most 100 m");
//! # Ok::<(), ConfigError>(())
//! ```

mod decode;
mod document;
pub mod error;
pub mod field;
mod import;
pub mod node;
pub mod notation;
mod schema;
pub mod text;

pub use document::Document;
pub use error::ConfigError;
pub use field::{Field, Limits};
pub use import::Library;
pub use schema::schema_of;
