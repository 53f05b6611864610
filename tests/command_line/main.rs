//! The `kestrel` binary as users meet it.

#![expect(clippy::unwrap_used, reason = "a test that cannot go on should panic")]

mod at_hand;
mod aviary;
mod bits;
mod check;
mod errors;
mod flight_tests;
mod identify;
mod import;
mod kestrel;
mod render;
mod runs;
mod search;
mod several;
mod shipped;
mod study;
mod summaries;
mod verify;
