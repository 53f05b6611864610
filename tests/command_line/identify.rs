//! `kestrel identify` on a whole flight, and on logs that are none.

use std::fmt::Write;
use std::fs;
use std::path::Path;

use kestrel_core::airframe::CF2X;
use kestrel_core::attitude::Attitude;
use kestrel_core::dynamics::runge_kutta_4;
use kestrel_core::vehicle::{Air, State, Vehicle};
use nalgebra::Vector3;

use crate::kestrel::{kestrel, refusal};

const HEADING: &str = "time_secs,position_x_m,position_y_m,position_z_m,attitude_w,attitude_x,attitude_y,attitude_z,\
    velocity_x_m_per_s,velocity_y_m_per_s,velocity_z_m_per_s,gyro_x_rad_per_s,gyro_y_rad_per_s,gyro_z_rad_per_s,\
    motor_1_pwm,motor_2_pwm,motor_3_pwm,motor_4_pwm,battery_v,valid";

/// Share of the speed limit that the drone of the table reaches, of what is believed.
const WEAKER: f64 = 0.95;

/// A table of 20 s at 100 Hz of a drone that goes up and down, with weaker motors than `cf2x`.
fn bobbing() -> String {
    let vehicle = Vehicle::<f64>::new(&CF2X);
    let hover = CF2X.hover_rotor_speed();
    let mut state = State {
        position: Vector3::new(0.0, 0.0, 20.0),
        world_from_body: Attitude::level(),
        velocity: Vector3::zeros(),
        body_rates: Vector3::zeros(),
        rotor_speeds: [hover; 4],
    };
    let mut table = HEADING.to_owned();
    for row in 0..2000 {
        let secs = f64::from(row) * 0.01;
        let asked = hover * (1.0 + 0.2 * (5.0 * secs).sin() - 0.05 * state.velocity.z);
        let pwm = (65_535.0 * asked / (WEAKER * CF2X.rotor_speed_limit)).round();
        let (z, speed) = (state.position.z, state.velocity.z);
        write!(table, "\n{secs:.2},0,0,{z:.4},1,0,0,0,0,0,{speed:.4},0,0,0,{pwm},{pwm},{pwm},{pwm},4.2,1")
            .unwrap();
        let target = WEAKER * CF2X.rotor_speed_limit * pwm / 65_535.0;
        for _ in 0..10 {
            state = runge_kutta_4(&vehicle, &state, &[target; 4], &Air::still(), 0.001);
        }
    }
    table
}

#[test]
fn a_flight_becomes_an_airframe_that_the_next_one_begins_with() {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("flight.csv"), bobbing()).unwrap();
    let output = kestrel(place.path(), &["identify", "flight.csv", "-o", "mine.yaml", "--threads", "1"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{text}{}", String::from_utf8(output.stderr).unwrap());
    assert!(text.contains("inertia about x") && text.contains("no flight has the signals"), "{text}");
    assert!(fs::read_to_string(place.path().join("mine.svg")).unwrap().contains("velocity [m/s]"));
    let mine = kestrel_sim::config::read_airframe(&place.path().join("mine.yaml")).unwrap();
    assert!((mine.rotor_speed_limit / (WEAKER * CF2X.rotor_speed_limit) - 1.0).abs() < 0.01, "{mine:?}");
    assert!((mine.inertia[0], mine.mass) == (CF2X.inertia[0], CF2X.mass));
    let again = kestrel(place.path(), &["identify", "flight.csv", "--airframe", "mine.yaml", "--keep", "rotor"]);
    assert_eq!(again.status.code(), Some(0));
    assert!(String::from_utf8(again.stdout).unwrap().contains("kept, as asked"));
    assert!(place.path().join("airframe.yaml").is_file());
}

#[test]
fn a_residual_network_is_shown_beside_the_identified_airframe() {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("flight.csv"), bobbing()).unwrap();
    let output = kestrel(place.path(), &["identify", "flight.csv", "--residual", "--seed", "3", "--threads", "1"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{text}{}", String::from_utf8(output.stderr).unwrap());
    assert!(text.contains("  with residual network") && text.contains("Residual network: 10 inputs"), "{text}");
    let picture = fs::read_to_string(place.path().join("airframe.svg")).unwrap();
    assert!(picture.contains("with residual network"));
}

#[test]
fn logs_and_wishes_that_make_no_sense_are_named() {
    let place = tempfile::tempdir().unwrap();
    let directory = place.path();
    let wrong = |arguments: &[&str]| refusal(&kestrel(directory, &[&["identify"], arguments].concat()));
    assert!(wrong(&["absent.csv"]).contains("absent.csv: found "));
    fs::write(directory.join("text.csv"), "a,b\n1,2\n").unwrap();
    assert!(wrong(&["text.csv"]).contains("text.csv: found a file of no known format"));
    fs::write(directory.join("flight.csv"), bobbing().replace(",4.2,1\n10.00", ",full,1\n10.00")).unwrap();
    assert!(wrong(&["flight.csv"]).contains("flight.csv:1001: found `full`, expected a number"));
    fs::write(directory.join("flight.csv"), bobbing()).unwrap();
    assert!(wrong(&["flight.csv", "--airframe", "cf2y"]).contains("found `cf2y`"));
    assert!(wrong(&["flight.csv", "--keep", "colour"]).contains("expected one of rotor speed limit"));
    assert!(wrong(&["flight.csv", "--hold-out", "other"]).contains("--hold-out: found `other`"));
    assert!(wrong(&["flight.csv", "--hold-out", "flight"]).contains("no stretch that can be followed"));
    assert!(wrong(&["flight.csv", "--seed", "1"]).contains("--residual"));
    assert!(wrong(&["flight.csv", "--residual=much"]).contains("--residual"));
    assert!(wrong(&["flight.csv", "--residual", "--seed", "one"]).contains("--seed"));
    let little = wrong(&["flight.csv", "--residual", "--hold-out", "flight:4-20"]);
    assert!(little.contains("--residual: found ") && little.contains("about ten seconds"), "{little}");
    assert!(!Path::new(directory).join("airframe.yaml").exists(), "nothing is written");
}

#[test]
fn real_flights_that_are_not_there_are_named() {
    let place = tempfile::tempdir().unwrap();
    let text = refusal(&kestrel(place.path(), &["verify", "--real", "."]));
    assert!(
        text.contains(
            "found no real flights, expected a folder with crazyflie-usd-logs, nanobench or idsia-nanodrone"
        ),
        "{text}"
    );
    assert!(refusal(&kestrel(place.path(), &["verify"])).contains("required"));
}
