//! A configuration as a tree in which every value knows where it was written.

use std::fmt;
use std::sync::Arc;

use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_yaml::{Location, Spanned};

use crate::error::{Place, Source};

/// A value and where it was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// The value.
    pub value: Value,
    /// Where it begins.
    pub place: Place,
    /// Where the path of the file stands that this mapping imports.
    pub import: Option<Place>,
}

/// What YAML can say.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Nothing, or `null`.
    Nothing,
    /// `true` or `false`.
    Truth(bool),
    /// A whole number.
    Whole(i128),
    /// A number with its spelling.
    Number(f64, String),
    /// Text.
    Text(String),
    /// A list.
    List(Vec<Node>),
    /// Keys with their values.
    Mapping(Vec<Entry>),
}

/// One `key: value` of a mapping.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The key.
    pub key: String,
    /// Where it stands.
    pub place: Place,
    /// The value.
    pub node: Node,
    /// How many layers of the same mapping it lies over: an alternative that lies higher replaces the others of a choice.
    pub(crate) layer: usize,
}

impl Node {
    /// A value that was left out at `place`.
    pub(crate) fn nothing(place: &Place) -> Self {
        Self { value: Value::Nothing, place: place.clone(), import: None }
    }

    /// The value below `step`: a key, or an index counted from zero.
    pub(crate) fn child(&self, step: &str) -> Option<&Self> {
        match &self.value {
            Value::Mapping(entries) => entries.iter().find(|entry| entry.key == step).map(|entry| &entry.node),
            Value::List(items) => items.get(step.parse::<usize>().ok()?),
            Value::Nothing | Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_) => None,
        }
    }
}

impl Node {
    /// The same value as if all of it was written at `place`.
    pub(crate) fn moved_to(self, place: &Place) -> Self {
        let value = match self.value {
            Value::List(items) => Value::List(items.into_iter().map(|item| item.moved_to(place)).collect()),
            Value::Mapping(entries) => {
                Value::Mapping(entries.into_iter().map(|entry| entry.moved_to(place)).collect())
            }
            scalar @ (Value::Nothing | Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_)) => {
                scalar
            }
        };
        Self { value, place: place.clone(), import: None }
    }

    /// This laid over `base`: mappings merge key by key, everything else replaces.
    pub(crate) fn over(self, base: Self) -> Self {
        let (mut below, above) = match (base.value, self.value) {
            (Value::Mapping(below), Value::Mapping(above)) => (below, above),
            (_, value) => return Self { value, ..self },
        };
        let layers = layers(&below);
        for entry in above {
            let layer = entry.layer + layers;
            match below.iter().position(|other| other.key == entry.key) {
                Some(index) => {
                    let covered = std::mem::replace(&mut below[index].node, Self::nothing(&entry.place));
                    below[index] = Entry { node: entry.node.over(covered), layer, ..entry };
                }
                None => below.push(Entry { layer, ..entry }),
            }
        }
        Self { value: Value::Mapping(below), place: self.place, import: self.import.or(base.import) }
    }

    /// What is left without all that came through the import at `import`.
    pub(crate) fn without(mut self, import: &Place) -> Option<Self> {
        let imported = self.place.came_through(import);
        if let Value::Mapping(entries) = self.value {
            let entries: Vec<Entry> = entries.into_iter().filter_map(|entry| entry.without(import)).collect();
            let left = !imported || !entries.is_empty();
            self.value = Value::Mapping(entries);
            return left.then_some(self);
        }
        (!imported).then_some(self)
    }
}

/// How many layers a mapping has.
fn layers(entries: &[Entry]) -> usize {
    entries.iter().map(|entry| entry.layer + 1).max().unwrap_or(0)
}

/// The one that lies over all others, if there is one.
pub(crate) fn topmost(entries: &[Entry]) -> Option<&Entry> {
    let layers = layers(entries);
    let mut top = entries.iter().filter(|entry| entry.layer + 1 == layers);
    top.next().filter(|_| top.next().is_none())
}

/// The value of the key as if it stood in the configuration's own file, over all that was imported; nothing yet if it was not
/// there.
pub(crate) fn raised<'a>(entries: &'a mut Vec<Entry>, key: &str, place: &Place) -> &'a mut Node {
    let own = entries.iter().any(|entry| !entry.place.is_imported());
    let layer = if own { layers(entries) - 1 } else { layers(entries) };
    let index = entries.iter().position(|entry| entry.key == key).unwrap_or_else(|| {
        entries.push(Entry::new(key.to_owned(), place.clone(), Node::nothing(place)));
        entries.len() - 1
    });
    entries[index].layer = layer;
    &mut entries[index].node
}

impl Entry {
    /// One that lies over nothing.
    pub fn new(key: String, place: Place, node: Node) -> Self {
        Self { key, place, node, layer: 0 }
    }

    fn without(self, import: &Place) -> Option<Self> {
        Some(Self { node: self.node.without(import)?, ..self })
    }

