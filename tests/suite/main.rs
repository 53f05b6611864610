//! Suites that look at several crates at once.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

mod clean_and_bullet;
mod diagnosis;
mod goldens;
mod layering;
mod learning;
mod plot;
mod readme;
mod source;
mod tune;
