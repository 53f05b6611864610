//! `docs/clean-and-bullet.md`: what each quirk of the reference changes, flown and drawn from the core.
//!
//! With `BLESS=1` the tests rewrite the pictures and the table of the page; without it they hold the page to the code.

mod pictures;

use std::fs;
use std::path::{Path, PathBuf};

use kestrel_core::airframe::{CF2X, RADIANS_PER_SECOND_PER_RPM};
use kestrel_core::attitude::Attitude;
use kestrel_core::reference::bullet::{
    Bullet, BulletMode, BulletState, DragFrame, DynAttitude, DynReport, LinkAttitude, Quirks, RotorPrecision,
};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

/// The reference's rates.
const STEP_SECS: f64 = 1.0 / 240.0;
const STEPS_PER_SECOND: usize = 240;

/// Length of the flights of the table \[s\].
const FLIGHT_SECS: usize = 3;

/// Between these lines of the page stands the table.
const TABLE_BEGIN: &str = "<!-- measured: BLESS=1 cargo test -p kestrel-tests clean_and_bullet -->\n";
const TABLE_END: &str = "<!-- end of measured -->\n";

fn docs(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs").join(path)
}

/// A drone at a height \[m\], upright and at rest, its rotors at hover speed.
fn hovering(height: f64) -> State<f64> {
    State {
        position: Vector3::new(0.0, 0.0, height),
        world_from_body: Attitude::level(),
        velocity: Vector3::zeros(),
        body_rates: Vector3::zeros(),
        rotor_speeds: [CF2X.hover_rotor_speed(); 4],
    }
}

/// Rotor speeds \[rad/s\] around hover that roll the drone to one side and back, then pitch it: a doublet of 150 RPM
/// for a twentieth of a second each way.
fn doublets(step: usize) -> [f64; 4] {
    let push = match step / 12 {
        2 => [-1.0, -1.0, 1.0, 1.0],
        3 => [1.0, 1.0, -1.0, -1.0],
        8 => [-1.0, 1.0, 1.0, -1.0],
        9 => [1.0, -1.0, -1.0, 1.0],
        _ => [0.0; 4],
    };
    push.map(|sign: f64| CF2X.hover_rotor_speed() + sign * 150.0 * RADIANS_PER_SECOND_PER_RPM)
}

/// Rotor speeds \[rad/s\] drawn anew 48 times a second from hover ± `fraction`, the same in every run.
fn rough(step: usize, fraction: f64) -> [f64; 4] {
    core::array::from_fn(|rotor| {
        // SplitMix64 of the draw's number.
        let mut bits = (4 * (step / 5) + rotor + 1) as u64;
        bits = bits.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let share = ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 53) as f64;
        CF2X.hover_rotor_speed() * (1.0 + fraction * (2.0 * share - 1.0))
    })
}

/// The states of a flight, one a physics step, the start first.
fn flight(
    bullet: &Bullet<f64>,
    start: State<f64>,
    other: Option<Vector3<f64>>,
    steps: usize,
    rotor_speeds: impl Fn(usize) -> [f64; 4],
) -> Vec<BulletState<f64>> {
    let mut drone = BulletState::placed(start);
    let swarm: Vec<Vector3<f64>> = other.into_iter().collect();
    let mut states = vec![drone];
    for step in 0..steps {
        drone = bullet.step(&drone, &rotor_speeds(step), &swarm, STEP_SECS);
        states.push(drone);
    }
    states
}

/// One row of the table: a quirk, the flight that shows it, and what to fly it without.
struct Case {
    field: &'static str,
    reference: &'static str,
    clean: &'static str,
    shown_by: &'static str,
    mode: BulletMode,
    with: Quirks,
    without: Quirks,
    start: State<f64>,
    other: Option<Vector3<f64>>,
    rotor_speeds: fn(usize) -> [f64; 4],
}

