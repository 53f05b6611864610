//! Between values that lie sample by sample, or pixel by pixel, and values that lie channel by channel.
//!
//! Both go by squares as wide as a cache line, so that each line is fetched once.

use super::super::kernel::LANES;
use super::layer::Grid;

/// `sums[channel][i] += values[places[i]][channel]`, where `values` has rows of stored channels.
pub(super) fn add_transposed(
    values: &[f32],
    Grid { channels, stored, .. }: Grid,
    places: &[usize],
    sums: &mut [f32],
) {
    let len = sums.len() / channels;
    for (block, sums) in sums.chunks_mut(LANES * len).enumerate() {
        for (index, place) in places.iter().enumerate() {
            let line = &values[place * stored + block * LANES..][..LANES];
            for (sum, value) in sums[index..].iter_mut().step_by(len).zip(line) {
                *sum += value;
            }
        }
    }
}

/// `rows[column][channel] = values[channel][column]`, where `rows` are of stored channels.
pub(super) fn write_transposed(values: &[f32], columns: usize, Grid { stored, .. }: Grid, rows: &mut [f32]) {
    for (first, rows) in rows.chunks_mut(LANES * stored).enumerate() {
        for (block, values) in values.chunks(LANES * columns).enumerate() {
            for (column, row) in rows.chunks_exact_mut(stored).enumerate() {
                let line = &mut row[block * LANES..][..LANES];
                for (place, value) in line.iter_mut().zip(values[first * LANES + column..].iter().step_by(columns))
                {
                    *place = *value;
                }
            }
        }
    }
}
