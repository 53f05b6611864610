use proptest::prelude::*;

use super::*;

const KIND: Kind = Kind { noun: "checkpoint", magic: *b"KESTRELC", version: 1 };

#[derive(Debug, PartialEq, Serialize, serde::Deserialize)]
struct Model {
    weights: Vec<f32>,
    steps: u64,
}

fn model(steps: u64) -> Model {
    Model { weights: vec![0.5, -1.0, f32::MIN_POSITIVE], steps }
}

fn decoded(bytes: &[u8]) -> Result<Model, String> {
    KIND.decode(Path::new("x.checkpoint"), bytes).map_err(|error| error.to_string())
}

/// What is read from a file with these bytes, and the message for one that is refused, without its place.
fn read(bytes: &[u8]) -> Result<Model, String> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("x.checkpoint");
    std::fs::write(&path, bytes).unwrap();
    let place = format!("{}/", directory.path().display());
    KIND.read(&path).map_err(|error| error.to_string().replace(&place, ""))
}

#[test]
fn what_was_written_is_read() {
    assert_eq!(read(&KIND.encode(&model(3))).unwrap(), model(3));
}

#[test]
fn a_file_is_refused_like_its_bytes() {
    let bytes = KIND.encode(&model(3));
    let longer = [&bytes[..], b"\0"].concat();
    for bytes in [&longer[..], &bytes[..30], &bytes[..20], b"", b"GIF89a and so on and on and on and on"] {
        assert_eq!(read(bytes).unwrap_err(), decoded(bytes).unwrap_err());
    }
}

#[test]
fn an_endless_file_is_refused_at_its_beginning() {
    let endless = Path::new("/dev/zero");
    if endless.exists() {
        let error = KIND.read::<Model>(endless).unwrap_err().to_string();
        assert!(error.starts_with("/dev/zero is no checkpoint: it begins with"), "{error}");
    }
}

#[test]
fn every_length_but_the_whole_is_refused() {
    let bytes = KIND.encode(&model(3));
    for length in 0..bytes.len() {
        let error = decoded(&bytes[..length]).unwrap_err();
        let expected = if length < HEADER_LEN { HEADER_LEN } else { bytes.len() };
        assert_eq!(error, format!("x.checkpoint is truncated: found {length} bytes, expected {expected}"));
    }
    let longer = [&bytes[..], b"\0"].concat();
    let (found, expected) = (longer.len(), bytes.len());
    assert_eq!(
        decoded(&longer).unwrap_err(),
        format!("x.checkpoint is too long: found {found} bytes or more, expected {expected}")
    );
}

#[test]
fn other_files_are_recognised_by_their_beginning() {
    assert_eq!(
        decoded(b"GIF89a and so on").unwrap_err(),
        r#"x.checkpoint is no checkpoint: it begins with "GIF89a a", expected "KESTRELC""#
    );
}

#[test]
fn a_newer_format_is_named() {
    let mut bytes = KIND.encode(&model(3));
    bytes[8] = 2;
    assert_eq!(
        decoded(&bytes).unwrap_err(),
        "x.checkpoint has checkpoint format 2, expected 1: use the version of kestrel that wrote it"
    );
}

#[test]
fn other_content_is_refused() {
    let shorter = decoded(&KIND.encode(&vec![1.0_f32])).unwrap_err();
    assert!(shorter.starts_with("x.checkpoint holds other content than expected ("), "{shorter}");
    let longer = decoded(&KIND.encode(&(model(3), 1_u8))).unwrap_err();
    assert!(longer.starts_with("x.checkpoint holds other content than expected (1 bytes too many)"), "{longer}");
}

proptest! {
    #[test]
    fn no_flipped_bit_goes_unnoticed(bit in 0..8 * KIND.encode(&model(3)).len()) {
        let mut bytes = KIND.encode(&model(3));
        bytes[bit / 8] ^= 1 << (bit % 8);
        prop_assert!(decoded(&bytes).is_err());
    }

    #[test]
    fn no_garbage_is_taken_for_a_checkpoint(bytes: Vec<u8>) {
        prop_assert!(decoded(&bytes).is_err());
    }
}
