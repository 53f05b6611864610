//! Memory for the operands of matrix products.

use std::ops::{Deref, DerefMut};

/// Bytes of a cache line, and of the widest register.
const LINE_BYTES: usize = 64;

/// Values that begin with a cache line: a product that loads its right factor across two lines is a quarter slower.
#[derive(Debug)]
pub(crate) struct Aligned {
    /// With as many values to spare as the first may lie before a line.
    values: Vec<f32>,
    len: usize,
}

impl Aligned {
    /// So many zeros.
    pub(crate) fn zeros(len: usize) -> Self {
        Self { values: vec![0.0; len + LINE_BYTES / size_of::<f32>()], len }
    }

    fn first(&self) -> usize {
        self.values.as_ptr().align_offset(LINE_BYTES)
    }
}

impl Deref for Aligned {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.values[self.first()..][..self.len]
    }
}

impl DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f32] {
        let first = self.first();
        &mut self.values[first..][..self.len]
    }
}

impl Clone for Aligned {
    fn clone(&self) -> Self {
        let mut clone = Self::zeros(self.len);
        clone.copy_from_slice(self);
        clone
    }
}
