//! The vision encoder of a policy (a CNN): convolutions over an image and a dense layer, whose outputs enter the policy's network behind
//! the observation.
//!
//! An image is bytes `[rows][columns][channels]`, 255 of which are one. Convolutions have no padding; they and the
//! dense layer are followed by a rectifier. What the dense layer writes are the features.
//!
//! [`Encoder`] computes in `f32`: each sum starts with the bias and adds its products in the order of the weights, so the
//! bits are the same everywhere. [`FixedEncoder`] computes in integers: weights of 8 bits with a step per filter,
//! activations of 15 bits and no sign with a step per stage, sums of 32 bits. Sums are in units of `weight step · input
//! step`, so
//!
//! ```text
//! activation = (bias + Σ weight · term) · multiplier >> 32,   limited to [0, 2^bits − 1]
//! ```
//!
//! where `multiplier = weight step · input step / output step · 2³²` and the bias has half a unit of the activation on
//! top, which makes the shift round to the nearest. The steps come from images ([`EncoderFormat::calibrated`]). No sum can
//! leave 32 bits, whatever the image: where `Σ|weight|` is too large for inputs of 15 bits, they get fewer, and
//! parameters that break this are refused.
//!
//! What a filter reads is gathered side by side, weights lie as `[block of 4 filters][group of 4 terms][filter][4]`
//! (the dense layer's input already does): one pointer walks through the weights, and a pair of terms is one word
//! for a microcontroller that multiplies halfwords. Working memory is the caller's: the terms of one filter, and two
//! buffers that the stages read and write in turn.

mod error;
mod fixed;
mod float;
mod packing;
mod shape;
mod stage;
mod walk;

pub use error::EncoderError;
pub use fixed::FixedEncoder;
pub use float::Encoder;
pub use packing::{EncoderFormat, round_weights, write_fixed, write_float};
pub use shape::{
    CHANNEL_LIMIT, CONVOLUTION_LIMIT, EncoderShape, FEATURE_LIMIT, KERNEL_LIMIT, SIDE_LIMIT, STAGE_LIMIT,
    TERM_LIMIT,
};
pub use stage::{Convolution, EncoderStage, Volume};
