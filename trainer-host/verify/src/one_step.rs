//! One physics step from a fresh state.

use std::path::{Path, PathBuf};

use kestrel_core::reference::bullet::{Bullet, Quirks};
use nalgebra::Vector3;
use serde::Deserialize;

use super::error::RecordingError;
use super::index::Case;
use super::model::{Models, Physics};
use super::motion::{largest, rotor_speeds};
use super::report::{Kind, Ledger, Worst};
use super::table::{Columns, RPM, Row, Table};

/// The reference's physics rate \[Hz\], where a recording does not say.
const FREQUENCY: u64 = 240;

#[derive(Deserialize)]
struct Settings {
    model: String,
    physics: Physics,
    rows: Option<usize>,
    pyb_freq: Option<u64>,
}

/// Compares a case.
pub(super) fn compare(
    folder: &Path,
    case: &Case<'_>,
    models: &Models,
    ledger: &mut Ledger,
) -> Result<(), RecordingError> {
    let settings: Settings = case.part.decode()?;
    let frequency = settings.pyb_freq.unwrap_or(FREQUENCY);
    let clock = case.part.clock(frequency, frequency)?;
    let airframe = models.of_case(&settings.model, &case.part)?;
    let table = Table::read(&file_of(folder, case, &settings))?;
    if let Some(rows) = settings.rows.filter(|rows| *rows != table.rows().len()) {
        return Err(case.part.refuse(format_args!("{} rows", table.rows().len()), rows));
    }
    let bullet = Bullet::new(&airframe, settings.physics.mode(), Quirks::upstream());
    ledger.add(Kind::OneStep, &case.id, &worst_row(&table, &bullet, clock.step_secs)?);
    Ok(())
}

/// `MODEL_PHYSICS.csv`, or the case's own file where there is none.
fn file_of(folder: &Path, case: &Case<'_>, settings: &Settings) -> PathBuf {
    let shared = folder.join("one_step").join(format!("{}_{}.csv", settings.model, settings.physics.name()));
    let own = folder.join("one_step").join(format!("{}.csv", case.id));
    if own.exists() && !shared.exists() { own } else { shared }
}

/// What a row starts from, and the names of both publishers for the rates that DYN integrates.
struct Layout {
    before: Columns<13>,
    after: Columns<13>,
    rates: Option<(Columns<3>, Columns<3>)>,
    last_rpm: Option<Columns<4>>,
    rpm: Columns<4>,
    other: Option<Columns<3>>,
}

impl Layout {
    fn of(table: &Table) -> Result<Self, RecordingError> {
        let mut rates = None;
        for (before, after) in [
            (["bx0", "by0", "bz0"], ["bx1", "by1", "bz1"]),
            (["rr0_0", "rr1_0", "rr2_0"], ["rr0_1", "rr1_1", "rr2_1"]),
        ] {
            if let Some(before) = table.optional(before)? {
                rates = Some((before, table.columns(after)?));
            }
        }
        Ok(Self {
            before: table.motion("0")?,
            after: table.motion("1")?,
            rates,
            last_rpm: table.optional(["l0", "l1", "l2", "l3"])?,
            rpm: table.columns(RPM)?,
            other: table.optional(["ox", "oy", "oz"])?,
        })
    }
}

/// The worst of a table's rows.
pub(super) fn worst_row(table: &Table, bullet: &Bullet<f64>, step_secs: f64) -> Result<Worst, RecordingError> {
    let layout = Layout::of(table)?;
    let mut worst = Worst::default();
    for row in table.rows() {
        worst.add(error_of(table, row, &layout, bullet, step_secs)?, row.name());
    }
    Ok(worst)
}

fn error_of(
    table: &Table,
    row: &Row,
    layout: &Layout,
    bullet: &Bullet<f64>,
    step_secs: f64,
) -> Result<f64, RecordingError> {
    let mut drone = table.start(row, &layout.before)?.placed();
    if let Some(last) = &layout.last_rpm {
        drone.motion.rotor_speeds = rotor_speeds(table.given(row, last)?);
    }
    if let Some((before, _)) = &layout.rates {
        drone.motion.body_rates = Vector3::from(table.given(row, before)?);
    }
    let other = layout.other.map(|columns| Vector3::from(row.pick(&columns)));
    let swarm: Vec<_> = other.into_iter().filter(|position| !position.x.is_nan()).collect();
    let speeds = rotor_speeds(table.given(row, &layout.rpm)?);
    let after = bullet.step(&drone, &speeds, &swarm, step_secs);
    let error = row.motion(&layout.after).deviation(&after);
    let rates =
        layout.rates.map_or(0.0, |(_, columns)| largest(after.motion.body_rates.as_slice(), &row.pick(&columns)));
    Ok(error.max(rates))
}
