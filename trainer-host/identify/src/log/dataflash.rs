//! `ArduPilot`'s `DataFlash` logs: records that begin with two bytes and a type; those of type `FMT` say how long the others
//! are and what is in them (`libraries/AP_Logger/LogStructure.h`, "Downloading and Analyzing Data Logs" of its wiki).
//!
//! Axes are those of PX4's logs. A multicopter X has its motors in one of four orders, by the parameter `FRAME_TYPE`.

use std::collections::BTreeMap;

use super::{LogReader, PX4_CLOCKWISE, completeness, turned};
use crate::error::LogError;
use crate::flight::{CommandRecord, Recording};
use crate::track::Track;

/// Two bytes before each type.
const MAGIC: [u8; 2] = [0xa3, 0x95];

/// Bytes before the fields of a record.
const HEADER_BYTES: usize = 3;

/// Type of the records that describe the others, and the bytes of one.
const FORMAT_TYPE: u8 = 0x80;
const FORMAT_BYTES: usize = 89;

/// Pulse widths of a motor at rest and at full throttle \[µs\] where the log has no `MOT_PWM_MIN` and `MOT_PWM_MAX`.
const PULSE_MICROS: [f64; 2] = [1000.0, 2000.0];

/// `SERVOn_FUNCTION` of the first motor.
const MOTOR_1_FUNCTION: f64 = 33.0;

/// Outputs of a record `RCOU`.
const OUTPUTS: usize = 14;

/// Reads `ArduPilot`'s logs.
#[derive(Clone, Copy, Debug)]
pub struct DataFlash;

impl LogReader for DataFlash {
    fn format(&self) -> &'static str {
        "ArduPilot's DataFlash"
    }

    fn recognises(&self, bytes: &[u8]) -> bool {
        bytes.starts_with(&[MAGIC[0], MAGIC[1], FORMAT_TYPE])
    }

    fn recording(&self, name: &str, bytes: &[u8]) -> Result<Recording, LogError> {
        let mut signals = Signals::default();
        let mut formats = Formats::default();
        let mut at = 0;
        while at < bytes.len() {
            let Some((kind, record)) = formats.record(bytes, at) else {
                // Cut off with the power, or damaged: whatever begins a record next is one.
                at += 1;
                continue;
            };
            if kind == FORMAT_TYPE {
                formats
                    .define(record)
                    .map_err(|(found, expected)| LogError::at(format!("{name}, byte {at}"), found, expected))?;
            } else if let Some(format) = formats.of.get(&kind) {
                // A record of another version, without these fields, says nothing.
                let _ = Record { format, bytes: record }.store(&mut signals);
            }
            at += record.len();
        }
        signals.recording(name)
    }
}

/// What the records of a type hold.
#[derive(Debug)]
struct Format {
    name: String,
    /// Bytes of a record, with its header.
    length: usize,
    fields: Vec<Field>,
}

#[derive(Debug)]
struct Field {
    label: String,
    kind: u8,
    /// Place in the record.
    at: usize,
}

#[derive(Debug, Default)]
struct Formats {
    of: BTreeMap<u8, Format>,
}

impl Formats {
    /// Type and bytes of the record at a place, if a whole one of a known type is there.
    fn record<'a>(&self, bytes: &'a [u8], at: usize) -> Option<(u8, &'a [u8])> {
        let rest = bytes.get(at..)?;
        let kind = *rest.strip_prefix(&MAGIC)?.first()?;
        let length = match kind {
            FORMAT_TYPE => FORMAT_BYTES,
            other => self.of.get(&other)?.length,
        };
        Some((kind, rest.get(..length)?))
    }

    /// Takes a format over.
    ///
    /// # Errors
    /// Found and expected, where it makes no sense.
    fn define(&mut self, record: &[u8]) -> Result<(), (String, &'static str)> {
        let (kind, length) = (record[3], usize::from(record[4]));
        let (name, kinds, labels) = (text(&record[5..9]), &record[9..25], text(&record[25..89]));
        let mut fields = Vec::new();
        let mut at = HEADER_BYTES;
        let mut labels = labels.split(',');
        for kind in kinds.iter().copied().take_while(|kind| *kind != 0) {
            let found = || {
                (format!("a field of type `{}` in `{name}`", kind.escape_ascii()), "one of aBbcCdEefgHhIiLMnNQqZ")
            };
            let bytes = size(kind).ok_or_else(found)?;
            fields.push(Field { label: labels.next().unwrap_or_default().to_owned(), kind, at });
            at += bytes;
        }
        if at != length {
            let found = format!("records `{name}` of {length} bytes with fields of {}", at - HEADER_BYTES);
            return Err((found, "as many as header and fields have together"));
        }
        self.of.insert(kind, Format { name, length, fields });
        Ok(())
    }
}

