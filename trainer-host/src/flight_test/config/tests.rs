use std::path::PathBuf;

use kestrel_shim::ground_station::StationOrder;

use super::*;
use crate::flight_test::expectation::{Condition, Extent};

/// The shortest file with everything that can be wrong in it.
const MINIMAL: &str = "\
version: 1
name: trial
task:
  version: 1
  name: low
  scenario:
    aviary: {goal_m: [0, 0, 1]}
    physics: {control_rate_hz: 50}
    start: {position: {around_goal: {farthest_m: 0.5}}, tilt_limit_deg: 10}
    rewards:
      - proximity: {weight: 1, scale_m: 0.5}
    success:
      settle: {radius_m: 0.05, within_secs: 4}
pilot: hover-cf2x
parameters: {COM_DL_LOSS_T: 3}
flights:
  - name: one
    secs: 20
    parameters: {NAV_DLL_ACT: 2}
    matrix: {pilots: [hover-cf2x, cascade], seeds: [3, 4], heights_m: [0.5, 1.5], winds_m_per_s: [[0, 0, 0], [1, 0, 0]]}
    script:
      - {at_secs: 1, send: arm}
      - {at_secs: 2, send: {take_off: {height_m: 1}}}
      - {at_secs: 6, send: {go_to: {at_m: [1, 0], height_m: 1, heading_deg: 90, for_secs: 2}}}
      - {at_secs: 9, send: {velocity: {m_per_s: [0.5, 0, 0], for_secs: 2}}}
      - {at_secs: 9, send: {speed: {m_per_s: 0.5}}}
      - {at_secs: 9, send: {upload: [{take_off: {height_m: 1}}, {waypoint: {at_m: [1, 0], height_m: 1, hold_secs: 1}}, land]}}
    faults:
      - {at_secs: 10, for_secs: 1, fault: link_loss}
      - {at_secs: 10, for_secs: 1, fault: {motor: {rotor: 0, share: 0.5}}}
      - {at_secs: 10, fault: {battery: {left: 0.5}}}
      - {at_secs: 10, for_secs: 1, fault: {gust: {wind_m_per_s: [1, 0, 0]}}}
      - {at_secs: 10, for_secs: 1, fault: {estimate: frozen}}
    expect:
      - stays_above: {height_m: 0.3, from_secs: 5, until_secs: 9}
      - stays_inside: {low_m: [-1, -1, 0], high_m: [1, 1, 2]}
      - stays_near: {at_m: [0, 0], radius_m: 1}
      - arrives: {at_m: [0, 0], height_m: 1, radius_m: 0.2, from_secs: 3, by_secs: 9}
      - holds_heading: {heading_deg: 0, within_deg: 20}
      - tilts_less: {degrees: 20}
      - slower: {m_per_s: 1}
      - mode_becomes: {mode: holding, by_secs: 9}
      - mode_stays: {mode: holding, from_secs: 5}
      - flown_by: {controller: policy}
      - touches_nothing: {from_secs: 1}
      - ends_landed
      - says: {text: landed}
";

fn cases(overrides: &[&str]) -> Result<Vec<Case>, ConfigError> {
    let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
    from_document(Document::parse("trial.yaml", MINIMAL)?, &overrides)
}

