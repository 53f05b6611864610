//! Tables with a heading: `NanoBench`'s columns, those that cflib's log blocks write under their own names, and those of
//! IDSIA's nano-drone benchmark (Busetto et al. 2026), with measured rotor speeds instead of commands.

use super::LogReader;
use super::crazyflie::{FULL_COMMAND, METRES_PER_SECOND_SQUARED_PER_G};
use crate::error::LogError;
use crate::flight::{Clocks, CommandRecord, Recording};

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

const TIME: [Column; 3] = [column("time_secs", 1.0), column("timestamp", 1e-3), SYNCHRONISED];

/// Time of a table whose signals its authors have put on one clock.
const SYNCHRONISED: Column = column("t", 1.0);

/// Rotor speeds \[rad/s\], in the order of the motors.
const SPEEDS: [[Column; 1]; 4] =
    [[column("m1_rads", 1.0)], [column("m2_rads", 1.0)], [column("m3_rads", 1.0)], [column("m4_rads", 1.0)]];

/// Fastest rotor that is believed \[rad/s\]: a tip 2.3 cm from the axis would pass twice the speed of sound.
const FASTEST_ROTOR: f64 = 30_000.0;

const MOTORS: [[Column; 2]; 4] = [
    [column("motor_1_pwm", 1.0 / FULL_COMMAND), column("motor.m1", 1.0 / FULL_COMMAND)],
    [column("motor_2_pwm", 1.0 / FULL_COMMAND), column("motor.m2", 1.0 / FULL_COMMAND)],
    [column("motor_3_pwm", 1.0 / FULL_COMMAND), column("motor.m3", 1.0 / FULL_COMMAND)],
    [column("motor_4_pwm", 1.0 / FULL_COMMAND), column("motor.m4", 1.0 / FULL_COMMAND)],
];

const RATES: [[Column; 3]; 3] = [
    [column("gyro_x_rad_per_s", 1.0), column("gyro.x", RADIANS), column("wx", 1.0)],
    [column("gyro_y_rad_per_s", 1.0), column("gyro.y", RADIANS), column("wy", 1.0)],
    [column("gyro_z_rad_per_s", 1.0), column("gyro.z", RADIANS), column("wz", 1.0)],
];

const FORCES: [[Column; 3]; 3] = [
    [
        column("accelerometer_x_g", METRES_PER_SECOND_SQUARED_PER_G),
        column("acc.x", METRES_PER_SECOND_SQUARED_PER_G),
        column("ax_body", 1.0),
    ],
    [
        column("accelerometer_y_g", METRES_PER_SECOND_SQUARED_PER_G),
        column("acc.y", METRES_PER_SECOND_SQUARED_PER_G),
        column("ay_body", 1.0),
    ],
    [
        column("accelerometer_z_g", METRES_PER_SECOND_SQUARED_PER_G),
        column("acc.z", METRES_PER_SECOND_SQUARED_PER_G),
        column("az_body", 1.0),
    ],
];

const POSITIONS: [[Column; 3]; 3] = [
    [column("position_x_m", 1.0), column("stateEstimate.x", 1.0), column("x", 1.0)],
    [column("position_y_m", 1.0), column("stateEstimate.y", 1.0), column("y", 1.0)],
    [column("position_z_m", 1.0), column("stateEstimate.z", 1.0), column("z", 1.0)],
];

const VELOCITIES: [[Column; 3]; 3] = [
    [column("velocity_x_m_per_s", 1.0), column("stateEstimate.vx", 1.0), column("vx", 1.0)],
    [column("velocity_y_m_per_s", 1.0), column("stateEstimate.vy", 1.0), column("vy", 1.0)],
    [column("velocity_z_m_per_s", 1.0), column("stateEstimate.vz", 1.0), column("vz", 1.0)],
];

