//! `TensorBoard` event files: records of protocol buffers, each with a checksum.
//!
//! A record is, little-endian: length (`u64`), masked CRC-32C of the length bytes (`u32`), data, masked CRC-32C of
//! the data (`u32`). The data is an `Event` (tensorboard/compat/proto/event.proto), of which this writes `wall_time`
//! (field 1), `step` (2), `file_version` (3), `summary` (5) and `session_log` (7). A summary has values: scalars, texts, and
//! what the plugin `hparams` (`tensorboard/plugins/hparams/plugin_data.proto`) shows as a run's settings.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use crate::atomic_file::FileError;

/// An event file, open for appending.
#[derive(Debug)]
pub struct EventFile {
    file: File,
    path: PathBuf,
}

impl EventFile {
    /// Starts an event file in the directory of a run, which goes on after `steps` environment steps (0 for a new
    /// run): `TensorBoard` then forgets the later steps in earlier files of the directory.
    ///
    /// # Errors
    /// The system's reason.
    pub fn create(directory: &Path, steps: u64) -> Result<Self, FileError> {
        let wall_secs = wall_secs();
        let mut events = Self::create_unused(directory, wall_secs as u64)?;
        let mut records = record(&Message::event(wall_secs, 0).bytes(3, b"brain.Event:2"));
        records.extend(record(&Message::event(wall_secs, steps + 1).bytes(7, &session_start())));
        events.write(&records)?;
        Ok(events)
    }

    /// Appends one value per tag, at `steps` environment steps, in one write; a value that is no number is left out.
    ///
    /// # Errors
    /// The system's reason.
    pub fn write_scalars(&mut self, steps: u64, scalars: &[(&str, f32)]) -> Result<(), FileError> {
        let finite = scalars.iter().filter(|(_, value)| value.is_finite());
        let summary = finite.fold(Message::default(), |summary, (tag, value)| {
            summary.bytes(1, &Message::default().bytes(1, tag.as_bytes()).float(2, *value).encoded)
        });
        self.write(&record(&Message::event(wall_secs(), steps).bytes(5, &summary.encoded)))
    }

    /// Appends a text in Markdown, which the tab "Text" shows.
    ///
    /// # Errors
    /// The system's reason.
    pub fn write_text(&mut self, tag: &str, markdown: &str) -> Result<(), FileError> {
        let tensor = Message::default().varint(1, STRINGS).bytes(2, &one_number()).bytes(8, markdown.as_bytes());
        self.write_plugin(tag, "text", &[], &tensor)
    }

    /// Says with which settings the run trains, which the tab `HParams` compares between runs.
    ///
    /// # Errors
    /// The system's reason.
    pub fn write_settings(&mut self, settings: &BTreeMap<String, String>) -> Result<(), FileError> {
        let start = settings.iter().fold(Message::default(), |start, (name, value)| {
            start.bytes(1, &Message::default().bytes(1, name.as_bytes()).bytes(2, &setting(value).encoded).encoded)
        });
        let content = Message::default().bytes(3, &start.double(5, wall_secs()).encoded).encoded;
        let nothing =
            Message::default().varint(1, FLOATS).bytes(2, &one_number()).bytes(5, &0.0_f32.to_le_bytes());
        self.write_plugin("_hparams_/session_start_info", "hparams", &content, &nothing)
    }

    /// Appends a value that a plugin shows: a tensor, and what the plugin alone understands.
    fn write_plugin(
        &mut self,
        tag: &str,
        plugin: &str,
        content: &[u8],
        tensor: &Message,
    ) -> Result<(), FileError> {
        let plugin = Message::default().bytes(1, plugin.as_bytes()).bytes(2, content);
        let metadata = Message::default().bytes(1, &plugin.encoded);
        let value =
            Message::default().bytes(1, tag.as_bytes()).bytes(8, &tensor.encoded).bytes(9, &metadata.encoded);
        let summary = Message::default().bytes(1, &value.encoded);
        self.write(&record(&Message::event(wall_secs(), 0).bytes(5, &summary.encoded)))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn create_unused(directory: &Path, seconds: u64) -> Result<Self, FileError> {
        let mut number = 0;
        let host = host();
        loop {
            // TensorBoard reads the files of a directory in the order of their names; Weights & Biases those of this machine.
            let path = directory.join(format!("events.out.tfevents.{seconds:010}.{host}.{number:03}"));
            match OpenOptions::new().append(true).create_new(true).open(&path) {
                Ok(file) => return Ok(Self { file, path }),
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
                Err(cause) => return Err(FileError::new("create", &path, cause)),
            }
        }
    }

    fn write(&mut self, records: &[u8]) -> Result<(), FileError> {
        self.file.write_all(records).map_err(|cause| FileError::new("write", &self.path, cause))
    }
}

/// Types of tensors (tensorflow/core/framework/types.proto).
const FLOATS: u64 = 1;
const STRINGS: u64 = 7;

/// The shape of a tensor with one element.
fn one_number() -> Vec<u8> {
    Message::default().bytes(2, &Message::default().varint(1, 1).encoded).encoded
}

/// A number, a truth or a text (google/protobuf/struct.proto).
fn setting(value: &str) -> Message {
    match (value.parse::<f64>(), value.parse::<bool>()) {
        (Ok(number), _) => Message::default().double(2, number),
        (_, Ok(truth)) => Message::default().varint(4, u64::from(truth)),
        (Err(_), Err(_)) => Message::default().bytes(3, value.as_bytes()),
    }
}

/// Seconds since 1970.
fn wall_secs() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}

