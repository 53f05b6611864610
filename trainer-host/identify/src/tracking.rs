//! Closed loops: the set-points of a real flight, flown once more by Bitcraze's controllers on our drone.
//!
//! The battery's voltage is that of the flight, and so is the place of the take-off; nothing else is. Set-points have time
//! stamps of their own, which wander by a tenth of a second: a jump of them may be stamped before or after the drone
//! leans into it. They are put onto the clock of the motion by the controller's own law: where the drone was measured to
//! be, it leans as the controller has to make it lean.

use kestrel_core::crazyflie::{
    FIRMWARE_MASS_KG, Mix, MotorVoltage, Propellers, STABILISER_SECS, StockController, StockPilot,
};
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_onboard::plant::{FlatFloor, Plant};
use nalgebra::{Vector2, Vector3};

use crate::alignment::peak;
use crate::drone::Drone;
use crate::flight::{Flight, Motion, SetPoint};

/// Height of a set-point from which on a flight is judged \[m\]: below, the drone stands, or the ground cushions it.
const JUDGED_HEIGHT_M: f64 = 0.3;

/// Mean height above the set-points under which Mellinger's controller flew \[m\]: its integral holds two grams at most,
/// while the cascade's ends where the error does. The flights for fitting have -0.09 to -0.12, or -0.02 and more.
const SAGGING_M: f64 = -0.05;

/// Greatest difference between the clocks of set-points and motion that is looked for \[s\].
const CLOCK_LIMIT_SECS: f64 = 0.2;

/// Greatest lag that is looked for \[s\].
const LAG_LIMIT_SECS: f64 = 1.5;

/// Greatest difference between the root mean squares, as a share of the real one.
const RMS_TOLERANCE: f64 = 0.2;

/// Greatest difference between the lags \[s\].
const LAG_TOLERANCE_SECS: f64 = 0.03;

/// How a real flight, and ours, follow the same set-points.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackingFinding {
    /// File name.
    pub flight: String,
    /// What flew it, as its height shows.
    pub controller: StockController,
    /// By how much the set-points are stamped too early \[s\]; negative if too late.
    pub early_secs: f64,
    /// The real flight.
    pub real: TrackingError,
    /// Ours.
    pub ours: TrackingError,
}

/// How far from the set-points, and how late.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackingError {
    /// Root mean square of the distance \[m\].
    pub rms_m: f64,
    /// By how much the set-points must be delayed for the positions to correlate best with them \[s\].
    pub lag_secs: f64,
}

impl TrackingFinding {
    /// Of a flight that has positions, set-points and a voltage, and takes off.
    pub(crate) fn of(flight: &Flight, drone: &Drone) -> Option<Self> {
        let stamped = flight.set_points.as_ref()?;
        let sagging = Track::of(flight, stamped, &flight.motion.as_ref()?.positions).mean_error().z < SAGGING_M;
        let controller = if sagging { StockController::Mellinger } else { StockController::Cascade };
        let repetition = Repetition::of(flight, drone, controller)?;
        let early_rows = repetition.early_rows(stamped);
        let set_points = delayed(stamped, early_rows);
        let error = |positions: &[_]| Track::of(flight, &set_points, positions).error(flight.period_secs);
        Some(Self {
            flight: flight.name.clone(),
            controller,
            early_secs: early_rows as f64 * flight.period_secs,
            real: error(&repetition.motion.positions),
            ours: error(&repetition.positions(&set_points)),
        })
    }

    /// Root mean square of ours over that of the real flight.
    pub fn ratio(&self) -> f64 {
        self.ours.rms_m / self.real.rms_m
    }

    /// Whether error and lag are those of the real flight.
    pub fn passed(&self) -> bool {
        let lag = self.ours.lag_secs - self.real.lag_secs;
        (self.ratio() - 1.0).abs() <= RMS_TOLERANCE && lag.abs() <= LAG_TOLERANCE_SECS
    }
}

/// The same set-points so many rows later.
fn delayed(set_points: &[SetPoint], rows: isize) -> Vec<SetPoint> {
    let last = set_points.len() as isize - 1;
    (0..=last).map(|row| set_points[(row - rows).clamp(0, last) as usize]).collect()
}

