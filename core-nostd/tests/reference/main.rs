//! The preset `bullet` against recordings of the reference system (see `tests/golden/README.md`).
//!
//! The committed subset is compared by default; `KESTREL_REFERENCE` names a folder with more of the same kind.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod closed_loop;
mod controllers;
mod fork;
mod learning;
mod one_step;
mod open_loop;
mod recording;
