//! From the tree to the types users write, with messages in the words of the configuration instead of Rust's.

use serde::de::value::StrDeserializer;
use serde::de::{
    self, DeserializeSeed, Deserializer, EnumAccess, Expected, MapAccess, SeqAccess, Unexpected, VariantAccess,
    Visitor,
};
use serde::forward_to_deserialize_any;

use crate::error::{ConfigError, Place};
use crate::node::{Entry, Node, Value, either, topmost};

/// Most edits between a mistyped name and the one that is suggested for it.
const SUGGESTION_EDITS: usize = 3;

/// Greatest whole number that every f64 up to it represents.
const EXACT_LIMIT: f64 = 9_007_199_254_740_992.0;

/// A complaint on its way up to the root; it gathers its place and path as it goes. Small, because every key of every type
/// passes it on, and out of the way of what is right.
#[derive(Debug)]
pub struct Fault(Box<Complaint>);

#[derive(Debug)]
struct Complaint {
    found: String,
    expected: String,
    place: Option<Place>,
    /// Steps from the value up to the root.
    path: Vec<String>,
}

impl Fault {
    fn new(found: impl Into<String>, expected: impl Into<String>) -> Self {
        let (found, expected) = (found.into(), expected.into());
        Self(Box::new(Complaint { found, expected, place: None, path: Vec::new() }))
    }

    /// The innermost place wins.
    #[cold]
    #[inline(never)]
    fn at(mut self, place: &Place) -> Self {
        self.0.place.get_or_insert_with(|| place.clone());
        self
    }

    #[cold]
    #[inline(never)]
    fn under(mut self, step: &str) -> Self {
        self.0.path.push(step.to_string());
        self
    }

    /// The finished message; `root` is the place of complaints that found none.
    pub(crate) fn into_error(self, root: &Place) -> ConfigError {
        let Complaint { found, expected, place, mut path } = *self.0;
        path.reverse();
        ConfigError::at(place.as_ref().unwrap_or(root), &path.join("."), found, expected)
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "found {}, expected {}", self.0.found, self.0.expected)
    }
}

impl std::error::Error for Fault {}

impl de::Error for Fault {
    fn custom<T: std::fmt::Display>(message: T) -> Self {
        Self::new(message.to_string(), "a valid value")
    }

    fn invalid_type(unexpected: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::new(unexpected.to_string(), expected.to_string())
    }

    fn invalid_value(unexpected: Unexpected<'_>, expected: &dyn Expected) -> Self {
        Self::new(unexpected.to_string(), expected.to_string())
    }

    fn unknown_field(field: &str, known: &'static [&'static str]) -> Self {
        Self::new(format!("the unknown key `{field}`"), one_of(field, known))
    }

    fn unknown_variant(variant: &str, known: &'static [&'static str]) -> Self {
        Self::new(format!("`{variant}`"), one_of(variant, known))
    }

    fn missing_field(field: &'static str) -> Self {
        Self::new(format!("no key `{field}`"), "one: it has no default")
    }
}

/// The known names, and the one that was probably meant.
fn one_of(found: &str, known: &[&str]) -> String {
    let nearest = known.iter().map(|name| (edits(found, name), name)).min_by_key(|(distance, _)| *distance);
    let hint = match nearest {
        Some((distance, name)) if distance <= SUGGESTION_EDITS && 2 * distance <= name.len() => {
            format!(" (did you mean `{name}`?)")
        }
        Some(_) | None => String::new(),
    };
    format!("{}{hint}", either(known, "or"))
}

/// Levenshtein distance.
fn edits(from: &str, to: &str) -> usize {
    let to: Vec<char> = to.chars().collect();
    let mut row: Vec<usize> = (0..=to.len()).collect();
    for (removed, letter) in from.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = removed + 1;
        for (column, other) in to.iter().enumerate() {
            let substituted = diagonal + usize::from(letter != *other);
            diagonal = row[column + 1];
            row[column + 1] = substituted.min(diagonal + 1).min(row[column] + 1);
        }
    }
    row[to.len()]
}

impl Node {
    fn fault(&self, expected: impl Into<String>) -> Fault {
        Fault::new(self.value.to_string(), expected).at(&self.place)
    }

