//! A flight in columns of one clock: what the drone was told, and what it was measured to do.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use crate::error::LogError;
use crate::track::Track;

/// Longest stretch that a straight line may bridge \[s\]; a drone turns by a radian in less than ten of them.
const GAP_SECS: f64 = 0.025;

/// Shortest flight that says anything \[s\].
const SHORTEST_SECS: f64 = 2.0;

/// Finest clock \[s\]: motors take fifty of them to react.
const FINEST_PERIOD_SECS: f64 = 0.001;

/// Coarsest clock \[s\].
const COARSEST_PERIOD_SECS: f64 = 0.02;

/// Whether a log holds every command that reached the motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandRecord {
    /// Each command held until the next one of the log.
    Complete,
    /// Some of them, by radio: the controller gave others between. Turning cannot be followed with these; thrust can.
    Sampled,
}

/// Whether motion and gyroscope of a log have clocks of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Clocks {
    /// They may: turning shows by how much they differ.
    Several,
    /// They have one: who wrote the log has aligned them.
    One,
}

/// What a reader finds in a log, every signal with its own time stamps \[s\].
#[derive(Clone, Debug)]
pub struct Recording {
    /// File name.
    pub name: String,
    /// Share of the greatest command of each motor in \[0, 1\]: front right, rear right, rear left, front left.
    pub commands: Track<4>,
    /// Whether these are all commands.
    pub command_record: CommandRecord,
    /// Measured rotor speeds \[rad/s\] in the order of the commands; without samples where none were.
    pub rotor_speeds: Track<4>,
    /// Whether motion and gyroscope may differ.
    pub clocks: Clocks,
    /// Body rates \[rad/s\].
    pub body_rates: Track<3>,
    /// Accelerometer \[m/s²\], body.
    pub specific_forces: Track<3>,
    /// Position \[m\], world.
    pub positions: Track<3>,
    /// Velocity \[m/s\], world.
    pub velocities: Track<3>,
    /// Quaternion `world_from_body`, scalar first.
    pub attitudes: Track<4>,
    /// Battery voltage under load \[V\].
    pub battery_volts: Track<1>,
    /// Position \[m\], world, and heading \[rad\] that the controller was asked for.
    pub set_points: Track<4>,
    /// Time stamps of rows that the log itself does not vouch for.
    pub doubtful_secs: Vec<f64>,
}

impl Recording {
    /// Without samples.
    pub fn new(name: &str, command_record: CommandRecord) -> Self {
        Self {
            name: name.to_owned(),
            commands: Track::new(),
            command_record,
            rotor_speeds: Track::new(),
            clocks: Clocks::Several,
            body_rates: Track::new(),
            specific_forces: Track::new(),
            positions: Track::new(),
            velocities: Track::new(),
            attitudes: Track::new(),
            battery_volts: Track::new(),
            set_points: Track::new(),
            doubtful_secs: Vec::new(),
        }
    }
}

impl Recording {
    /// Takes the measured rotor speeds for commands: what was asked of the motors does not matter any more.
    pub(crate) fn command_by_speeds(&mut self) {
        let greatest =
            self.rotor_speeds.samples().flat_map(|(_, speeds)| speeds).fold(f64::MIN_POSITIVE, f64::max);
        for (time, speeds) in self.rotor_speeds.samples() {
            self.commands.push(time, speeds.map(|speed| (speed / greatest).clamp(0.0, 1.0)));
        }
    }
}

/// Where the drone was, by motion capture or by an estimator.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Position \[m\], world.
    pub positions: Vec<Vector3<f64>>,
    /// Attitude.
    pub attitudes: Vec<Attitude<f64>>,
    /// Velocity \[m/s\], world.
    pub velocities: Vec<Vector3<f64>>,
}