/// Text up to the first zero.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).trim_end().to_owned()
}

/// Bytes of a field.
fn size(kind: u8) -> Option<usize> {
    match kind {
        b'b' | b'B' | b'M' => Some(1),
        b'h' | b'H' | b'c' | b'C' | b'g' => Some(2),
        b'i' | b'I' | b'e' | b'E' | b'f' | b'L' | b'n' => Some(4),
        b'q' | b'Q' | b'd' => Some(8),
        b'N' => Some(16),
        b'a' | b'Z' => Some(64),
        _ => None,
    }
}

struct Record<'a> {
    format: &'a Format,
    bytes: &'a [u8],
}

impl Record<'_> {
    fn field(&self, label: &str) -> Option<(u8, &[u8])> {
        let field = self.format.fields.iter().find(|field| field.label == label)?;
        Some((field.kind, &self.bytes[field.at..]))
    }

    /// A number, in hundredths where its type says so.
    fn number(&self, label: &str) -> Option<f64> {
        let (kind, bytes) = self.field(label)?;
        let hundredths = |number: f64| number / 100.0;
        match kind {
            b'b' => Some(f64::from(*bytes.first()? as i8)),
            b'B' | b'M' => Some(f64::from(*bytes.first()?)),
            b'h' => Some(f64::from(i16::from_le_bytes(*bytes.first_chunk()?))),
            b'H' => Some(f64::from(u16::from_le_bytes(*bytes.first_chunk()?))),
            b'c' => Some(hundredths(f64::from(i16::from_le_bytes(*bytes.first_chunk()?)))),
            b'C' => Some(hundredths(f64::from(u16::from_le_bytes(*bytes.first_chunk()?)))),
            b'i' | b'L' => Some(f64::from(i32::from_le_bytes(*bytes.first_chunk()?))),
            b'I' => Some(f64::from(u32::from_le_bytes(*bytes.first_chunk()?))),
            b'e' => Some(hundredths(f64::from(i32::from_le_bytes(*bytes.first_chunk()?)))),
            b'E' => Some(hundredths(f64::from(u32::from_le_bytes(*bytes.first_chunk()?)))),
            b'f' => Some(f64::from(f32::from_le_bytes(*bytes.first_chunk()?))),
            b'd' => Some(f64::from_le_bytes(*bytes.first_chunk()?)),
            b'q' => Some(i64::from_le_bytes(*bytes.first_chunk()?) as f64),
            b'Q' => Some(u64::from_le_bytes(*bytes.first_chunk()?) as f64),
            _ => None,
        }
    }

    fn vector(&self, labels: [&str; 3]) -> Option<[f64; 3]> {
        let [x, y, z] = labels.map(|label| self.number(label));
        Some([x?, y?, z?])
    }

    /// When it was sampled, or else written \[s\].
    fn time_secs(&self) -> Option<f64> {
        Some(self.number("SampleUS").or_else(|| self.number("TimeUS"))? * 1e-6)
    }

    /// Whether it is of the first sensor, battery or estimator.
    fn is_first(&self) -> bool {
        ["I", "C", "Inst", "Instance"]
            .into_iter()
            .find_map(|label| self.number(label))
            .is_none_or(|index| index == 0.0)
    }

    /// Stores what it says about the motion.
    fn store(&self, signals: &mut Signals) -> Option<()> {
        if self.format.name == "PARM" {
            let (_, name) = self.field("Name")?;
            signals.parameters.insert(text(name.get(..16)?), self.number("Value")?);
            return Some(());
        }
        if !self.is_first() {
            return None;
        }
        let time_secs = self.time_secs()?;
        match self.format.name.as_str() {
            "RCOU" => {
                let outputs: Vec<f64> =
                    (1..=OUTPUTS).filter_map(|output| self.number(&format!("C{output}"))).collect();
                signals.outputs.push((time_secs, outputs));
            }
            "GYR" => signals.raw_body_rates.push(time_secs, turned(self.vector(["GyrX", "GyrY", "GyrZ"])?)),
            "ACC" => signals.raw_specific_forces.push(time_secs, turned(self.vector(["AccX", "AccY", "AccZ"])?)),
            "IMU" => {
                signals.body_rates.push(time_secs, turned(self.vector(["GyrX", "GyrY", "GyrZ"])?));
                signals.specific_forces.push(time_secs, turned(self.vector(["AccX", "AccY", "AccZ"])?));
            }
            "RATE" => signals.rates.push(time_secs, turned(self.vector(["R", "P", "Y"])?.map(f64::to_radians))),
            "ATT" => signals.attitudes.push(time_secs, quaternion(self.vector(["Roll", "Pitch", "Yaw"])?)),
            "XKF1" | "NKF1" => {
                signals.positions.push(time_secs, turned(self.vector(["PN", "PE", "PD"])?));
                signals.velocities.push(time_secs, turned(self.vector(["VN", "VE", "VD"])?));
            }
            "BAT" => signals.battery_volts.push(time_secs, [self.number("Volt")?]),
            _ => (),
        }
        Some(())
    }
}

