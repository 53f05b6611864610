//! Log of the Crazyflie's µSD-card deck ("cfusdlog", versions 1 and 2): a header that names and types the variables of
//! each event, records of event, time stamp and values, and a CRC-32 (Bitcraze, crazyflie-firmware, `usddeck.c`).

use flate2::Crc;

use super::LogReader;
use crate::error::LogError;
use crate::flight::{CommandRecord, Recording};

/// First byte of a log.
const MAGIC: u8 = 0xbc;

/// Standard gravity of the accelerometer's unit \[m/s²\].
pub(super) const METRES_PER_SECOND_SQUARED_PER_G: f64 = 9.806_65;

/// Greatest command of a motor.
pub(super) const FULL_COMMAND: f64 = 65_535.0;

/// Reads logs of the µSD-card deck.
#[derive(Clone, Copy, Debug)]
pub struct Crazyflie;

impl LogReader for Crazyflie {
    fn format(&self) -> &'static str {
        "a Crazyflie's µSD log"
    }

    fn recognises(&self, bytes: &[u8]) -> bool {
        matches!(bytes, [MAGIC, 1 | 2, 0, ..])
    }

    fn recording(&self, name: &str, bytes: &[u8]) -> Result<Recording, LogError> {
        let refuse = |found: String, expected: &str| LogError::at(name, found, expected);
        let Some((content, crc)) = bytes.split_last_chunk::<4>() else {
            return Err(refuse(format!("{} bytes", bytes.len()), "a header"));
        };
        let mut sum = Crc::new();
        sum.update(content);
        let stated = u32::from_le_bytes(*crc);
        // A log whose writing was cut off, by an empty battery for one, has no sum: its whole records still count.
        let cut_off = sum.sum() != stated;
        let mut cursor = Cursor { bytes: if cut_off { bytes } else { content }, at: 1 };
        let header = Header::read(&mut cursor).ok_or_else(|| {
            refuse(format!("a header that ends at byte {}", cursor.at), "names and types of variables")
        })?;
        let mut recording = Recording::new(name, CommandRecord::Complete);
        while let Some(()) = header.record(&mut cursor, &mut recording) {}
        if cursor.at < cursor.bytes.len() && !cut_off {
            return Err(refuse(format!("no record at byte {}", cursor.at), "event, time stamp and values"));
        }
        Ok(recording)
    }
}

/// Bytes from a place on.
struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let chunk = self.bytes.get(self.at..)?.first_chunk::<N>()?;
        self.at += N;
        Some(*chunk)
    }

    fn text(&mut self) -> Option<&'a str> {
        let rest = self.bytes.get(self.at..)?;
        let length = rest.iter().position(|byte| *byte == 0)?;
        self.at += length + 1;
        std::str::from_utf8(&rest[..length]).ok()
    }
}

/// The events of a log.
struct Header {
    version: u16,
    events: Vec<Event>,
}

struct Event {
    id: u16,
    variables: Vec<Variable>,
}

struct Variable {
    name: String,
    kind: Kind,
}

/// Types of Python's `struct`, as the deck names them.
#[derive(Clone, Copy)]
enum Kind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
}

impl Kind {
    const fn of(letter: u8) -> Option<Self> {
        match letter {
            b'B' => Some(Self::U8),
            b'b' => Some(Self::I8),
            b'H' => Some(Self::U16),
            b'h' => Some(Self::I16),
            b'I' | b'L' => Some(Self::U32),
            b'i' | b'l' => Some(Self::I32),
            b'f' => Some(Self::F32),
            _ => None,
        }
    }

    fn value(self, cursor: &mut Cursor<'_>) -> Option<f64> {
        Some(match self {
            Self::U8 => f64::from(u8::from_le_bytes(cursor.take()?)),
            Self::I8 => f64::from(i8::from_le_bytes(cursor.take()?)),
            Self::U16 => f64::from(u16::from_le_bytes(cursor.take()?)),
            Self::I16 => f64::from(i16::from_le_bytes(cursor.take()?)),
            Self::U32 => f64::from(u32::from_le_bytes(cursor.take()?)),
            Self::I32 => f64::from(i32::from_le_bytes(cursor.take()?)),
            Self::F32 => f64::from(f32::from_le_bytes(cursor.take()?)),
        })
    }
}

impl Header {
    fn read(cursor: &mut Cursor<'_>) -> Option<Self> {
        let version = u16::from_le_bytes(cursor.take()?);
        let events = u16::from_le_bytes(cursor.take()?);
        let events = (0..events).map(|_| Event::read(cursor)).collect::<Option<_>>()?;
        Some(Self { version, events })
    }

    /// Reads one record into the recording; `None` where no whole one follows.
    fn record(&self, cursor: &mut Cursor<'_>, recording: &mut Recording) -> Option<()> {
        let start = cursor.at;
        let values = self.values(cursor);
        if values.is_none() {
            cursor.at = start;
        }
        let (event, time_secs, values) = values?;
        event.store(time_secs, &values, recording);
        Some(())
    }

    fn values(&self, cursor: &mut Cursor<'_>) -> Option<(&Event, f64, Vec<f64>)> {
        let id = u16::from_le_bytes(cursor.take()?);
        let time_secs = match self.version {
            1 => f64::from(u32::from_le_bytes(cursor.take()?)) * 1e-3,
            _ => u64::from_le_bytes(cursor.take()?) as f64 * 1e-6,
        };
        let event = self.events.iter().find(|event| event.id == id)?;
        let values = event.variables.iter().map(|variable| variable.kind.value(cursor)).collect::<Option<_>>()?;
        Some((event, time_secs, values))
    }
}

