//! Reproducible numbers, and the memory of an anchor.

use kestrel_core::anchor::Anchor;
use kestrel_core::anchor::fixed::FixedAnchor;

/// Numbers that look random (Marsaglia's xorshift, 64 bits).
pub(crate) struct Numbers(u64);

impl Numbers {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// In \[low, high).
    pub(crate) fn within(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * ((self.bits() >> 40) as f32 / (1_u32 << 24) as f32)
    }

    pub(crate) fn vector(&mut self, length: usize, low: f32, high: f32) -> Vec<f32> {
        (0..length).map(|_| self.within(low, high)).collect()
    }

    /// Spread evenly over the octaves between two powers of two.
    pub(crate) fn octaves(&mut self, length: usize, low: f32, high: f32) -> Vec<f32> {
        self.vector(length, low, high).into_iter().map(f32::exp2).collect()
    }
}

/// What a caller owns of an [`Anchor`].
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Memory {
    pub(crate) center: Vec<f32>,
    pub(crate) importance: Vec<f32>,
}

impl Memory {
    pub(crate) fn new(parameters: usize) -> Self {
        Self { center: vec![0.0; parameters], importance: vec![0.0; parameters] }
    }

    pub(crate) fn anchor(&mut self) -> Anchor<'_> {
        Anchor { center: &mut self.center, importance: &mut self.importance }
    }
}

/// What a caller owns of a [`FixedAnchor`].
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FixedMemory {
    pub(crate) center: Vec<i16>,
    pub(crate) importance: Vec<u8>,
}

impl FixedMemory {
    pub(crate) fn new(parameters: usize) -> Self {
        Self { center: vec![0; parameters], importance: vec![0; parameters] }
    }

    pub(crate) fn anchor(&mut self) -> FixedAnchor<'_> {
        FixedAnchor { center: &mut self.center, importance: &mut self.importance }
    }
}

/// The greatest and the root of the mean square.
pub(crate) fn largest_and_rms(errors: impl Iterator<Item = f64>) -> (f64, f64) {
    let (mut largest, mut squares, mut count) = (0.0_f64, 0.0, 0.0);
    for error in errors {
        largest = largest.max(error.abs());
        squares += error * error;
        count += 1.0;
    }
    (largest, (squares / count).sqrt())
}