/// A flight, a row each period.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    /// File name.
    pub name: String,
    /// Time stamp of the first row \[s\].
    pub start_secs: f64,
    /// Time between rows \[s\].
    pub period_secs: f64,
    /// Whether every signal of a row was measured: no gap, nothing interpolated by the log.
    pub measured: Vec<bool>,
    /// Share of the greatest command of each motor in \[0, 1\], held until the next row.
    pub commands: Vec<[f64; 4]>,
    /// Whether these are all commands.
    pub command_record: CommandRecord,
    /// Measured rotor speeds \[rad/s\]; the commands are then their share of the greatest one, and drive nothing.
    pub rotor_speeds: Option<Vec<[f64; 4]>>,
    /// Body rates \[rad/s\].
    pub body_rates: Vec<Vector3<f64>>,
    /// Accelerometer \[m/s²\], body.
    pub specific_forces: Option<Vec<Vector3<f64>>>,
    /// Position, attitude and velocity.
    pub motion: Option<Motion>,
    /// Battery voltage \[V\].
    pub battery_volts: Option<Vec<f64>>,
    /// What the controller was asked for, held until the next row.
    pub set_points: Option<Vec<SetPoint>>,
}

/// Where a controller was asked to go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetPoint {
    /// \[m\], world.
    pub position: Vector3<f64>,
    /// Heading \[rad\].
    pub yaw: f64,
}

impl Flight {
    /// The recording on one clock: commands held, measurements on straight lines.
    ///
    /// # Errors
    /// When commands or body rates are missing, or they have less than two seconds in common.
    pub fn resampled(recording: &Recording) -> Result<Self, LogError> {
        let [start, end] = common_span(recording)?;
        let period = period_secs(recording);
        // A thousandth of a row for the rounding of time stamps.
        let rows = ((end - start) / period + 1e-3) as usize + 1;
        let times: Vec<f64> = (0..rows).map(|row| start + row as f64 * period).collect();
        let gap = GAP_SECS.max(3.0 * period);
        let column = |track: &Track<3>| -> Option<Vec<Vector3<f64>>> {
            (!track.is_empty()).then(|| filled(&times, |time| track.interpolated(time, gap)).map_vectors())
        };
        let volts =
            |track: &Track<1>| filled(&times, |time| track.held(time)).0.iter().map(|[volts]| *volts).collect();
        let mut flight = Self {
            name: recording.name.clone(),
            start_secs: start,
            period_secs: period,
            measured: times.iter().map(|time| is_measured(recording, *time, gap)).collect(),
            commands: filled(&times, |time| recording.commands.held(time)).0,
            command_record: recording.command_record,
            rotor_speeds: (!recording.rotor_speeds.is_empty())
                .then(|| filled(&times, |time| recording.rotor_speeds.interpolated(time, gap)).0),
            body_rates: column(&recording.body_rates).unwrap_or_default(),
            specific_forces: column(&recording.specific_forces),
            motion: motion(recording, &times, gap),
            battery_volts: (!recording.battery_volts.is_empty()).then(|| volts(&recording.battery_volts)),
            set_points: set_points(recording, &times),
        };
        flight.doubt(&recording.doubtful_secs);
        Ok(flight)
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.measured.len()
    }

    /// Time stamp of a row \[s\].
    pub fn time_secs(&self, row: usize) -> f64 {
        self.start_secs + row as f64 * self.period_secs
    }

    /// Rows in `secs`, at least one.
    pub fn rows_in(&self, secs: f64) -> usize {
        ((secs / self.period_secs).round() as usize).max(1)
    }

    fn doubt(&mut self, doubtful_secs: &[f64]) {
        for time in doubtful_secs {
            let row = (time - self.start_secs) / self.period_secs;
            for row in [row.floor(), row.ceil()] {
                if let Some(measured) = (row >= 0.0).then(|| self.measured.get_mut(row as usize)).flatten() {
                    *measured = false;
                }
            }
        }
    }
}