    /// A whole number up to `limit`; `1e6` is one too.
    fn whole(&self, limit: u64) -> Result<u64, Fault> {
        let value = match &self.value {
            Value::Whole(value) => *value,
            Value::Number(value, _) if value.fract() == 0.0 && value.abs() <= EXACT_LIMIT => *value as i128,
            Value::Number(..)
            | Value::Nothing
            | Value::Truth(_)
            | Value::Text(_)
            | Value::List(_)
            | Value::Mapping(_) => return Err(self.fault("a whole number")),
        };
        match u64::try_from(value) {
            Ok(value) if value <= limit => Ok(value),
            Ok(_) => Err(self.fault(format!("a whole number up to {limit}"))),
            Err(_) => Err(self.fault("a whole number, zero or more")),
        }
    }

    fn number(&self) -> Result<f64, Fault> {
        match &self.value {
            Value::Whole(value) => Ok(*value as f64),
            Value::Number(value, _) => Ok(*value),
            Value::Nothing | Value::Truth(_) | Value::Text(_) | Value::List(_) | Value::Mapping(_) => {
                Err(self.fault("a number"))
            }
        }
    }

    fn truth(&self) -> Result<bool, Fault> {
        let Value::Truth(value) = self.value else { return Err(self.fault("`true` or `false`")) };
        Ok(value)
    }

    fn text(&self) -> Result<&str, Fault> {
        let Value::Text(value) = &self.value else {
            return Err(self.fault("text (in quotes if it looks like a number)"));
        };
        Ok(value)
    }

    fn list(&self, expected: &str) -> Result<&[Node], Fault> {
        let Value::List(items) = &self.value else { return Err(self.fault(expected)) };
        Ok(items)
    }

    /// The entries of a mapping; a key with nothing after it counts as an empty one.
    fn entries(&self, known: &[&str]) -> Result<&[Entry], Fault> {
        match &self.value {
            Value::Mapping(entries) => Ok(entries),
            Value::Nothing => Ok(&[]),
            Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::Text(_) | Value::List(_) => {
                Err(self.fault(format!("keys: {}", either(known, "and"))))
            }
        }
    }

    /// Not exactly one variant; the second of several is the one that is too many.
    fn not_one_of(&self, variants: &[&str]) -> Fault {
        let expected = format!("exactly one of {}", either(variants, "or"));
        let place = match &self.value {
            Value::Mapping(entries) if entries.len() > 1 => &entries[1].place,
            Value::Mapping(_)
            | Value::Nothing
            | Value::Truth(_)
            | Value::Whole(_)
            | Value::Number(..)
            | Value::Text(_)
            | Value::List(_) => &self.place,
        };
        Fault::new(self.value.to_string(), expected).at(place)
    }

    fn visit_items<'de, V: Visitor<'de>>(&self, items: &[Node], visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_seq(Items { items, next: 0 }).map_err(|fault| fault.at(&self.place))
    }

    fn visit_entries<'de, V: Visitor<'de>>(&self, entries: &[Entry], visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_map(Entries { entries, current: None }).map_err(|fault| fault.at(&self.place))
    }
}

