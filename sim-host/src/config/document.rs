//! A configuration file: read with care, changed by overrides, decoded into a type.

use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::Path;
use std::sync::Arc;

use serde::de::DeserializeOwned;
use serde_yaml::{Error as YamlError, Location, Options};

use super::error::{ConfigError, Place, Source};
use super::field::Field;
use super::node::{Entry, Node, Parsed, Value, either, place};
use super::urdf;

/// Largest configuration file \[bytes\]; the examples have a few thousand.
const SIZE_LIMIT: u64 = 1 << 20;

/// Deepest nesting; the deepest valid configuration has eight.
const DEPTH_LIMIT: usize = 48;

/// Most values, counted with every alias written out; the examples have about two hundred.
const NODE_LIMIT: usize = 100_000;

/// A parsed configuration in which every value knows its line.
#[derive(Clone, Debug)]
pub struct Document {
    root: Node,
}

impl Document {
    /// Reads and parses a YAML file, or a URDF file as the airframe in it.
    ///
    /// # Errors
    /// When there is no such file, it is a directory, larger than 1 MiB, not UTF-8, or not one YAML mapping.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let name = path.display().to_string();
        Self::parse(&name, &text_of(path, &name)?)
    }

    /// Parses YAML; `name` is what messages call it.
    ///
    /// # Errors
    /// When the text is empty or not one YAML mapping with unique keys.
    pub fn parse(name: &str, text: &str) -> Result<Self, ConfigError> {
        let source = Arc::new(Source::File { name: name.to_owned(), text: text.to_owned() });
        let root = if is_urdf(name) {
            urdf::tree(&source, text)?
        } else {
            parsed(text, &source).map_err(|fault| fault.in_file(&source))?
        };
        let place = root.place.clone();
        match root.value {
            Value::Mapping(_) => Ok(Self { root }),
            Value::Nothing => {
                Err(ConfigError::at(&place, "", "an empty file", "keys such as `version` and `name`"))
            }
            other @ (Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_) | Value::List(_)) => {
                Err(ConfigError::at(&place, "", other, "keys such as `version` and `name`"))
            }
        }
    }

    /// Refuses a file made for another version of the program; the file says so in its key `version`.
    ///
    /// # Errors
    /// When `version` is missing or not `supported`.
    pub fn require_version(&self, supported: u32) -> Result<(), ConfigError> {
        let this = format!("`version: {supported}`, the only one that this program reads");
        let Some(version) = self.root.child("version") else {
            return Err(ConfigError::at(&self.root.place, "", "no key `version`", this));
        };
        match &version.value {
            Value::Whole(found) if *found == i128::from(supported) => Ok(()),
            Value::Whole(found) if *found > i128::from(supported) => {
                let newer = format!("{this} (a newer Kestrel wrote the file)");
                Err(ConfigError::at(&version.place, "version", found, newer))
            }
            other => Err(ConfigError::at(&version.place, "version", other, this)),
        }
    }

    /// Applies one override, `training.epochs=3`: a dotted path (list items by index, from zero) and a YAML value.
    ///
    /// # Errors
    /// When the text is not `key=value`, the value is not YAML, or the path leads through something without keys.
    pub fn set(&mut self, assignment: &str) -> Result<(), ConfigError> {
        let (key, value) = assignment.split_once('=').unwrap_or((assignment, ""));
        let key = key.trim();
        let source = Arc::new(Source::Override { assignment: assignment.to_owned(), key: key.to_owned() });
        let place = Place { source: Arc::clone(&source), line: 1, column: 1 };
        let refuse =
            |found: String| ConfigError::at(&place, key, found, "`key=value`, such as `training.epochs=3`");
        if !assignment.contains('=') {
            return Err(refuse("no `=`".to_owned()));
        }
        if key.split('.').any(str::is_empty) {
            return Err(refuse(format!("the key `{key}`")));
        }
        if value.trim().is_empty() {
            return Err(refuse("no value".to_owned()));
        }
        let node = parsed(value, &source).map_err(|fault| fault.in_override(&place, key))?;
        replace(&mut self.root, key, node.moved_to(&place))
    }

    /// The whole document as `T`, which need not check values, only their kinds.
    ///
    /// # Errors
    /// The first key that is unknown, missing, or of the wrong kind.
    pub fn decode<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        T::deserialize(&self.root).map_err(|fault| fault.into_error(&self.root.place))
    }

    /// The top level, to check values from.
    pub fn root(&self) -> Field<'_> {
        Field::root(&self.root)
    }
}

/// Whether a file is another form of an airframe's numbers.
fn is_urdf(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("urdf"))
}

/// The text of the file, however odd the file is.
fn text_of(path: &Path, name: &str) -> Result<String, ConfigError> {
    let refuse = |found: &str, expected: &str| ConfigError::Unreadable {
        path: name.to_owned(),
        found: found.to_owned(),
        expected: expected.to_owned(),
    };
    let broken = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => refuse("no such file", "a configuration, such as configs/hover.yaml"),
        _ => refuse(&format!("a file that cannot be read ({error})"), "a readable configuration"),
    };
    if path.is_dir() {
        return Err(refuse("a directory", "a configuration file, such as configs/hover.yaml"));
    }
    let mut bytes = Vec::new();
    File::open(path).and_then(|file| file.take(SIZE_LIMIT + 1).read_to_end(&mut bytes)).map_err(broken)?;
    if bytes.len() as u64 > SIZE_LIMIT {
        return Err(refuse("more than 1 MiB", "a configuration, which is a few KiB long"));
    }
    String::from_utf8(bytes).map_err(|error| not_text(&error, name))
}

