//! A configuration file: read with care, changed by overrides, decoded into a type.

use std::path::Path;
use std::sync::Arc;

use serde::de::DeserializeOwned;
use serde_yaml::{Error as YamlError, Location, Options};

use crate::error::{ConfigError, Place, Source};
use crate::field::Field;
use crate::import::{IMPORT, Imports};
use crate::node::{Entry, Node, Parsed, Value, either, place, raised};
use crate::notation::{Notations, Yaml, tree_of};
use crate::text::{Unreadable, read_text};

/// Deepest nesting; the deepest valid configuration has eight.
const DEPTH_LIMIT: usize = 48;

/// Most values, counted with every alias written out; the examples have about two hundred.
const NODE_LIMIT: usize = 100_000;

/// A parsed configuration in which every value knows its line.
///
/// Any mapping may hold `import: PATH`: it then is the mapping of that file, with its own other keys laid over it. Files
/// are YAML, or what else the notations `N` read.
#[derive(Clone, Debug)]
pub struct Document<N = Yaml> {
    root: Node,
    imports: Imports<N>,
}

impl<N: Notations> Document<N> {
    /// Reads and parses a file and what it imports.
    ///
    /// # Errors
    /// When a file is not there, a directory, larger than 8 MiB, not UTF-8, or not one YAML mapping; when files import
    /// each other in a circle, or more than 8 in a chain.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let name = path.display().to_string();
        let text = read_text(path).map_err(|fault| refused(&name, &fault))?;
        Self::parse(&name, &text)
    }

    /// Parses YAML; `name` is what messages call it, and imports are relative to it as a path.
    ///
    /// # Errors
    /// When the text is empty or not one YAML mapping with unique keys, or an import fails as in [`Self::read`].
    pub fn parse(name: &str, text: &str) -> Result<Self, ConfigError> {
        let source = Arc::new(Source::File { name: name.to_owned(), text: text.to_owned(), importer: None });
        let root = tree_of::<N>(&source)?;
        match &root.value {
            Value::Mapping(_) => {
                let mut imports = Imports::of(Path::new(name));
                let trail = imports.trail(&[]);
                Ok(Self { root: imports.expand(root, &trail)?, imports })
            }
            Value::Nothing => {
                Err(ConfigError::at(&root.place, "", "an empty file", "keys such as `version` and `name`"))
            }
            other @ (Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_) | Value::List(_)) => {
                Err(ConfigError::at(&root.place, "", other, "keys such as `version` and `name`"))
            }
        }
    }

    /// Whether it has this key at its top level.
    pub fn holds(&self, key: &str) -> bool {
        self.root.child(key).is_some()
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
        let newer = match version.value {
            Value::Whole(found) if found == i128::from(supported) => return Ok(()),
            Value::Whole(found) => found > i128::from(supported),
            Value::Nothing
            | Value::Truth(_)
            | Value::Number(..)
            | Value::Text(_)
            | Value::List(_)
            | Value::Mapping(_) => false,
        };
        let expected = if newer { format!("{this} (a newer Kestrel wrote the file)") } else { this };
        Err(ConfigError::at(&version.place, "version", &version.value, expected))
    }

    /// Applies one override, `training.epochs=3`: a dotted path and a YAML value. Items of a list are called by their index,
    /// from zero, or by their name: `scenario.rewards.proximity.weight=2`.
    ///
    /// `scenario.aviary.import=PATH` replaces the file that is imported there and keeps what was laid over it; the path
    /// is relative to the configuration.
    ///
    /// # Errors
    /// When the text is not `key=value`, the value is not YAML, the path leads through something without keys, or an
    /// import fails as in [`Self::read`].
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
        let node = parsed_text(value, &source).map_err(|fault| fault.in_override(&place, key))?.moved_to(&place);
        let steps: Vec<&str> = key.split('.').collect();
        if let Some((&IMPORT, mapping)) = steps.split_last() {
            return self.set_import(mapping, &node);
        }
        let node = self.imports.expand(node, &self.imports.trail(&steps))?;
        *target(&mut self.root, &steps, &place)? = node;
        Ok(())
    }

    /// Replaces what the mapping at `steps` imports.
    fn set_import(&mut self, steps: &[&str], import: &Node) -> Result<(), ConfigError> {
        let trail = self.imports.trail(steps);
        let place = &import.place;
        let mapping = target(&mut self.root, steps, place)?;
        let empty = Node { value: Value::Mapping(Vec::new()), place: place.clone(), import: None };
        let written = match (&mapping.value, mapping.import.take()) {
            (Value::Mapping(_), Some(earlier)) => mapping.clone().without(&earlier).unwrap_or(empty),
            (Value::Mapping(_), None) => mapping.clone(),
            (Value::Nothing, _) => empty,
            (
                other @ (Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_) | Value::List(_)),
                _,
            ) => {
                let found = format!("{other} at `{}`", steps.join("."));
                return Err(ConfigError::at(place, &trail.key(), found, "keys, of which one is `import`"));
            }
        };
        *mapping = written.over(self.imports.load(import, &trail)?);
        Ok(())
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

/// The message about a configuration that is no text.
fn refused(name: &str, fault: &Unreadable) -> ConfigError {
    let expected = match fault {
        Unreadable::Missing => "a configuration (.yaml)",
        Unreadable::Folder => "a configuration file (.yaml)",
        Unreadable::Long(_) => "a configuration, which is a few KiB long",
        Unreadable::Broken(_) => "a readable configuration",
        Unreadable::Bytes { line, column, .. } => {
            return ConfigError::Invalid {
                place: format!("{name}:{line}:{column}"),
                key: String::new(),
                found: fault.to_string(),
                expected: "text in UTF-8".to_owned(),
                excerpt: String::new(),
            };
        }
    };
    ConfigError::Unreadable { path: name.to_owned(), found: fault.to_string(), expected: expected.to_owned() }
}