/// `SessionLog { status: START }`.
fn session_start() -> Vec<u8> {
    Message::default().varint(1, 1).encoded
}

fn record(event: &Message) -> Vec<u8> {
    let length = (event.encoded.len() as u64).to_le_bytes();
    let mut record = Vec::with_capacity(event.encoded.len() + 16);
    record.extend(length);
    record.extend(masked_crc32c(&length).to_le_bytes());
    record.extend(&event.encoded);
    record.extend(masked_crc32c(&event.encoded).to_le_bytes());
    record
}

/// A protocol buffer message under construction: fields in the order of the calls.
#[derive(Default)]
struct Message {
    encoded: Vec<u8>,
}

/// How the value of a field is laid out.
#[derive(Clone, Copy)]
enum Wire {
    Varint = 0,
    Fixed64 = 1,
    Bytes = 2,
    Fixed32 = 5,
}

impl Message {
    fn event(wall_secs: f64, steps: u64) -> Self {
        Self::default().double(1, wall_secs).varint(2, steps)
    }

    fn varint(mut self, field: u8, value: u64) -> Self {
        self.key(field, Wire::Varint);
        self.push_varint(value);
        self
    }

    fn double(mut self, field: u8, value: f64) -> Self {
        self.key(field, Wire::Fixed64);
        self.encoded.extend(value.to_le_bytes());
        self
    }

    fn float(mut self, field: u8, value: f32) -> Self {
        self.key(field, Wire::Fixed32);
        self.encoded.extend(value.to_le_bytes());
        self
    }

    fn bytes(mut self, field: u8, value: &[u8]) -> Self {
        self.key(field, Wire::Bytes);
        self.push_varint(value.len() as u64);
        self.encoded.extend(value);
        self
    }

    fn key(&mut self, field: u8, wire: Wire) {
        self.encoded.push(field << 3 | wire as u8);
    }

    fn push_varint(&mut self, mut value: u64) {
        while value >= 0x80 {
            self.encoded.push(value as u8 | 0x80);
            value >>= 7;
        }
        self.encoded.push(value as u8);
    }
}

/// CRC-32C (Castagnoli), rotated and offset so that a checksum over data that holds checksums stays meaningful.
fn masked_crc32c(bytes: &[u8]) -> u32 {
    crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

fn crc32c(bytes: &[u8]) -> u32 {
    const REVERSED_POLYNOMIAL: u32 = 0x82f6_3b78;
    let shift = |crc: u32| (crc >> 1) ^ if crc & 1 == 1 { REVERSED_POLYNOMIAL } else { 0 };
    !bytes.iter().fold(!0, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), |crc, _| shift(crc)))
}

/// Name of this machine, as `TensorBoard` has it in the names of files.
#[cfg(not(target_family = "wasm"))]
fn host() -> String {
    gethostname::gethostname().to_string_lossy().replace(['/', '\\'], "-")
}