/// Quaternion `world_from_body` in our axes of roll, pitch and yaw \[°\] in `ArduPilot`'s.
fn quaternion(degrees: [f64; 3]) -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = degrees.map(|angle| (angle.to_radians() / 2.0).sin_cos());
    let [w, x] = [cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy];
    let [y, z] = [cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy];
    [w, x, -y, -z]
}

/// Everything that a log says, of which a recording takes the best.
#[derive(Debug, Default)]
struct Signals {
    parameters: BTreeMap<String, f64>,
    /// Time \[s\] and pulse widths \[µs\].
    outputs: Vec<(f64, Vec<f64>)>,
    /// At the sensor's rate, if they are logged.
    raw_body_rates: Track<3>,
    raw_specific_forces: Track<3>,
    body_rates: Track<3>,
    specific_forces: Track<3>,
    /// At the controller's rate.
    rates: Track<3>,
    attitudes: Track<4>,
    positions: Track<3>,
    velocities: Track<3>,
    battery_volts: Track<1>,
}

impl Signals {
    /// # Errors
    /// When the frame is no X of four motors, or an output of a motor is missing.
    fn recording(self, name: &str) -> Result<Recording, LogError> {
        let clockwise = self.motors_clockwise(name)?;
        let output_of_motor: [usize; 4] = std::array::from_fn(|motor| self.output_of(motor));
        let parameter = |key: &str, default: f64| {
            self.parameters.get(key).copied().filter(|value| *value > 0.0).unwrap_or(default)
        };
        let [rest, full] = [parameter("MOT_PWM_MIN", PULSE_MICROS[0]), parameter("MOT_PWM_MAX", PULSE_MICROS[1])];
        if full <= rest {
            let found = format!("MOT_PWM_MIN {rest} and MOT_PWM_MAX {full}");
            return Err(LogError::at(name, found, "a pulse at full throttle that is longer than at rest"));
        }
        let mut recording = Recording::new(name, CommandRecord::Sampled);
        for (time_secs, pulses) in &self.outputs {
            let pulse = |motor: usize| pulses.get(output_of_motor[motor]).copied();
            let [Some(a), Some(b), Some(c), Some(d)] = clockwise.map(pulse) else {
                let found = format!("{} outputs", pulses.len());
                return Err(LogError::at(
                    name,
                    found,
                    format!("those of four motors, {output_of_motor:?} from 0"),
                ));
            };
            let share = |micros: f64| ((micros - rest) / (full - rest)).clamp(0.0, 1.0);
            recording.commands.push(*time_secs, [a, b, c, d].map(share));
        }
        recording.body_rates = longest([self.raw_body_rates, self.body_rates, self.rates]);
        recording.specific_forces = longest([self.raw_specific_forces, self.specific_forces]);
        recording.attitudes = self.attitudes;
        recording.positions = self.positions;
        recording.velocities = self.velocities;
        recording.battery_volts = self.battery_volts;
        recording.command_record = completeness(&recording.commands);
        Ok(recording)
    }

    /// Motors, from 0, clockwise from the front right one.
    fn motors_clockwise(&self, name: &str) -> Result<[usize; 4], LogError> {
        let whole = |key: &str| self.parameters.get(key).copied().unwrap_or(1.0);
        let [class, kind] = [whole("FRAME_CLASS"), whole("FRAME_TYPE")];
        let order = match kind {
            1.0 => Some(PX4_CLOCKWISE),
            // Betaflight's numbers, propellers turning its way or the other.
            12.0 | 18.0 => Some([1, 0, 2, 3]),
            // DJI's, anticlockwise.
            13.0 => Some([0, 3, 2, 1]),
            14.0 => Some([0, 1, 2, 3]),
            _ => None,
        };
        order.filter(|_| class == 1.0).ok_or_else(|| {
            let expected = "FRAME_CLASS 1 (four motors) and FRAME_TYPE 1, 12, 13, 14 or 18 (X)";
            LogError::at(name, format!("FRAME_CLASS {class} and FRAME_TYPE {kind}"), expected)
        })
    }

