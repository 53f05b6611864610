//! The encoder in integers: near the float encoder, the same bits everywhere, safe at every limit.

use kestrel_core::crc32::crc32;
use kestrel_core::encoder::{EncoderError, EncoderFormat, EncoderShape, FixedEncoder, STAGE_LIMIT, write_fixed};
use proptest::prelude::*;

use crate::support::{
    Random, convolution, fixed_bytes, fixed_stages, float_stages, image, largest, nature, parameters, small,
    volume,
};

/// Fraction bits of features: they reach 8 before they saturate.
const FEATURE_BITS: u8 = 12;

fn calibrated(shape: &EncoderShape, parameters: &[f32]) -> EncoderFormat {
    let images: Vec<_> = (0..16).map(|seed| image(shape, 100 + seed)).collect();
    EncoderFormat::calibrated(shape, parameters, &largest(shape, parameters, &images), FEATURE_BITS)
        .expect("the encoder is valid")
}

/// Largest and mean difference between the features in integers and in float, divided by the largest feature, on
/// images that the calibration has not seen.
fn errors(shape: &EncoderShape, seed: u64) -> (f64, f64) {
    let parameters = parameters(shape, seed);
    let format = calibrated(shape, &parameters);
    let (mut largest_error, mut sum, mut count, mut largest) = (0.0_f64, 0.0, 0.0, 0.0_f64);
    for seed in 0..8 {
        let image = image(shape, 500 + seed);
        let fixed = fixed_stages(shape, &parameters, &format, &image).pop().expect("stages");
        let float = float_stages(shape, &parameters, &image).pop().expect("stages");
        for (fixed, float) in fixed.iter().zip(float) {
            let error = (fixed - f64::from(float)).abs();
            largest_error = largest_error.max(error);
            largest = largest.max(f64::from(float));
            (sum, count) = (sum + error, count + 1.0);
        }
    }
    (largest_error / largest, sum / count / largest)
}

#[test]
fn features_are_within_a_fortieth_of_the_largest_and_a_five_hundredth_on_average() {
    for (shape, seeds) in [(small(1, 16), 0..4), (small(1, 32), 4..6), (small(3, 32), 6..8), (nature(), 8..9)] {
        for seed in seeds {
            let (largest, mean) = errors(&shape, seed);
            assert!(largest < 2.5e-2 && mean < 2e-3, "{:?}: largest {largest}, mean {mean}", shape.image());
        }
    }
}

/// Every activation by its definition, in 64 bits.
fn integer_reference(
    shape: &EncoderShape,
    parameters: &[f32],
    format: &EncoderFormat,
    image: &[u8],
) -> Vec<Vec<i64>> {
    let bytes = fixed_bytes(shape, parameters, format);
    let mut values: Vec<i64> = image.iter().map(|byte| i64::from(*byte)).collect();
    let mut rest = bytes.as_slice();
    let mut stages = Vec::new();
    for (stage, bits) in shape.stages().iter().zip(format.code_bits) {
        let padded_filters = stage.filters().next_multiple_of(4);
        let groups = stage.terms().div_ceil(4);
        let word = |at: usize| i64::from(i32::from_le_bytes(rest[4 * at..][..4].try_into().expect("4 bytes")));
        let weight = |filter: usize, term: usize| {
            let at = 8 * padded_filters + ((filter / 4 * groups + term / 4) * 4 + filter % 4) * 4 + term % 4;
            i64::from(rest[at] as i8)
        };
        let (columns, channels) = (usize::from(stage.input.columns), usize::from(stage.input.channels));
        let run = usize::from(stage.kernel_columns) * channels;
        let stride = usize::from(stage.stride);
        let mut output = Vec::new();
        for place in 0..usize::from(stage.output.rows) * usize::from(stage.output.columns) {
            let (row, column) =
                (place / usize::from(stage.output.columns), place % usize::from(stage.output.columns));
            for filter in 0..stage.filters() {
                let value = |term: usize| {
                    values[((row * stride + term / run) * columns + column * stride) * channels + term % run]
                };
                let products: i64 = (0..stage.terms()).map(|term| weight(filter, term) * value(term)).sum();
                let sum = word(filter) + products;
                assert!(i32::try_from(sum).is_ok(), "a sum of {sum}");
                output.push(((sum * word(padded_filters + filter)) >> 32).clamp(0, (1 << bits) - 1));
            }
        }
        rest = &rest[stage.fixed_bytes()..];
        stages.push(output.clone());
        values = output;
    }
    stages
}

