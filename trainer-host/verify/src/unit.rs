//! Attitudes, single controller calls and constants.

use std::path::Path;

use kestrel_core::action::Setpoint;
use kestrel_core::airframe::{Airframe, GRAVITY, RADIANS_PER_SECOND_PER_RPM};
use kestrel_core::attitude::Attitude;
use kestrel_core::reference::bullet::{Bullet, BulletMode, Quirks};
use kestrel_core::reference::controller::{DslPid, DslPidMemory};
use kestrel_core::reference::euler::EulerAngles;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use serde_json::Value;

use super::camera;
use super::error::RecordingError;
use super::index::{Json, Part};
use super::model::{Models, Publisher};
use super::motion::{largest, rpm};
use super::report::{Kind, Ledger, Worst};
use super::table::{Columns, RPM, Row, Table};

/// Compares the files that the folder holds.
pub(super) fn compare(folder: &Path, models: &Models, ledger: &mut Ledger) -> Result<(), RecordingError> {
    let file = |name: &str| Some(folder.join(name)).filter(|path| path.exists());
    if let Some(path) = file("attitude.csv") {
        ledger.add(Kind::UnitAttitude, "attitude.csv", &attitudes(&Table::read(&path)?)?);
    }
    if let Some(path) = file("dslpid_calls.csv") {
        ledger.add(Kind::UnitDslPid, "dslpid_calls.csv", &dsl_pid_calls(&Table::read(&path)?, models)?);
    }
    if let Some(path) = file("constants.json") {
        constants(&Json::read(&path)?, models, ledger)?;
    }
    if let Some(path) = file("camera_matrices.csv") {
        ledger.add(Kind::UnitCamera, "camera_matrices.csv", &camera::matrices(&Table::read(&path)?)?);
    }
    Ok(())
}

fn attitudes(table: &Table) -> Result<Worst, RecordingError> {
    let given = table.columns(["roll", "pitch", "yaw"])?;
    let quaternion = table.columns(["qx", "qy", "qz", "qw"])?;
    let angles = table.columns(["eroll", "epitch", "eyaw"])?;
    let matrix: Columns<9> = table.columns(["r00", "r01", "r02", "r10", "r11", "r12", "r20", "r21", "r22"])?;
    let mut worst = Worst::default();
    for row in table.rows() {
        let [roll, pitch, yaw] = table.given(row, &given)?;
        let [x, y, z, w] = table.given(row, &quaternion)?;
        let attitude = Attitude { w, x, y, z };
        let made = EulerAngles { roll, pitch, yaw }.attitude();
        let error = largest(&[made.x, made.y, made.z, made.w], &[x, y, z, w])
            .max(largest(&EulerAngles::of(&attitude).to_array(), &row.pick(&angles)))
            .max(largest(attitude.rows().as_flattened(), &row.pick(&matrix)));
        worst.add(error, row.name());
    }
    Ok(worst)
}

/// Where the numbers of a controller call are.
struct CallColumns {
    group: Columns<4>,
    position: Columns<3>,
    quaternion: Columns<4>,
    velocity: Columns<3>,
    target: Columns<4>,
    target_velocity: Columns<3>,
    target_rates: Columns<3>,
    rpm: Columns<4>,
    position_error: Columns<3>,
    yaw_error: Columns<1>,
    memory: [Columns<3>; 3],
}

impl CallColumns {
    fn of(table: &Table) -> Result<Self, RecordingError> {
        Ok(Self {
            group: table.columns(["model", "group", "call", "dt"])?,
            position: table.columns(["px", "py", "pz"])?,
            quaternion: table.columns(["qx", "qy", "qz", "qw"])?,
            velocity: table.columns(["vx", "vy", "vz"])?,
            target: table.columns(["tx", "ty", "tz", "tyaw"])?,
            target_velocity: table.columns(["tvx", "tvy", "tvz"])?,
            target_rates: table.columns(["trr", "tpr", "tyr"])?,
            rpm: table.columns(RPM)?,
            position_error: table.columns(["pex", "pey", "pez"])?,
            yaw_error: table.columns(["yaw_e"])?,
            memory: [
                table.columns(["ip0", "ip1", "ip2"])?,
                table.columns(["ir0", "ir1", "ir2"])?,
                table.columns(["lr0", "lr1", "lr2"])?,
            ],
        })
    }

