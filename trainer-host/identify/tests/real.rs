//! The shipped Crazyflie against flights of real ones, where they are at hand.

use std::path::PathBuf;

use kestrel_core::airframe::{CF2X, CRAZYFLIE_2_1};
use kestrel_identify::verify_real;

/// Folder of the recordings, which belong to others and are not part of this repository.
fn folder() -> PathBuf {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/reference");
    std::env::var_os("KESTREL_REAL_FLIGHTS").map_or_else(|| PathBuf::from(beside), PathBuf::from)
}

#[test]
fn the_crazyflie_predicts_real_flights_and_its_predecessor_does_not() {
    let folder = folder();
    if !folder.join("crazyflie-usd-logs").is_dir() {
        println!("skipped: no real flights in {}, or name their folder in KESTREL_REAL_FLIGHTS", folder.display());
        return;
    }
    let airframe = |name: &str, airframe| (name.to_owned(), airframe);
    let judged = verify_real(&folder, &[airframe("crazyflie_2_1", CRAZYFLIE_2_1)], &|| true).unwrap();
    assert!(judged.passed(), "{judged}");
    let before = verify_real(&folder, &[airframe("cf2x", CF2X)], &|| true).unwrap();
    assert!(!before.passed(), "{before}");
    for (now, before) in judged.findings.iter().zip(&before.findings) {
        let after = |finding: &kestrel_identify::RealFinding| finding.horizon.after(1, 50);
        assert!(after(now) < after(before) && after(now) < now.horizon.after(0, 50), "{}", now.flights);
    }
}

#[test]
fn a_folder_without_flights_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let error = verify_real(place.path(), &[], &|| true).unwrap_err().to_string();
    assert!(
        error.ends_with("found no real flights, expected a folder with crazyflie-usd-logs or nanobench"),
        "{error}"
    );
}

#[test]
fn who_asks_to_stop_gets_no_report() {
    let folder = folder();
    if folder.join("crazyflie-usd-logs").is_dir() {
        let airframes = [("cf2x".to_owned(), CF2X)];
        assert_eq!(verify_real(&folder, &airframes, &|| false).unwrap_err().to_string(), "interrupted");
    }
}

#[test]
fn bitcrazes_controllers_follow_set_points_on_our_drone_as_they_did_on_theirs() {
    let folder = folder();
    if !folder.join("nanobench").is_dir() {
        println!("skipped: no real flights in {}, or name their folder in KESTREL_REAL_FLIGHTS", folder.display());
        return;
    }
    let report = verify_real(&folder, &[("crazyflie_2_1".to_owned(), CRAZYFLIE_2_1)], &|| true).unwrap();
    let passed = report.tracking.iter().filter(|finding| finding.passed()).count();
    assert!(report.tracking.len() == 8 && passed >= 6, "{report}");
    assert!(report.tracking.iter().all(|finding| (finding.ratio() - 1.0).abs() < 0.2), "{report}");
}
