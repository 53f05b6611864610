//! Tables with a heading: `NanoBench`'s columns, and those that cflib's log blocks write under their own names.

use super::LogReader;
use super::crazyflie::{FULL_COMMAND, METRES_PER_SECOND_SQUARED_PER_G};
use crate::error::LogError;
use crate::flight::{CommandRecord, Recording};

/// Shortest time between samples that a radio log of all commands could have \[s\]: controllers run at 500 Hz.
const COMPLETE_PERIOD_SECS: f64 = 0.003;

/// Reads comma-separated tables.
#[derive(Clone, Copy, Debug)]
pub struct Table;

const RADIANS: f64 = std::f64::consts::PI / 180.0;

/// A column under one of its names.
struct Column {
    name: &'static str,
    /// SI units per unit of the column.
    scale: f64,
}

const fn column(name: &'static str, scale: f64) -> Column {
    Column { name, scale }
}

const TIME: [Column; 2] = [column("time_secs", 1.0), column("timestamp", 1e-3)];

const MOTORS: [[Column; 2]; 4] = [
    [column("motor_1_pwm", 1.0 / FULL_COMMAND), column("motor.m1", 1.0 / FULL_COMMAND)],
    [column("motor_2_pwm", 1.0 / FULL_COMMAND), column("motor.m2", 1.0 / FULL_COMMAND)],
    [column("motor_3_pwm", 1.0 / FULL_COMMAND), column("motor.m3", 1.0 / FULL_COMMAND)],
    [column("motor_4_pwm", 1.0 / FULL_COMMAND), column("motor.m4", 1.0 / FULL_COMMAND)],
];

const RATES: [[Column; 2]; 3] = [
    [column("gyro_x_rad_per_s", 1.0), column("gyro.x", RADIANS)],
    [column("gyro_y_rad_per_s", 1.0), column("gyro.y", RADIANS)],
    [column("gyro_z_rad_per_s", 1.0), column("gyro.z", RADIANS)],
];

const FORCES: [[Column; 2]; 3] = [
    [
        column("accelerometer_x_g", METRES_PER_SECOND_SQUARED_PER_G),
        column("acc.x", METRES_PER_SECOND_SQUARED_PER_G),
    ],
    [
        column("accelerometer_y_g", METRES_PER_SECOND_SQUARED_PER_G),
        column("acc.y", METRES_PER_SECOND_SQUARED_PER_G),
    ],
    [
        column("accelerometer_z_g", METRES_PER_SECOND_SQUARED_PER_G),
        column("acc.z", METRES_PER_SECOND_SQUARED_PER_G),
    ],
];

const POSITIONS: [[Column; 2]; 3] = [
    [column("position_x_m", 1.0), column("stateEstimate.x", 1.0)],
    [column("position_y_m", 1.0), column("stateEstimate.y", 1.0)],
    [column("position_z_m", 1.0), column("stateEstimate.z", 1.0)],
];

const VELOCITIES: [[Column; 2]; 3] = [
    [column("velocity_x_m_per_s", 1.0), column("stateEstimate.vx", 1.0)],
    [column("velocity_y_m_per_s", 1.0), column("stateEstimate.vy", 1.0)],
    [column("velocity_z_m_per_s", 1.0), column("stateEstimate.vz", 1.0)],
];

const ATTITUDES: [[Column; 2]; 4] = [
    [column("attitude_w", 1.0), column("stateEstimate.qw", 1.0)],
    [column("attitude_x", 1.0), column("stateEstimate.qx", 1.0)],
    [column("attitude_y", 1.0), column("stateEstimate.qy", 1.0)],
    [column("attitude_z", 1.0), column("stateEstimate.qz", 1.0)],
];

const VOLTS: [[Column; 2]; 1] = [[column("battery_v", 1.0), column("pm.vbat", 1.0)]];

const SET_POINTS: [[Column; 2]; 4] = [
    [column("setpoint_x_m", 1.0), column("ctrltarget.x", 1.0)],
    [column("setpoint_y_m", 1.0), column("ctrltarget.y", 1.0)],
    [column("setpoint_z_m", 1.0), column("ctrltarget.z", 1.0)],
    [column("setpoint_yaw_deg", RADIANS), column("ctrltarget.yaw", RADIANS)],
];