/// A page has none.
#[cfg(target_family = "wasm")]
fn host() -> String {
    "page".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A decoded field: its number and its value.
    #[derive(Debug, PartialEq)]
    enum Field {
        Varint(u8, u64),
        Double(u8, f64),
        Bytes(u8, Vec<u8>),
        Float(u8, f32),
    }

    fn take<const N: usize>(bytes: &mut &[u8]) -> [u8; N] {
        let (head, rest) = bytes.split_first_chunk::<N>().unwrap();
        *bytes = rest;
        *head
    }

    fn take_varint(bytes: &mut &[u8]) -> u64 {
        let (mut value, mut shift) = (0, 0);
        loop {
            let [byte] = take::<1>(bytes);
            value |= u64::from(byte & 0x7f) << shift;
            shift += 7;
            if byte < 0x80 {
                return value;
            }
        }
    }

    fn fields(mut bytes: &[u8]) -> Vec<Field> {
        let mut fields = Vec::new();
        while !bytes.is_empty() {
            let [key] = take::<1>(&mut bytes);
            fields.push(match key & 7 {
                0 => Field::Varint(key >> 3, take_varint(&mut bytes)),
                1 => Field::Double(key >> 3, f64::from_le_bytes(take(&mut bytes))),
                5 => Field::Float(key >> 3, f32::from_le_bytes(take(&mut bytes))),
                _ => {
                    let length = take_varint(&mut bytes) as usize;
                    let (value, rest) = bytes.split_at(length);
                    bytes = rest;
                    Field::Bytes(key >> 3, value.to_vec())
                }
            });
        }
        fields
    }

    fn events(path: &Path) -> Vec<Vec<Field>> {
        let file = std::fs::read(path).unwrap();
        let (mut bytes, mut events) = (&file[..], Vec::new());
        while !bytes.is_empty() {
            let length = take::<8>(&mut bytes);
            assert_eq!(u32::from_le_bytes(take(&mut bytes)), masked_crc32c(&length));
            let (event, rest) = bytes.split_at(u64::from_le_bytes(length) as usize);
            bytes = rest;
            assert_eq!(u32::from_le_bytes(take(&mut bytes)), masked_crc32c(event));
            events.push(fields(event));
        }
        events
    }

    #[test]
    fn the_checksum_matches_the_published_vectors() {
        // RFC 3720, section B.4, and the check value of the Castagnoli polynomial.
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }

    #[test]
    fn a_file_decodes_to_what_was_written() {
        let directory = tempfile::tempdir().unwrap();
        let mut file = EventFile::create(directory.path(), 0).unwrap();
        file.write_scalars(300, &[("episode_return", 12.5), ("approx_kl", f32::NAN), ("entropy", -1.0)]).unwrap();
        let events = events(file.path());
        assert_eq!(events.len(), 3);
        assert!(matches!(events[0][0], Field::Double(1, secs) if secs > 1.7e9));
        assert_eq!(events[0][1..], [Field::Varint(2, 0), Field::Bytes(3, b"brain.Event:2".to_vec())]);
        assert_eq!(events[1][1..], [Field::Varint(2, 1), Field::Bytes(7, vec![8, 1])]);
        assert_eq!(events[2][1], Field::Varint(2, 300));
        let Field::Bytes(5, summary) = &events[2][2] else { panic!("a summary is expected") };
        let values: Vec<_> = fields(summary)
            .iter()
            .map(|value| if let Field::Bytes(1, value) = value { fields(value) } else { vec![] })
            .collect();
        assert_eq!(values[0], [Field::Bytes(1, b"episode_return".to_vec()), Field::Float(2, 12.5)]);
        assert_eq!(values[1], [Field::Bytes(1, b"entropy".to_vec()), Field::Float(2, -1.0)]);
        assert_eq!(values.len(), 2);
    }

    /// Tag, plugin, its content and the tensor of the only value of a summary.
    fn plugin_value(event: &[Field]) -> [Vec<u8>; 4] {
        let inner = |field: &Field, number: u8| {
            let Field::Bytes(found, bytes) = field else { panic!("field {number} expected") };
            assert_eq!(*found, number);
            fields(bytes)
        };
        let bytes = |field: &Field| if let Field::Bytes(_, bytes) = field { bytes.clone() } else { panic!() };
        let value = inner(&inner(&event[2], 5)[0], 1);
        let plugin = inner(&inner(&value[2], 9)[0], 1);
        [&value[0], &plugin[0], &plugin[1], &value[1]].map(bytes)
    }

    #[test]
    fn texts_and_settings_are_those_of_their_plugins() {
        let directory = tempfile::tempdir().unwrap();
        let mut file = EventFile::create(directory.path(), 0).unwrap();
        file.write_text("config", "    name: hover").unwrap();
        let settings = [("rate", "0.003"), ("resets", "true"), ("rule", "adam")];
        file.write_settings(&settings.map(|(name, value)| (name.to_owned(), value.to_owned())).into()).unwrap();
        let events = events(file.path());
        let [tag, plugin, content, tensor] = plugin_value(&events[2]);
        assert_eq!((&tag[..], &plugin[..], &content[..]), (&b"config"[..], &b"text"[..], &b""[..]));
        assert_eq!(fields(&tensor)[2], Field::Bytes(8, b"    name: hover".to_vec()));
        let [tag, plugin, content, _] = plugin_value(&events[3]);
        assert_eq!((&tag[..], &plugin[..]), (&b"_hparams_/session_start_info"[..], &b"hparams"[..]));
        let Field::Bytes(3, start) = &fields(&content)[0] else { panic!("a start is expected") };
        let setting = |index: usize| {
            let Field::Bytes(1, entry) = &fields(start)[index] else { panic!("an entry is expected") };
            let Field::Bytes(2, value) = &fields(entry)[1] else { panic!("a value is expected") };
            fields(value).remove(0)
        };
        assert_eq!(setting(0), Field::Double(2, 0.003));
        assert_eq!(setting(1), Field::Varint(4, 1));
        assert_eq!(setting(2), Field::Bytes(3, b"adam".to_vec()));
        assert!(matches!(fields(start)[3], Field::Double(5, secs) if secs > 1.7e9));
    }

    #[test]
    fn a_resumed_run_gets_a_file_of_its_own_that_is_read_later() {
        let directory = tempfile::tempdir().unwrap();
        let first = EventFile::create(directory.path(), 0).unwrap();
        let second = EventFile::create(directory.path(), 1_000_000).unwrap();
        assert!(first.path() < second.path());
        assert_eq!(events(second.path())[1][1], Field::Varint(2, 1_000_001));
    }

    #[test]
    fn a_missing_directory_is_one_clear_error() {
        let error = EventFile::create(Path::new("/nowhere"), 0).unwrap_err().to_string();
        assert!(error.starts_with("cannot create /nowhere/events.out.tfevents."), "{error}");
    }
}
