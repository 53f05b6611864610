//! The anchor of continual learning: closed forms in floating point, and fixed point against both an integer reference
//! and floating point.

mod closed_forms;
mod fixed;
mod fixed_reference;
mod support;
