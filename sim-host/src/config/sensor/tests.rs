use nalgebra::Vector3;

use super::*;
use crate::config::Document;
use crate::sensor::Way;

/// A file with nothing but sensors.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Equipment {
    sensors: Vec<SensorConfig>,
}

const ALL: &str = "sensors: [imu: {}, flow: {}, range: {}, barometer: {}]";

fn suite(text: &str) -> Result<SensorSuite, ConfigError> {
    let document = Document::parse("trial.yaml", text)?;
    let equipment: Equipment = document.decode()?;
    SensorConfig::check_all(&equipment.sensors, 0.01, &document.root().at("sensors"))
}

fn message(text: &str) -> String {
    let error = suite(text).unwrap_err().to_string();
    error.lines().next().unwrap_or_default().to_owned()
}

#[test]
fn a_fully_equipped_crazyflie_measures_fifteen_values() {
    let suite = suite(ALL).unwrap();
    assert_eq!(suite.len(), 6 + 3 + 5 + 1);
    let signals: Vec<_> = suite.instruments().iter().map(|instrument| instrument.signal).collect();
    assert_eq!(signals[..2], [Signal::BodyRates, Signal::SpecificForce]);
    assert_eq!(signals[3], Signal::Distance { direction: Direction::Down, limit: 4.0 });
    assert_eq!(signals[8], Signal::Distance { direction: Direction::Up, limit: 4.0 });
    assert_eq!(signals[9], Signal::Height);
}

#[test]
fn data_sheets_become_si() {
    let suite = suite(ALL).unwrap();
    let near = |value: f64, expected: f64| (value / expected - 1.0).abs() < 1e-3;
    let gyroscope = &suite.instruments()[0];
    // 0.014 °/s/√Hz in 88.9 Hz is 0.132 °/s.
    assert!(matches!(gyroscope.noise, Noise::Constant(deviation) if near(deviation, 2.3034e-3)));
    assert!(near(gyroscope.limits[1], 34.907) && near(gyroscope.resolution, 1.0647e-3));
    let accelerometer = &suite.instruments()[1];
    // 175 µg/√Hz in 33.3 Hz is 1.01 mg.
    assert!(matches!(accelerometer.noise, Noise::Constant(deviation) if near(deviation, 9.9066e-3)));
    assert!(near(accelerometer.bias.constant, 0.196_133) && accelerometer.unit == GRAVITY);
}

#[test]
fn a_rangers_noise_is_the_firmwares() {
    let suite = suite(ALL).unwrap();
    let Noise::Growing { near, onset, growth } = suite.instruments()[3].noise else { panic!("it grows") };
    assert_eq!((near, onset), (0.0025, 2.5));
    // zranger2.c: expCoeff = log(expStdB / expStdA) / (expPointB - expPointA).
    assert!((growth - (0.2_f64 / 0.0025).ln() / 1.5).abs() < 1e-12);
}

#[test]
fn a_perfect_instrument_can_be_written() {
    let perfect = "sensors: [range: {directions: [down], beam: {noise_m: 0, noise_at_limit_m: 0, bias_m: 0, \\
                   resolution_m: 0, latency_secs: 0, rate_hz: 10000}}]";
    let suite = suite(&perfect.replace("\\\n", "")).unwrap();
    let instrument = &suite.instruments()[0];
    assert_eq!((instrument.noise, instrument.resolution), (Noise::Constant(0.0), 0.0));
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    let table = [
        (
            "sensors: [sonar: {}]",
            "found `sonar`, expected `imu`, `flow`, `range`, `barometer`, `tof`, `scan`, `mates`, `path`, `coverage`, `gates` or `way`",
        ),
        ("sensors: [imu: {gyro: {}}]", "found the unknown key `gyro`, expected `gyroscope` or `accelerometer`"),
        ("sensors: [barometer: {rate_hz: 0}]", "found 0, expected a number from 0.1 to 10000 Hz"),
        ("sensors: [barometer: {noise_m: -1}]", "found -1, expected a number from 0 to 1000"),
        ("sensors: [flow: {height: {drop_out: 1}}]", "found 1, expected a number from 0 to 0.99"),
        ("sensors: [imu: {gyroscope: {latency_secs: 2}}]", "found 2, expected a number from 0 to 1 s"),
        ("sensors: [imu: {accelerometer: {limit_g: 0}}]", "found 0, expected a number above 0, at most 1000 g"),
        ("sensors: [range: {directions: []}]", "found no directions, expected at least one, such as `front`"),
        (
            "sensors: [range: {directions: [up, front, up]}]",
            "sensors.0.range.directions.2: found a direction a second time, expected each direction once",
        ),
        ("sensors: [range: {directions: [north]}]", "expected `front`, `back`, `left`, `right`, `up` or `down`"),
    ];
    for (text, expected) in table {
        let found = message(text);
        assert!(found.starts_with("trial.yaml:1:") && found.contains(expected), "{text}\n{found}");
    }
}

