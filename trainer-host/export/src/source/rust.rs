//! A Rust module that holds a policy file, for firmwares that link `kestrel-core`.

use kestrel_core::policy_file::PolicyError;

use super::{SourceError, comment, for_px4, rows};
use crate::policy::Policy;

/// The module of the policy file `bytes`, which start on a four-byte boundary of memory.
///
/// # Errors
/// [`SourceError::Policy`].
pub fn rust_module(bytes: &[u8]) -> Result<String, SourceError> {
    let policy = Policy::parse(bytes)?;
    policy.self_test()?;
    let Kind { feature, runner, pilot_type, file_type, constructor } = match &policy {
        Policy::Blind(policy) if for_px4(policy).is_some() => {
            Kind { feature: "; it needs the feature `px4`", ..STATE_BASED }
        }
        Policy::Blind(_) => STATE_BASED,
        Policy::Recurrent(policy) if for_px4(policy.network()).is_some() => {
            Kind { feature: "; it needs the features `recurrent` and `px4`", ..RECURRENT }
        }
        Policy::Recurrent(_) => RECURRENT,
        Policy::Seeing(_) => return Err(PolicyError::Vision.into()),
    };
    let metadata = policy.metadata();
    let (name, arithmetic, period) =
        (comment(metadata.name), policy.arithmetic().name(), metadata.control_period_secs);
    let (observation, action) = (metadata.observation.name(), metadata.action.name());
    let numbers = rows(bytes.iter().map(u8::to_string), 24);
    Ok(format!(
        "//! The policy \"{name}\" in {arithmetic}, written by `kestrel export --target rust`{feature}.
//!
//! It sees {observation}, commands {action}, and is to be called every {period} s.

use kestrel_core::pilot::{runner};
use kestrel_core::policy_file::{{Aligned, PolicyError, {file_type}}};

/// A pilot whose policy computes what it did when it was exported; to be made before arming.
///
/// # Errors
/// What is wrong with the policy: do not fly.
pub fn pilot() -> Result<{pilot_type}, PolicyError> {{
    let mut pilot = Pilot::{constructor}({file_type}::parse(&POLICY.0)?);
    pilot.self_test()?;
    Ok(pilot)
}}

/// The policy file.
#[rustfmt::skip]
pub static POLICY: Aligned<{len}> = Aligned([{numbers}
]);
",
        len = bytes.len()
    ))
}

/// What the module of a kind of policy says.
struct Kind {
    feature: &'static str,
    runner: &'static str,
    pilot_type: &'static str,
    file_type: &'static str,
    constructor: &'static str,
}

const STATE_BASED: Kind = Kind {
    feature: "",
    runner: "Pilot",
    pilot_type: "Pilot<'static>",
    file_type: "PolicyFile",
    constructor: "new",
};

const RECURRENT: Kind = Kind {
    feature: "; it needs the feature `recurrent`",
    runner: "{Pilot, RecurrentRunner}",
    pilot_type: "Pilot<'static, RecurrentRunner<'static>>",
    file_type: "RecurrentPolicy",
    constructor: "with_memory",
};