    fn moved_to(self, place: &Place) -> Self {
        Self { place: place.clone(), node: self.node.moved_to(place), ..self }
    }
}

/// How a message calls the value.
impl fmt::Display for Value {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => formatter.write_str("nothing"),
            Self::Truth(value) => write!(formatter, "{value}"),
            Self::Whole(value) => write!(formatter, "{value}"),
            Self::Number(_, text) => formatter.write_str(text),
            Self::Text(text) => write!(formatter, "the text {}", quoted(text)),
            Self::List(items) => write!(formatter, "a list of {}", items.len()),
            Self::Mapping(entries) if entries.is_empty() => formatter.write_str("no keys"),
            Self::Mapping(entries) => {
                let keys: Vec<_> = entries.iter().map(|entry| entry.key.as_str()).collect();
                write!(formatter, "the key{} {}", if keys.len() > 1 { "s" } else { "" }, either(&keys, "and"))
            }
        }
    }
}

/// Text as a message shows it: in quotes, escaped, not too long.
fn quoted(text: &str) -> String {
    const SHOWN: usize = 40;
    let cut: String = text.chars().take(SHOWN).collect();
    if cut.len() < text.len() { format!("{cut:?}…") } else { format!("{cut:?}") }
}

/// `` `a`, `b` or `c` ``, where `or` is the last word between.
pub(crate) fn either(names: &[&str], or: &str) -> String {
    let quoted: Vec<_> = names.iter().map(|name| format!("`{name}`")).collect();
    match quoted.as_slice() {
        [] => "none".to_owned(),
        [only] => only.clone(),
        [others @ .., last] => format!("{} {or} {last}", others.join(", ")),
    }
}

/// A node as the parser hands it over.
pub(crate) struct Parsed(Spanned<Content>);

enum Content {
    Nothing,
    Truth(bool),
    Whole(i128),
    Number(f64),
    Text(String),
    List(Vec<Parsed>),
    Mapping(Vec<(Spanned<String>, Parsed)>),
}

impl Parsed {
    /// The tree, with every place in `source`, whose text is `text`.
    pub(crate) fn settled(self, source: &Arc<Source>, text: &str) -> Node {
        let Spanned { value, defined, .. } = self.0;
        let value = match value {
            Content::Nothing => Value::Nothing,
            Content::Truth(truth) => Value::Truth(truth),
            Content::Whole(whole) => Value::Whole(whole),
            Content::Number(number) => Value::Number(number, spelling(number, defined, text)),
            Content::Text(words) => Value::Text(words),
            Content::List(items) => {
                Value::List(items.into_iter().map(|item| item.settled(source, text)).collect())
            }
            Content::Mapping(pairs) => Value::Mapping(
                pairs
                    .into_iter()
                    .map(|(key, value)| {
                        Entry::new(key.value, place(source, key.defined), value.settled(source, text))
                    })
                    .collect(),
            ),
        };
        Node { value, place: place(source, defined), import: None }
    }
}

pub(crate) fn place(source: &Arc<Source>, location: Location) -> Place {
    Place {
        source: Arc::clone(source),
        line: location.line().max(1) as usize,
        column: location.column().max(1) as usize,
    }
}

/// The number as its author spelled it, where the parser can tell.
fn spelling(number: f64, location: Location, text: &str) -> String {
    let span = location.span();
    span.byte_offset()
        .zip(span.byte_len())
        .and_then(|(start, length)| text.get(start as usize..(start + length) as usize))
        .map(str::trim)
        .filter(|spelled| !spelled.is_empty())
        .map_or_else(|| number.to_string(), str::to_owned)
}

impl<'de> Deserialize<'de> for Parsed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        Spanned::deserialize(deserializer).map(Self)
    }
}

impl<'de> Deserialize<'de> for Content {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ContentVisitor)
    }
}

struct ContentVisitor;

impl<'de> Visitor<'de> for ContentVisitor {
    type Value = Content;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a value")
    }

    fn visit_unit<E: Error>(self) -> Result<Content, E> {
        Ok(Content::Nothing)
    }

    fn visit_none<E: Error>(self) -> Result<Content, E> {
        Ok(Content::Nothing)
    }

    fn visit_bool<E: Error>(self, value: bool) -> Result<Content, E> {
        Ok(Content::Truth(value))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<Content, E> {
        Ok(Content::Whole(value.into()))
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<Content, E> {
        Ok(Content::Whole(value.into()))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Content, E> {
        Ok(Content::Number(value))
    }

    fn visit_str<E: Error>(self, value: &str) -> Result<Content, E> {
        Ok(Content::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut access: A) -> Result<Content, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = access.next_element()? {
            items.push(item);
        }
        Ok(Content::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Content, A::Error> {
        let mut entries = Vec::new();
        while let Some(entry) = access.next_entry()? {
            entries.push(entry);
        }
        Ok(Content::Mapping(entries))
    }
}