const ATTITUDES: [[Column; 3]; 4] = [
    [column("attitude_w", 1.0), column("stateEstimate.qw", 1.0), column("qw", 1.0)],
    [column("attitude_x", 1.0), column("stateEstimate.qx", 1.0), column("qx", 1.0)],
    [column("attitude_y", 1.0), column("stateEstimate.qy", 1.0), column("qy", 1.0)],
    [column("attitude_z", 1.0), column("stateEstimate.qz", 1.0), column("qz", 1.0)],
];

const VOLTS: [[Column; 3]; 1] = [[column("battery_v", 1.0), column("pm.vbat", 1.0), column("Vbat", 1.0)]];

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
        "a table (CSV) with the columns time_secs, motor_1_pwm …, gyro_x_rad_per_s …, or timestamp, motor.m1 …, gyro.x …, \
         or t, m1_rads …, wx …"
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
        recording.command_by_speeds();
        if heading.contains(&SYNCHRONISED.name) {
            recording.clocks = Clocks::One;
        }
        if recording.commands.period_secs().is_some_and(|period| period <= COMPLETE_PERIOD_SECS) {
            recording.command_record = CommandRecord::Complete;
        }
        Ok(recording)
    }
}

/// An empty cell is a value that is missing; the truth of a flag is 1 or 0.
fn number(cell: &str) -> Option<f64> {
    match cell.trim() {
        "" => Some(f64::NAN),
        "True" => Some(1.0),
        "False" => Some(0.0),
        cell => cell.parse().ok(),
    }
}

/// Where a signal stands in a row.
struct Place {
    index: usize,
    scale: f64,
}

/// What says how fast the rotors turned.
enum Driving {
    Commands([Place; 4]),
    Speeds([Place; 4]),
}

struct Places {
    time: Place,
    driven: Driving,
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
            driven: find_all(&SPEEDS, heading)
                .map(Driving::Speeds)
                .or_else(|| find_all(&MOTORS, heading).map(Driving::Commands))
                .ok_or_else(|| lacks(&MOTORS[0][0]))?,
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
        if !self.driven.store(time_secs, row, recording) {
            recording.doubtful_secs.push(time_secs);
        }
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

impl Driving {
    /// Whether the row's values are possible.
    fn store(&self, time_secs: f64, row: &[f64], recording: &mut Recording) -> bool {
        match self {
            Self::Commands(places) => {
                let commands = values(places, row);
                recording.commands.push(time_secs, commands.map(|share| share.clamp(0.0, 1.0)));
                commands.iter().all(|share| (0.0..=1.0).contains(share))
            }
            Self::Speeds(places) => {
                let speeds = values(places, row);
                recording.rotor_speeds.push(time_secs, speeds.map(|speed| speed.clamp(0.0, FASTEST_ROTOR)));
                speeds.iter().all(|speed| (0.0..=FASTEST_ROTOR).contains(speed))
            }
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
    fn measured_rotor_speeds_stand_for_commands() {
        let mut text =
            ",t,x,y,z,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz,is_flying,m1_rads,m2_rads,m3_rads,m4_rads,az_body".to_owned();
        for row in 0..300 {
            let time = f64::from(row) * 0.01;
            write!(text, "\n{row},{time:.2},1,2,3,0,0,0,1,4,5,6,0.1,0.2,0.3,True,1000,2000,1500,500,9.8").unwrap();
        }
        let flight = parse("flight.csv", text.as_bytes()).unwrap();
        assert_eq!(flight.rotor_speeds.as_ref().map(|speeds| speeds[7]), Some([1000.0, 2000.0, 1500.0, 500.0]));
        assert_eq!((flight.commands[7], flight.battery_volts.is_none()), ([0.5, 1.0, 0.75, 0.25], true));
        let motion = flight.motion.as_ref().unwrap();
        assert_eq!((motion.positions[7].z, motion.velocities[7].x, motion.attitudes[7].w), (3.0, 4.0, 1.0));
        assert_eq!(flight.body_rates[7].y, 0.2);
        let fast = parse("flight.csv", text.replacen("2000", "2e9", 1).as_bytes());
        assert!(!fast.unwrap().measured[0]);
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
