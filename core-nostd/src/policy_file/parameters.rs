//! Reading a policy file back into numbers: for exporters and tests, not for flight.

use super::{Network, ParameterFormat, PolicyFile, read_golden};
use crate::limits::{ACTION_LIMIT, WIDTH_LIMIT};

impl<'a> PolicyFile<'a> {
    /// The weight that stands in `row` and `column` of `layer`; zero beyond the matrix. Exact in either format.
    pub fn weight(&self, layer: usize, row: usize, column: usize) -> f32 {
        match (&self.network, self.header.parameters) {
            (Network::Fixed16(network), ParameterFormat::Fixed16(format)) => {
                let bits = format.weight_fraction_bits.get(layer).copied().unwrap_or_default();
                f32::from(network.weight_code(layer, row, column)) / (1_u32 << bits) as f32
            }
            (Network::Float32(network), _) => network.weight(layer, row, column),
            (Network::Fixed16(_), ParameterFormat::Float32) => 0.0,
        }
    }

    /// The bias that stands in `row` of `layer`; zero beyond the rows. Rounded to 24 bits in fixed point.
    pub fn bias(&self, layer: usize, row: usize) -> f32 {
        match (&self.network, self.header.parameters) {
            (Network::Fixed16(network), ParameterFormat::Fixed16(format)) => {
                let bits = format.sum_fraction_bits(layer).unwrap_or_default();
                network.bias_code(layer, row) as f32 / (1_u64 << bits) as f32
            }
            (Network::Float32(network), _) => network.bias(layer, row),
            (Network::Fixed16(_), ParameterFormat::Float32) => 0.0,
        }
    }

    /// Observations, followed by zeros, and the actions that the exporter computed for them, followed by NaN.
    pub fn golden_vectors(&self) -> impl Iterator<Item = ([f32; WIDTH_LIMIT], [f32; ACTION_LIMIT])> + '_ {
        self.golden().map(|(observation, action, _)| (observation, action))
    }

    /// As [`Self::golden_vectors`], with the image behind them, filled up to a multiple of four bytes.
    pub(super) fn golden(&self) -> impl Iterator<Item = ([f32; WIDTH_LIMIT], [f32; ACTION_LIMIT], &'a [u8])> + '_ {
        let observation_len = self.header.observation_len();
        let numbers_len = 4 * (observation_len + self.header.action_len());
        // No header has an empty vector; the bound lets the compiler drop the panic of an empty chunk.
        let vector_bytes = self.golden.len().checked_div(self.header.golden_vectors).unwrap_or_default().max(4);
        self.golden.chunks_exact(vector_bytes).map(move |golden| {
            let (numbers, image) = golden.split_at_checked(numbers_len).unwrap_or_default();
            let (observation, action) = read_golden(numbers, observation_len);
            (observation, action, image)
        })
    }
}
