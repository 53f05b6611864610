//! An app for crazyflie-firmware: a policy as its out-of-tree controller.

use std::fmt::Write;

use kestrel_core::action::ActionSpace;
use kestrel_core::policy_file::PolicyFile;

use super::{GUARD, SourceError, comment, for_crazyflie, for_px4, rows};

/// What is the same for every policy: file name and contents.
const APP: [(&str, &str); 6] = [
    ("kestrel_controller.c", include_str!("../../../../firmware-shim/crazyflie/app/kestrel_controller.c")),
    ("Kbuild", include_str!("../../../../firmware-shim/crazyflie/app/Kbuild")),
    ("Makefile", include_str!("../../../../firmware-shim/crazyflie/app/Makefile")),
    ("app-config", include_str!("../../../../firmware-shim/crazyflie/app/app-config")),
    ("kestrel.h", include_str!("../../../../firmware-shim/crazyflie/include/kestrel.h")),
    ("kestrel_guard.h", GUARD),
];

/// The app around the policy file `bytes`, which start on a four-byte boundary of memory: names and contents of its files.
///
/// # Errors
/// [`SourceError`], also when the policy sees what an app cannot show it, or commands one of the reference's controllers,
/// for whose stack a stabilizer task has no room.
pub fn crazyflie_app(bytes: &[u8]) -> Result<Vec<(&'static str, String)>, SourceError> {
    with_policy(bytes, "crazyflie", &APP)
}

/// `files` and the policy file `bytes` as C, for the pilot of `kestrel.h`.
pub(super) fn with_policy(
    bytes: &[u8],
    target: &str,
    files: &[(&'static str, &str)],
) -> Result<Vec<(&'static str, String)>, SourceError> {
    let policy = PolicyFile::parse(bytes)?;
    policy.self_test()?;
    let observation = policy.metadata().observation;
    if !observation.shows_goal() || observation.measured_len() > 0 {
        return Err(SourceError::Observation { found: observation.name() });
    }
    if let ActionSpace::Reference(_) = policy.metadata().action {
        return Err(SourceError::Published);
    }
    if let Some(found) = for_px4(&policy) {
        return Err(SourceError::Px4 { found });
    }
    if !for_crazyflie(&policy) {
        return Err(SourceError::Rotors);
    }
    let mut files: Vec<(&str, String)> = files.iter().map(|(name, text)| (*name, (*text).to_owned())).collect();
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

#ifdef __cplusplus
}}
#endif
"
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
"
    );
    files.push(("policy.c", source));
    Ok(files)
}