/// A flight that our drone flies once more.
struct Repetition<'a> {
    flight: &'a Flight,
    motion: &'a Motion,
    volts: &'a [f64],
    drone: &'a Drone,
    controller: StockController,
    /// The row in which the motors begin to turn.
    start: usize,
}

impl<'a> Repetition<'a> {
    fn of(flight: &'a Flight, drone: &'a Drone, controller: StockController) -> Option<Self> {
        let (motion, volts) = (flight.motion.as_ref()?, flight.battery_volts.as_ref()?);
        let turning = |row: &usize| flight.commands[*row].iter().all(|command| *command > 0.0);
        let start = (0..flight.rows()).find(|row| flight.measured[*row] && turning(row))?;
        Some(Self { flight, motion, volts, drone, controller, start })
    }

    /// Positions of our drone \[m\] in the rows of the flight; before the start, those of the flight.
    fn positions(&self, set_points: &[SetPoint]) -> Vec<Vector3<f64>> {
        let mut flyer = self.flyer();
        let mut positions = self.motion.positions[..=self.start].to_vec();
        for row in self.start..self.flight.rows() - 1 {
            for _ in 0..self.steps_per_row() {
                flyer.step(&set_points[row], self.volts[row]);
            }
            positions.push(flyer.position());
        }
        positions
    }

    /// By how many rows the set-points are stamped too early: when they are this much later, the controller makes our
    /// drone lean as the real one leans.
    fn early_rows(&self, set_points: &[SetPoint]) -> isize {
        let reach = (CLOCK_LIMIT_SECS / self.flight.period_secs) as isize;
        let score = |rows: isize| -self.leaning_error(&delayed(set_points, rows));
        let scores: Vec<f64> = (-reach..=reach).map(score).collect();
        peak(&scores).map_or(0, |best| best.round() as isize - reach)
    }

    /// Mean squared difference, less the mean difference, between the lean of the real drone and that of ours, which the
    /// controller turns while it is carried along the real course.
    fn leaning_error(&self, set_points: &[SetPoint]) -> f64 {
        let mut flyer = self.flyer();
        let mut differences: Vec<Vector2<f64>> = Vec::new();
        for row in self.start..self.flight.rows() - 1 {
            for _ in 0..self.steps_per_row() {
                flyer.carry(&self.motion.positions[row], &self.motion.velocities[row]);
                flyer.step(&set_points[row], self.volts[row]);
            }
            if is_judged(self.flight, set_points, row + 1) {
                let ours = flyer.plant.state().world_from_body.body_z().cast::<f64>();
                differences.push((ours - self.motion.attitudes[row + 1].body_z()).xy());
            }
        }
        let count = differences.len().max(1) as f64;
        let mean = differences.iter().sum::<Vector2<f64>>() / count;
        differences.iter().map(|difference| (difference - mean).norm_squared()).sum::<f64>() / count
    }

    fn steps_per_row(&self) -> usize {
        (self.flight.period_secs / STABILISER_SECS).round() as usize
    }

    /// On the floor, where the real drone stands.
    fn flyer(&self) -> Flyer<'a> {
        let place: Vector3<f32> = self.motion.positions[self.start].cast();
        let mut plant = FlatFloor::new(&self.drone.airframe, STABILISER_SECS as f32).at([place.x, place.y]);
        let turned = self.motion.attitudes[self.start].map(|part| part as f32);
        plant.put(State { world_from_body: turned, ..*plant.state() });
        let pilot = StockPilot::begun(self.controller, FIRMWARE_MASS_KG, plant.state());
        let lift = place.z - plant.state().position.z;
        Flyer { drone: self.drone, plant, pilot, motor: MotorVoltage::new(Propellers::Plus), lift }
    }
}

/// Our drone above the floor from which the real one takes off.
struct Flyer<'a> {
    drone: &'a Drone,
    plant: FlatFloor,
    pilot: StockPilot<f32>,
    motor: MotorVoltage,
    /// Height of the real floor above that of the plant \[m\].
    lift: f32,
}