/// Keys of the first flight, a value that is wrong, and what the message says of it.
const WRONG: [(&str, &str); 53] = [
    ("name=a b", "found the text \"a b\", expected 1 to 64 letters"),
    ("secs=0", "found 0, expected a number above 0, at most 3600 s"),
    ("secs=x", "found the text \"x\", expected a number"),
    ("length=3", "found the unknown key `length`"),
    ("parameters={NAV_DLL_ACT: 7}", "found 7, expected one of [0, 1, 2, 3]"),
    ("parameters={NAV_DLL_ACT: 1.5}", "found 1.5, expected one of [0, 1, 2, 3]"),
    ("parameters={MPC_XY_CRUISE: 9}", "found 9, expected 0.05 to 3"),
    ("parameters={SYS_ID: 2}", "found 2, expected another parameter: this one is read-only"),
    ("parameters={NAV_DL_ACT: 2}", "found the unknown parameter `NAV_DL_ACT`"),
    (
        "matrix.pilots=[hoover]",
        "found the text \"hoover\", expected a pilot (hover, hover-cf2x, hover-2-1-plus, …), `cascade`, or a policy file",
    ),
    ("matrix.pilots=[none.kestrel]", "found cannot read policy none.kestrel"),
    ("matrix.seeds=[-1]", "found -1, expected a whole number, zero or more"),
    ("matrix.heights_m=[0.1]", "found 0.1, expected a number from 0.2"),
    ("matrix.winds_m_per_s=[[0, 0, 99]]", "found 99, expected a number from -30 to 30 m/s"),
    ("matrix.days=[1]", "found the unknown key `days`"),
    ("script.0.at_secs=21", "found 21, expected a number from 0 to 20 s, the length of the flight"),
    ("script.1.at_secs=0.5", "found 0.5, expected a time that is not before that of the step above"),
    ("script.0.send=fly", "found `fly`, expected `arm`"),
    ("script.1.send.take_off.height_m=50", "found 50, expected a number from 0.2"),
    ("script.2.send.go_to.at_m=[1]", "found a list of 1, expected a list of 2"),
    ("script.2.send.go_to.at_m=[1e9, 0]", "expected a number from -1000 to 1000 m"),
    ("script.2.send.go_to.height_m=-1", "found -1, expected a number from 0 to 1000 m"),
    ("script.2.send.go_to.heading_deg=999", "found 999, expected a number from -360 to 360 degrees"),
    ("script.2.send.go_to.for_secs=-1", "found -1, expected a number from 0 to 20 s"),
    ("script.3.send.velocity.m_per_s=[2, 0, 0]", "found 2, expected a number from -1 to 1 m/s"),
    ("script.3.send.velocity.for_secs=99", "found 99, expected a number from 0 to 20 s"),
    ("script.4.send.speed.m_per_s=0", "found 0, expected a number from 0.05"),
    ("script.5.send.upload=[]", "found 0 items, expected 1 to 64 items"),
    ("script.5.send.upload.0.take_off.height_m=0", "found 0, expected a number from 0.2"),
    ("script.5.send.upload.1.waypoint.hold_secs=-1", "found -1, expected a number from 0 to 600 s"),
    ("script.5.send.upload.2=hover", "found `hover`, expected `take_off`"),
    ("faults.0.at_secs=-1", "found -1, expected a number from 0 to 20 s"),
    ("faults.0.for_secs=0", "found 0, expected a number above 0"),
    ("faults.0.fault=smoke", "found `smoke`, expected `link_loss`"),
    ("faults.1.fault.motor.rotor=4", "found 4, expected a whole number from 0 to 3"),
    ("faults.1.fault.motor.share=1.5", "found 1.5, expected a number from 0 to 1"),
    ("faults.2.fault.battery.left=2", "found 2, expected a number from 0 to 1"),
    ("faults.2.for_secs=3", "found 3, expected none: no battery recharges in flight"),
    ("faults.3.fault.gust.wind_m_per_s=[0, 99, 0]", "found 99, expected a number from -30 to 30 m/s"),
    ("faults.4.fault.estimate=late", "found `late`, expected `frozen` or `lost`"),
    (
        "faults.4.fault={policy: silent}",
        "found a fault of a policy, expected a fault of what flies, which is the cascade",
    ),
    ("expect=[]", "found an empty list, expected at least one expectation"),
    ("expect.0.stays_above.until_secs=3", "found 3, expected a time after 5 s, where it begins"),
    ("expect.1.stays_inside.high_m=[-2, 1, 2]", "expected"),
    ("expect.2.stays_near.radius_m=0", "found 0, expected a number above 0"),
    ("expect.3.arrives.by_secs=30", "found 30, expected a number from 0 to 20 s"),
    ("expect.4.holds_heading.within_deg=0", "found 0, expected a number above 0, at most 180 degrees"),
    ("expect.5.tilts_less.degrees=200", "found 200, expected a number above 0, at most 180 degrees"),
    ("expect.6.slower.m_per_s=0", "found 0, expected a number above 0, at most 100 m/s"),
    ("expect.7.mode_becomes.mode=hovering", "found `hovering`, expected `disarmed`"),
    ("expect.9.flown_by.controller=pid", "found `pid`, expected `policy` or `cascade`"),
    ("expect.10.touches_nothing.from_secs=-1", "found -1, expected a number from 0 to 20 s"),
    ("expect.12.says.text=\"\"", "expected words"),
];