#[test]
fn more_values_than_a_policy_sees_are_refused() {
    let many = format!("sensors: [{}]", ["imu: {}"; OBSERVATION_LIMIT / 6 + 1].join(", "));
    assert!(message(&many).contains("sensors that measure"), "{}", message(&many));
}

#[test]
fn a_way_is_found_behind_a_scan() {
    let of =
        |keys: &str| format!("sensors: [scan: {{}}, way: {{map: {{low_m: [0, 0, 0], high_m: [2, 1, 1]}}{keys}}}]");
    let equipped = suite(&of("")).unwrap();
    let Some(Told::Way(way)) = equipped.told() else { panic!("a way") };
    assert_eq!((equipped.len(), way.grid.len(), way.periods), (19, 21 * 11 * 11, 10));
    assert_eq!(suite(&of(", rate_hz: 1000")).unwrap().told(), Some(&Told::Way(Way { periods: 1, ..*way })));
    let cases = [
        (
            of(", spacing_m: 0.02"),
            "found nodes 0.02 m apart in this `map`, expected 2 along each edge at least, and 65024 at most",
        ),
        (of(", spacing_m: 3"), "found nodes 3 m apart in this `map`, expected 2 along each edge at least"),
        (of(", rate_hz: 0"), "found 0, expected a number from 0.1 to 1000 Hz"),
        (of(", lookahead_m: 0"), "found 0, expected a number from 0.05 to 10 m"),
        (of(", nearness_cost: -1"), "found -1, expected a number from 0 to 30"),
        (of(", unseen_cost: 0.5"), "found 0.5, expected a number from 1 to 10"),
        (of(", mapped_within_m: 0"), "found 0, expected a number from 0.1 to 100 m"),
        (of("").replace("[2, 1, 1]", "[2, 0, 1]"), "high_m"),
        (
            "sensors: [way: {map: {low_m: [0, 0, 0], high_m: [2, 1, 1]}}, scan: {}]".to_owned(),
            "`way` before other sensors",
        ),
    ];
    assert_eq!(suite(&of("").replace("scan", "tof")).unwrap().len(), 67);
    assert_eq!(suite(&of(", shows_nearest: true")).unwrap().len(), 22);
    for (text, expected) in cases {
        assert!(message(&text).contains(expected), "{text}\n{}", message(&text));
    }
}

#[test]
fn a_scan_is_the_last_sensor_and_adds_its_beams() {
    let equipped =
        suite("sensors: [imu: {}, scan: {rings: [{beams: 8}, {elevation_deg: 90, beams: 1}]}]").unwrap();
    assert_eq!((equipped.instruments_len(), equipped.len()), (6, 15));
    let directions = equipped.scan().unwrap().directions(0);
    assert!((directions[2] - Vector3::y()).norm() < 1e-12 && (directions[8] - Vector3::z()).norm() < 1e-12);
    assert_eq!(suite("sensors: [scan: {}]").unwrap().len(), 16);
    let cases = [
        (
            "sensors: [scan: {}, imu: {}]",
            "trial.yaml:1:11: sensors.0: found a `scan` before other sensors, expected one `scan`, as the last of them",
        ),
        (
            "sensors: [scan: {rings: [{beams: 64}, {beams: 1}]}]",
            "trial.yaml:1:25: sensors.0.scan.rings: found 65 beams, expected 1 to 64",
        ),
        (
            "sensors: [scan: {limit_m: 0}]",
            "trial.yaml:1:27: sensors.0.scan.limit_m: found 0, expected a number from 0.1 to 1000 m",
        ),
        (
            "sensors: [scan: {near_scale_m: 0}]",
            "trial.yaml:1:32: sensors.0.scan.near_scale_m: found 0, expected a number from 0.01 to 1000 m",
        ),
    ];
    for (text, expected) in cases {
        assert_eq!(message(text), expected);
    }
}

#[test]
fn a_multizone_ranger_stands_between_instruments_and_scan() {
    let equipped = suite("sensors: [imu: {}, tof: {zones: 4}, scan: {rings: [{beams: 8}]}]").unwrap();
    assert_eq!((equipped.len(), equipped.scan_start()), (6 + 16 + 8, 6 + 16));
    assert_eq!(suite("sensors: [tof: {}]").unwrap().len(), 64);
    for (text, expected) in [
        (
            "sensors: [tof: {}, imu: {}]",
            "trial.yaml:1:11: sensors.0: found a `tof` before other sensors, expected one `tof`, as the last but for a `scan` \
             and what is told",
        ),
        ("sensors: [tof: {zones: 6}]", "trial.yaml:1:24: sensors.0.tof.zones: found 6, expected 4 or 8"),
        (
            "sensors: [tof: {latency_secs: 0.07}]",
            "trial.yaml:1:31: sensors.0.tof.latency_secs: found 0.07 s, expected less than 0.0667 s, what passes from one \
             measurement to the next",
        ),
        (
            "sensors: [tof: {field_of_view_deg: 150}]",
            "trial.yaml:1:36: sensors.0.tof.field_of_view_deg: found 150, expected a number from 5 to 120 degrees",
        ),
    ] {
        assert_eq!(message(text), expected);
    }
}
