//! A Rust module that holds a policy file, for firmwares that link `kestrel-core`.

use kestrel_core::policy_file::PolicyFile;

use super::{SourceError, comment, rows};

/// The module of the policy file `bytes`, which start on a four-byte boundary of memory.
///
/// # Errors
/// [`SourceError::Policy`].
pub fn rust_module(bytes: &[u8]) -> Result<String, SourceError> {
    let policy = PolicyFile::parse(bytes)?;
    policy.self_test()?;
    let metadata = policy.metadata();
    let (name, arithmetic, period) =
        (comment(metadata.name), policy.arithmetic().name(), metadata.control_period_secs);
    let (observation, action) = (metadata.observation.name(), metadata.action.name());
    let numbers = rows(bytes.iter().map(u8::to_string), 24);
    Ok(format!(
        "//! The policy \"{name}\" in {arithmetic}, written by `kestrel export --target rust`.
//!
//! It sees {observation}, commands {action}, and is to be called every {period} s.

use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{{Aligned, PolicyError, PolicyFile}};

/// A pilot whose policy computes what it did when it was exported; to be made before arming.
///
/// # Errors
/// What is wrong with the policy: do not fly.
pub fn pilot() -> Result<Pilot<'static>, PolicyError> {{
    let mut pilot = Pilot::new(PolicyFile::parse(&POLICY.0)?);
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
