//! Policies from weights to rotor targets: inference, the file, the pilot.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod damage;
mod file;
mod inference;
mod learner;
mod pilot;
mod recurrent;
mod spaces;
mod support;
mod vision;
