//! Where the values of one convolution lie, before it and behind it.
//!
//! The last layer of a CNN, fully connected, is a convolution whose kernel covers everything: one code for both.

use std::ops::Range;

use super::super::kernel::{LANES, Place};

/// Values of one sample, `[rows][columns][stored]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Grid {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) channels: usize,
    /// The channels and zeros up to a whole vector; those of an image have none.
    pub(super) stored: usize,
}

impl Grid {
    pub(super) fn len(&self) -> usize {
        self.rows * self.columns * self.stored
    }

    pub(super) fn pixels(&self) -> usize {
        self.rows * self.columns
    }
}

/// One convolution of a CNN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layer {
    pub(super) input: Grid,
    pub(super) output: Grid,
    /// Rows and columns.
    kernel: (usize, usize),
    stride: usize,
}

impl Layer {
    pub(super) fn new(input: Grid, kernel: (usize, usize), stride: usize, filters: usize) -> Self {
        let output = Grid {
            rows: (input.rows - kernel.0) / stride + 1,
            columns: (input.columns - kernel.1) / stride + 1,
            channels: filters,
            stored: filters.next_multiple_of(LANES),
        };
        Self { input, output, kernel, stride }
    }

    /// Weights of one filter, `[kernel row][kernel column][channel]`.
    pub(super) fn inputs(&self) -> usize {
        self.kernel.0 * self.kernel.1 * self.input.channels
    }

    pub(super) fn weight_count(&self) -> usize {
        self.inputs() * self.output.channels
    }

    pub(super) fn parameter_count(&self) -> usize {
        self.weight_count() + self.output.channels
    }

    /// Where each value of a patch lies behind its first, zeros included, in the order of the weights.
    pub(super) fn patch(&self) -> Vec<usize> {
        self.segments().flat_map(|(offset, len)| offset..offset + len).collect()
    }

    /// The values of a patch that lie side by side: where they begin, and how many.
    pub(super) fn segments(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let row = self.input.columns * self.input.stored;
        let (count, len) = match self.kernel {
            (rows, columns) if columns == self.input.columns => (1, rows * row),
            (rows, columns) => (rows, columns * self.input.stored),
        };
        (0..count).map(move |index| (index * row, len))
    }

    /// Which value of a patch, zeros included, each weight of a filter belongs to.
    pub(super) fn weight_places(&self) -> Vec<usize> {
        let Grid { channels, stored, .. } = self.input;
        (0..self.inputs()).map(|weight| weight / channels * stored + weight % channels).collect()
    }

    /// Where the patch of each pixel behind the layer begins before it.
    fn corners(&self) -> impl Iterator<Item = usize> + use<> {
        let Self { input, output, stride, .. } = *self;
        let corner = move |pixel: usize| {
            let (row, column) = (pixel / output.columns, pixel % output.columns);
            (row * input.columns + column) * stride * input.stored
        };
        (0..output.pixels()).map(corner)
    }

    /// From the patches to the pixels of so many samples, sample by sample.
    pub(super) fn forward_places(&self, samples: usize) -> Vec<Place> {
        let mut places = Vec::with_capacity(samples * self.output.pixels());
        for sample in 0..samples {
            let patches = self.corners().map(|corner| sample * self.input.len() + corner);
            let pixels = (0..).map(|pixel| sample * self.output.len() + pixel * self.output.stored);
            places.extend(patches.zip(pixels).map(|(left, result)| Place { left, result }));
        }
        places
    }

    /// From the pixels to the patches of so many samples, pixel by pixel, because the patches of a sample overlap.
    pub(super) fn backward_places(&self, samples: usize) -> Vec<Place> {
        let mut places = Vec::with_capacity(samples * self.output.pixels());
        for (pixel, corner) in self.corners().enumerate() {
            places.extend((0..samples).map(|sample| Place {
                left: sample * self.output.len() + pixel * self.output.stored,
                result: sample * self.input.len() + corner,
            }));
        }
        places
    }
}

/// A range of so many values in pieces of at most `piece`.
pub(super) fn pieces(len: usize, piece: usize) -> impl Iterator<Item = Range<usize>> {
    (0..len).step_by(piece).map(move |from| from..len.min(from + piece))
}
