//! The aviary of a task, lent to an autopilot that is not ours.

use std::path::Path;

use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_shim::bridge::event::BridgeCounts;
use kestrel_shim::bridge::session::{self, Callbacks};
use kestrel_shim::bridge::{BridgeError, BridgeOptions};
use kestrel_sim::flight::Flight;
use kestrel_sim::scenario::{Physics, Scenario};

use crate::fly::SimulatedFlight;
use kestrel_experiments::output::say;

/// Has an autopilot fly the scenario's drone, from the floor below where its episodes begin, until the time is up or
/// `interrupted` says so. The autopilot's pace replaces the scenario's; its substeps become no longer.
///
/// # Errors
/// If the bridge does not stand or fails, or the log or the words cannot be written.
pub(crate) fn lend(
    scenario: &Scenario,
    options: &BridgeOptions,
    log: Option<&Path>,
    interrupted: &dyn Fn() -> bool,
) -> Result<BridgeCounts, BridgeError> {
    let physics = at_rate(&scenario.physics, options.rate_hz());
    // Its motors turn as it says: there is no rate loop but the autopilot's own.
    let action = ActionSpace::RotorSpeeds(RotorSpeeds::new(&scenario.airframe, 1.0));
    let scenario = Scenario { physics, action, ..scenario.clone() };
    let mut plant = SimulatedFlight::new(Flight::landed(&scenario));
    let mut print = |text: &str| say(text).map_err(std::io::Error::other);
    let mut callbacks = Callbacks { print: &mut print, interrupted };
    session::run(options, &scenario.airframe, &mut plant, log, &mut callbacks)
}

fn at_rate(physics: &Physics, rate_hz: u32) -> Physics {
    let control_rate_hz = f64::from(rate_hz);
    let substeps_hz = physics.control_rate_hz * f64::from(physics.substeps);
    Physics { control_rate_hz, substeps: (substeps_hz / control_rate_hz).ceil().max(1.0) as u32, ..*physics }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kestrel_experiments::experiment_config;

    #[test]
    fn substeps_become_no_longer_at_another_rate() {
        let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../configs/hover.yaml");
        let physics = experiment_config::load(Path::new(config), &[]).unwrap().scenario.physics;
        for rate_hz in [50, 100, 250, 500, 1200] {
            let changed = at_rate(&physics, rate_hz);
            assert_eq!(changed.control_rate_hz, f64::from(rate_hz));
            assert!(changed.substep_secs() <= physics.substep_secs() + 1e-12, "{rate_hz} Hz");
        }
    }
}