fn set_points(recording: &Recording, times: &[f64]) -> Option<Vec<SetPoint>> {
    let asked = |[x, y, z, yaw]: [f64; 4]| SetPoint { position: Vector3::new(x, y, z), yaw };
    let held = || filled(times, |time| recording.set_points.held(time)).0.into_iter().map(asked).collect();
    (!recording.set_points.is_empty()).then(held)
}

/// Values of a column; the last one stands where there is none, so that the column is whole.
struct Filled<const N: usize>(Vec<[f64; N]>);

impl Filled<3> {
    fn map_vectors(self) -> Vec<Vector3<f64>> {
        self.0.into_iter().map(Vector3::from).collect()
    }
}

fn filled<const N: usize>(times: &[f64], value: impl Fn(f64) -> Option<[f64; N]>) -> Filled<N> {
    let mut last = times.iter().find_map(|time| value(*time)).unwrap_or([0.0; N]);
    let mut next = |time: &f64| {
        last = value(*time).unwrap_or(last);
        last
    };
    Filled(times.iter().map(&mut next).collect())
}

fn common_span(recording: &Recording) -> Result<[f64; 2], LogError> {
    let span = |what: &str, span: Option<[f64; 2]>| {
        span.ok_or_else(|| LogError::at(&recording.name, format!("no {what}"), "motor commands and a gyroscope"))
    };
    let commands = span("motor commands", recording.commands.span_secs())?;
    let rates = span("gyroscope", recording.body_rates.span_secs())?;
    let [start, end] = [commands[0].max(rates[0]), commands[1].min(rates[1])];
    if end - start >= SHORTEST_SECS {
        return Ok([start, end]);
    }
    let found = format!("{:.1} s with motor commands and gyroscope", (end - start).max(0.0));
    Err(LogError::at(&recording.name, found, format!("{SHORTEST_SECS} s or more")))
}

/// The gyroscope's period in whole half milliseconds.
fn period_secs(recording: &Recording) -> f64 {
    let period = recording.body_rates.period_secs().unwrap_or(FINEST_PERIOD_SECS);
    ((period / 5e-4).round() * 5e-4).clamp(FINEST_PERIOD_SECS, COARSEST_PERIOD_SECS)
}

fn is_measured(recording: &Recording, time: f64, gap: f64) -> bool {
    let known = |track: &Track<3>| track.is_empty() || track.interpolated(time, gap).is_some();
    recording.commands.covers(time, gap)
        && recording.body_rates.interpolated(time, gap).is_some()
        && [&recording.specific_forces, &recording.positions, &recording.velocities].into_iter().all(known)
        && (recording.attitudes.is_empty() || recording.attitudes.interpolated(time, gap).is_some())
}

/// `None` unless position, velocity and attitude are all there.
fn motion(recording: &Recording, times: &[f64], gap: f64) -> Option<Motion> {
    let Recording { positions, velocities, attitudes, .. } = recording;
    if positions.is_empty() || velocities.is_empty() || attitudes.is_empty() {
        return None;
    }
    let column = |track: &Track<3>| filled(times, |time| track.interpolated(time, gap)).map_vectors();
    let quaternions = filled(times, |time| continuous(attitudes, time, gap)).0;
    let attitude = |[w, x, y, z]: [f64; 4]| Attitude { w, x, y, z }.normalized();
    Some(Motion {
        positions: column(positions),
        velocities: column(velocities),
        attitudes: quaternions.into_iter().map(attitude).collect(),
    })
}

/// Between two quaternions, one of which may be the other's negative.
fn continuous(attitudes: &Track<4>, time: f64, gap: f64) -> Option<[f64; 4]> {
    let before = attitudes.held(time)?;
    let between = attitudes.interpolated(time, gap)?;
    let norm: f64 = between.iter().map(|part| part * part).sum();
    // Opposite signs nearly cancel in the middle; the earlier one then stands for both.
    Some(if norm < 0.9 { before } else { between })
}