/// 1 where the log had data, 0 where it was filled in.
const VALID: [[Column; 1]; 1] = [[column("valid", 1.0)]];

impl LogReader for Table {
    fn format(&self) -> &'static str {
        "a table (CSV) with the columns time_secs, motor_1_pwm …, gyro_x_rad_per_s … or timestamp, motor.m1 …, gyro.x …"
    }

    fn recognises(&self, bytes: &[u8]) -> bool {
        let heading = bytes.split(|byte| *byte == b'\n').next().unwrap_or_default();
        let text = std::str::from_utf8(heading).unwrap_or_default();
        text.split(',').any(|cell| TIME.iter().any(|time| time.name == cell.trim()))
    }

    fn recording(&self, name: &str, bytes: &[u8]) -> Result<Recording, LogError> {
        let text = std::str::from_utf8(bytes).map_err(|error| {
            LogError::at(name, format!("byte {} that is no text", error.valid_up_to()), "UTF-8")
        })?;
        let mut lines = text.lines();
        let heading: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
        let places = Places::of(name, &heading)?;
        let mut recording = Recording::new(name, CommandRecord::Sampled);
        let mut row = Vec::with_capacity(heading.len());
        for (index, line) in lines.enumerate().filter(|(_, line)| !line.trim().is_empty()) {
            let place = || format!("{name}:{}", index + 2);
            row.clear();
            for cell in line.split(',') {
                row.push(
                    number(cell).ok_or_else(|| LogError::at(place(), format!("`{}`", cell.trim()), "a number"))?,
                );
            }
            if row.len() != heading.len() {
                let found = format!("{} cells", row.len());
                return Err(LogError::at(place(), found, format!("{}, as in the heading", heading.len())));
            }
            places.store(&row, &mut recording);
        }
        if recording.commands.period_secs().is_some_and(|period| period <= COMPLETE_PERIOD_SECS) {
            recording.command_record = CommandRecord::Complete;
        }
        Ok(recording)
    }
}

/// An empty cell is a value that is missing.
fn number(cell: &str) -> Option<f64> {
    let cell = cell.trim();
    if cell.is_empty() { Some(f64::NAN) } else { cell.parse().ok() }
}

/// Where a signal stands in a row.
struct Place {
    index: usize,
    scale: f64,
}

struct Places {
    time: Place,
    motors: [Place; 4],
    rates: [Place; 3],
    forces: Option<[Place; 3]>,
    positions: Option<[Place; 3]>,
    velocities: Option<[Place; 3]>,
    attitudes: Option<[Place; 4]>,
    volts: Option<[Place; 1]>,
    set_points: Option<[Place; 4]>,
    valid: Option<[Place; 1]>,
}

fn find(columns: &[Column], heading: &[&str]) -> Option<Place> {
    columns.iter().find_map(|column| {
        let index = heading.iter().position(|name| *name == column.name)?;
        Some(Place { index, scale: column.scale })
    })
}

fn find_all<const N: usize, const M: usize>(columns: &[[Column; M]; N], heading: &[&str]) -> Option<[Place; N]> {
    let places: Vec<Place> = columns.iter().filter_map(|column| find(column, heading)).collect();
    places.try_into().ok()
}

impl Places {
    fn of(name: &str, heading: &[&str]) -> Result<Self, LogError> {
        let lacks =
            |column: &Column| LogError::at(format!("{name}:1"), format!("no column `{}`", column.name), "it");
        Ok(Self {
            time: find(&TIME, heading).ok_or_else(|| lacks(&TIME[0]))?,
            motors: find_all(&MOTORS, heading).ok_or_else(|| lacks(&MOTORS[0][0]))?,
            rates: find_all(&RATES, heading).ok_or_else(|| lacks(&RATES[0][0]))?,
            forces: find_all(&FORCES, heading),
            positions: find_all(&POSITIONS, heading),
            velocities: find_all(&VELOCITIES, heading),
            attitudes: find_all(&ATTITUDES, heading),
            volts: find_all(&VOLTS, heading),
            set_points: find_all(&SET_POINTS, heading),
            valid: find_all(&VALID, heading),
        })
    }

