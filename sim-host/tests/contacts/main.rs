//! What contacts do: as the reference recorded it, and as mechanics demands (see `tests/golden/README.md`).
//!
//! The committed recordings are compared by default; `KESTREL_REFERENCE` names a folder with more of the same kind.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod flight;
mod movables;
mod recorded;
mod resting;