impl<'de> Deserializer<'de> for &Node {
    type Error = Fault;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        match &self.value {
            Value::Nothing => visitor.visit_unit(),
            Value::Truth(value) => visitor.visit_bool(*value),
            Value::Whole(value) => visitor.visit_i128(*value),
            Value::Number(value, _) => visitor.visit_f64(*value),
            Value::Text(value) => visitor.visit_str(value),
            Value::List(items) => self.visit_items(items, visitor),
            Value::Mapping(entries) => self.visit_entries(entries, visitor),
        }
        .map_err(|fault| fault.at(&self.place))
    }

    fn deserialize_bool<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_bool(self.truth()?)
    }

    fn deserialize_u32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_u64(self.whole(u32::MAX.into())?)
    }

    fn deserialize_u64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_u64(self.whole(u64::MAX)?)
    }

    fn deserialize_f32<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_f64(self.number()?)
    }

    fn deserialize_f64<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_f64(self.number()?)
    }

    fn deserialize_string<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        visitor.visit_str(self.text()?)
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        if self.value == Value::Nothing { visitor.visit_none() } else { visitor.visit_some(self) }
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, Fault> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, Fault> {
        self.visit_items(self.list("a list")?, visitor)
    }

    fn deserialize_tuple<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, Fault> {
        let expected = format!("a list of {length}");
        let items = self.list(&expected)?;
        if items.len() != length {
            return Err(self.fault(expected));
        }
        self.visit_items(items, visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        self.visit_entries(self.entries(fields)?, visitor)
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        match &self.value {
            Value::Text(name) => {
                visitor.visit_enum(Choice { name, name_place: &self.place, content: &Node::nothing(&self.place) })
            }
            Value::Mapping(entries) => match topmost(entries) {
                Some(Entry { key, place, node, .. }) => {
                    visitor.visit_enum(Choice { name: key, name_place: place, content: node })
                }
                None => Err(self.not_one_of(variants)),
            },
            Value::Nothing | Value::Truth(_) | Value::Whole(_) | Value::Number(..) | Value::List(_) => {
                Err(self.not_one_of(variants))
            }
        }
    }

    forward_to_deserialize_any! {
        i8 i16 i32 i64 i128 u8 u16 u128 char str bytes byte_buf unit unit_struct
        tuple_struct map identifier ignored_any
    }
}

struct Items<'a> {
    items: &'a [Node],
    next: usize,
}

impl<'de> SeqAccess<'de> for Items<'_> {
    type Error = Fault;

    fn next_element_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, Fault> {
        let Some(item) = self.items.get(self.next) else { return Ok(None) };
        let index = self.next;
        self.next += 1;
        seed.deserialize(item).map(Some).map_err(|fault| fault.at(&item.place).under(&index.to_string()))
    }
}

struct Entries<'a> {
    entries: &'a [Entry],
    current: Option<&'a Entry>,
}

impl<'de> MapAccess<'de> for Entries<'_> {
    type Error = Fault;

    fn next_key_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<Option<S::Value>, Fault> {
        let Some((first, rest)) = self.entries.split_first() else { return Ok(None) };
        self.entries = rest;
        self.current = Some(first);
        seed.deserialize(StrDeserializer::new(&first.key)).map(Some).map_err(|fault: Fault| fault.at(&first.place))
    }

    fn next_value_seed<S: DeserializeSeed<'de>>(&mut self, seed: S) -> Result<S::Value, Fault> {
        let entry = self.current.expect("serde asks for a key before its value");
        seed.deserialize(&entry.node).map_err(|fault| fault.at(&entry.place).under(&entry.key))
    }
}

/// One variant of an enum, by name alone or as a mapping with one key.
struct Choice<'a> {
    name: &'a str,
    name_place: &'a Place,
    content: &'a Node,
}

impl<'de, 'a> EnumAccess<'de> for Choice<'a> {
    type Error = Fault;
    type Variant = Chosen<'a>;

    fn variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<(S::Value, Chosen<'a>), Fault> {
        let variant =
            seed.deserialize(StrDeserializer::new(self.name)).map_err(|fault: Fault| fault.at(self.name_place))?;
        Ok((variant, Chosen { name: self.name, content: self.content }))
    }
}

struct Chosen<'a> {
    name: &'a str,
    content: &'a Node,
}

impl<'de> VariantAccess<'de> for Chosen<'_> {
    type Error = Fault;

    fn unit_variant(self) -> Result<(), Fault> {
        if matches!(&self.content.value, Value::Nothing) {
            return Ok(());
        }
        Err(self.content.fault(format!("`{}` alone", self.name)))
    }

    fn newtype_variant_seed<S: DeserializeSeed<'de>>(self, seed: S) -> Result<S::Value, Fault> {
        seed.deserialize(self.content).map_err(|fault| fault.at(&self.content.place).under(self.name))
    }

    fn tuple_variant<V: Visitor<'de>>(self, length: usize, visitor: V) -> Result<V::Value, Fault> {
        self.content.deserialize_tuple(length, visitor).map_err(|fault| fault.under(self.name))
    }

    fn struct_variant<V: Visitor<'de>>(
        self,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Fault> {
        self.content.deserialize_struct("", fields, visitor).map_err(|fault| fault.under(self.name))
    }
}