    fn store(&self, row: &[f64], recording: &mut Recording) {
        let time_secs = row[self.time.index] * self.time.scale;
        if self.valid.as_ref().is_some_and(|[valid]| row[valid.index] != 1.0) {
            recording.doubtful_secs.push(time_secs);
        }
        let commands = values(&self.motors, row);
        if commands.iter().any(|share| !(0.0..=1.0).contains(share)) {
            recording.doubtful_secs.push(time_secs);
        }
        recording.commands.push(time_secs, commands.map(|share| share.clamp(0.0, 1.0)));
        recording.body_rates.push(time_secs, values(&self.rates, row));
        if let Some(places) = &self.forces {
            recording.specific_forces.push(time_secs, values(places, row));
        }
        if let Some(places) = &self.positions {
            recording.positions.push(time_secs, values(places, row));
        }
        if let Some(places) = &self.velocities {
            recording.velocities.push(time_secs, values(places, row));
        }
        if let Some(places) = &self.attitudes {
            recording.attitudes.push(time_secs, values(places, row));
        }
        if let Some(places) = &self.volts {
            recording.battery_volts.push(time_secs, values(places, row));
        }
        if let Some(places) = &self.set_points {
            recording.set_points.push(time_secs, values(places, row));
        }
    }
}

fn values<const N: usize>(places: &[Place; N], row: &[f64]) -> [f64; N] {
    std::array::from_fn(|part| row[places[part].index] * places[part].scale)
}

#[cfg(test)]
mod tests {
    use std::fmt::Write;

    use super::super::parse;

    const HEADING: &str = "time_secs,motor_1_pwm,motor_2_pwm,motor_3_pwm,motor_4_pwm,gyro_x_rad_per_s,\
        gyro_y_rad_per_s,gyro_z_rad_per_s,battery_v,valid";

    fn table(rows: usize, damage: impl Fn(usize, &str) -> String) -> String {
        let mut text = HEADING.to_owned();
        for row in 0..rows {
            let line = format!("{:.2},65535,0,6553.5,32767.5,0.5,0,-1,3.7,1", row as f64 * 0.01);
            write!(text, "\n{}", damage(row, &line)).unwrap();
        }
        text
    }

    #[test]
    fn rows_that_the_table_disowns_are_not_measured() {
        let text = table(400, |row, line| match row {
            100..200 => format!("{}0", &line[..line.len() - 1]),
            300 => line.replace("65535", "4800000"),
            _ => line.to_owned(),
        });
        let flight = parse("flight.csv", text.as_bytes()).unwrap();
        assert_eq!((flight.rows(), flight.period_secs), (400, 0.01));
        let dropped: Vec<usize> = (0..400).filter(|row| !flight.measured[*row]).collect();
        assert_eq!(dropped, (100..200).chain([300]).collect::<Vec<_>>());
        assert_eq!(flight.commands[0], [1.0, 0.0, 0.1, 0.5]);
        assert_eq!((flight.body_rates[0].z, flight.battery_volts.unwrap()[5]), (-1.0, 3.7));
    }

    #[test]
    fn a_gap_is_not_bridged() {
        let text = table(400, |row, line| if (100..120).contains(&row) { String::new() } else { line.to_owned() });
        let flight = parse("flight.csv", text.as_bytes()).unwrap();
        assert!(!flight.measured[110] && flight.measured[98] && flight.measured[121]);
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line() {
        let refusal = |text: &str| parse("flight.csv", text.as_bytes()).unwrap_err().to_string();
        let damaged = table(400, |row, line| if row == 5 { line.replace("3.7", "full") } else { line.to_owned() });
        assert_eq!(refusal(&damaged), "flight.csv:7: found `full`, expected a number");
        let short = table(400, |row, line| if row == 5 { line[5..].to_owned() } else { line.to_owned() });
        assert_eq!(refusal(&short), "flight.csv:7: found 9 cells, expected 10, as in the heading");
        assert_eq!(
            refusal("time_secs,gyro_x_rad_per_s\n"),
            "flight.csv:1: found no column `motor_1_pwm`, expected it"
        );
        assert!(refusal("a,b\n1,2\n").starts_with("flight.csv: found a file of no known format, expected a Craz"));
        let brief = table(100, |_, line| line.to_owned());
        assert!(refusal(&brief).ends_with("expected 2 s or more"), "{}", refusal(&brief));
    }
}
