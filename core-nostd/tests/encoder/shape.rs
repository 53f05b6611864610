//! Shapes, and what follows from them.

use kestrel_core::encoder::{Encoder, EncoderError, EncoderShape, FixedEncoder, STAGE_LIMIT};

use crate::support::{convolution, nature, small, volume};

#[test]
fn sizes_of_the_small_encoder_are_known_while_compiling() {
    const SHAPE: EncoderShape = {
        let image = kestrel_core::encoder::Volume { rows: 24, columns: 32, channels: 1 };
        let convolutions = [
            kestrel_core::encoder::Convolution { filters: 16, kernel: 5, stride: 2 },
            kestrel_core::encoder::Convolution { filters: 16, kernel: 3, stride: 2 },
        ];
        match EncoderShape::new(image, &convolutions, 64) {
            Ok(shape) => shape,
            Err(_) => panic!("the shape is valid"),
        }
    };
    static SCRATCH: [i16; SHAPE.scratch_len()] = [0; SHAPE.scratch_len()];
    // 10 × 14 × 16 behind the first, 4 × 6 × 16 behind the second; the longest filter has 3 × 3 × 16 terms.
    assert_eq!(SCRATCH.len(), 144 + 10 * 14 * 16 + 4 * 6 * 16);
    assert_eq!(SHAPE, small(1, 16));
    let multiplications = 140 * 16 * 25 + 24 * 16 * 144 + 64 * 384;
    assert_eq!(SHAPE.multiply_accumulates(), multiplications);
    assert_eq!(SHAPE.parameter_count(), 16 * 26 + 16 * 145 + 64 * 385);
    assert_eq!(SHAPE.float_bytes(), 4 * SHAPE.parameter_count());
    assert_eq!(SHAPE.fixed_bytes(), 16 * (8 + 28) + 16 * (8 + 144) + 64 * (8 + 384));
}

#[test]
fn stages_follow_each_other() {
    let shape = nature();
    let outputs: Vec<_> = shape.stages().iter().map(|stage| stage.output).collect();
    assert_eq!(outputs, [volume(11, 15, 32), volume(4, 6, 64), volume(2, 4, 64), volume(1, 1, 512)]);
    assert_eq!(shape.image(), volume(48, 64, 4));
    assert_eq!((shape.features(), shape.convolutions().count()), (512, 3));
    assert_eq!(shape.convolutions().nth(1), Some(convolution(64, 4, 2)));
    let terms: Vec<_> = shape.stages().iter().map(kestrel_core::encoder::EncoderStage::terms).collect();
    assert_eq!(terms, [256, 512, 576, 512]);
}

#[test]
fn impossible_shapes_are_told_apart() {
    let good = volume(24, 32, 1);
    let one = [convolution(8, 5, 2)];
    let error =
        |image, convolutions: &[_], features| EncoderShape::new(image, convolutions, features).unwrap_err();
    assert_eq!(error(volume(0, 32, 1), &one, 8), EncoderError::ImageShape { rows: 0, columns: 32, channels: 1 });
    assert_eq!(
        error(volume(8, 1025, 1), &one, 8),
        EncoderError::ImageShape { rows: 8, columns: 1025, channels: 1 }
    );
    assert_eq!(error(volume(8, 8, 257), &one, 8), EncoderError::ImageShape { rows: 8, columns: 8, channels: 257 });
    assert_eq!(error(good, &[], 8), EncoderError::ConvolutionCount { found: 0 });
    assert_eq!(error(good, &[convolution(4, 1, 1); 5], 8), EncoderError::ConvolutionCount { found: 5 });
    assert_eq!(error(good, &one, 0), EncoderError::FeatureCount { found: 0 });
    assert_eq!(error(good, &one, 513), EncoderError::FeatureCount { found: 513 });
    assert_eq!(error(good, &[convolution(0, 5, 2)], 8), EncoderError::FilterCount { stage: 0, found: 0 });
    assert_eq!(error(good, &[convolution(8, 5, 0)], 8), EncoderError::Stride { stage: 0, found: 0 });
    assert_eq!(error(good, &[convolution(8, 25, 1)], 8), EncoderError::Kernel { stage: 0, found: 25, side: 24 });
    let second = [convolution(8, 5, 2), convolution(8, 11, 1)];
    assert_eq!(error(good, &second, 8), EncoderError::Kernel { stage: 1, found: 11, side: 10 });
    let wide = [convolution(256, 1, 1)];
    assert_eq!(error(volume(16, 17, 1), &wide, 8), EncoderError::Terms { stage: 1, found: 16 * 17 * 256 });
}

#[test]
fn memory_of_other_lengths_is_refused() {
    let shape = small(3, 16);
    let bytes = vec![0; shape.float_bytes()];
    let encoder = Encoder::from_parameters(shape, &bytes).unwrap();
    let (image, mut scratch, mut features) = (vec![0; 24 * 32 * 3], vec![0.0; shape.scratch_len()], vec![0.0; 64]);
    assert_eq!(encoder.encode(&image, &mut scratch, &mut features), Ok(()));
    let (found, expected) = (24 * 32, 24 * 32 * 3);
    assert_eq!(
        encoder.encode(&image[..found], &mut scratch, &mut features),
        Err(EncoderError::ImageLength { found, expected })
    );
    let expected = scratch.len();
    assert_eq!(
        encoder.encode(&image, &mut scratch[1..], &mut features),
        Err(EncoderError::ScratchLength { found: expected - 1, expected })
    );
    assert_eq!(
        encoder.encode(&image, &mut scratch, &mut features[1..]),
        Err(EncoderError::FeatureLength { found: 63, expected: 64 })
    );
}

#[test]
fn parameters_of_other_lengths_are_refused() {
    let shape = small(1, 16);
    let bytes = vec![0; shape.float_bytes() + 1];
    let (found, expected) = (bytes.len(), shape.float_bytes());
    assert_eq!(
        Encoder::from_parameters(shape, &bytes).unwrap_err(),
        EncoderError::ParameterLength { found, expected, unit: "bytes" }
    );
    let expected = shape.fixed_bytes();
    assert_eq!(
        FixedEncoder::from_parameters(shape, &[15; STAGE_LIMIT], &bytes).unwrap_err(),
        EncoderError::ParameterLength { found, expected, unit: "bytes" }
    );
}