fn assert_is_reference(shape: &EncoderShape, parameters: &[f32], format: &EncoderFormat, image: &[u8]) {
    let bytes = fixed_bytes(shape, parameters, format);
    let encoder = FixedEncoder::from_parameters(*shape, &format.code_bits, &bytes).expect("the encoder is valid");
    let expected = integer_reference(shape, parameters, format, image);
    let (mut scratch, mut features) = (vec![i16::MIN; shape.scratch_len()], vec![-1; shape.features()]);
    encoder
        .encode_each(image, &mut scratch, &mut features, |stage, codes| {
            let codes: Vec<_> = codes.iter().map(|code| i64::from(*code)).collect();
            assert_eq!(codes, expected[stage], "stage {stage}");
        })
        .expect("the encoder is valid");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn every_bit_is_the_definitions(
        seed: u64,
        (rows, columns, channels) in (7_u16..16, 7_u16..16, 1_u16..5),
        first in (1_u16..9, 1_u16..6, 1_u16..4),
        second in (1_u16..21, 1_u16..3, 1_u16..3),
        features in 1_u16..20,
        gain in -6_i32..6,
    ) {
        let convolutions = [convolution(first.0, first.1, first.2), convolution(second.0, second.1, second.2)];
        let shape = EncoderShape::new(volume(rows, columns, channels), &convolutions, features);
        prop_assume!(shape.is_ok());
        let shape = shape.unwrap();
        let mut random = Random(seed);
        let image: Vec<u8> = (0..shape.image().len()).map(|_| random.next() as u8).collect();
        // Some filters far larger than others, some empty.
        let mut parameters = parameters(&shape, seed);
        for parameter in &mut parameters {
            *parameter *= match random.next() % 16 { 0 => 0.0, 1 => (f64::from(gain)).exp2() as f32, _ => 1.0 };
        }
        let largest = largest(&shape, &parameters, std::slice::from_ref(&image));
        let format = (0..14).rev().find_map(|bits| EncoderFormat::calibrated(&shape, &parameters, &largest, bits).ok());
        assert_is_reference(&shape, &parameters, &format.unwrap(), &image);
    }
}

/// Longest filters, weights all at their limits, an image all white, activations all at theirs.
#[test]
fn no_sum_leaves_32_bits_at_the_limits_of_everything() {
    let convolutions = [convolution(64, 1, 1), convolution(64, 8, 1), convolution(64, 8, 1)];
    let shape = EncoderShape::new(volume(16, 16, 1), &convolutions, 8).unwrap();
    assert_eq!(shape.stages()[1].terms(), 8 * 8 * 64);
    for sign in [1.0, -1.0] {
        let parameters: Vec<f32> = vec![sign; shape.parameter_count()];
        let format = EncoderFormat::calibrated(&shape, &parameters, &[1e-3; STAGE_LIMIT], 4).unwrap();
        // 127 · 4096 leaves 11 bits.
        assert_eq!(format.code_bits[..3], [11, 11, 15]);
        for byte in [0, 1, 255] {
            assert_is_reference(&shape, &parameters, &format, &[byte; 256]);
        }
    }
}

#[test]
fn activations_saturate_and_do_not_wrap() {
    let shape = small(1, 16);
    let parameters: Vec<f32> = vec![1.0; shape.parameter_count()];
    let format = EncoderFormat::calibrated(&shape, &parameters, &[0.5; STAGE_LIMIT], 0).unwrap();
    let stages = fixed_stages(&shape, &parameters, &format, &[255; 24 * 32]);
    for (stage, values) in stages.iter().enumerate() {
        let limit = f64::from((1 << format.code_bits[stage]) - 1) * f64::from(format.steps[stage]);
        let float = float_stages(&shape, &parameters, &[255; 24 * 32]);
        for (value, float) in values.iter().zip(&float[stage]) {
            assert!(*value <= limit && *value <= f64::from(*float) * 1.001, "stage {stage}: {value}");
        }
    }
    assert_eq!(stages[0][0], f64::from((1 << format.code_bits[0]) - 1) * f64::from(format.steps[0]));
}

