//! The reference's tuning aviary started on its line: as far as the physics, not the rounding, decides.

use std::path::Path;

use kestrel_experiments::experiment_config::load;
use kestrel_sim::scenario::{Scenario, StartPosition};
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::Simulation;

/// Return of the first 48 steps of `TuneAviary` (fork, commit 40d017e, PyBullet 3.2.7, numpy 1.26, five physics steps
/// per action) started at (0, 4, 1) with the zero action.
const FIRST_SECOND: f64 = -0.013_899_480_789_032_578;

fn on_track() -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/aviaries/tune-on-track-as-published.yaml");
    load(&path, &[]).unwrap().evaluation.scenario
}

/// Rewards of an episode of the zero action that starts so far beside the line \[m\].
fn rewards(beside: f64) -> Vec<f64> {
    let mut scenario = on_track();
    if let StartPosition::Exactly(places) = &mut scenario.start.position {
        places[0].position.y += beside;
    }
    let mut simulation = Simulation::<1, f64>::new(&scenario, Seed(0), 0, 1);
    let step = |_| {
        simulation.step(&[0.0; 6]);
        simulation.rewards()[0]
    };
    (0..242).map(step).collect()
}

#[test]
fn the_tuned_controller_follows_its_line_as_in_the_reference() {
    let first_second: f64 = rewards(0.0)[..48].iter().sum();
    // The scenario keeps the rate of 0.288 rad/s in single precision, which the limit cycle makes 1.3e-8 of by then.
    assert!((first_second - FIRST_SECOND).abs() < 1e-7, "{first_second}");
}

/// The published return of -0.0427 is therefore no number to meet: a second run of the reference on another machine
/// gave -0.0493, and starts within a micrometre of the line give -0.080 to -0.043.
#[test]
fn its_limit_cycle_lets_rounding_decide_the_return() {
    let total = |beside| rewards(beside).iter().sum::<f64>();
    let returns = [0.0, 1e-12, 1e-10, 1e-8].map(total);
    let (low, high) = (returns.iter().copied().fold(0.0, f64::min), returns.iter().copied().fold(-1.0, f64::max));
    assert!(high - low > 1e-3, "{returns:?}");
    assert!(-0.09 < low && high < -0.03, "{returns:?}");
}
