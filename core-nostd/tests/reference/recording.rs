//! Reading recordings, and keeping the worst deviation from them.

use std::fs;
use std::path::PathBuf;

use kestrel_core::airframe::{Airframe, CF2P, CF2X, HUMMINGBIRD, RADIANS_PER_SECOND_PER_RPM, RotorOrder};
use kestrel_core::attitude::Attitude;
use kestrel_core::reference::bullet::{BulletMode, BulletState};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use serde_json::Value;

/// The reference's physics step \[s\].
pub(crate) const STEP_SECS: f64 = 1.0 / 240.0;

/// What the reference logs of a pose and its motion, before the step number that some columns carry.
const STATE: [&str; 13] = ["px", "py", "pz", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz"];

/// Folder that holds `pybullet` and `fork`.
pub(crate) fn folder() -> PathBuf {
    std::env::var_os("KESTREL_REFERENCE")
        .map_or_else(|| PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/golden")), PathBuf::from)
}

pub(crate) fn json(path: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(folder().join(path)).unwrap()).unwrap()
}

/// The numbers of a JSON list.
pub(crate) fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    assert_eq!(value.as_array().unwrap().len(), N);
    core::array::from_fn(|index| value[index].as_f64().unwrap())
}

/// The cases of one kind in the index.
pub(crate) fn cases(kind: &str) -> Vec<Value> {
    let index = json("pybullet/index.json");
    index["cases"].as_array().unwrap().iter().filter(|case| case["kind"] == kind).cloned().collect()
}

/// The airframe and the mode of a case.
pub(crate) fn settings(case: &Value) -> (Airframe, BulletMode) {
    (airframe(case["model"].as_str().unwrap()), mode(case["physics"].as_str().unwrap()))
}

/// Upstream's drones.
pub(crate) fn airframe(model: &str) -> Airframe {
    match model {
        "cf2x" => CF2X,
        "cf2p" => CF2P.numbered(RotorOrder::CounterClockwise),
        "hb" => HUMMINGBIRD,
        other => panic!("unknown model {other}"),
    }
}

pub(crate) fn mode(physics: &str) -> BulletMode {
    match physics {
        "pyb" => BulletMode::Pyb,
        "pyb_gnd" => BulletMode::PybGnd,
        "pyb_drag" => BulletMode::PybDrag,
        "pyb_dw" => BulletMode::PybDw,
        "pyb_gnd_drag_dw" => BulletMode::PybGndDragDw,
        "dyn" => BulletMode::Dyn,
        other => panic!("unknown physics {other}"),
    }
}

/// A CSV file of numbers.
pub(crate) struct Table {
    header: Vec<String>,
    pub(crate) rows: Vec<Vec<f64>>,
}

impl Table {
    pub(crate) fn read(path: &str) -> Self {
        let text = fs::read_to_string(folder().join(path)).unwrap();
        let mut lines = text.lines();
        let header = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect()).collect();
        Self { header, rows }
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.header.iter().any(|column| column == name)
    }

    /// Columns named by a letter and a number.
    pub(crate) fn columns_like(&self, letter: char) -> Vec<usize> {
        let numbered = |name: &str| name.strip_prefix(letter).is_some_and(|rest| rest.parse::<u8>().is_ok());
        (0..self.header.len()).filter(|column| numbered(&self.header[*column])).collect()
    }

    pub(crate) fn get<const N: usize>(&self, row: &[f64], names: [&str; N]) -> [f64; N] {
        names.map(|name| row[self.header.iter().position(|column| column == name).unwrap()])
    }

    /// The 13 numbers of a logged motion; `suffix` ends the columns' names.
    pub(crate) fn motion(&self, row: &[f64], suffix: &str) -> [f64; 13] {
        STATE.map(|name| self.get(row, [format!("{name}{suffix}").as_str()])[0])
    }
}

/// A drone placed with a logged motion, its rotors forgotten.
pub(crate) fn placed(logged: &[f64; 13]) -> BulletState<f64> {
    let [px, py, pz, x, y, z, w, vx, vy, vz, wx, wy, wz] = *logged;
    let world_from_body = Attitude { w, x, y, z };
    BulletState::placed(State {
        position: Vector3::new(px, py, pz),
        world_from_body,
        velocity: Vector3::new(vx, vy, vz),
        body_rates: world_from_body.rotate_inverse(Vector3::new(wx, wy, wz)),
        rotor_speeds: [0.0; 4],
    })
}

pub(crate) fn rotor_speeds(rpm: [f64; 4]) -> [f64; 4] {
    rpm.map(|rpm| rpm * RADIANS_PER_SECOND_PER_RPM)
}

/// Greatest absolute difference of any logged number; a quaternion counts as its opposite.
pub(crate) fn deviation(drone: &BulletState<f64>, logged: &[f64; 13]) -> f64 {
    let Attitude { w, x, y, z } = drone.motion.world_from_body;
    let sign = (x * logged[3] + y * logged[4] + z * logged[5] + w * logged[6]).signum();
    let (position, velocity) = (drone.motion.position, drone.motion.velocity);
    let spin = drone.reported_angular_velocity;
    let attitude = [x, y, z, w].map(|part| sign * part);
    let computed = [position.as_slice(), &attitude, velocity.as_slice(), spin.as_slice()];
    largest(&computed.concat(), logged)
}

/// Greatest absolute difference of two lists; NaN is infinitely far from anything.
pub(crate) fn largest(computed: &[f64], logged: &[f64]) -> f64 {
    assert_eq!(computed.len(), logged.len());
    let far = |(a, b): (&f64, &f64)| if (a - b).is_nan() { f64::INFINITY } else { (a - b).abs() };
    computed.iter().zip(logged).map(far).fold(0.0, f64::max)
}

/// The worst deviation of a kind of recording.
pub(crate) struct Worst {
    kind: &'static str,
    cases: usize,
    error: f64,
    case: String,
}

impl Worst {
    pub(crate) fn new(kind: &'static str) -> Self {
        Self { kind, cases: 0, error: 0.0, case: String::new() }
    }

    pub(crate) fn add(&mut self, case: &str, error: f64) {
        self.cases += 1;
        if error >= self.error {
            (self.error, self.case) = (error, case.to_owned());
        }
    }

    /// States the worst error, and fails beyond the tolerance or without a case.
    pub(crate) fn within(self, tolerance: f64) {
        let Self { kind, cases, error, case } = self;
        println!("{kind}: {cases} cases, worst error {error:.2e} in {case}");
        assert!(
            cases > 0 && error <= tolerance,
            "{kind}: {error:.2e} in {case} (of {cases}), expected {tolerance:.0e}"
        );
    }
}