    /// The output of a motor, both from 0.
    fn output_of(&self, motor: usize) -> usize {
        let is_of = |output: &usize| {
            let function = self.parameters.get(&format!("SERVO{}_FUNCTION", output + 1));
            function == Some(&(MOTOR_1_FUNCTION + motor as f64))
        };
        (0..OUTPUTS).find(is_of).unwrap_or(motor)
    }
}

/// The track with the most samples, the first of equals.
fn longest<const N: usize>(tracks: [Track<3>; N]) -> Track<3> {
    tracks.into_iter().rev().max_by_key(Track::len).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::parse;
    use super::*;

    /// A record with its header.
    fn record(kind: u8, fields: &[&[u8]]) -> Vec<u8> {
        [&[MAGIC[0], MAGIC[1], kind], fields.concat().as_slice()].concat()
    }

    fn padded<const N: usize>(text: &str) -> [u8; N] {
        std::array::from_fn(|index| text.as_bytes().get(index).copied().unwrap_or(0))
    }

    /// `FMT` of a type whose records have the bytes that its fields need.
    fn definition(kind: u8, [name, kinds, labels]: [&str; 3]) -> Vec<u8> {
        let length = HEADER_BYTES + kinds.bytes().map(|kind| size(kind).unwrap()).sum::<usize>();
        let texts: [&[u8]; 3] = [&padded::<4>(name), &padded::<16>(kinds), &padded::<64>(labels)];
        record(FORMAT_TYPE, &[&[kind, length as u8], texts[0], texts[1], texts[2]])
    }

    fn floats(values: &[f32]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    fn parameter(name: &str, value: f32) -> Vec<u8> {
        record(0x81, &[&5_u64.to_le_bytes(), &padded::<16>(name), &value.to_le_bytes(), &value.to_le_bytes()])
    }

    /// Four seconds at 250 Hz with `parameters`, in the records of ArduCopter 4.5.
    fn log(parameters: &[(&str, f32)]) -> Vec<u8> {
        let mut bytes = definition(FORMAT_TYPE, ["FMT", "BBnNZ", "Type,Length,Name,Format,Columns"]);
        bytes.extend(definition(0x81, ["PARM", "QNff", "TimeUS,Name,Value,Default"]));
        bytes.extend(definition(
            0x20,
            ["RCOU", "QHHHHHHHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10,C11,C12,C13,C14"],
        ));
        bytes.extend(definition(
            0x21,
            ["IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"],
        ));
        bytes.extend(definition(
            0x22,
            ["ATT", "QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"],
        ));
        bytes.extend(definition(
            0x23,
            ["XKF1", "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"],
        ));
        bytes.extend(definition(
            0x24,
            ["BAT", "QBfffffcf", "TimeUS,Instance,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res"],
        ));
        for (name, value) in parameters {
            bytes.extend(parameter(name, *value));
        }
        for row in 0..1000_u64 {
            let micros = (2_000_000 + 4000 * row).to_le_bytes();
            let pulses: Vec<u8> = [1100_u16, 1200, 1300, 1400, 1900, 0, 0, 0, 0, 0, 0, 0, 0, 0]
                .into_iter()
                .flat_map(u16::to_le_bytes)
                .collect();
            bytes.extend(record(0x20, &[&micros, &pulses]));
            for (instance, rate) in [(0_u8, 1.0_f32), (1, 9.0)] {
                let imu = floats(&[rate, 2.0, 3.0, 0.5, 0.25, -9.75]);
                bytes.extend(record(0x21, &[&micros, &[instance], &imu, &[0; 18]]));
            }
            let angles: Vec<u8> =
                [0, 1000, 0, -2000, 0, 9000, 0, 0].into_iter().flat_map(i16::to_le_bytes).collect();
            bytes.extend(record(0x22, &[&micros, &angles, &[3]]));
            let moves = floats(&[1.0, 2.0, 3.0, 0.0, 10.0, 20.0, -30.0]);
            bytes.extend(record(0x23, &[&micros, &[0], &[0; 6], &moves, &[0; 10]]));
            bytes.extend(record(0x24, &[&micros, &[0], &floats(&[15.5; 5]), &[0; 6]]));
        }
        bytes
    }

    #[test]
    fn records_become_a_flight_in_our_axes() {
        let flight = parse("log.bin", &log(&[("FRAME_CLASS", 1.0), ("FRAME_TYPE", 1.0)])).unwrap();
        assert_eq!(
            (flight.rows(), flight.period_secs, flight.command_record),
            (1000, 0.004, CommandRecord::Complete)
        );
        // Motors 1, 4, 2, 3 of ArduPilot's X.
        assert_eq!(flight.commands[10], [0.1, 0.4, 0.2, 0.3]);
        assert!((flight.body_rates[10] - Vector3::new(1.0, -2.0, -3.0)).norm() < 1e-12);
        assert!((flight.specific_forces.unwrap()[10] - Vector3::new(0.5, -0.25, 9.75)).norm() < 1e-12);
        assert_eq!(flight.battery_volts.unwrap()[10], 15.5);
        let motion = flight.motion.unwrap();
        assert!((motion.positions[10] - Vector3::new(10.0, -20.0, 30.0)).norm() < 1e-12);
        assert!((motion.velocities[10] - Vector3::new(1.0, -2.0, -3.0)).norm() < 1e-12);
        // East ahead (south of west, in our axes -y), nose 20° down, right side 10° down.
        let degrees = motion.attitudes[10].roll_pitch_yaw().map(f64::to_degrees);
        for (angle, expected) in degrees.into_iter().zip([10.0, 20.0, -90.0]) {
            assert!((angle - expected).abs() < 1e-9, "{degrees:?}");
        }
        assert!(flight.measured.iter().all(|measured| *measured));
    }

    #[test]
    fn parameters_say_which_output_turns_which_rotor() {
        let commands = |parameters: &[(&str, f32)]| parse("log.bin", &log(parameters)).unwrap().commands[10];
        assert_eq!(commands(&[]), [0.1, 0.4, 0.2, 0.3]);
        assert_eq!(commands(&[("FRAME_TYPE", 12.0)]), [0.2, 0.1, 0.3, 0.4]);
        assert_eq!(commands(&[("FRAME_TYPE", 13.0)]), [0.1, 0.4, 0.3, 0.2]);
        assert_eq!(commands(&[("FRAME_TYPE", 14.0)]), [0.1, 0.2, 0.3, 0.4]);
        assert_eq!(commands(&[("SERVO5_FUNCTION", 33.0), ("SERVO1_FUNCTION", 0.0)]), [0.9, 0.4, 0.2, 0.3]);
        assert_eq!(commands(&[("MOT_PWM_MIN", 1100.0), ("MOT_PWM_MAX", 1900.0)]), [0.0, 0.375, 0.125, 0.25]);
    }

    #[test]
    fn what_cannot_be_flown_is_named() {
        let refusal = |parameters: &[(&str, f32)]| parse("log.bin", &log(parameters)).unwrap_err().to_string();
        assert_eq!(
            refusal(&[("FRAME_CLASS", 2.0)]),
            "log.bin: found FRAME_CLASS 2 and FRAME_TYPE 1, expected FRAME_CLASS 1 (four motors) and FRAME_TYPE 1, 12, 13, \
             14 or 18 (X)"
        );
        assert!(refusal(&[("FRAME_TYPE", 0.0)]).contains("found FRAME_CLASS 1 and FRAME_TYPE 0"));
        assert!(refusal(&[("MOT_PWM_MIN", 2100.0)]).contains("found MOT_PWM_MIN 2100 and MOT_PWM_MAX 2000"));
        let mut short = log(&[]);
        short.truncate(5000);
        assert!(parse("log.bin", &short).unwrap_err().to_string().contains("expected 2 s or more"));
    }

    #[test]
    fn formats_that_make_no_sense_are_named_with_their_place() {
        let refusal = |change: &dyn Fn(&mut [u8])| {
            let mut bytes = log(&[]);
            change(&mut bytes);
            parse("log.bin", &bytes).unwrap_err().to_string()
        };
        assert_eq!(
            refusal(&|bytes| bytes[FORMAT_BYTES + 4] = 2),
            "log.bin, byte 89: found records `PARM` of 2 bytes with fields of 32, expected as many as header and fields have \
             together"
        );
        assert_eq!(
            refusal(&|bytes| bytes[FORMAT_BYTES + 9] = b'x'),
            "log.bin, byte 89: found a field of type `x` in `PARM`, expected one of aBbcCdEefgHhIiLMnNQqZ"
        );
    }

    #[test]
    fn damaged_records_are_passed_over() {
        let whole = parse("log.bin", &log(&[])).unwrap();
        let mut bytes = log(&[]);
        let place = bytes.len() / 2;
        for byte in &mut bytes[place..place + 40] {
            *byte = 0xa3;
        }
        bytes.truncate(bytes.len() - 7);
        let damaged = parse("log.bin", &bytes).unwrap();
        assert!(damaged.rows() > whole.rows() - 5);
        assert_eq!(damaged.commands[10], whole.commands[10]);
    }
}
