//! Damaged files of policies with an encoder: each kind is told apart, none is read.

use kestrel_core::encoder::EncoderError;
use kestrel_core::observation::PILOT_LEN;
use kestrel_core::policy_file::{HEADER_LEN, PolicyError, PolicyScratch, VisionPolicy};
use proptest::prelude::*;

use super::support::{VisionModel, with_memory};
use crate::support::seal;

fn files() -> [Vec<u8>; 2] {
    VisionModel::tiny().files()
}

/// The error of a file whose byte at `offset` became `value`, with the right checksum.
fn forged(bytes: &[u8], offset: usize, value: u8) -> PolicyError {
    let mut bytes = bytes.to_vec();
    bytes[offset] = value;
    seal(&mut bytes);
    VisionPolicy::parse(&bytes).expect_err("the byte matters")
}

#[test]
fn every_flipped_bit_is_found() {
    for mut bytes in files() {
        for bit in 0..bytes.len() * 8 {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(VisionPolicy::parse(&bytes).is_err(), "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        assert!(VisionPolicy::parse(&bytes).is_ok());
    }
}

#[test]
fn every_cut_is_a_truncation() {
    for bytes in files() {
        for found in 0..bytes.len() {
            let expected = if found < HEADER_LEN { HEADER_LEN } else { bytes.len() };
            assert_eq!(
                VisionPolicy::parse(&bytes[..found]).unwrap_err(),
                PolicyError::Truncated { found, expected }
            );
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert!(matches!(VisionPolicy::parse(&longer), Err(PolicyError::TrailingBytes { .. })));
    }
}

#[test]
fn versions_are_told_apart() {
    for bytes in files() {
        assert_eq!(forged(&bytes, 8, 0), PolicyError::Version { found: 0, newest: 4 });
        assert_eq!(forged(&bytes, 8, 1), PolicyError::StateBased);
        assert_eq!(forged(&bytes, 8, 3), PolicyError::Recurrent);
        assert_eq!(forged(&bytes, 8, 5), PolicyError::NewerVersion { found: 5, newest: 4 });
    }
}

#[test]
fn impossible_encoders_are_told_apart() {
    let encoder = |error: EncoderError| PolicyError::Encoder(error);
    for bytes in files() {
        let at = |offset: usize| HEADER_LEN + offset;
        let empty = EncoderError::ImageShape { rows: 0, columns: 6, channels: 1 };
        assert_eq!(forged(&bytes, at(0), 0), encoder(empty));
        assert_eq!(forged(&bytes, at(6), 0), encoder(EncoderError::FeatureCount { found: 0 }));
        assert_eq!(forged(&bytes, at(8), 0), encoder(EncoderError::Pace));
        assert_eq!(forged(&bytes, at(10), 0), encoder(EncoderError::ConvolutionCount { found: 0 }));
        assert_eq!(forged(&bytes, at(10), 5), encoder(EncoderError::ConvolutionCount { found: 5 }));
        assert_eq!(forged(&bytes, at(16), 0), encoder(EncoderError::FilterCount { stage: 0, found: 0 }));
        assert_eq!(forged(&bytes, at(18), 6), encoder(EncoderError::Kernel { stage: 0, found: 6, side: 5 }));
        assert_eq!(forged(&bytes, at(19), 0), encoder(EncoderError::Stride { stage: 0, found: 0 }));
        // The second of the convolutions that there are not.
        assert_eq!(forged(&bytes, at(20), 1), PolicyError::UnusedField { offset: at(20), found: 1 });
        // More features, for which there are no parameters.
        assert!(matches!(forged(&bytes, at(6), 9), PolicyError::Length { .. }));
    }
}

#[test]
fn bits_of_activations_are_checked() {
    let [float, fixed] = files();
    let at = HEADER_LEN + 11;
    assert_eq!(forged(&float, at, 15), PolicyError::UnusedField { offset: at, found: 15 });
    assert_eq!(forged(&fixed, at, 16), PolicyError::Encoder(EncoderError::CodeBits { stage: 0, found: 16 }));
    assert_eq!(forged(&fixed, at + 1, 14), PolicyError::Encoder(EncoderError::CodeBits { stage: 1, found: 14 }));
    assert_eq!(forged(&fixed, at + 2, 15), PolicyError::UnusedField { offset: at + 2, found: 15 });
}

#[test]
fn parameters_of_the_encoder_are_checked() {
    let [float, fixed] = files();
    let mut bytes = float;
    let last_weight = bytes.len() - 8;
    bytes[last_weight..last_weight + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    seal(&mut bytes);
    assert_eq!(
        VisionPolicy::parse(&bytes).unwrap_err(),
        PolicyError::Encoder(EncoderError::NotFinite { stage: 1 })
    );
    let shape = VisionModel::tiny().shape;
    // The most significant byte of the first bias of the dense layer.
    let bias = fixed.len() - 4 - shape.stages()[1].fixed_bytes() + 3;
    let error = forged(&fixed, bias, 0x7F);
    assert!(matches!(error, PolicyError::Encoder(EncoderError::Overflow { stage: 1, filter: 0, .. })), "{error}");
}

proptest! {
    #[test]
    fn altered_bytes_never_pass_and_never_panic(
        fixed: bool,
        changes in prop::collection::vec((any::<prop::sample::Index>(), 1_u8..), 1..8),
    ) {
        let [float_file, fixed_file] = files();
        let intact = if fixed { fixed_file } else { float_file };
        let mut bytes = intact.clone();
        for (index, difference) in changes {
            let at = index.index(bytes.len());
            bytes[at] ^= difference;
        }
        prop_assume!(bytes != intact);
        prop_assert!(VisionPolicy::parse(&bytes).is_err());
    }

    /// Whatever the headers, metadata and parameters say: what is read flies within the limits.
    #[test]
    fn forged_files_never_panic(
        fixed: bool,
        changes in prop::collection::vec((8_usize..900, any::<u8>()), 1..6),
        observation in prop::collection::vec(any::<f32>(), PILOT_LEN),
    ) {
        let [float_file, fixed_file] = files();
        let mut bytes = if fixed { fixed_file } else { float_file };
        for (at, value) in changes {
            bytes[at] = value;
        }
        seal(&mut bytes);
        if let Ok(policy) = VisionPolicy::parse(&bytes) {
            let image = vec![255; policy.encoder().shape().image().len()];
            let action = with_memory(policy.memory_len(), fixed, |mut memory| {
                policy.encode(&image, &mut memory)?;
                policy.act(&observation, &mut memory, &mut PolicyScratch::new())
            });
            let action = action.expect("the memory fits");
            prop_assert!(action.iter().all(|value| (-1.0..=1.0).contains(value)));
        }
    }

    #[test]
    fn any_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(VisionPolicy::parse(&bytes).is_err());
    }
}
