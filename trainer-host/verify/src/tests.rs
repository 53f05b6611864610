//! The recordings of `tests/golden`, or those that `KESTREL_REFERENCE` names.

use std::path::{Path, PathBuf};

use super::*;

/// Folder that holds `pybullet` and `fork`.
fn recordings() -> PathBuf {
    let golden = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden");
    std::env::var_os("KESTREL_REFERENCE").map_or_else(golden, PathBuf::from)
}

#[test]
fn every_recording_is_reproduced() {
    let report = verify(&recordings(), &Models::default(), Tolerances::default()).unwrap();
    println!("{report}");
    assert!(report.passed(), "{report}");
    for kind in Kind::ALL {
        let known = report.findings.iter().any(|finding| finding.kind == kind && finding.rows > 0);
        assert!(known, "nothing of {} was compared", kind.name());
    }
}
