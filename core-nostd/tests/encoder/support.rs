//! Encoders, images, and a convolution without any layout.

use kestrel_core::encoder::{
    Convolution, Encoder, EncoderFormat, EncoderShape, FixedEncoder, STAGE_LIMIT, Volume, write_fixed, write_float,
};

/// `SplitMix64`, enough to fill test networks.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// Uniform in ±`limit`.
    pub(crate) fn within(&mut self, limit: f32) -> f32 {
        ((self.next() >> 40) as f32 / (1 << 23) as f32 - 1.0) * limit
    }
}

pub(crate) fn volume(rows: u16, columns: u16, channels: u16) -> Volume {
    Volume { rows, columns, channels }
}

pub(crate) fn convolution(filters: u16, kernel: u16, stride: u16) -> Convolution {
    Convolution { filters, kernel, stride }
}

/// 24 rows of 32 columns, 16 filters 5 × 5 / 2, `filters` 3 × 3 / 2, 64 features.
pub(crate) fn small(channels: u16, filters: u16) -> EncoderShape {
    EncoderShape::new(volume(24, 32, channels), &[convolution(16, 5, 2), convolution(filters, 3, 2)], 64)
        .expect("the encoder is valid")
}

/// The network of Mnih et al. 2015 on four images of 64 × 48.
pub(crate) fn nature() -> EncoderShape {
    let convolutions = [convolution(32, 8, 4), convolution(64, 4, 2), convolution(64, 3, 1)];
    EncoderShape::new(volume(48, 64, 4), &convolutions, 512).expect("the encoder is valid")
}

/// Weights uniform with standard deviation √(2 / terms), with which activations keep their size; biases within ±0.1.
pub(crate) fn parameters(shape: &EncoderShape, seed: u64) -> Vec<f32> {
    let mut random = Random(seed);
    let mut parameters = Vec::new();
    for stage in shape.stages() {
        let limit = (6.0 / stage.terms() as f32).sqrt();
        parameters.extend((0..stage.terms() * stage.filters()).map(|_| random.within(limit)));
        parameters.extend((0..stage.filters()).map(|_| random.within(0.1)));
    }
    parameters
}

/// Smooth pictures with edges: a slope and a rectangle, another colour in each channel.
pub(crate) fn image(shape: &EncoderShape, seed: u64) -> Vec<u8> {
    let Volume { rows, columns, channels } = shape.image();
    let mut random = Random(seed);
    let mut below = |limit: u16| (random.next() % u64::from(limit)) as u16;
    let (top, left) = (below(rows), below(columns));
    let (height, width) = (1 + below(rows), 1 + below(columns));
    let colours: Vec<u16> = (0..channels).map(|_| below(256)).collect();
    let (down, right) = (below(6), below(6));
    let mut image = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let inside = row >= top && row < top + height && column >= left && column < left + width;
            for colour in &colours {
                let value = if inside { *colour } else { 255 - colour + row * down + column * right };
                image.push(value.min(255) as u8);
            }
        }
    }
    image
}

pub(crate) fn float_bytes(shape: &EncoderShape, parameters: &[f32]) -> Vec<u8> {
    let mut bytes = vec![0xAA; shape.float_bytes()];
    write_float(shape, parameters, &mut bytes).expect("the encoder is valid");
    bytes
}

pub(crate) fn fixed_bytes(shape: &EncoderShape, parameters: &[f32], format: &EncoderFormat) -> Vec<u8> {
    let mut bytes = vec![0xAA; shape.fixed_bytes()];
    write_fixed(shape, parameters, format, &mut bytes).expect("the encoder is valid");
    bytes
}

/// What each stage has, and the features.
pub(crate) fn float_stages(shape: &EncoderShape, parameters: &[f32], image: &[u8]) -> Vec<Vec<f32>> {
    let bytes = float_bytes(shape, parameters);
    let encoder = Encoder::from_parameters(*shape, &bytes).expect("the encoder is valid");
    let (mut scratch, mut features) = (vec![f32::NAN; shape.scratch_len()], vec![f32::NAN; shape.features()]);
    let mut stages = Vec::new();
    encoder
        .encode_each(image, &mut scratch, &mut features, |_, activations| stages.push(activations.to_vec()))
        .expect("the encoder is valid");
    assert_eq!(stages.last(), Some(&features));
    stages
}

/// What each stage has, as numbers.
pub(crate) fn fixed_stages(
    shape: &EncoderShape,
    parameters: &[f32],
    format: &EncoderFormat,
    image: &[u8],
) -> Vec<Vec<f64>> {
    let bytes = fixed_bytes(shape, parameters, format);
    let encoder = FixedEncoder::from_parameters(*shape, &format.code_bits, &bytes).expect("the encoder is valid");
    let (mut scratch, mut features) = (vec![-1; shape.scratch_len()], vec![-1; shape.features()]);
    let mut stages = Vec::new();
    encoder
        .encode_each(image, &mut scratch, &mut features, |stage, codes| {
            stages.push(codes.iter().map(|code| f64::from(*code) * f64::from(format.steps[stage])).collect());
        })
        .expect("the encoder is valid");
    stages
}

/// The largest activation behind each stage.
pub(crate) fn largest(shape: &EncoderShape, parameters: &[f32], images: &[Vec<u8>]) -> [f32; STAGE_LIMIT] {
    let mut largest = [0.0_f32; STAGE_LIMIT];
    for image in images {
        for (largest, activations) in largest.iter_mut().zip(float_stages(shape, parameters, image)) {
            *largest = activations.into_iter().fold(*largest, f32::max);
        }
    }
    largest
}

/// Every stage by the definition, in `f64`: indices and nothing else.
pub(crate) fn reference(shape: &EncoderShape, parameters: &[f32], image: &[u8]) -> Vec<Vec<f64>> {
    let mut values: Vec<f64> = image.iter().map(|byte| f64::from(*byte) / 255.0).collect();
    let mut rest = parameters;
    let mut stages = Vec::new();
    for stage in shape.stages() {
        let (weights, following) = rest.split_at(stage.filters() * stage.terms());
        let (biases, following) = following.split_at(stage.filters());
        rest = following;
        let (columns, channels) = (usize::from(stage.input.columns), usize::from(stage.input.channels));
        let (kernel_rows, kernel_columns) = (usize::from(stage.kernel_rows), usize::from(stage.kernel_columns));
        let stride = usize::from(stage.stride);
        let mut output = Vec::new();
        for row in 0..usize::from(stage.output.rows) {
            for column in 0..usize::from(stage.output.columns) {
                for filter in 0..stage.filters() {
                    let mut sum = f64::from(biases[filter]);
                    for i in 0..kernel_rows {
                        for j in 0..kernel_columns {
                            for channel in 0..channels {
                                let weight =
                                    ((filter * kernel_rows + i) * kernel_columns + j) * channels + channel;
                                let at = ((row * stride + i) * columns + column * stride + j) * channels + channel;
                                sum += f64::from(weights[weight]) * values[at];
                            }
                        }
                    }
                    output.push(sum.max(0.0));
                }
            }
        }
        stages.push(output.clone());
        values = output;
    }
    stages
}
