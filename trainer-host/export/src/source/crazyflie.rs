//! An app for crazyflie-firmware: a policy as its out-of-tree controller.

use std::fmt::Write;

use kestrel_core::action::ActionSpace;
use kestrel_sim::scenario::Scenario;

use super::sensing::Sensing;
use super::{GUARD, SourceError, comment, for_crazyflie, for_px4, network_of, rows};
use crate::policy::Policy;

/// What is the same for every policy: file name and contents.
const APP: [(&str, &str); 6] = [
    ("kestrel_controller.c", include_str!("../../../../firmware-shim/crazyflie/app/kestrel_controller.c")),
    ("Kbuild", include_str!("../../../../firmware-shim/crazyflie/app/Kbuild")),
    ("Makefile", include_str!("../../../../firmware-shim/crazyflie/app/Makefile")),
    ("app-config", include_str!("../../../../firmware-shim/crazyflie/app/app-config")),
    ("kestrel.h", include_str!("../../../../firmware-shim/crazyflie/include/kestrel.h")),
    ("kestrel_guard.h", GUARD),
];

/// Where Kbuild says what the policy needs of the pilot.
const FEATURES: &str = "KESTREL_FEATURES ?=";

/// The app around the policy file `bytes`, which start on a four-byte boundary of memory: names and contents of its files.
/// `tasks`, by their names, are those that it learned: a policy that sees sensors sees what they say.
///
/// # Errors
/// [`SourceError`], also when the policy sees what an app cannot show it, or commands one of the reference's controllers,
/// for whose stack a stabilizer task has no room.
pub fn crazyflie_app(
    bytes: &[u8],
    tasks: &[(&str, &Scenario)],
) -> Result<Vec<(&'static str, String)>, SourceError> {
    let observation = Policy::parse(bytes)?.metadata().observation;
    if !observation.shows_goal() {
        return Err(SourceError::Observation { found: observation.name() });
    }
    with_policy(bytes, "crazyflie", &APP, &Sensing::new(observation.measured_len(), tasks)?)
}

/// Flash that the maps of the app around the policy file `bytes` take \[bytes\]; nothing for a policy that sees no scan.
///
/// # Errors
/// As [`crazyflie_app`].
pub fn crazyflie_map_bytes(bytes: &[u8], tasks: &[(&str, &Scenario)]) -> Result<usize, SourceError> {
    let observation = Policy::parse(bytes)?.metadata().observation;
    Ok(Sensing::new(observation.measured_len(), tasks)?.map_bytes())
}

/// `files` and the policy file `bytes` as C, for the pilot of `kestrel.h`.
pub(super) fn with_policy(
    bytes: &[u8],
    target: &str,
    files: &[(&'static str, &str)],
    sensing: &Sensing,
) -> Result<Vec<(&'static str, String)>, SourceError> {
    let policy = Policy::parse(bytes)?;
    policy.self_test()?;
    let (network, memory) = network_of(&policy)?;
    if let ActionSpace::Reference(_) = policy.metadata().action {
        return Err(SourceError::Published);
    }
    if let Some(found) = for_px4(network) {
        return Err(SourceError::Px4 { found });
    }
    if !for_crazyflie(network) {
        return Err(SourceError::Rotors);
    }
    let text = |name: &str, text: &str| match (name, memory) {
        ("Kbuild", Some(_)) => text.replace(FEATURES, &format!("{FEATURES} ,recurrent")),
        (_, Some(_) | None) => text.to_owned(),
    };
    let mut files: Vec<(&str, String)> = files.iter().map(|(name, file)| (*name, text(name, file))).collect();
    let about = comment(policy.metadata().name);
    files.push((
        "policy.h",
        format!(
            "/* The policy \"{about}\", written by `kestrel export --target {target}`. */
#pragma once

#include <stddef.h>
#include <stdint.h>

/* A policy file, on an eight-byte boundary. */
#ifdef __cplusplus
extern \"C\" {{
#endif

extern const uint8_t kestrel_policy[];
extern const size_t kestrel_policy_len;
{recurrent}{sensing}
#ifdef __cplusplus
}}
#endif
",
            recurrent = memory.map_or("", |_| "\n/* It has a memory. */\n#define KESTREL_RECURRENT\n"),
            sensing = sensing.header()
        ),
    ));
    let mut source = format!(
        "/* The policy \"{about}\", written by `kestrel export --target {target}`. */\n#include \"policy.h\"\n\n"
    );
    let bytes = rows(bytes.iter().map(|byte| format!("0x{byte:02x}")), 16);
    let _infallible = write!(
        source,
        "const uint8_t kestrel_policy[] __attribute__((aligned(8))) = {{{bytes}
}};
const size_t kestrel_policy_len = sizeof kestrel_policy;
{maps}",
        maps = sensing.source()
    );
    files.push(("policy.c", source));
    Ok(files)
}
