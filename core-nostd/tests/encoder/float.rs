//! The float encoder against the definition.

use kestrel_core::encoder::{EncoderError, EncoderShape, write_float};
use proptest::prelude::*;

use crate::support::{Random, convolution, float_stages, image, nature, parameters, reference, small, volume};

/// Relative to the largest activation of the stage; sums of 800 terms round by 800 · 2⁻²⁴ at worst.
const TOLERANCE: f64 = 5e-6;

fn compare(shape: &EncoderShape, parameters: &[f32], image: &[u8]) {
    let found = float_stages(shape, parameters, image);
    let expected = reference(shape, parameters, image);
    assert_eq!(found.len(), expected.len());
    for (stage, (found, expected)) in found.iter().zip(&expected).enumerate() {
        assert_eq!(found.len(), expected.len(), "stage {stage}");
        let largest = expected.iter().copied().fold(1.0, f64::max);
        for (found, expected) in found.iter().zip(expected) {
            assert!((f64::from(*found) - expected).abs() < TOLERANCE * largest, "stage {stage}");
        }
    }
}

#[test]
fn encoders_of_the_usual_shapes_are_their_definition() {
    for shape in [small(1, 16), small(1, 32), small(3, 32), nature()] {
        compare(&shape, &parameters(&shape, 1), &image(&shape, 2));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Filters that are no multiple of the blocks, kernels that leave a rest, strides longer than kernels.
    #[test]
    fn encoders_of_any_shape_are_their_definition(
        seed: u64,
        (rows, columns, channels) in (9_u16..20, 9_u16..20, 1_u16..5),
        first in (1_u16..9, 1_u16..6, 1_u16..4),
        second in (1_u16..21, 1_u16..3, 1_u16..3),
        features in 1_u16..20,
    ) {
        let convolutions = [convolution(first.0, first.1, first.2), convolution(second.0, second.1, second.2)];
        let shape = EncoderShape::new(volume(rows, columns, channels), &convolutions, features);
        prop_assume!(shape.is_ok());
        let shape = shape.unwrap();
        let mut random = Random(seed);
        let image: Vec<u8> = (0..shape.image().len()).map(|_| random.next() as u8).collect();
        compare(&shape, &parameters(&shape, seed), &image);
    }
}

#[test]
fn a_kernel_of_one_and_a_copying_dense_layer_show_the_image() {
    let shape = EncoderShape::new(volume(2, 3, 1), &[convolution(1, 1, 1)], 6).unwrap();
    let mut parameters = vec![1.0, 0.0];
    parameters.extend((0..36).map(|at| f32::from(u8::from(at % 7 == 0))));
    parameters.extend([0.0; 6]);
    let image = [0, 51, 102, 153, 204, 255];
    assert_eq!(float_stages(&shape, &parameters, &image)[1], [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]);
}

#[test]
fn what_is_no_number_is_refused_and_never_comes_out() {
    let shape = EncoderShape::new(volume(4, 4, 1), &[convolution(4, 2, 1)], 4).unwrap();
    let mut broken = parameters(&shape, 3);
    let mut bytes = vec![0; shape.float_bytes()];
    broken[20] = f32::INFINITY;
    assert_eq!(write_float(&shape, &broken, &mut bytes), Err(EncoderError::NotFinite { stage: 1 }));
    let large: Vec<f32> =
        (0..shape.parameter_count()).map(|at| if at % 2 == 0 { f32::MAX } else { f32::MIN }).collect();
    let features = &float_stages(&shape, &large, &[255; 16])[1];
    assert!(features.iter().all(|feature| *feature >= 0.0), "{features:?}");
}
