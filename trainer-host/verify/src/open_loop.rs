//! Runs with recorded rotor speeds, up to their first contact; what comes of it is compared by [`super::contact`].

use std::collections::BTreeMap;
use std::path::Path;

use kestrel_core::airframe::Airframe;
use kestrel_core::reference::bullet::{Bullet, BulletState, Quirks};
use nalgebra::Vector3;
use serde::Deserialize;

use super::contact;
use super::error::RecordingError;
use super::index::Case;
use super::model::{Models, Physics};
use super::motion::{Clock, Logged, largest, rotor_speeds};
use super::report::{Kind, Ledger, Worst};
use super::table::{Columns, RPM, Table};

#[derive(Deserialize)]
struct Settings {
    model: String,
    physics: Physics,
    pyb_freq: u64,
    ctrl_freq: u64,
    phys_steps: usize,
    first_contact_step: Option<usize>,
    num_drones: usize,
    category: Option<String>,
    #[serde(default)]
    boxes: Vec<StaticBox>,
}

/// A body in the way of a run; it never moves.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct StaticBox {
    /// \[m\].
    pub half_extents: [f64; 3],
    /// Of its centre \[m, world\].
    pub position: [f64; 3],
    /// Roll, pitch, yaw \[rad\].
    pub rpy: [f64; 3],
}

/// A recorded run of several drones.
#[derive(Clone, Debug)]
pub struct Run {
    /// Its name.
    pub id: String,
    /// `drop`, `wall` and the like.
    pub category: String,
    /// The drones.
    pub airframe: Airframe,
    /// Its physics.
    pub physics: Physics,
    /// Its rates.
    pub clock: Clock,
    /// What is in the way.
    pub boxes: Vec<StaticBox>,
    /// Physics step at which a contact was first seen.
    pub first_contact_step: Option<usize>,
    /// Length of the run in physics steps.
    pub steps: usize,
    /// What each drone did, by physics step; zero is the start.
    pub record: BTreeMap<usize, Vec<Sample>>,
    /// Rotor speeds \[rad/s\] by control step and drone, held until the drone's next.
    pub commands: Vec<Command>,
}

/// One drone after a physics step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Where it is and how it moves.
    pub motion: Logged,
    /// Its contact points, and the sum of their normal forces \[N\].
    pub contacts: [f64; 2],
    /// Angular velocity \[rad/s\], body, if it is recorded.
    pub body_rates: Option<[f64; 3]>,
}

/// From a control step on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Counted from zero.
    pub control_step: usize,
    /// Counted from zero.
    pub drone: usize,
    /// \[rad/s\].
    pub rotor_speeds: [f64; 4],
}

/// Compares a case.
pub(super) fn compare(
    folder: &Path,
    case: &Case<'_>,
    models: &Models,
    ledger: &mut Ledger,
) -> Result<(), RecordingError> {
    let run = Run::read(folder, case, models)?;
    ledger.add(Kind::OpenLoop, &run.id, &run.worst_free_step());
    contact::compare(&run, ledger);
    if run.last_step() < run.steps {
        ledger.note(format!("open_loop: {} ends at step {} of {}", run.id, run.last_step(), run.steps));
    }
    Ok(())
}

impl Run {
    /// Reads a case and its two tables.
    ///
    /// # Errors
    /// When something is missing or contradicts the index.
    pub(super) fn read(folder: &Path, case: &Case<'_>, models: &Models) -> Result<Self, RecordingError> {
        let settings: Settings = case.part.decode()?;
        if !(1..=1000).contains(&settings.num_drones) {
            return Err(case.part.refuse(format_args!("num_drones {}", settings.num_drones), "1 to 1000"));
        }
        let folder = folder.join("open_loop");
        let states = Table::read(&folder.join(format!("{}.state.csv", case.id)))?;
        let commands = Table::read(&folder.join(format!("{}.rpm.csv", case.id)))?;
        Ok(Self {
            id: case.id.clone(),
            category: settings.category.unwrap_or_default(),
            airframe: models.of_case(&settings.model, &case.part)?,
            physics: settings.physics,
            clock: case.part.clock(settings.pyb_freq, settings.ctrl_freq)?,
            boxes: settings.boxes,
            first_contact_step: settings.first_contact_step,
            steps: settings.phys_steps,
            record: record(&states, settings.num_drones)?,
            commands: rotor_commands(&commands, settings.num_drones)?,
        })
    }

    /// The drones at the start of the run.
    pub fn start(&self) -> Vec<BulletState<f64>> {
        self.record[&0].iter().map(Sample::placed).collect()
    }

    /// Flies the recorded rotor speeds where nothing touches anything.
    fn worst_free_step(&self) -> Worst {
        let bullet = Bullet::new(&self.airframe, self.physics.mode(), Quirks::upstream());
        let mut drones = self.start();
        let mut commands = self.commands();
        let mut worst = Worst::default();
        for step in 0..self.free_steps() {
            advance(&bullet, &mut drones, commands.at(step), self.clock.step_secs);
            if let Some(samples) = self.record.get(&(step + 1)) {
                let error = drones.iter().zip(samples).map(|(drone, sample)| sample.deviation(drone));
                worst.add(error.fold(0.0, f64::max), format_args!("step {}", step + 1));
            }
        }
        worst
    }