/// Everything from small integers; integers only, so a microcontroller has these bits too. Recorded when format
/// version 2 was defined.
#[test]
fn the_bits_have_not_moved() {
    let encoders = [
        (small(1, 16), (0xA4C6_52ED, 0xF4DB_3C15)),
        (small(3, 32), (0x3BCB_C92B, 0x9663_4855)),
        (nature(), (0x94ED_77F4, 0xB7E9_B2C1)),
    ];
    for (shape, expected) in encoders {
        let parameters: Vec<f32> =
            (0..shape.parameter_count()).map(|at| ((at * 5) % 17) as f32 / 64.0 - 0.125).collect();
        let format = EncoderFormat::calibrated(&shape, &parameters, &[4.0; STAGE_LIMIT], 10).unwrap();
        let bytes = fixed_bytes(&shape, &parameters, &format);
        let encoder = FixedEncoder::from_parameters(shape, &format.code_bits, &bytes).unwrap();
        let image: Vec<u8> = (0..shape.image().len()).map(|at| (at * 37 % 251) as u8).collect();
        let (mut scratch, mut features) = (vec![0; shape.scratch_len()], vec![0_i16; shape.features()]);
        encoder.encode(&image, &mut scratch, &mut features).unwrap();
        let codes: Vec<u8> = features.iter().flat_map(|code| code.to_le_bytes()).collect();
        assert!(features.iter().any(|code| *code > 0 && *code < i16::MAX));
        assert_eq!((crc32(&bytes), crc32(&codes)), expected);
    }
}

#[test]
fn bytes_that_could_overflow_or_mislead_are_refused() {
    let shape = EncoderShape::new(volume(6, 6, 1), &[convolution(3, 3, 1)], 5).unwrap();
    let parameters = parameters(&shape, 1);
    let format = calibrated(&shape, &parameters);
    let bytes = fixed_bytes(&shape, &parameters, &format);
    let refusal = |bits: &[u8; STAGE_LIMIT], at: usize, value: [u8; 4]| {
        let mut bytes = bytes.clone();
        bytes[at..at + 4].copy_from_slice(&value);
        FixedEncoder::from_parameters(shape, bits, &bytes).unwrap_err()
    };
    let bits = format.code_bits;
    let intact = [bytes[0], bytes[1], bytes[2], bytes[3]];
    assert_eq!(refusal(&[7, 15, 0, 0, 0], 0, intact), EncoderError::CodeBits { stage: 0, found: 7 });
    assert_eq!(refusal(&[16, 15, 0, 0, 0], 0, intact), EncoderError::CodeBits { stage: 0, found: 16 });
    assert_eq!(refusal(&[15, 14, 0, 0, 0], 0, intact), EncoderError::CodeBits { stage: 1, found: 14 });
    let error = refusal(&bits, 4, i32::MAX.to_le_bytes());
    assert!(matches!(error, EncoderError::Overflow { stage: 0, filter: 1, .. }), "{error}");
    let error = refusal(&bits, 16 + 8, (-1_i32).to_le_bytes());
    assert_eq!(error, EncoderError::Multiplier { stage: 0, filter: 2, found: -1 });
    // The third group of the first filter has one weight and three of padding.
    let error = refusal(&bits, 32 + 2 * 16, [1, 0, 1, 0]);
    assert_eq!(error, EncoderError::Padding { stage: 0, filter: 0 });
}

#[test]
fn formats_that_do_not_exist_are_refused() {
    let shape = EncoderShape::new(volume(6, 6, 1), &[convolution(3, 3, 1)], 5).unwrap();
    let mut parameters = parameters(&shape, 1);
    let calibrated = |parameters: &[f32], largest: f32, bits| {
        EncoderFormat::calibrated(&shape, parameters, &[largest; STAGE_LIMIT], bits).map(|_| ())
    };
    assert_eq!(calibrated(&parameters, 1.0, FEATURE_BITS), Ok(()));
    assert_eq!(calibrated(&parameters, 1e7, 14), Err(EncoderError::FeatureFractionBits { found: 14 }));
    assert_eq!(calibrated(&parameters, f32::INFINITY, 14), Err(EncoderError::NoFormat { stage: 0 }));
    let (found, expected) = (parameters.len() - 1, parameters.len());
    assert_eq!(
        calibrated(&parameters[1..], 1.0, 14),
        Err(EncoderError::ParameterLength { found, expected, unit: "values" })
    );
    parameters[0] = f32::NAN;
    assert_eq!(calibrated(&parameters, 1.0, 14), Err(EncoderError::NotFinite { stage: 0 }));
    let mut bytes = vec![0; shape.fixed_bytes()];
    let error = write_fixed(&shape, &parameters, &EncoderFormat::default(), &mut bytes);
    assert_eq!(error, Err(EncoderError::NotFinite { stage: 0 }));
}
