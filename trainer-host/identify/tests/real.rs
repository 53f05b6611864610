//! The shipped Crazyflie against flights of real ones, where they are at hand.

use std::path::{Path, PathBuf};

use kestrel_core::airframe::{Airframe, CF2X, CRAZYFLIE_2_1, CRAZYFLIE_2_1_BRUSHLESS};
use kestrel_identify::{IdentifyError, RealDrones, RealFinding, RealReport, verify_real};

/// Folder of the recordings, which belong to others and are not part of this repository.
fn folder() -> PathBuf {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/reference");
    std::env::var_os("KESTREL_REAL_FLIGHTS").map_or_else(|| PathBuf::from(beside), PathBuf::from)
}

fn judged(folder: &Path, brushed: Airframe, brushless: Airframe) -> Result<RealReport, IdentifyError> {
    let drones = RealDrones {
        brushed: &[("brushed".to_owned(), brushed)],
        brushless: &("brushless".to_owned(), brushless),
    };
    verify_real(folder, drones, &|| true)
}

#[test]
fn the_brushless_with_its_turning_refitted_is_predicted_as_well_as_by_any_published_model() {
    let folder = folder();
    let place = folder.join("idsia-nanodrone");
    if !place.is_dir() {
        println!("skipped: no {}, or name its folder in KESTREL_REAL_FLIGHTS", place.display());
        return;
    }
    let report = judged(&folder, CRAZYFLIE_2_1, CRAZYFLIE_2_1_BRUSHLESS).unwrap();
    let findings: Vec<&RealFinding> =
        report.findings.iter().filter(|finding| finding.published.is_some()).collect();
    assert!(findings.len() == 4 && findings.iter().all(|finding| finding.passed()), "{report}");
}

#[test]
fn the_crazyflie_predicts_real_flights_and_its_predecessor_does_not() {
    let folder = folder();
    if !folder.join("crazyflie-usd-logs").is_dir() {
        println!("skipped: no real flights in {}, or name their folder in KESTREL_REAL_FLIGHTS", folder.display());
        return;
    }
    let judged = judged(&folder, CRAZYFLIE_2_1, CRAZYFLIE_2_1_BRUSHLESS).unwrap();
    assert!(judged.passed(), "{judged}");
    let before = self::judged(&folder, CF2X, CRAZYFLIE_2_1_BRUSHLESS).unwrap();
    assert!(!before.passed(), "{before}");
    let brushed = |finding: &&RealFinding| finding.published.is_none();
    for (now, before) in judged.findings.iter().filter(brushed).zip(&before.findings) {
        let after = |finding: &RealFinding| finding.horizon.after(1, 50);
        assert!(after(now) < after(before) && after(now) < now.horizon.after(0, 50), "{}", now.flights);
    }
}

#[test]
fn a_folder_without_flights_is_refused() {
    let place = tempfile::tempdir().unwrap();
    let error = judged(place.path(), CF2X, CF2X).unwrap_err().to_string();
    assert!(
        error.ends_with(
            "found no real flights, expected a folder with crazyflie-usd-logs, nanobench or idsia-nanodrone"
        ),
        "{error}"
    );
}

#[test]
fn who_asks_to_stop_gets_no_report() {
    let folder = folder();
    if folder.join("crazyflie-usd-logs").is_dir() {
        let airframe = ("cf2x".to_owned(), CF2X);
        let drones = RealDrones { brushed: std::slice::from_ref(&airframe), brushless: &airframe };
        assert_eq!(verify_real(&folder, drones, &|| false).unwrap_err().to_string(), "interrupted");
    }
}

#[test]
fn bitcrazes_controllers_follow_set_points_on_our_drone_as_they_did_on_theirs() {
    let folder = folder();
    if !folder.join("nanobench").is_dir() {
        println!("skipped: no real flights in {}, or name their folder in KESTREL_REAL_FLIGHTS", folder.display());
        return;
    }
    let report = judged(&folder, CRAZYFLIE_2_1, CRAZYFLIE_2_1_BRUSHLESS).unwrap();
    let passed = report.tracking.iter().filter(|finding| finding.passed()).count();
    assert!(report.tracking.len() == 8 && passed >= 6, "{report}");
    assert!(report.tracking.iter().all(|finding| (finding.ratio() - 1.0).abs() < 0.2), "{report}");
}