impl Case {
    /// The doublets in free air under one quirk of upstream.
    fn new(field: &'static str, [reference, clean]: [&'static str; 2], without: Quirks) -> Self {
        Self {
            field,
            reference,
            clean,
            shown_by: "doublets",
            mode: BulletMode::Pyb,
            with: Quirks::upstream(),
            without,
            start: hovering(40.0),
            other: None,
            rotor_speeds: doublets,
        }
    }

    /// Between the flights with and without the quirk: distance \[m\] and angle \[deg\] at the end, and the greatest
    /// difference of the reported angular velocities \[rad/s\].
    fn difference(&self) -> [f64; 3] {
        let steps = FLIGHT_SECS * STEPS_PER_SECOND;
        let fly = |quirks| {
            let bullet = Bullet::new(&CF2X, self.mode, quirks);
            flight(&bullet, self.start, self.other, steps, self.rotor_speeds)
        };
        let (with, without) = (fly(self.with), fly(self.without));
        let spins = with
            .iter()
            .zip(&without)
            .map(|(one, other)| (one.reported_angular_velocity - other.reported_angular_velocity).norm());
        let (end, other_end) = (with[steps].motion, without[steps].motion);
        [
            (end.position - other_end.position).norm(),
            angle_between(&end.world_from_body, &other_end.world_from_body).to_degrees(),
            spins.fold(0.0, f64::max),
        ]
    }

    fn row(&self) -> String {
        let [metres, degrees, rates] = self.difference();
        let Self { field, reference, clean, shown_by, .. } = self;
        format!(
            "| `{field}` | {reference} | {clean} | {shown_by} | {} | {} | {} |\n",
            length(metres),
            figure(degrees, "°"),
            figure(rates, " rad/s")
        )
    }
}

/// \[rad\].
fn angle_between(one: &Attitude<f64>, other: &Attitude<f64>) -> f64 {
    let vector = [
        one.w * other.x - one.x * other.w - one.y * other.z + one.z * other.y,
        one.w * other.y - one.y * other.w - one.z * other.x + one.x * other.z,
        one.w * other.z - one.z * other.w - one.x * other.y + one.y * other.x,
    ];
    2.0 * vector.iter().map(|part| part * part).sum::<f64>().sqrt().min(1.0).asin()
}

/// A length in a unit that suits it.
fn length(metres: f64) -> String {
    match metres {
        small if small < 1e-9 => "0".to_owned(),
        small if small < 1e-3 => figure(small * 1e6, " µm"),
        middle if middle < 1.0 => figure(middle * 100.0, " cm"),
        large => figure(large, " m"),
    }
}

/// Two significant digits, or zero; rounding of the platform's mathematics must not reach the page.
fn figure(value: f64, unit: &str) -> String {
    match value.abs() {
        small if small < 1e-6 => "0".to_owned(),
        small if small < 1e-2 => format!("{value:.0e}{unit}"),
        middle if middle < 1.0 => format!("{value:.2}{unit}"),
        middle if middle < 10.0 => format!("{value:.1}{unit}"),
        large => format!("{:.0}{unit}", if large < 100.0 { value } else { (value / 10.0).round() * 10.0 }),
    }
}

/// The fields' names; the pattern refuses to forget one.
fn fields() -> [&'static str; 15] {
    let Quirks {
        damping: _,
        rotor_precision: _,
        link_attitude: _,
        ground_query: _,
        drag_frame: _,
        drag_rotors: _,
        downwash_axis: _,
        downwash_nearest: _,
        downwash_reach: _,
        rotation_cap: _,
        velocity_cap: _,
        attitude_update: _,
        dyn_attitude: _,
        dyn_levers: _,
        dyn_report: _,
    } = Quirks::none();
    [
        "damping",
        "rotor_precision",
        "link_attitude",
        "ground_query",
        "drag_frame",
        "drag_rotors",
        "downwash_axis",
        "downwash_nearest",
        "downwash_reach",
        "rotation_cap",
        "velocity_cap",
        "attitude_update",
        "dyn_attitude",
        "dyn_levers",
        "dyn_report",
    ]
}