/// Text that is not YAML.
pub(crate) struct SyntaxFault {
    error: Box<YamlError>,
}

impl SyntaxFault {
    pub(crate) fn in_file(&self, source: &Arc<Source>) -> ConfigError {
        let location = self.error.location().unwrap_or(Location::UNKNOWN);
        let (found, expected) = self.said();
        ConfigError::at(&place(source, location), "", found, expected)
    }

    fn in_override(&self, place: &Place, key: &str) -> ConfigError {
        let (found, expected) = self.said();
        ConfigError::at(place, key, found, expected)
    }

    /// What was found and what was expected, in words for people who write configurations.
    #[expect(clippy::wildcard_enum_match_arm, reason = "the parser's errors may become more")]
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
    let error = error.without_snippet();
    if let YamlError::AliasError { error, .. } = error { innermost(error) } else { error }
}

/// The parser's message without its ` at line 3, column 4`: the place is said in front.
fn without_place(message: &str) -> &str {
    message.split_once(" at line ").map_or(message, |(said, _)| said)
}

/// The tree of a whole source.
pub(crate) fn parsed(source: &Arc<Source>) -> Result<Node, SyntaxFault> {
    match &**source {
        Source::File { text, .. } | Source::Override { assignment: text, .. } => parsed_text(text, source),
    }
}

fn parsed_text(text: &str, source: &Arc<Source>) -> Result<Node, SyntaxFault> {
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

/// The node at `steps`, with the mappings on the way that are not there yet made by whoever writes at `place`.
fn target<'a>(root: &'a mut Node, steps: &[&str], place: &Place) -> Result<&'a mut Node, ConfigError> {
    let mut target = root;
    for (walked, step) in steps.iter().enumerate() {
        target = descend(target, step, place).map_err(|(found, expected)| {
            let key =
                if walked == 0 { "the top level".to_owned() } else { format!("`{}`", steps[..walked].join(".")) };
            ConfigError::at(place, &steps.join("."), format!("{found} at {key}"), expected)
        })?;
    }
    Ok(target)
}

/// The one item of a list with this name: what stands below its only key, or the whole item with this `name`. Of two that
/// are called the same nobody knows which is meant.
fn named<'a>(items: &'a mut [Node], name: &str) -> Option<&'a mut Node> {
    let mut called = items.iter_mut().filter_map(|item| {
        if matches!(&item.value, Value::Mapping(entries) if has_name(entries, name)) {
            return Some(item);
        }
        let Value::Mapping(entries) = &mut item.value else { return None };
        let [only] = entries.as_mut_slice() else { return None };
        (only.key == name).then_some(&mut only.node)
    });
    let only = called.next();
    if called.next().is_some() { None } else { only }
}

fn has_name(entries: &[Entry], name: &str) -> bool {
    entries.iter().any(|entry| entry.key == "name" && entry.node.value == Value::Text(name.to_owned()))
}

/// The child at `step`, made if `node` is a mapping or nothing; otherwise what was found and expected.
fn descend<'a>(node: &'a mut Node, step: &str, place: &Place) -> Result<&'a mut Node, (String, String)> {
    let found = node.value.to_string();
    if node.value == Value::Nothing {
        *node = Node { value: Value::Mapping(Vec::new()), place: place.clone(), import: None };
    }
    match &mut node.value {
        Value::Mapping(entries) => Ok(raised(entries, step, place)),
        Value::List(items) => {
            let expected = format!("an index below {}, or the name of one, instead of `{step}`", items.len());
            let item = match step.parse::<usize>() {
                Ok(index) => items.get_mut(index),
                Err(_) => named(items, step),
            };
            item.ok_or((found, expected))
        }
        Value::Nothing | Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_) => {
            Err((found, format!("keys, of which one is {}", either(&[step], "or"))))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    const SHOP: &str = "
shelves:
  - oak: { wide: 1 }
  - elm: { wide: 2 }
  - elm: { wide: 3 }
  - { name: ash, wide: 4 }
";

    #[derive(Debug, Default, PartialEq, serde::Deserialize)]
    #[serde(default)]
    struct Item {
        oak: BTreeMap<String, u32>,
        elm: BTreeMap<String, u32>,
        name: String,
        wide: u32,
    }

    fn shop(assignment: &str) -> Result<Vec<Item>, ConfigError> {
        let mut shop: Document = Document::parse("shop.yaml", SHOP)?;
        shop.set(assignment)?;
        Ok(shop.decode::<BTreeMap<String, Vec<Item>>>()?.remove("shelves").unwrap_or_default())
    }

    #[test]
    fn items_of_a_list_are_called_by_index_or_by_name() {
        let by = |key: &str| shop(&format!("shelves.{key}.wide=9")).unwrap();
        assert_eq!(by("oak"), by("0.oak"));
        assert_eq!(by("ash"), by("3"));
        assert_eq!((by("oak")[0].oak["wide"], by("ash")[3].wide), (9, 9));
        let expected = "found a list of 4 at `shelves`, expected an index below 4, or the name of one, instead of";
        // Two are called elm, and nothing fir.
        for name in ["elm", "fir", "4"] {
            let said = shop(&format!("shelves.{name}.wide=9")).unwrap_err().to_string();
            assert!(said.ends_with(&format!("{expected} `{name}`")), "{said}");
        }
    }
}
