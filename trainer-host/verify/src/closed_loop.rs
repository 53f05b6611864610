//! Flights under a controller, whole and in two halves: the controller in recorded states, the physics under
//! recorded rotor speeds.

use std::path::Path;

use kestrel_core::action::Setpoint;
use kestrel_core::airframe::Airframe;
use kestrel_core::reference::bullet::{Bullet, BulletState, Quirks};
use kestrel_core::reference::controller::{DslPid, DslPidMemory, command};
use kestrel_core::vehicle::State;
use serde::Deserialize;

use super::error::RecordingError;
use super::index::Case;
use super::model::{Models, Physics};
use super::motion::{Clock, Logged, flown, free_of_floor, largest, rotor_speeds, rpm};
use super::report::{Kind, Ledger, Worst};
use super::table::{RPM, Table};

/// Cosine of the tilt beyond which a flight counts as lost: 60°.
const LOST: f64 = 0.5;

/// Difference of the start by which a twin shows how far a flight is determined \[m/s\].
const NUDGE: f64 = 1e-12;

/// Difference of the twins' body rates from which it is not \[rad/s\].
const UNDETERMINED: f64 = 1e-8;

#[derive(Deserialize)]
struct Settings {
    model: String,
    physics: Physics,
    pyb_freq: u64,
    ctrl_freq: u64,
    controller_model: Option<String>,
}

/// A recorded flight and who flew it.
struct Flight {
    airframe: Airframe,
    physics: Physics,
    bullet: Bullet<f64>,
    controller: DslPid<f64>,
    clock: Clock,
    rows: Vec<Moment>,
}

/// One control step: the state, and what was asked of the controller and commanded by it.
struct Moment {
    name: String,
    motion: Logged,
    rpm: [f64; 4],
    request: Request,
}

/// What the controller was asked.
enum Request {
    /// Position, velocity \[m, m/s, world\] and yaw \[rad\].
    Target(Setpoint<f64>),
    /// Direction and share of the speed limit.
    Velocity([f64; 4]),
}

/// Compares a case.
pub(super) fn compare(
    folder: &Path,
    case: &Case<'_>,
    models: &Models,
    ledger: &mut Ledger,
) -> Result<(), RecordingError> {
    let flight = Flight::read(folder, case, models)?;
    ledger.add(Kind::ClosedLoopRpm, &case.id, &flight.worst_command());
    ledger.add(Kind::ClosedLoopStates, &case.id, &flight.worst_state());
    ledger.add(Kind::ClosedLoopFlight, &case.id, &flight.worst_of_flight());
    Ok(())
}

impl Flight {
    fn read(folder: &Path, case: &Case<'_>, models: &Models) -> Result<Self, RecordingError> {
        let settings: Settings = case.part.decode()?;
        let airframe = models.of_case(&settings.model, &case.part)?;
        let controlled = settings.controller_model.as_ref().unwrap_or(&settings.model);
        let table = Table::read(&folder.join("closed_loop").join(format!("{}.csv", case.id)))?;
        Ok(Self {
            airframe,
            physics: settings.physics,
            bullet: Bullet::new(&airframe, settings.physics.mode(), Quirks::upstream()),
            controller: DslPid::new(&models.of_case(controlled, &case.part)?),
            clock: case.part.clock(settings.pyb_freq, settings.ctrl_freq)?,
            rows: moments(&table)?,
        })
    }

    fn worst_command(&self) -> Worst {
        let mut memory = DslPidMemory::new();
        let mut worst = Worst::default();
        for moment in &self.rows {
            let speeds = self.command(&mut memory, moment, &moment.motion.placed().motion);
            worst.add(largest(&rpm(speeds), &moment.rpm), &moment.name);
        }
        worst
    }