/// Rolled by 29°.
fn rolled() -> State<f64> {
    State { world_from_body: Attitude::from_axis_angle(Vector3::x(), 0.5), ..hovering(40.0) }
}

/// Rolled, and yawing at a rate \[rad/s\].
fn yawing(rate: f64) -> State<f64> {
    State { body_rates: Vector3::new(0.0, 0.0, rate), ..rolled() }
}

/// Rotors and the links that carry their forces.
fn rotor_cases() -> Vec<Case> {
    let upstream = Quirks::upstream();
    let Quirks { damping, rotor_precision, link_attitude, ground_query, .. } = Quirks::none();
    let single = Quirks { rotor_precision: RotorPrecision::Single, ..upstream };
    let late = || Case::new("link_attitude", ["`Previous`", "`Current`"], Quirks { link_attitude, ..upstream });
    vec![
        Case::new("damping", ["0.04", "0"], Quirks { damping, ..upstream }),
        Case {
            with: single,
            ..Case::new(
                "rotor_precision",
                ["`Single` (fork, RPM actions)", "`Full`"],
                Quirks { rotor_precision, ..single },
            )
        },
        late(),
        Case { shown_by: "random rotor speeds, ± 20 %", rotor_speeds: |step| rough(step, 0.2), ..late() },
        Case {
            mode: BulletMode::PybGndDragDw,
            shown_by: "doublets, all effects",
            ..Case::new("ground_query", ["`RefreshesLinks`", "`LeavesLinks`"], Quirks { ground_query, ..upstream })
        },
    ]
}

/// Drag, in a glide.
fn drag_cases() -> Vec<Case> {
    let upstream = Quirks::upstream();
    let Quirks { drag_frame, drag_rotors, .. } = Quirks::none();
    let gliding = State { velocity: Vector3::new(2.0, 1.0, 0.0), ..rolled() };
    let glide = |case| Case { mode: BulletMode::PybDrag, start: gliding, shown_by: "the same", ..case };
    let framed =
        |reference| glide(Case::new("drag_frame", [reference, "`Body`"], Quirks { drag_frame, ..upstream }));
    vec![
        Case { shown_by: "doublets at 2.2 m/s, rolled 29°", ..framed("`ScaledInWorld`") },
        Case { with: Quirks { drag_frame: DragFrame::TurnedTwice, ..upstream }, ..framed("`TurnedTwice` (fork)") },
        Case {
            start: State { rotor_speeds: [0.0; 4], ..gliding },
            shown_by: "the same, rotors forgotten by a reset",
            ..glide(Case::new("drag_rotors", ["`Previous`", "`Current`"], Quirks { drag_rotors, ..upstream }))
        },
    ]
}

/// Another drone above.
fn downwash_cases() -> Vec<Case> {
    let upstream = Quirks::upstream();
    let Quirks { downwash_axis, downwash_nearest, downwash_reach, .. } = Quirks::none();
    let under = |x, z, case| Case { mode: BulletMode::PybDw, other: Some(Vector3::new(x, 0.0, 40.0 + z)), ..case };
    let axis = Case::new("downwash_axis", ["`Body`", "`World`"], Quirks { downwash_axis, ..upstream });
    let nearest = Case::new("downwash_nearest", ["0", "0.05 m"], Quirks { downwash_nearest, ..upstream });
    let reach = Case::new("downwash_reach", ["10 m", "none"], Quirks { downwash_reach, ..upstream });
    vec![
        Case {
            start: rolled(),
            shown_by: "rolled 29° under another drone, 1 m",
            rotor_speeds: |_| [CF2X.hover_rotor_speed(); 4],
            ..under(0.0, 1.0, axis)
        },
        Case { shown_by: "2 cm below another drone", ..under(0.05, 0.02, nearest) },
        Case { shown_by: "10.5 m beside and 30 m below another drone", ..under(10.5, 30.0, reach) },
    ]
}

