//! The four pictures of the page.

use super::*;
use crate::plot::{Line, Panel, Role};

/// Every picture with its file's name.
pub(super) fn all() -> [(&'static str, [Panel; 2]); 4] {
    [
        ("damping.svg", damping()),
        ("attitude-lag.svg", attitude_lag()),
        ("drag-frame.svg", drag_frame()),
        ("euler-integration.svg", euler_integration()),
    ]
}

fn line(name: &str, role: Role, points: Vec<[f64; 2]>) -> Line {
    Line { name: name.to_owned(), role, points }
}

/// A quantity of every state over time \[s\].
fn over_time(states: &[BulletState<f64>], quantity: impl Fn(&BulletState<f64>) -> f64) -> Vec<[f64; 2]> {
    states.iter().enumerate().step_by(6).map(|(step, state)| [step as f64 * STEP_SECS, quantity(state)]).collect()
}

fn damping() -> [Panel; 2] {
    let clean = Quirks { damping: 0.0, ..Quirks::upstream() };
    let falling = |quirks, steps| {
        let bullet = Bullet::new(&CF2X, BulletMode::Pyb, quirks);
        over_time(&flight(&bullet, hovering(0.0), None, steps, |_| [0.0; 4]), |drone| -drone.motion.velocity.z)
    };
    let turning = |quirks| {
        let bullet = Bullet::new(&CF2X, BulletMode::Pyb, quirks);
        let start = State { body_rates: Vector3::new(0.0, 0.0, 20.0), ..hovering(0.0) };
        over_time(&flight(&bullet, start, None, 480, |_| [0.0; 4]), |drone| drone.motion.body_rates.z)
    };
    [
        Panel {
            title: "Falling with rotors off: speed [m/s]",
            across: "time [s]",
            lines: vec![
                line("clean (no drag either: its rotors stand still)", Role::Clean, falling(clean, 960)),
                line("bullet", Role::Upstream, falling(Quirks::upstream(), 960)),
            ],
        },
        Panel {
            title: "Spinning about z with rotors off: rate [rad/s]",
            across: "time [s]",
            lines: vec![
                line("clean", Role::Clean, turning(clean)),
                line("bullet", Role::Upstream, turning(Quirks::upstream())),
            ],
        },
    ]
}

/// A flight with random rotor speeds of hover ± `fraction`.
fn rough_flight(link_attitude: LinkAttitude, fraction: f64) -> Vec<BulletState<f64>> {
    let bullet = Bullet::new(&CF2X, BulletMode::Pyb, Quirks { link_attitude, ..Quirks::upstream() });
    flight(&bullet, hovering(0.0), None, FLIGHT_SECS * STEPS_PER_SECOND, |step| rough(step, fraction))
}

fn attitude_lag() -> [Panel; 2] {
    let rolling =
        |link_attitude| over_time(&rough_flight(link_attitude, 0.2), |drone| drone.reported_angular_velocity.x);
    let apart = |fraction| {
        let lagging = rough_flight(LinkAttitude::Previous, fraction);
        let current = rough_flight(LinkAttitude::Current, fraction);
        let distance = |index: usize| (lagging[index].motion.position - current[index].motion.position).norm();
        (0..lagging.len()).step_by(6).map(|step| [step as f64 * STEP_SECS, 100.0 * distance(step)]).collect()
    };
    [
        Panel {
            title: "Random rotor speeds: angular velocity x [rad/s]",
            across: "time [s]",
            lines: vec![
                line("without the lag, ± 20 % of hover", Role::Clean, rolling(LinkAttitude::Current)),
                line("bullet: forces one step late", Role::Upstream, rolling(LinkAttitude::Previous)),
            ],
        },
        Panel {
            title: "Distance between the flights [cm]",
            across: "time [s]",
            lines: vec![
                line("± 20 % of hover", Role::Upstream, apart(0.2)),
                line("± 5 % of hover", Role::Fork, apart(0.05)),
            ],
        },
    ]
}

/// Deceleration \[m/s²\] along a flight at 1 m/s in +x, from the drag of one step.
fn deceleration(frame: DragFrame, world_from_body: Attitude<f64>) -> f64 {
    let start = State { world_from_body, velocity: Vector3::new(1.0, 0.0, 0.0), ..hovering(0.0) };
    let after = |mode| {
        let quirks = Quirks { drag_frame: frame, ..Quirks::upstream() };
        let states = flight(&Bullet::new(&CF2X, mode, quirks), start, None, 1, |_| [CF2X.hover_rotor_speed(); 4]);
        states[1].motion.velocity.x
    };
    (after(BulletMode::Pyb) - after(BulletMode::PybDrag)) / STEP_SECS
}

fn drag_frame() -> [Panel; 2] {
    let over_angle = |frame, axis: Vector3<f64>, degrees: usize| -> Vec<[f64; 2]> {
        let at = |degree: usize| {
            let angle = (degree as f64).to_radians();
            [degree as f64, deceleration(frame, Attitude::from_axis_angle(axis, angle))]
        };
        (0..=degrees).step_by(2).map(at).collect()
    };
    let lines = |axis: Vector3<f64>, degrees| {
        vec![
            line(
                "clean: coefficients meet the body velocity",
                Role::Clean,
                over_angle(DragFrame::Body, axis, degrees),
            ),
            line(
                "bullet: they meet the world velocity",
                Role::Upstream,
                over_angle(DragFrame::ScaledInWorld, axis, degrees),
            ),
            line(
                "the fork: turned out of the body twice",
                Role::Fork,
                over_angle(DragFrame::TurnedTwice, axis, degrees),
            ),
        ]
    };
    [
        Panel {
            title: "Level at 1 m/s: braking [m/s²]",
            across: "yaw relative to the flight [degrees]",
            lines: lines(Vector3::z(), 180),
        },
        Panel {
            title: "Nose along the flight: braking [m/s²]",
            across: "pitch [degrees]",
            lines: lines(Vector3::y(), 90),
        },
    ]
}

fn euler_integration() -> [Panel; 2] {
    let euler = Quirks { dyn_attitude: DynAttitude::EulerAngles, ..Quirks::upstream() };
    let start = State {
        world_from_body: Attitude::from_axis_angle(Vector3::x(), 30.0_f64.to_radians()),
        body_rates: Vector3::new(0.0, 0.0, 2.0),
        ..hovering(0.0)
    };
    let fly = |quirks| {
        flight(&Bullet::new(&CF2X, BulletMode::Dyn, quirks), start, None, 480, |_| [CF2X.hover_rotor_speed(); 4])
    };
    let path = |quirks| {
        let places = fly(quirks);
        places.iter().step_by(6).map(|drone| [drone.motion.position.x, drone.motion.position.y]).collect()
    };
    let leaning = |quirks| {
        over_time(&fly(quirks), |drone| {
            let up = drone.motion.world_from_body.body_z();
            up.y.atan2(up.x).to_degrees()
        })
    };
    let lines = |of: &dyn Fn(Quirks) -> Vec<[f64; 2]>| {
        vec![
            line("clean and upstream: quaternion", Role::Clean, of(Quirks::upstream())),
            line("the fork: roll, pitch, yaw grow by the body rates", Role::Fork, of(euler)),
        ]
    };
    [
        Panel { title: "Rolled 30°, yawing at 2 rad/s: path, y [m]", across: "x [m]", lines: lines(&path) },
        Panel { title: "Where the thrust leans [degrees from +x]", across: "time [s]", lines: lines(&leaning) },
    ]
}