    fn setpoint(&self, table: &Table, row: &Row) -> Result<Setpoint<f64>, RecordingError> {
        let [x, y, z, yaw] = table.given(row, &self.target)?;
        Ok(Setpoint {
            velocity: table.given(row, &self.target_velocity)?.into(),
            yaw,
            euler_rates: table.given(row, &self.target_rates)?.into(),
            ..Setpoint::at([x, y, z].into())
        })
    }
}

fn dsl_pid_calls(table: &Table, models: &Models) -> Result<Worst, RecordingError> {
    let columns = CallColumns::of(table)?;
    let mut worst = Worst::default();
    let mut memory = DslPidMemory::<f64>::new();
    for row in table.rows() {
        let [model, _, call, secs] = table.given(row, &columns.group)?;
        if call == 0.0 {
            memory = DslPidMemory::new();
        }
        let controller = DslPid::new(&numbered_model(table, row, model, models)?);
        let state = seen(
            table.given(row, &columns.position)?,
            table.given(row, &columns.quaternion)?,
            table.given(row, &columns.velocity)?,
        );
        let command = controller.command(&mut memory, &state, &columns.setpoint(table, row)?, secs);
        let mut error = largest(&rpm(command.rotor_speeds), &row.pick(&columns.rpm))
            .max(largest(command.position_error.as_slice(), &row.pick(&columns.position_error)))
            .max(largest(&[command.yaw_error], &row.pick(&columns.yaw_error)));
        let remembered = [memory.position_integral, memory.attitude_integral, memory.last_angles];
        for (computed, recorded) in remembered.iter().zip(&columns.memory) {
            error = error.max(largest(computed.as_slice(), &row.pick(recorded)));
        }
        worst.add(error, row.name());
    }
    Ok(worst)
}

/// The drones of the calls: 0 is `cf2x`, 1 is `cf2p`.
fn numbered_model(table: &Table, row: &Row, model: f64, models: &Models) -> Result<Airframe, RecordingError> {
    let name = match model {
        0.0 => Some("cf2x"),
        1.0 => Some("cf2p"),
        _ => None,
    };
    name.and_then(|name| models.find(name, Publisher::Upstream))
        .ok_or_else(|| table.refuse_row(row, format_args!("model {model}"), "0 (cf2x) or 1 (cf2p)"))
}

/// A drone of which controllers read no more than this; the quaternion is x, y, z, w.
pub(super) fn seen(position: [f64; 3], [x, y, z, w]: [f64; 4], velocity: [f64; 3]) -> State<f64> {
    State {
        position: Vector3::from(position),
        world_from_body: Attitude { w, x, y, z },
        velocity: Vector3::from(velocity),
        body_rates: Vector3::zeros(),
        rotor_speeds: [0.0; 4],
    }
}

/// A constant of the reference computed from an airframe; one number or several.
type Constant = fn(&Airframe) -> Vec<f64>;

const RPM_SQUARED: f64 = RADIANS_PER_SECOND_PER_RPM * RADIANS_PER_SECOND_PER_RPM;

