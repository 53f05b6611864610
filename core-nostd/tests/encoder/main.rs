//! Encoders: against a convolution written directly, in float and in integers, at the limits of both.

mod fixed;
mod float;
mod shape;
mod support;
