//! Random, damaged and hostile frames: to the framer, to a vehicle in flight, and to one that wants signatures.
//!
//! It takes seconds by default. Environment variables make it long, and the optimiser fast; integers that overflow still panic:
//!
//! ```text
//! FUZZ_FRAMES=100000000 FUZZ_REQUESTS=10000000 \
//!   cargo test -p kestrel-shim --test fuzz --config profile.dev.opt-level=3 -- --nocapture --test-threads 1
//! ```
//!
//! `FUZZ_SEED` chooses other frames.

mod corpus;
mod draft;
mod effort;
mod framer;
mod random;
mod request;
mod rig;
mod sample;
mod security;
mod vehicle;