#[test]
fn every_key_of_a_flight_that_is_wrong_is_named_with_what_was_found_and_expected() {
    let mut unexpected = Vec::new();
    for (assignment, expected) in WRONG {
        let assignment = format!("flights.0.{assignment}");
        let message = cases(&[&assignment]).err().map_or_else(|| "accepted".to_owned(), |error| error.to_string());
        let located = message.starts_with(&format!("--set {assignment}: "));
        if !(located && message.contains("found ") && message.contains(expected)) {
            unexpected.push(format!("{message} instead of {expected}"));
        }
    }
    assert!(unexpected.is_empty(), "{}", unexpected.join("\n"));
}

#[test]
fn what_is_wrong_in_the_file_is_named_with_its_line() {
    let wrong = [
        ("version: 1\nname", "version: 2\nname", 1, "found 2, expected `version: 1`"),
        ("name: trial", "name: a b", 2, "found the text \"a b\", expected 1 to 64 letters"),
        ("tilt_limit_deg: 10", "tilt_limit_deg: x", 9, "found the text \"x\", expected a number"),
        (
            "pilot: hover-cf2x\n",
            "pilot: nobody\n",
            14,
            "found the text \"nobody\", expected a pilot (hover, room-1",
        ),
        ("COM_DL_LOSS_T: 3", "COM_DL_LOSS_T: 0", 15, "found 0, expected 1 to 300"),
        (
            "rate_hz: 50",
            "rate_hz: 100",
            14,
            "found a policy that acts every 0.02 s, expected one that acts every 0.01 s",
        ),
    ];
    for (right, wrong, line, expected) in wrong {
        assert_eq!(MINIMAL.matches(right).count(), 1, "{right}");
        let text = MINIMAL.replace(right, wrong);
        let checked = Document::parse("trial.yaml", &text).and_then(|document| from_document(document, &[]));
        let message = checked.unwrap_err().to_string();
        assert!(message.starts_with(&format!("trial.yaml:{line}:")) && message.contains(expected), "{message}");
    }
    let twice = "flights=[{name: one, secs: 1, script: [], expect: [ends_landed]}, {name: one, secs: 1, script: [], expect: [ends_landed]}]";
    let message = cases(&[twice]).unwrap_err().to_string();
    assert!(message.ends_with("expected a name that no other flight of the file has"), "{message}");
    let bullet = "task.scenario.physics.bullet={}";
    let message = cases(&[bullet]).unwrap_err().to_string();
    assert!(message.contains("found wind, expected none, because the physics `bullet`"), "{message}");
    let message = cases(&["flights=[]"]).unwrap_err().to_string();
    assert!(message.ends_with("found an empty list, expected at least one flight"), "{message}");
}

#[test]
fn a_matrix_is_a_flight_for_every_combination() {
    let cases = cases(&[]).unwrap();
    assert_eq!(cases.len(), 16);
    let names: Vec<String> = cases.iter().map(Case::full_name).collect();
    assert_eq!(names[0], "trial/one [hover-cf2x, seed 3, 0.5 m, wind 0 0 0]");
    assert_eq!(names[15], "trial/one [cascade, seed 4, 1.5 m, wind 1 0 0]");
    assert!(matches!((&cases[7].pilot, &cases[8].pilot), (CasePilot::Policy(_), CasePilot::Cascade)));
    let last = &cases[15];
    assert_eq!((last.seed.map(|seed| seed.0), last.wind), (Some(4), Vector3::new(1.0, 0.0, 0.0)));
    assert_eq!(last.parameters.settings().link_loss_secs, 3.0, "of the file");
    let Condition::Near { point, .. } = last.expectations[2].condition else { panic!("{last:?}") };
    assert_eq!(point.z, 1.5, "a height that is left out is that of the flight");
    assert_eq!(last.expectations[3].extent, Extent::Once);
    assert_eq!(last.script[1].order, StationOrder::TakeOff(Some(1.0)), "one that is given stays");
}

fn in_repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

#[test]
fn the_schema_is_the_one_in_the_repository() {
    let path = in_repository("configs/tests/schema.json");
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, schema()).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap();
    assert!(kept == schema(), "{} is out of date: run the test with BLESS=1", path.display());
}

#[test]
fn every_file_of_the_repository_is_sound_names_the_schema_and_together_they_are_a_hundred_flights() {
    let mut flights = 0;
    for entry in std::fs::read_dir(in_repository("configs/tests")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "yaml") {
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.starts_with("# yaml-language-server: $schema=schema.json\n"), "{}", path.display());
            flights += load(&path, &[]).unwrap_or_else(|error| panic!("{error}")).len();
        }
    }
    assert!(flights >= 100, "{flights}");
}
