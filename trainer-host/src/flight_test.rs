//! Scripted flights with faults, judged by the true state: what `kestrel test` runs.
//!
//! A file of flights ([`config`]) becomes [`case::Case`]s. Each is flown by the vehicle behind MAVLink in the simulation, a
//! ground station in the same process speaking to it ([`flight`], [`station`]); [`fault`]s act in the [`plant`], in the policy
//! ([`backend`]) and on the link. An [`expectation`] judges the log of the flight. [`runner`] flies many side by side;
//! [`junit`] and [`film`] are what is left of them.

pub(crate) mod backend;
pub(crate) mod case;
pub(crate) mod config;
pub(crate) mod expectation;
pub(crate) mod fault;
pub(crate) mod film;
pub(crate) mod flight;
pub(crate) mod junit;
pub(crate) mod plant;
pub(crate) mod runner;
pub(crate) mod station;
#[cfg(test)]
mod tests;
