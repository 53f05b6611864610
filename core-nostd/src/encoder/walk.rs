//! From an image to features: what each place of each filter reads, gathered side by side.

use super::stage::{EncoderStage, FILTER_BLOCK};
use super::{EncoderError, EncoderShape};

/// What an encoder works on: an image, values whose contents do not matter, and where the features go.
pub(super) type Work<'a, T> = (&'a [u8], &'a mut [T], &'a mut [T]);

/// Takes an image through all stages. `sums` writes the activations of a stage's filters for what they read, and
/// `show` is shown each stage's activations behind its number.
#[inline(always)]
pub(super) fn walk<T: Copy>(
    shape: &EncoderShape,
    (image, scratch, features): Work<'_, T>,
    from_byte: impl Fn(u8) -> T,
    sums: impl Fn(usize, &[T], &mut [T]),
    mut show: impl FnMut(usize, &[T]),
) -> Result<(), EncoderError> {
    shape.check_lengths(image.len(), scratch.len(), features.len())?;
    let (patch, buffers) = scratch.split_at_mut_checked(shape.patch_len()).unwrap_or_default();
    let (mut output, mut input) = buffers.split_at_mut_checked(shape.buffer_len(0)).unwrap_or_default();
    let dense_stage = shape.stages().len().saturating_sub(1);
    for (index, stage) in shape.stages().iter().enumerate() {
        let sums = |terms: &[T], output: &mut [T]| sums(index, terms, output);
        if index == 0 {
            convolve(stage, image, &from_byte, (patch, output), sums);
        } else if index < dense_stage {
            convolve(stage, input, |value| value, (patch, output), sums);
        } else {
            let padded_filters = stage.filters().next_multiple_of(FILTER_BLOCK);
            sums(input, output.get_mut(..padded_filters).unwrap_or_default());
        }
        show(index, output.get(..stage.output.len()).unwrap_or_default());
        core::mem::swap(&mut input, &mut output);
    }
    for (feature, value) in features.iter_mut().zip(&*input) {
        *feature = *value;
    }
    Ok(())
}

/// Calls `dense` with what the filters read at each place, in `patch`, and with where their sums belong: as many as
/// there are rows in the padded matrix. The sums of padding end up where the next place writes its own.
#[inline(always)]
fn convolve<S: Copy, T>(
    stage: &EncoderStage,
    source: &[S],
    convert: impl Fn(S) -> T,
    (patch, output): (&mut [T], &mut [T]),
    dense: impl Fn(&[T], &mut [T]),
) {
    let stride = usize::from(stage.stride);
    let padded_filters = stage.filters().next_multiple_of(FILTER_BLOCK);
    let mut first = 0;
    for row in 0..usize::from(stage.output.rows) {
        for column in 0..usize::from(stage.output.columns) {
            gather(stage, source, (row * stride, column * stride), &convert, patch);
            let sums = output.get_mut(first..).unwrap_or_default();
            dense(patch, sums.get_mut(..padded_filters).unwrap_or_default());
            first += stage.filters();
        }
    }
}

/// Copies the rows of the window at `(row, column)` of `source` one behind the other.
#[inline(always)]
fn gather<S: Copy, T>(
    stage: &EncoderStage,
    source: &[S],
    (row, column): (usize, usize),
    convert: impl Fn(S) -> T,
    patch: &mut [T],
) {
    let channels = usize::from(stage.input.channels);
    let row_len = usize::from(stage.input.columns) * channels;
    let run_len = usize::from(stage.kernel_columns) * channels;
    let runs = patch.chunks_exact_mut(run_len.max(1)).take(usize::from(stage.kernel_rows));
    let mut start = row * row_len + column * channels;
    for run in runs {
        for (slot, value) in run.iter_mut().zip(source.get(start..).unwrap_or_default()) {
            *slot = convert(*value);
        }
        start += row_len;
    }
}