impl Flyer<'_> {
    fn step(&mut self, set_point: &SetPoint, battery_volts: f64) {
        let mut goal: Vector3<f32> = set_point.position.cast();
        goal.z -= self.lift;
        let set_point = Setpoint { yaw: set_point.yaw as f32, ..Setpoint::at(goal) };
        let mix = self.pilot.mix(self.plant.state(), &set_point, &Vector3::zeros());
        self.plant.step(&self.rotor_targets(&mix, battery_volts));
    }

    /// \[rad/s\].
    fn rotor_targets(&self, mix: &Mix<f32>, battery_volts: f64) -> [f32; 4] {
        let Drone { airframe, thrust_curve } = self.drone;
        mix.motor_counts().map(|counts| {
            let duty = self.motor.duty(f64::from(counts), battery_volts);
            let share = thrust_curve.speed_share(duty, battery_volts / thrust_curve.full_volts);
            (airframe.rotor_speed_limit * share) as f32
        })
    }

    /// Puts the drone where the real one is, as fast as that, and lets it lean as it does.
    fn carry(&mut self, position: &Vector3<f64>, velocity: &Vector3<f64>) {
        let mut position: Vector3<f32> = position.cast();
        position.z -= self.lift;
        self.plant.put(State { position, velocity: velocity.cast(), ..*self.plant.state() });
    }

    fn position(&self) -> Vector3<f64> {
        let position = self.plant.state().position;
        Vector3::new(position.x, position.y, position.z + self.lift).cast()
    }
}

fn is_judged(flight: &Flight, set_points: &[SetPoint], row: usize) -> bool {
    flight.measured[row] && set_points[row].position.z >= JUDGED_HEIGHT_M
}

/// Positions beside set-points, and the rows that count.
struct Track<'a> {
    positions: &'a [Vector3<f64>],
    set_points: &'a [SetPoint],
    judged: Vec<bool>,
}

impl<'a> Track<'a> {
    fn of(flight: &Flight, set_points: &'a [SetPoint], positions: &'a [Vector3<f64>]) -> Self {
        let judged = (0..flight.rows()).map(|row| is_judged(flight, set_points, row)).collect();
        Self { positions, set_points, judged }
    }

    /// Position less set-point, in the rows that count.
    fn errors(&self) -> impl Iterator<Item = Vector3<f64>> {
        let rows = self.positions.iter().zip(self.set_points).zip(&self.judged);
        rows.filter(|(_, judged)| **judged).map(|((position, asked), _)| position - asked.position)
    }

    fn mean_error(&self) -> Vector3<f64> {
        self.errors().sum::<Vector3<f64>>() / self.errors().count().max(1) as f64
    }

    fn error(&self, period_secs: f64) -> TrackingError {
        let square = self.errors().map(|error| error.norm_squared()).sum::<f64>();
        let reach = (LAG_LIMIT_SECS / period_secs) as usize;
        let scores: Vec<f64> = (0..=reach).map(|late| self.correlation(late)).collect();
        TrackingError {
            rms_m: (square / self.errors().count().max(1) as f64).sqrt(),
            lag_secs: peak(&scores).unwrap_or(0.0) * period_secs,
        }
    }

    /// Of the positions with the set-points so many rows before, over all axes, each about its mean.
    fn correlation(&self, late: usize) -> f64 {
        let both = |row: &usize| self.judged[*row] && self.judged[*row - late];
        let rows: Vec<usize> = (late..self.judged.len()).filter(both).collect();
        let there = |row: &usize| self.positions[*row];
        let asked = |row: &usize| self.set_points[*row - late].position;
        let count = rows.len().max(1) as f64;
        let mean_there = rows.iter().map(there).sum::<Vector3<f64>>() / count;
        let mean_asked = rows.iter().map(asked).sum::<Vector3<f64>>() / count;
        let (mut product, mut own, mut other) = (0.0, 0.0, 0.0);
        for row in &rows {
            let (there, asked) = (there(row) - mean_there, asked(row) - mean_asked);
            product += there.dot(&asked);
            own += there.norm_squared();
            other += asked.norm_squared();
        }
        product / (own * other).sqrt().max(1e-12)
    }
}

#[cfg(test)]
mod tests;
