//! Images, and what a policy needs to look at them.

use kestrel_core::policy_file::{Arithmetic, EncoderWorkspace};

use crate::input::Inputs;

/// Bytes of an image: 24 rows of 32 grey pixels.
pub const IMAGE_LEN: usize = 24 * 32;

/// Values with which the eye in the image works.
const WORK_LEN: usize = 4096;

/// Memory for an eye in either arithmetic.
#[derive(Clone, Debug)]
pub struct Sight {
    words: [f32; WORK_LEN],
    codes: [i16; WORK_LEN],
}

impl Sight {
    /// All zero.
    pub const fn new() -> Self {
        Self { words: [0.0; WORK_LEN], codes: [0; WORK_LEN] }
    }

    /// As a policy of this arithmetic takes it.
    pub fn workspace(&mut self, arithmetic: Arithmetic) -> EncoderWorkspace<'_> {
        match arithmetic {
            Arithmetic::Float32 => EncoderWorkspace::Float32(&mut self.words),
            Arithmetic::Fixed16 => EncoderWorkspace::Fixed16(&mut self.codes),
        }
    }
}

impl Default for Sight {
    fn default() -> Self {
        Self::new()
    }
}

/// An image of noise.
pub fn photograph(inputs: &mut Inputs) -> [u8; IMAGE_LEN] {
    let mut image = [0; IMAGE_LEN];
    for pixel in &mut image {
        *pixel = inputs.bits() as u8;
    }
    image
}
