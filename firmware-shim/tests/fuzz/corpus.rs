//! Frames that real clients sent; `tests/corpus/mavlink/README.md` says which.

use kestrel_onboard::signature::{SignatureTime, SigningKey};
use kestrel_onboard::signature_guard::Verifier;
use kestrel_shim::frame::{Frame, FrameVersion, Frames};

const PYMAVLINK_SIGNED: &[u8] = include_bytes!("../../../tests/corpus/mavlink/pymavlink_signed.bin");
const PYMAVLINK_V1: &[u8] = include_bytes!("../../../tests/corpus/mavlink/pymavlink_v1.bin");
const FILES: [&[u8]; 5] = [
    include_bytes!("../../../tests/corpus/mavlink/mavproxy.bin"),
    include_bytes!("../../../tests/corpus/mavlink/mavsdk.bin"),
    include_bytes!("../../../tests/corpus/mavlink/pymavlink.bin"),
    PYMAVLINK_SIGNED,
    PYMAVLINK_V1,
];

/// All of them; none is damaged.
pub(crate) fn frames() -> Vec<Frame<'static>> {
    FILES.into_iter().flat_map(Frames::new).map(|frame| frame.expect("a frame that a client sent")).collect()
}

#[test]
fn every_frame_of_every_client_is_read() {
    let frames = frames();
    assert!(frames.len() > 100, "{}", frames.len());
    let read: usize = frames.iter().map(|frame| frame.bytes.len()).sum();
    assert_eq!(read, FILES.iter().map(|file| file.len()).sum::<usize>());
    assert!(Frames::new(PYMAVLINK_V1).flatten().all(|frame| frame.version == FrameVersion::V1));
}

#[test]
fn signatures_of_pymavlink_are_accepted_once() {
    let mut verifier = Verifier::new(SigningKey([42; 32]), SignatureTime(0), SignatureTime(0));
    let frames: Vec<_> = Frames::new(PYMAVLINK_SIGNED).flatten().collect();
    assert_eq!(frames.len(), 7);
    assert!(frames.iter().all(|frame| verifier.verify(frame).is_ok()));
    assert!(frames.iter().all(|frame| verifier.verify(frame).is_err()));
}