/// Fast rotation.
fn turning_cases() -> Vec<Case> {
    let upstream = Quirks::upstream();
    let Quirks { rotation_cap, velocity_cap, attitude_update, .. } = Quirks::none();
    let exponential = ["`ExponentialMap`", "`FirstOrder`"];
    let capped = ["100 m/s, 100 rad/s", "none"];
    vec![
        Case {
            start: yawing(60.0),
            shown_by: "doublets at 60 rad/s of yaw",
            ..Case::new("attitude_update", exponential, Quirks { attitude_update, ..upstream })
        },
        Case {
            start: yawing(99.0),
            shown_by: "doublets at 99 rad/s of yaw (0.41 rad a step)",
            ..Case::new("rotation_cap", ["π/4", "π"], Quirks { rotation_cap, ..upstream })
        },
        Case {
            start: yawing(120.0),
            shown_by: "doublets at 120 rad/s of yaw",
            ..Case::new("velocity_cap", capped, Quirks { velocity_cap, ..upstream })
        },
    ]
}

/// The explicit model.
fn dyn_cases() -> Vec<Case> {
    let upstream = Quirks::upstream();
    let Quirks { dyn_attitude, dyn_levers, dyn_report, .. } = Quirks::none();
    let explicit = |case| Case { mode: BulletMode::Dyn, ..case };
    let leaning = |case| Case { start: yawing(1.0), shown_by: "doublets, rolled 29°, yawing at 1 rad/s", ..case };
    let levers = ["`NominalArm`", "`RotorPositions`"];
    let reported = |reference| {
        leaning(explicit(Case::new("dyn_report", [reference, "`Current`"], Quirks { dyn_report, ..upstream })))
    };
    let integrated = ["`EulerAngles` (fork)", "`Quaternion`"];
    vec![
        Case {
            with: Quirks { dyn_attitude: DynAttitude::EulerAngles, ..upstream },
            ..leaning(explicit(Case::new("dyn_attitude", integrated, Quirks { dyn_attitude, ..upstream })))
        },
        explicit(Case::new("dyn_levers", levers, Quirks { dyn_levers, ..upstream })),
        reported("`PreviousAttitude`"),
        Case {
            shown_by: "the same",
            with: Quirks { dyn_report: DynReport::MinusOne, ..upstream },
            ..reported("`MinusOne` (fork)")
        },
    ]
}

fn cases() -> Vec<Case> {
    [rotor_cases(), drag_cases(), downwash_cases(), turning_cases(), dyn_cases()].into_iter().flatten().collect()
}

fn table() -> String {
    let head = "| field of `Quirks` | reference | clean | shown by | position | attitude | spin |\n\
                |---|---|---|---|---|---|---|\n";
    cases().iter().map(Case::row).fold(head.to_owned(), |text, row| text + &row)
}

/// Compares with a file of `docs`, or rewrites it when the environment has `BLESS`.
#[test]
fn every_quirk_has_a_row() {
    let cases = cases();
    let rows = |field: &&str| !cases.iter().any(|case| case.field == *field);
    assert_eq!(fields().into_iter().find(rows), None);
}

#[test]
fn the_page_says_what_the_code_measures() {
    let path = docs("clean-and-bullet.md");
    let page = fs::read_to_string(&path).unwrap();
    for (name, _) in pictures::all() {
        assert!(page.contains(name), "{name} is on the page");
    }
    let (before, rest) = page.split_once(TABLE_BEGIN).unwrap();
    let (_, after) = rest.split_once(TABLE_END).unwrap();
    crate::assert_blessed(&path, &format!("{before}{TABLE_BEGIN}\n{}\n{TABLE_END}{after}", table()));
}

#[test]
fn the_pictures_show_what_the_code_flies() {
    for (name, panels) in pictures::all() {
        crate::assert_blessed(&docs("pictures").join(name), &crate::plot::picture(&panels));
    }
}