    fn worst_state(&self) -> Worst {
        let mut drone = self.rows.first().map(|first| first.motion.placed());
        let mut worst = Worst::default();
        for moment in self.upright_rows() {
            let Some(present) = drone else { break };
            worst.add(moment.motion.deviation(&present), &moment.name);
            drone = self.advanced(present, &rotor_speeds(moment.rpm));
        }
        worst
    }

    /// The controller saturates in a limit cycle and doubles any difference, rounding included, every other step.
    fn worst_of_flight(&self) -> Worst {
        let mut worst = Worst::default();
        let Some(first) = self.rows.first() else { return worst };
        let mut drones = [first.motion.placed(); 2];
        drones[1].motion.velocity.x += NUDGE;
        let mut memories = [DslPidMemory::new(); 2];
        for moment in self.upright_rows() {
            if (drones[0].motion.body_rates - drones[1].motion.body_rates).norm() > UNDETERMINED {
                break;
            }
            worst.add(moment.motion.deviation(&drones[0]), &moment.name);
            for (drone, memory) in drones.iter_mut().zip(&mut memories) {
                let speeds = self.command(memory, moment, &drone.motion);
                let Some(after) = self.advanced(*drone, &speeds) else { return worst };
                *drone = after;
            }
        }
        worst
    }

    /// The rows until the drone is lost.
    fn upright_rows(&self) -> impl Iterator<Item = &Moment> {
        let upright = |moment: &&Moment| moment.motion.placed().motion.world_from_body.up_cosine() > LOST;
        self.rows.iter().take_while(upright)
    }

    /// Rotor speeds \[rad/s\] for what the recording asked.
    fn command(&self, memory: &mut DslPidMemory<f64>, moment: &Moment, state: &State<f64>) -> [f64; 4] {
        let setpoint = match &moment.request {
            Request::Target(setpoint) => *setpoint,
            Request::Velocity(action) => command::velocity(&self.airframe, state, action),
        };
        self.controller.command(memory, state, &setpoint, self.clock.control_secs()).rotor_speeds
    }

    /// A control period; none if the floor could be touched.
    fn advanced(&self, drone: BulletState<f64>, speeds: &[f64; 4]) -> Option<BulletState<f64>> {
        match self.physics {
            Physics::Dyn => Some(
                (0..self.clock.substeps)
                    .fold(drone, |drone, _| self.bullet.step(&drone, speeds, &[], self.clock.step_secs)),
            ),
            Physics::Pyb | Physics::PybGnd | Physics::PybDrag | Physics::PybDw | Physics::PybGndDragDw => {
                let free = free_of_floor(&self.airframe, &drone.motion);
                free.then(|| flown(&self.bullet, &self.airframe, &self.clock, drone, speeds)).flatten()
            }
        }
    }
}

fn moments(table: &Table) -> Result<Vec<Moment>, RecordingError> {
    let motion = table.motion("")?;
    let rpm = table.columns(RPM)?;
    let action = table.optional(["a0", "a1", "a2", "a3"])?;
    let target = if action.is_none() {
        Some((table.columns(["tx", "ty", "tz", "tyaw"])?, table.columns(["tvx", "tvy", "tvz"])?))
    } else {
        None
    };
    let mut moments = Vec::with_capacity(table.rows().len());
    for row in table.rows() {
        let request = match (&action, &target) {
            (Some(action), _) => Request::Velocity(table.given(row, action)?),
            (None, Some((place, velocity))) => {
                let [x, y, z, yaw] = table.given(row, place)?;
                let velocity = table.given(row, velocity)?.into();
                Request::Target(Setpoint { velocity, yaw, ..Setpoint::at([x, y, z].into()) })
            }
            (None, None) => unreachable!("without an action there are targets"),
        };
        let logged = table.start(row, &motion)?;
        moments.push(Moment { name: row.name(), motion: logged, rpm: table.given(row, &rpm)?, request });
    }
    if moments.is_empty() {
        return Err(table.refuse(2, "no rows", "one a control step"));
    }
    Ok(moments)
}
