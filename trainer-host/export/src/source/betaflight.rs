//! A policy behind the neural interface of `INDIflight` and other forks of Betaflight.

use super::crazyflie::with_policy;
use super::sensing::Sensing;
use super::{GUARD, SourceError};
use crate::policy::Policy;

/// What is the same for every policy: file name and contents.
const CONTROLLER: [(&str, &str); 4] = [
    ("nn_controller.c", include_str!("../../../../firmware-shim/betaflight/nn_controller.c")),
    ("nn_controller.h", include_str!("../../../../firmware-shim/betaflight/nn_controller.h")),
    ("kestrel.h", include_str!("../../../../firmware-shim/crazyflie/include/kestrel.h")),
    ("kestrel_guard.h", GUARD),
];

/// The controller around the policy file `bytes`, which start on a four-byte boundary of memory: names and contents of its files.
///
/// # Errors
/// As [`super::crazyflie_app`], also when the policy sees sensors.
pub fn betaflight_controller(bytes: &[u8]) -> Result<Vec<(&'static str, String)>, SourceError> {
    let policy = Policy::parse(bytes)?;
    if let Policy::Recurrent(_) = policy {
        return Err(SourceError::Memory);
    }
    let observation = policy.metadata().observation;
    if !observation.shows_goal() || observation.measured_len() > 0 {
        return Err(SourceError::Observation { found: observation.name() });
    }
    with_policy(bytes, "betaflight", &CONTROLLER, &Sensing::new(0, &[])?)
}
