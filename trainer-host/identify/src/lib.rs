//! System identification: from flight logs to an airframe with its uncertainty.
//!
//! A [`log`] becomes a [`flight`] on one clock. [`identify`] follows it in short windows from measured starts, with the
//! core's vehicle, and searches the numbers of the [`drone`] that leave the least error. Numbers that the flights cannot
//! tell stay as they were, and the [`horizon`] says how far predictions of flights that were not fitted are off.
//! What the airframe lacks, a small [`ResidualNetwork`] may learn.

mod airframe_file;
mod alignment;
mod balance;
mod course;
pub mod drone;
mod error;
pub mod flight;
mod hold_out;
pub mod horizon;
mod identification;
mod least_squares;
pub mod log;
mod moments;
mod motion;
mod parameter;
mod real;
mod report;
mod residual;
mod residual_gradient;
mod residual_network;
mod residual_training;
mod smoothing;
mod track;
mod tracking;

pub use airframe_file::airframe_file;
pub use error::LogError;
pub use hold_out::{HoldOut, Span};
pub use identification::{Finding, Identification, IdentifyError, Kept, Settings, Verdict, identify};
pub use parameter::Parameter;
pub use real::{Limit, RealDrones, RealFinding, RealReport, verify_real};
pub use residual_network::ResidualNetwork;
pub use track::Track;
pub use tracking::{TrackingError, TrackingFinding};