fn not_text(error: &std::string::FromUtf8Error, name: &str) -> ConfigError {
    let valid = error.utf8_error().valid_up_to();
    let before = String::from_utf8_lossy(&error.as_bytes()[..valid]);
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|letter| *letter != '\n').count() + 1;
    ConfigError::Invalid {
        place: format!("{name}:{line}:{column}"),
        key: String::new(),
        found: format!("the byte 0x{:02x}", error.as_bytes()[valid]),
        expected: "text in UTF-8".to_owned(),
        excerpt: String::new(),
    }
}

/// Text that is not YAML.
struct SyntaxFault {
    error: Box<YamlError>,
}

impl SyntaxFault {
    fn in_file(&self, source: &Arc<Source>) -> ConfigError {
        let location = self.error.location().unwrap_or(Location::UNKNOWN);
        let (found, expected) = self.said();
        ConfigError::at(&place(source, location), "", found, expected)
    }

    fn in_override(&self, place: &Place, key: &str) -> ConfigError {
        let (found, expected) = self.said();
        ConfigError::at(place, key, found, expected)
    }

    /// What was found and what was expected, in words for people who write configurations.
    fn said(&self) -> (String, &'static str) {
        match innermost(&self.error) {
            YamlError::DuplicateMappingKey { key: Some(key), .. } => {
                (format!("the key `{key}` a second time"), "each key once")
            }
            YamlError::Eof { .. } => ("an empty file".to_owned(), "keys such as `version` and `name`"),
            YamlError::MultipleDocuments { .. } => ("a second document (`---`)".to_owned(), "one"),
            YamlError::UnknownAnchor { .. } => {
                ("an alias without its anchor".to_owned(), "`&name` before `*name`")
            }
            YamlError::Budget { .. }
            | YamlError::AliasReplayLimitExceeded { .. }
            | YamlError::AliasExpansionLimitExceeded { .. }
            | YamlError::AliasReplayStackDepthExceeded { .. } => {
                ("too many or too deeply nested values".to_owned(), "a plain configuration")
            }
            other => (format!("a syntax error ({})", without_place(&other.to_string())), "valid YAML"),
        }
    }
}

/// The error behind snippets and aliases.
fn innermost(error: &YamlError) -> &YamlError {
    match error.without_snippet() {
        YamlError::AliasError { error, .. } => innermost(error),
        other => other,
    }
}

/// The parser's message without its ` at line 3, column 4`: the place is said in front.
fn without_place(message: &str) -> &str {
    message.split_once(" at line ").map_or(message, |(said, _)| said)
}

fn parsed(text: &str, source: &Arc<Source>) -> Result<Node, SyntaxFault> {
    match serde_yaml::from_str_with_options::<Parsed>(text, options()) {
        Ok(node) => Ok(node.settled(source, text)),
        Err(error) => Err(SyntaxFault { error: Box::new(error) }),
    }
}

fn options() -> Options {
    serde_yaml::options! {
        budget: serde_yaml::budget! { max_depth: DEPTH_LIMIT, max_nodes: NODE_LIMIT },
        alias_limits: serde_yaml::alias_limits! { max_total_replayed_events: NODE_LIMIT },
        non_finite_float_policy: serde_yaml::options::NonFiniteFloatPolicy::PassThrough,
        strict_booleans: true,
    }
}

/// Puts `node` at `path`, making the mappings on the way that are not there yet.
fn replace(root: &mut Node, path: &str, node: Node) -> Result<(), ConfigError> {
    let place = node.place.clone();
    let mut target = root;
    let mut walked = Vec::new();
    for step in path.split('.') {
        target = descend(target, step, &place).map_err(|(found, expected)| {
            let key =
                if walked.is_empty() { "the top level".to_owned() } else { format!("`{}`", walked.join(".")) };
            ConfigError::at(&place, path, format!("{found} at {key}"), expected)
        })?;
        walked.push(step);
    }
    *target = node;
    Ok(())
}

/// The child at `step`, made if `node` is a mapping or nothing; otherwise what was found and expected.
fn descend<'a>(node: &'a mut Node, step: &str, place: &Place) -> Result<&'a mut Node, (String, String)> {
    let found = node.value.to_string();
    if node.value == Value::Nothing {
        *node = Node { value: Value::Mapping(Vec::new()), place: place.clone() };
    }
    match &mut node.value {
        Value::Mapping(entries) => Ok(entry(entries, step, place)),
        Value::List(items) => {
            let expected = format!("an index below {} instead of `{step}`", items.len());
            step.parse::<usize>().ok().and_then(|index| items.get_mut(index)).ok_or((found, expected))
        }
        Value::Nothing | Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_) => {
            Err((found, format!("keys, of which one is {}", either(&[step], "or"))))
        }
    }
}

fn entry<'a>(entries: &'a mut Vec<Entry>, key: &str, place: &Place) -> &'a mut Node {
    let index = entries.iter().position(|entry| entry.key == key).unwrap_or_else(|| {
        let node = Node { value: Value::Nothing, place: place.clone() };
        entries.push(Entry { key: key.to_owned(), place: place.clone(), node });
        entries.len() - 1
    });
    &mut entries[index].node
}