/// The constants by the reference's names.
const CONSTANTS: [(&str, Constant); 23] = [
    ("G", |_| vec![GRAVITY]),
    ("M", |airframe| vec![airframe.mass]),
    ("L", |airframe| vec![airframe.arm]),
    ("THRUST2WEIGHT_RATIO", |airframe| vec![airframe.thrust_limit() / airframe.weight()]),
    ("J", |airframe| diagonal(airframe.inertia)),
    ("J_INV", |airframe| diagonal(airframe.inertia.map(f64::recip))),
    ("KF", |airframe| vec![airframe.thrust_coefficient * RPM_SQUARED]),
    ("KM", |airframe| vec![airframe.torque_coefficient.abs() * RPM_SQUARED]),
    ("COLLISION_H", |airframe| vec![airframe.collision_height]),
    ("COLLISION_R", |airframe| vec![airframe.collision_radius]),
    ("COLLISION_Z_OFFSET", |airframe| vec![airframe.collision_offset]),
    ("MAX_SPEED_KMH", |airframe| vec![airframe.nominal_speed * 3.6]),
    ("GND_EFF_COEFF", |airframe| vec![airframe.ground_effect_coefficient]),
    ("PROP_RADIUS", |airframe| vec![airframe.propeller_radius]),
    ("DRAG_COEFF", |airframe| {
        let drag = airframe.drag_coefficients;
        vec![drag.planar, drag.planar, drag.axial]
    }),
    ("DW_COEFF_1", |airframe| vec![airframe.downwash.strength]),
    ("DW_COEFF_2", |airframe| vec![airframe.downwash.width_slope]),
    ("DW_COEFF_3", |airframe| vec![airframe.downwash.width_offset]),
    ("HOVER_RPM", |airframe| vec![airframe.hover_rotor_speed() / RADIANS_PER_SECOND_PER_RPM]),
    ("MAX_RPM", |airframe| vec![airframe.rotor_speed_limit / RADIANS_PER_SECOND_PER_RPM]),
    ("MAX_THRUST", |airframe| vec![airframe.thrust_limit()]),
    ("MAX_XY_TORQUE", |airframe| vec![airframe.tilting_torque_limit()]),
    ("MAX_Z_TORQUE", |airframe| vec![airframe.turning_torque_limit()]),
];

/// More of them, which need more than an airframe's own numbers.
const DERIVED: [(&str, Constant); 4] = [
    ("GRAVITY", |airframe| vec![airframe.weight()]),
    ("GND_EFF_H_CLIP", |airframe| {
        vec![Bullet::<f64>::new(airframe, BulletMode::PybGnd, Quirks::upstream()).ground_effect_floor]
    }),
    ("INIT_XYZS", |airframe| vec![0.0, 0.0, airframe.start_height()]),
    ("SPEED_LIMIT", |airframe| vec![0.03 * airframe.nominal_speed]),
];

fn diagonal([x, y, z]: [f64; 3]) -> Vec<f64> {
    vec![x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z]
}

fn constants(json: &Json, models: &Models, ledger: &mut Ledger) -> Result<(), RecordingError> {
    for (name, part) in json.whole().entries()? {
        match models.find(&name, Publisher::Upstream) {
            Some(airframe) => ledger.add(Kind::UnitConstants, &name, &worst_constant(&part, &airframe)?),
            None => ledger.note(format!("unit/constants.json: {name} is no model, not compared")),
        }
    }
    Ok(())
}

fn worst_constant(part: &Part<'_>, airframe: &Airframe) -> Result<Worst, RecordingError> {
    let recorded: Value = part.decode()?;
    let mut worst = Worst::default();
    for (name, constant) in CONSTANTS.iter().chain(&DERIVED) {
        let Some(value) = recorded.get(name) else { continue };
        let computed = constant(airframe);
        let mut numbers = Vec::new();
        flatten(value, &mut numbers);
        if numbers.len() != computed.len() {
            let expected = format!("{} numbers", computed.len());
            return Err(part.refuse(format_args!("{} numbers in {name}", numbers.len()), expected));
        }
        worst.add(relative(&computed, &numbers), name);
    }
    for (index, position) in airframe.rotor_positions().iter().enumerate() {
        let Some(link) = recorded["links"].get(index + 1) else { break };
        let mut numbers = Vec::new();
        flatten(&link["inertial_pos"], &mut numbers);
        if let [x, y, _] = numbers.as_slice() {
            worst.add(relative(position, &[*x, *y]), format_args!("link {index}"));
        }
    }
    Ok(worst)
}

/// The numbers of nested lists; anything else is no number.
fn flatten(value: &Value, numbers: &mut Vec<f64>) {
    match value {
        Value::Array(items) => items.iter().for_each(|item| flatten(item, numbers)),
        Value::Number(number) => numbers.extend(number.as_f64()),
        Value::Null | Value::Bool(_) | Value::String(_) | Value::Object(_) => {}
    }
}

/// Greatest difference relative to the recorded number, absolute where that is zero.
fn relative(computed: &[f64], recorded: &[f64]) -> f64 {
    let scale = |number: f64| if number == 0.0 { 1.0 } else { number.abs() };
    computed.iter().zip(recorded).map(|(a, b)| (a - b).abs() / scale(*b)).fold(0.0, f64::max)
}
