//! PX4's `ULog`: definitions of formats, then messages of subscribed topics (docs.px4.io, "`ULog` File Format").
//!
//! PX4's world is north, east, down and its body forward, right, down; both turn half a turn about x here, so that the
//! world is north, west, up.

use std::collections::BTreeMap;

use super::{LogReader, PX4_CLOCKWISE, completeness, turned};
use crate::error::LogError;
use crate::flight::{CommandRecord, Recording};

const MAGIC: [u8; 7] = [0x55, 0x4c, 0x6f, 0x67, 0x01, 0x12, 0x35];

/// Bytes before the first message.
const HEADER_BYTES: usize = 16;

/// Formats may nest this deep.
const NESTING_LIMIT: usize = 4;

/// Reads PX4's logs.
#[derive(Clone, Copy, Debug)]
pub struct Ulog;

impl LogReader for Ulog {
    fn format(&self) -> &'static str {
        "PX4's ULog"
    }

    fn recognises(&self, bytes: &[u8]) -> bool {
        bytes.starts_with(&MAGIC)
    }

    fn recording(&self, name: &str, bytes: &[u8]) -> Result<Recording, LogError> {
        let mut recording = Recording::new(name, CommandRecord::Sampled);
        let mut definitions = Definitions::default();
        let mut at = HEADER_BYTES;
        // What follows the last whole message was cut off with the power.
        while let Some((kind, content)) = message(bytes, at) {
            let refuse = |found: &str, expected: &str| LogError::at(format!("{name}, byte {at}"), found, expected);
            match kind {
                b'F' => {
                    definitions.define(content).ok_or_else(|| refuse("a damaged format", "name:type field;…"))?;
                }
                b'A' => {
                    definitions.subscribe(content).ok_or_else(|| refuse("a damaged subscription", "a topic"))?;
                }
                b'D' => definitions.store(content, &mut recording),
                // Parameters, texts and marks say nothing about the motion.
                _ => (),
            }
            at += 3 + content.len();
        }
        recording.command_record = completeness(&recording.commands);
        Ok(recording)
    }
}

fn message(bytes: &[u8], at: usize) -> Option<(u8, &[u8])> {
    let header = bytes.get(at..)?.first_chunk::<3>()?;
    let length = usize::from(u16::from_le_bytes([header[0], header[1]]));
    Some((header[2], bytes.get(at + 3..at + 3 + length)?))
}

/// A field of a format.
#[derive(Clone, Debug)]
struct Field {
    kind: String,
    count: usize,
    name: String,
}

#[derive(Debug, Default)]
struct Definitions {
    formats: BTreeMap<String, Vec<Field>>,
    /// Topic of each message identifier; only the first instance of each.
    topics: BTreeMap<u16, String>,
}

impl Definitions {
    fn define(&mut self, content: &[u8]) -> Option<()> {
        let (name, fields) = std::str::from_utf8(content).ok()?.split_once(':')?;
        let fields = fields.split(';').filter(|field| !field.is_empty()).map(field).collect::<Option<_>>()?;
        self.formats.insert(name.to_owned(), fields);
        Some(())
    }

    fn subscribe(&mut self, content: &[u8]) -> Option<()> {
        let [instance, low, high, name @ ..] = content else { return None };
        let name = std::str::from_utf8(name).ok()?;
        if *instance == 0 {
            self.topics.insert(u16::from_le_bytes([*low, *high]), name.to_owned());
        }
        Some(())
    }

    /// Stores what a message says about the motion; one that does not fit its format says nothing.
    fn store(&self, content: &[u8], recording: &mut Recording) {
        if let Some((identifier, values)) = content.split_first_chunk::<2>()
            && let Some(topic) = self.topics.get(&u16::from_le_bytes(*identifier))
            && let Some(fields) = self.formats.get(topic)
        {
            let message = Message { definitions: self, fields, values };
            if message.store(topic, recording).is_none() {
                // A topic of another version of PX4, without these fields.
            }
        }
    }

    fn size(&self, kind: &str, depth: usize) -> Option<usize> {
        match kind {
            "int8_t" | "uint8_t" | "bool" | "char" => Some(1),
            "int16_t" | "uint16_t" => Some(2),
            "int32_t" | "uint32_t" | "float" => Some(4),
            "int64_t" | "uint64_t" | "double" => Some(8),
            nested if depth < NESTING_LIMIT => {
                let fields = self.formats.get(nested)?.iter();
                fields.map(|field| Some(field.count * self.size(&field.kind, depth + 1)?)).sum()
            }
            _ => None,
        }
    }
}

/// `float[4] q` or `uint64_t timestamp`.
fn field(text: &str) -> Option<Field> {
    let (kind, name) = text.split_once(' ')?;
    let (kind, count) = match kind.split_once('[') {
        Some((kind, count)) => (kind, count.strip_suffix(']')?.parse().ok()?),
        None => (kind, 1),
    };
    Some(Field { kind: kind.to_owned(), count, name: name.to_owned() })
}

struct Message<'a> {
    definitions: &'a Definitions,
    fields: &'a [Field],
    values: &'a [u8],
}