    /// The commands from the start on.
    pub(super) fn commands(&self) -> Commands<'_> {
        let speeds = vec![[0.0; 4]; self.record[&0].len()];
        Commands { coming: &self.commands, substeps: self.clock.substeps, speeds }
    }

    /// The last recorded step.
    pub(super) fn last_step(&self) -> usize {
        self.record.keys().next_back().copied().unwrap_or(0)
    }

    /// Steps before the first contact: contacts are recorded once a control step, so its first steps count as well
    /// as touching.
    fn free_steps(&self) -> usize {
        let last = self.last_step().min(self.steps);
        let before = |contact: usize| contact.saturating_sub(self.clock.substeps);
        self.first_contact().map_or(last, before).min(last)
    }

    /// The first step with a contact, as stated or as recorded.
    pub(super) fn first_contact(&self) -> Option<usize> {
        let touching = |(_, samples): &(&usize, &Vec<Sample>)| samples.iter().any(|each| each.contacts[0] > 0.0);
        let seen = self.record.iter().find(touching).map(|(step, _)| *step);
        self.first_contact_step.into_iter().chain(seen).min()
    }
}

/// The rotor speeds of a run, step by step.
pub(super) struct Commands<'a> {
    coming: &'a [Command],
    substeps: usize,
    speeds: Vec<[f64; 4]>,
}

impl Commands<'_> {
    /// Of all drones in a physics step \[rad/s\]; steps may only grow from call to call.
    pub(super) fn at(&mut self, step: usize) -> &[[f64; 4]] {
        while let Some((command, rest)) = self.coming.split_first() {
            if command.control_step * self.substeps > step {
                break;
            }
            self.speeds[command.drone] = command.rotor_speeds;
            self.coming = rest;
        }
        &self.speeds
    }
}

impl Sample {
    pub(super) fn placed(&self) -> BulletState<f64> {
        let mut drone = self.motion.placed();
        if let Some(body_rates) = self.body_rates {
            drone.motion.body_rates = Vector3::from(body_rates);
        }
        drone
    }

    fn deviation(&self, drone: &BulletState<f64>) -> f64 {
        let turning = self.body_rates.map_or(0.0, |rates| largest(drone.motion.body_rates.as_slice(), &rates));
        self.motion.deviation(drone).max(turning)
    }
}

/// One physics step of the whole swarm.
pub(super) fn advance(bullet: &Bullet<f64>, drones: &mut [BulletState<f64>], speeds: &[[f64; 4]], step_secs: f64) {
    let swarm: Vec<Vector3<f64>> = drones.iter().map(|drone| drone.motion.position).collect();
    for (drone, speeds) in drones.iter_mut().zip(speeds) {
        *drone = bullet.step(drone, speeds, &swarm, step_secs);
    }
}

/// The samples of all drones by step; every step that is there has all of them.
fn record(table: &Table, drones: usize) -> Result<BTreeMap<usize, Vec<Sample>>, RecordingError> {
    let [step_column, drone_column] = table.columns(["step", "drone"])?;
    let motion = table.motion("")?;
    let contacts: Columns<2> = table.columns(["nc", "fn"])?;
    let rates = table.optional(["bx", "by", "bz"])?;
    let mut record: BTreeMap<usize, Vec<Sample>> = BTreeMap::new();
    for row in table.rows() {
        let samples = record.entry(table.whole(row, step_column)?).or_default();
        let drone = table.whole(row, drone_column)?;
        if drone != samples.len() || drone >= drones {
            let expected = format!("{} of {drones}, counted from 0", samples.len());
            return Err(table.refuse_row(row, format_args!("drone {drone}"), expected));
        }
        samples.push(Sample {
            motion: row.motion(&motion),
            contacts: row.pick(&contacts),
            body_rates: rates.map(|columns| row.pick(&columns)),
        });
        if table.whole(row, step_column)? == 0 {
            table.start(row, &motion)?;
            rates.map(|columns| table.given(row, &columns)).transpose()?;
        }
    }
    match record.get(&0).map_or(0, Vec::len) {
        found if found == drones => Ok(record),
        found => {
            Err(table.refuse(2, format_args!("{found} rows of step 0"), format_args!("{drones}, one a drone")))
        }
    }
}

/// The commands in their order; every drone has one from the start.
fn rotor_commands(table: &Table, drones: usize) -> Result<Vec<Command>, RecordingError> {
    let [step_column, drone_column] = table.columns(["ctrl_step", "drone"])?;
    let rpm = table.columns(RPM)?;
    let mut commands: Vec<Command> = Vec::new();
    for row in table.rows() {
        let control_step = table.whole(row, step_column)?;
        let drone = table.whole(row, drone_column)?;
        if drone >= drones {
            return Err(table.refuse_row(row, format_args!("drone {drone}"), format_args!("less than {drones}")));
        }
        if let Some(last) = commands.last().filter(|last| last.control_step > control_step) {
            let expected = format!("{} or more: the order of time", last.control_step);
            return Err(table.refuse_row(row, format_args!("control step {control_step}"), expected));
        }
        commands.push(Command { control_step, drone, rotor_speeds: rotor_speeds(table.given(row, &rpm)?) });
    }
    let missing = (0..drones)
        .find(|drone| !commands.iter().any(|command| command.drone == *drone && command.control_step == 0));
    missing.map_or(Ok(commands), |drone| {
        Err(table.refuse(2, format_args!("no rotor speeds of drone {drone} at control step 0"), "some"))
    })
}