impl Event {
    fn read(cursor: &mut Cursor<'_>) -> Option<Self> {
        let id = u16::from_le_bytes(cursor.take()?);
        cursor.text()?;
        let count = u16::from_le_bytes(cursor.take()?);
        let variables = (0..count).map(|_| Variable::read(cursor)).collect::<Option<_>>()?;
        Some(Self { id, variables })
    }

    /// The values of these variables, scaled, if the event has them all.
    fn of<const N: usize>(&self, names: [&str; N], scale: f64, values: &[f64]) -> Option<[f64; N]> {
        let mut found = [0.0; N];
        for (slot, name) in found.iter_mut().zip(names) {
            let index = self.variables.iter().position(|variable| variable.name == name)?;
            *slot = values[index] * scale;
        }
        Some(found)
    }

    fn store(&self, time_secs: f64, values: &[f64], recording: &mut Recording) {
        let radians = std::f64::consts::PI / 180.0;
        let motors = ["motor.m1", "motor.m2", "motor.m3", "motor.m4"];
        if let Some(shares) = self.of(motors, 1.0 / FULL_COMMAND, values) {
            recording.commands.push(time_secs, shares.map(|share| share.clamp(0.0, 1.0)));
        }
        if let Some(rates) = self.of(["gyro.x", "gyro.y", "gyro.z"], radians, values) {
            recording.body_rates.push(time_secs, rates);
        }
        if let Some(forces) = self.of(["acc.x", "acc.y", "acc.z"], METRES_PER_SECOND_SQUARED_PER_G, values) {
            recording.specific_forces.push(time_secs, forces);
        }
        if let Some(position) = self.of(["stateEstimate.x", "stateEstimate.y", "stateEstimate.z"], 1.0, values) {
            recording.positions.push(time_secs, position);
        }
        if let Some(velocity) = self.of(["stateEstimate.vx", "stateEstimate.vy", "stateEstimate.vz"], 1.0, values)
        {
            recording.velocities.push(time_secs, velocity);
        }
        let quaternion = ["stateEstimate.qw", "stateEstimate.qx", "stateEstimate.qy", "stateEstimate.qz"];
        if let Some(attitude) = self.of(quaternion, 1.0, values) {
            recording.attitudes.push(time_secs, attitude);
        }
        if let Some(volts) = self.of(["pm.vbat"], 1.0, values) {
            recording.battery_volts.push(time_secs, volts);
        }
    }
}

impl Variable {
    fn read(cursor: &mut Cursor<'_>) -> Option<Self> {
        let declared = cursor.text()?.strip_suffix(')')?;
        let (name, letter) = declared.rsplit_once('(')?;
        let [letter] = letter.as_bytes() else { return None };
        Some(Self { name: name.to_owned(), kind: Kind::of(*letter)? })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VARIABLES: [&str; 10] = [
        "acc.x(f)",
        "acc.y(f)",
        "acc.z(f)",
        "gyro.x(f)",
        "gyro.y(f)",
        "gyro.z(f)",
        "motor.m1(H)",
        "motor.m2(H)",
        "motor.m3(H)",
        "motor.m4(H)",
    ];

    /// A log of some seconds at 1 kHz that turns about x with 90 °/s.
    fn log(rows: u64) -> Vec<u8> {
        let mut bytes = vec![MAGIC, 2, 0, 1, 0, 0xff, 0xff];
        bytes.extend(b"fixedFrequency\0");
        bytes.extend(10u16.to_le_bytes());
        for variable in VARIABLES {
            bytes.extend(variable.as_bytes());
            bytes.push(0);
        }
        for row in 0..rows {
            bytes.extend([0xff, 0xff]);
            bytes.extend((5_000_000 + 1000 * row).to_le_bytes());
            for value in [0.0f32, 0.0, 1.0, 90.0, 0.0, 0.0] {
                bytes.extend(value.to_le_bytes());
            }
            for motor in [0u16, 13107, 26214, 65535] {
                bytes.extend(motor.to_le_bytes());
            }
        }
        let mut crc = Crc::new();
        crc.update(&bytes);
        bytes.extend(crc.sum().to_le_bytes());
        bytes
    }

    #[test]
    fn a_log_becomes_a_flight_in_si_units() {
        let flight = super::super::parse("log", &log(3000)).unwrap();
        assert_eq!((flight.rows(), flight.period_secs, flight.start_secs), (3000, 0.001, 5.0));
        assert!((flight.body_rates[7].x - std::f64::consts::FRAC_PI_2).abs() < 1e-6);
        assert!((flight.specific_forces.as_ref().unwrap()[7].z - 9.806_65).abs() < 1e-6);
        assert_eq!(flight.commands[2999], [0.0, 0.2, 0.4, 1.0]);
        assert!(flight.measured.iter().all(|measured| *measured));
    }

    #[test]
    fn a_log_that_was_cut_off_ends_with_its_last_whole_record() {
        let bytes = log(3000);
        let flight = super::super::parse("log", &bytes[..bytes.len() - 30]).unwrap();
        assert_eq!(flight.rows(), 2999);
    }

    #[test]
    fn damaged_headers_are_refused() {
        let mut bytes = log(10);
        let place = bytes.windows(8).position(|text| text == b"gyro.y(f").unwrap() + 7;
        bytes[place] = b'?';
        let error = super::super::parse("log", &bytes).unwrap_err().to_string();
        assert!(error.contains("expected names and types of variables"), "{error}");
        let error = super::super::parse("log", &[MAGIC, 2, 0]).unwrap_err().to_string();
        assert_eq!(error, "log: found 3 bytes, expected a header");
    }
}
