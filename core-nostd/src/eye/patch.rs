//! Walking over an image: what each place of a filter sees, gathered side by side.

use super::stage::{FILTER_BLOCK, Stage};

/// Calls `dense` with what the filters see at each place, in `patch`, and with where their sums belong: as many as
/// there are rows in the padded matrix. The sums of padding end up where the next place writes its own.
#[inline(always)]
pub(super) fn convolve<S: Copy, T>(
    stage: &Stage,
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
    stage: &Stage,
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
