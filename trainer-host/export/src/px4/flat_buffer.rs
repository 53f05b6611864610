//! `FlatBuffers`, as many of their types as a model needs: tables of bytes, words, text, tables and vectors.
//!
//! A table is written behind its description of fields (the vtable), and what it refers to behind itself, because references
//! point forward.

/// A reference, a length and a field are words of so many bytes.
const WORD: usize = 4;

/// Boundary on which the data of weights must lie, so that they are read in place.
const DATA_BOUNDARY: usize = 16;

/// What a field holds.
#[derive(Clone, Debug)]
pub(super) enum Value {
    Byte(u8),
    Word(u32),
    Text(String),
    Table(Table),
    Tables(Vec<Table>),
    Words(Vec<u32>),
    /// On a boundary of sixteen bytes.
    Data(Vec<u8>),
}

/// Fields by their numbers in the schema.
#[derive(Clone, Debug, Default)]
pub(super) struct Table(Vec<(usize, Value)>);

impl Table {
    /// With another field.
    #[must_use]
    pub(super) fn with(mut self, field: usize, value: Value) -> Self {
        self.0.push((field, value));
        self
    }

    /// The buffer whose root this is.
    pub(super) fn buffer(&self, identifier: [u8; WORD]) -> Vec<u8> {
        let mut bytes = vec![0; WORD];
        bytes.extend(identifier);
        let root = write_table(&mut bytes, self);
        bytes[..WORD].copy_from_slice(&(root as u32).to_le_bytes());
        bytes
    }
}

/// Appends a table and what it refers to; where it is.
fn write_table(bytes: &mut Vec<u8>, Table(fields): &Table) -> usize {
    let slots = fields.iter().map(|(field, _)| field + 1).max().unwrap_or_default();
    let mut description = vec![0_u16; 2 + slots];
    description[0] = (2 * description.len()) as u16;
    description[1] = (WORD * (1 + fields.len())) as u16;
    for (place, (field, _)) in fields.iter().enumerate() {
        description[2 + field] = (WORD * (1 + place)) as u16;
    }
    pad(bytes, WORD, 0);
    let described = bytes.len();
    bytes.extend(description.iter().flat_map(|half| half.to_le_bytes()));
    pad(bytes, WORD, 0);
    let table = bytes.len();
    bytes.extend(((table - described) as i32).to_le_bytes());
    bytes.extend(fields.iter().flat_map(|(_, value)| value.inline().to_le_bytes()));
    for (place, (_, value)) in fields.iter().enumerate() {
        let reference = table + WORD * (1 + place);
        if let Some(target) = write_behind(bytes, value) {
            refer(bytes, reference, target);
        }
    }
    table
}

impl Value {
    /// What stands in the table itself; zero for a reference that is not known yet.
    fn inline(&self) -> u32 {
        match self {
            Self::Byte(byte) => u32::from(*byte),
            Self::Word(word) => *word,
            Self::Text(_) | Self::Table(_) | Self::Tables(_) | Self::Words(_) | Self::Data(_) => 0,
        }
    }
}

/// Appends what a reference leads to; where it is.
fn write_behind(bytes: &mut Vec<u8>, value: &Value) -> Option<usize> {
    match value {
        Value::Byte(_) | Value::Word(_) => None,
        Value::Table(table) => Some(write_table(bytes, table)),
        Value::Text(text) => {
            let start = write_vector(bytes, WORD, text.len(), text.as_bytes());
            bytes.push(0);
            Some(start)
        }
        Value::Words(words) => {
            let words_bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
            Some(write_vector(bytes, WORD, words.len(), &words_bytes))
        }
        Value::Data(data) => Some(write_vector(bytes, DATA_BOUNDARY, data.len(), data)),
        Value::Tables(tables) => {
            let start = write_vector(bytes, WORD, tables.len(), &vec![0; WORD * tables.len()]);
            for (index, table) in tables.iter().enumerate() {
                let target = write_table(bytes, table);
                refer(bytes, start + WORD * (1 + index), target);
            }
            Some(start)
        }
    }
}

/// Appends a length and what follows it, which lies on a boundary.
fn write_vector(bytes: &mut Vec<u8>, boundary: usize, len: usize, contents: &[u8]) -> usize {
    pad(bytes, boundary, WORD);
    let start = bytes.len();
    bytes.extend((len as u32).to_le_bytes());
    bytes.extend(contents);
    start
}

/// Fills up with zeros until so many bytes further on there is a boundary.
fn pad(bytes: &mut Vec<u8>, boundary: usize, ahead: usize) {
    bytes.resize((bytes.len() + ahead).next_multiple_of(boundary) - ahead, 0);
}

fn refer(bytes: &mut [u8], reference: usize, target: usize) {
    bytes[reference..reference + WORD].copy_from_slice(&((target - reference) as u32).to_le_bytes());
}