impl Message<'_> {
    /// The bytes of a field, if the message reaches so far.
    fn bytes(&self, name: &str) -> Option<(&Field, &[u8])> {
        let mut at = 0;
        for field in self.fields {
            let size = field.count.checked_mul(self.definitions.size(&field.kind, 0)?)?;
            if field.name == name {
                return Some((field, self.values.get(at..at + size)?));
            }
            at += size;
        }
        None
    }

    fn floats<const N: usize>(&self, name: &str) -> Option<[f64; N]> {
        let (field, bytes) = self.bytes(name)?;
        let (chunks, _) = bytes.as_chunks::<4>();
        if field.kind != "float" || chunks.len() < N {
            return None;
        }
        Some(std::array::from_fn(|index| f64::from(f32::from_le_bytes(chunks[index]))))
    }

    fn vector(&self, names: [&str; 3]) -> Option<[f64; 3]> {
        let [x, y, z] = names.map(|name| self.floats::<1>(name));
        Some([x?[0], y?[0], z?[0]])
    }

    /// The time at which it was sampled, or else published \[s\].
    fn time_secs(&self) -> Option<f64> {
        let (_, bytes) = self.bytes("timestamp_sample").or_else(|| self.bytes("timestamp"))?;
        Some(u64::from_le_bytes(*bytes.first_chunk()?) as f64 * 1e-6)
    }

    fn store(&self, topic: &str, recording: &mut Recording) -> Option<()> {
        let time_secs = self.time_secs()?;
        match topic {
            "actuator_motors" => {
                let motors: [f64; 4] = self.floats("control")?;
                recording.commands.push(time_secs, PX4_CLOCKWISE.map(|motor| motors[motor].clamp(0.0, 1.0)));
            }
            "vehicle_angular_velocity" => recording.body_rates.push(time_secs, turned(self.floats("xyz")?)),
            "sensor_combined" => {
                recording.specific_forces.push(time_secs, turned(self.floats("accelerometer_m_s2")?));
                recording.body_rates.push(time_secs, turned(self.floats("gyro_rad")?));
            }
            "vehicle_attitude" => {
                let [w, x, y, z] = self.floats("q")?;
                recording.attitudes.push(time_secs, [w, x, -y, -z]);
            }
            "vehicle_local_position" => {
                recording.positions.push(time_secs, turned(self.vector(["x", "y", "z"])?));
                recording.velocities.push(time_secs, turned(self.vector(["vx", "vy", "vz"])?));
            }
            "battery_status" => recording.battery_volts.push(time_secs, self.floats("voltage_v")?),
            _ => (),
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::parse;
    use super::*;

    fn message(kind: u8, content: &[u8]) -> Vec<u8> {
        let mut bytes = (content.len() as u16).to_le_bytes().to_vec();
        bytes.push(kind);
        bytes.extend(content);
        bytes
    }

    fn subscription(identifier: u16, topic: &str) -> Vec<u8> {
        let mut content = vec![0];
        content.extend(identifier.to_le_bytes());
        content.extend(topic.as_bytes());
        message(b'A', &content)
    }

    fn data(identifier: u16, micros: u64, values: &[f32]) -> Vec<u8> {
        let mut content = identifier.to_le_bytes().to_vec();
        content.extend(micros.to_le_bytes());
        for value in values {
            content.extend(value.to_le_bytes());
        }
        message(b'D', &content)
    }

    fn log() -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.resize(HEADER_BYTES, 0);
        bytes.extend(message(b'F', b"actuator_motors:uint64_t timestamp;float[12] control;"));
        bytes.extend(message(b'F', b"vehicle_angular_velocity:uint64_t timestamp;float[3] xyz;"));
        bytes.extend(message(b'F', b"vehicle_attitude:uint64_t timestamp;float[4] q;uint8_t[4] _padding0;"));
        bytes.extend(subscription(3, "actuator_motors"));
        bytes.extend(subscription(4, "vehicle_angular_velocity"));
        bytes.extend(subscription(5, "vehicle_attitude"));
        for row in 0..1000 {
            let micros = 1_000_000 + 4000 * row;
            bytes.extend(data(3, micros, &[0.1, 0.2, 0.3, 0.4, 0.0, 0.0, 0.0, 0.0, f32::NAN, 0.0, 0.0, 0.0]));
            bytes.extend(data(4, micros + 500, &[1.0, 2.0, 3.0]));
            bytes.extend(data(9, micros, &[1.0]));
            bytes.extend(data(5, micros, &[1.0]));
        }
        bytes
    }

    #[test]
    fn topics_become_a_flight_in_our_axes() {
        let flight = parse("log.ulg", &log()).unwrap();
        assert_eq!((flight.period_secs, flight.command_record), (0.004, CommandRecord::Complete));
        let expected = [0.1f32, 0.4, 0.2, 0.3].map(f64::from);
        assert_eq!(flight.commands[10], expected);
        assert!((flight.body_rates[10] - nalgebra::Vector3::new(1.0, -2.0, -3.0)).norm() < 1e-12);
        assert!(flight.motion.is_none() && flight.measured[10]);
    }

    #[test]
    fn a_damaged_format_is_named_and_a_cut_message_ends_the_log() {
        let mut bytes = log();
        bytes.truncate(bytes.len() - 3);
        assert!(parse("log.ulg", &bytes).is_ok());
        let place = bytes.windows(9).position(|text| text == b"float[12]").unwrap() + 6;
        bytes[place] = b'x';
        let error = parse("log.ulg", &bytes).unwrap_err().to_string();
        assert_eq!(error, "log.ulg, byte 16: found a damaged format, expected name:type field;…");
    }
}
