//! Damaged policy files: each kind is told apart, none is read.

use kestrel_core::observation::PILOT_LEN;
use kestrel_core::policy_file::{HEADER_LEN, MAGIC, PolicyError, PolicyFile};
use proptest::prelude::*;

use crate::support::{Model, seal};

/// Small, so that every bit of it can be tried.
fn small() -> Model {
    Model::random(1, &[PILOT_LEN, 6, 4], 1.0)
}

fn files() -> [Vec<u8>; 2] {
    [small().float_file(), small().fixed_file()]
}

/// The error of a file whose byte at `offset` became `value`, with the right checksum.
fn forged(bytes: &[u8], offset: usize, value: u8) -> PolicyError {
    let mut bytes = bytes.to_vec();
    bytes[offset] = value;
    seal(&mut bytes);
    PolicyFile::parse(&bytes).unwrap_err()
}

#[test]
fn every_flipped_bit_is_found() {
    for mut bytes in files() {
        for bit in 0..bytes.len() * 8 {
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert!(PolicyFile::parse(&bytes).is_err(), "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        assert!(PolicyFile::parse(&bytes).is_ok());
    }
}

#[test]
fn every_cut_is_a_truncation() {
    for bytes in files() {
        for found in 0..bytes.len() {
            let expected = if found < HEADER_LEN { HEADER_LEN } else { bytes.len() };
            assert_eq!(
                PolicyFile::parse(&bytes[..found]).unwrap_err(),
                PolicyError::Truncated { found, expected }
            );
        }
    }
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
        prop_assert!(PolicyFile::parse(&bytes).is_err());
    }

    #[test]
    fn forged_headers_never_panic(
        fixed: bool,
        changes in prop::collection::vec((8_usize..120, any::<u8>()), 1..6),
        observation in prop::collection::vec(any::<f32>(), PILOT_LEN),
    ) {
        let [float_file, fixed_file] = files();
        let mut bytes = if fixed { fixed_file } else { float_file };
        for (at, value) in changes {
            bytes[at] = value;
        }
        seal(&mut bytes);
        if let Ok(policy) = PolicyFile::parse(&bytes) {
            let action = policy.act(&observation, &mut kestrel_core::policy_file::PolicyScratch::new());
            prop_assert!(action.iter().all(|value| (-1.0..=1.0).contains(value)));
        }
    }

    #[test]
    fn any_bytes_are_refused(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(PolicyFile::parse(&bytes).is_err());
    }
}

#[test]
fn a_file_of_another_kind_is_not_called_damaged() {
    let found = *b"PK\x03\x04 zip";
    assert_eq!(
        PolicyFile::parse(b"PK\x03\x04 zip, not ours").unwrap_err(),
        PolicyError::Magic { found, expected: MAGIC }
    );
}

#[test]
fn bytes_behind_the_end_are_reported() {
    for mut bytes in files() {
        let expected = bytes.len();
        bytes.extend([0; 3]);
        let found = bytes.len();
        assert_eq!(PolicyFile::parse(&bytes).unwrap_err(), PolicyError::TrailingBytes { found, expected });
    }
}

#[test]
fn bytes_off_the_boundary_are_reported() {
    let [bytes, _] = files();
    let mut shifted = vec![0; bytes.len() + 4];
    for offset in 0..4 {
        let found = (shifted.as_ptr().addr() + offset) % 4;
        let place = &mut shifted[offset..][..bytes.len()];
        place.copy_from_slice(&bytes);
        match PolicyFile::parse(place) {
            Ok(_) => assert_eq!(found, 0),
            Err(error) => assert_eq!(error, PolicyError::Misaligned { found }),
        }
    }
}

#[test]
fn versions_are_told_apart() {
    for bytes in files() {
        assert_eq!(forged(&bytes, 8, 2), PolicyError::Vision);
        assert_eq!(forged(&bytes, 8, 3), PolicyError::Recurrent);
        assert_eq!(forged(&bytes, 8, 4), PolicyError::Vision);
        assert_eq!(forged(&bytes, 8, 5), PolicyError::NewerVersion { found: 5, newest: 4 });
        assert_eq!(forged(&bytes, 8, 0), PolicyError::Version { found: 0, newest: 4 });
    }
}

#[test]
fn unknown_identifiers_are_told_apart() {
    for bytes in files() {
        assert_eq!(forged(&bytes, 10, 3), PolicyError::Arithmetic { found: 3 });
        assert_eq!(forged(&bytes, 16, 9), PolicyError::ObservationLayout { found: 9 });
        assert_eq!(forged(&bytes, 18, 9), PolicyError::ActionSpace { found: 9 });
        let contradiction = PolicyError::MetadataMismatch { field: "action space", found: 1, expected: 2 };
        assert_eq!(forged(&bytes, 18, 2), contradiction);
        let contradiction = PolicyError::MetadataMismatch { field: "observation layout", found: 1, expected: 2 };
        assert_eq!(forged(&bytes, 16, 2), contradiction);
    }
}

#[test]
fn impossible_dimensions_are_told_apart() {
    for bytes in files() {
        assert_eq!(forged(&bytes, 11, 0), PolicyError::LayerCount { found: 0 });
        assert_eq!(forged(&bytes, 11, 5), PolicyError::LayerCount { found: 5 });
        assert_eq!(forged(&bytes, 26, 0), PolicyError::Width { layer: 1, found: 0 });
        assert_eq!(forged(&bytes, 26, 129), PolicyError::Width { layer: 1, found: 129 });
        assert_eq!(forged(&bytes, 28, 5), PolicyError::ActionLength { found: 5, expected: 4 });
        assert!(matches!(forged(&bytes, 26, 60), PolicyError::Length { found, .. } if found == bytes.len()));
        assert!(matches!(forged(&bytes, 22, 0), PolicyError::GoldenObservations { found: 0, .. }));
        assert!(matches!(forged(&bytes, 22, 65), PolicyError::GoldenObservations { .. }));
    }
}

#[test]
fn unused_fields_are_zero() {
    let [float, fixed] = files();
    assert_eq!(forged(&float, 30, 1), PolicyError::UnusedField { offset: 30, found: 1 });
    assert_eq!(forged(&float, 34, 1), PolicyError::UnusedField { offset: 34, found: 1 });
    assert_eq!(forged(&fixed, 37, 1), PolicyError::UnusedField { offset: 37, found: 1 });
    assert_eq!(forged(&fixed, 39, 2), PolicyError::Activation { found: 2 });
}

#[test]
fn formats_that_could_overflow_are_refused() {
    let [_, fixed] = files();
    assert_eq!(forged(&fixed, 35, 21), PolicyError::FractionBits { layer: 0, weights: 21, inputs: 13 });
    assert_eq!(forged(&fixed, 36, 4), PolicyError::FractionBits { layer: 1, weights: 4, inputs: 13 });
    // The most significant byte of the first bias of the output layer.
    let bias_of_last_layer = fixed.len() - 4 - (4 * 4 + 2 * 6 * 4);
    let error = forged(&fixed, bias_of_last_layer + 3, 0x7F);
    assert!(matches!(error, PolicyError::Overflow { layer: 1, row: 0, .. }), "{error}");
}

#[test]
fn a_float_weight_must_be_finite() {
    let [float, _] = files();
    let mut bytes = float;
    let last_weight = bytes.len() - 8;
    bytes[last_weight..last_weight + 4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    seal(&mut bytes);
    assert_eq!(PolicyFile::parse(&bytes).unwrap_err(), PolicyError::NotFinite { layer: 1 });
}

#[test]
fn metadata_must_decode_and_make_sense() {
    for bytes in files() {
        // The name's length, the first byte of the metadata.
        assert!(matches!(forged(&bytes, HEADER_LEN, 200), PolicyError::Metadata { .. }));
        // Behind the name "hover" and the layout's number: the sign of the position scale.
        let error = forged(&bytes, HEADER_LEN + 1 + 5 + 1 + 3, 0xBF);
        assert!(matches!(error, PolicyError::MetadataValue { field: "position_scale_m", .. }), "{error}");
    }
}

#[test]
fn messages_say_what_was_found_and_expected() {
    let [float, _] = files();
    let messages = [
        forged(&float, 8, 5).to_string(),
        PolicyFile::parse(&float[..100]).unwrap_err().to_string(),
        PolicyFile::parse(b"hello world").unwrap_err().to_string(),
    ];
    let expected = [
        "policy file has format version 5, this release reads up to 4: update kestrel, or export again".to_owned(),
        format!("policy file is truncated: found 100 bytes, expected {}", float.len()),
        r#"not a policy file: it begins with "hello wo", expected "\x89KPOL\r\n\x1a""#.to_owned(),
    ];
    assert_eq!(messages, expected);
}
