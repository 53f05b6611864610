use std::vec::Vec;

use mavlink::dialects::common::HEARTBEAT_DATA;
use proptest::prelude::*;

use super::*;
use crate::frame::{Encoder, Frames, Payload};
use crate::signature::Signer;

/// Some time in 2027, and a minute.
const NOW: SignatureTime = SignatureTime(4_000_000_000_000);
const MINUTE: u64 = 6_000_000;

fn key() -> SigningKey {
    SigningKey(core::array::from_fn(|i| i as u8))
}

fn signer(last: SignatureTime) -> Encoder {
    Encoder::new(255, 190).signed(Signer::new(key(), 3, last))
}

fn heartbeat(encoder: &mut Encoder) -> Vec<u8> {
    encoder.encode(&Payload::of(&HEARTBEAT_DATA::default())).to_vec()
}

fn verify(verifier: &mut Verifier, bytes: &[u8]) -> Result<(), SignatureError> {
    verifier.verify(&Frames::new(bytes).next().unwrap().unwrap())
}

fn verifier() -> Verifier {
    Verifier::new(key(), NOW, SignatureTime(0))
}

/// Two heartbeats of pymavlink 2.4.50, dialect `common`, key 0, 1, ... 31, link 3, at 1234567890123 and one later.
#[test]
fn signatures_are_those_of_pymavlink() {
    let payload = Payload::new(0, 50, &[0, 0, 0, 0, 6, 8, 192, 4, 3]);
    let theirs = [
        "fd09010000ffbe000000000000000608c00403038b03cb04fb711f01266ef6713a70",
        "fd09010000ffbe000000000000000608c00403038b03cc04fb711f01a419f0b45fa0",
    ];
    let mut verifier = Verifier::new(key(), SignatureTime(1_234_567_890_123), SignatureTime(0));
    for (index, theirs) in theirs.into_iter().enumerate() {
        let bytes: Vec<u8> =
            (0..theirs.len() / 2).map(|i| u8::from_str_radix(&theirs[2 * i..2 * i + 2], 16).unwrap()).collect();
        let mut ours = signer(SignatureTime(1_234_567_890_122 + index as u64));
        assert_eq!(ours.encode(&payload).to_vec(), bytes);
        assert_eq!(verify(&mut verifier, &bytes), Ok(()));
    }
}

#[test]
fn a_frame_is_accepted_once() {
    let (mut encoder, mut verifier) = (signer(NOW), verifier());
    let frames = [heartbeat(&mut encoder), heartbeat(&mut encoder)];
    assert_eq!(verify(&mut verifier, &frames[1]), Ok(()));
    assert_eq!(verify(&mut verifier, &frames[1]), Err(SignatureError::Replayed));
    assert_eq!(verify(&mut verifier, &frames[0]), Err(SignatureError::Replayed), "nor is one from before");
}

#[test]
fn a_new_sender_may_be_a_minute_behind() {
    for (behind, expected) in [(MINUTE - 1, Ok(())), (MINUTE + 1, Err(SignatureError::Stale))] {
        let bytes = heartbeat(&mut signer(SignatureTime(NOW.0 - behind - 1)));
        assert_eq!(verify(&mut verifier(), &bytes), expected, "{behind}");
    }
}

#[test]
fn a_frame_sets_the_clock_for_senders_that_are_new_after_it() {
    let mut verifier = verifier();
    assert_eq!(verify(&mut verifier, &heartbeat(&mut signer(SignatureTime(NOW.0 + 2 * MINUTE)))), Ok(()));
    let mut late = Encoder::new(254, 190).signed(Signer::new(key(), 3, SignatureTime(NOW.0 + MINUTE / 2)));
    assert_eq!(verify(&mut verifier, &heartbeat(&mut late)), Err(SignatureError::Stale));
}

#[test]
fn nothing_from_before_a_restart_is_accepted() {
    let mut encoder = signer(NOW);
    let mut before = verifier();
    let recorded = heartbeat(&mut encoder);
    verify(&mut before, &recorded).unwrap();
    let mut after = Verifier::new(key(), NOW, before.accepted());
    assert_eq!(verify(&mut after, &recorded), Err(SignatureError::Replayed));
    assert_eq!(verify(&mut after, &heartbeat(&mut encoder)), Ok(()));
}

#[test]
fn what_is_unsigned_or_of_another_key_is_refused() {
    let unsigned = heartbeat(&mut Encoder::new(255, 190));
    assert_eq!(verify(&mut verifier(), &unsigned), Err(SignatureError::Unsigned));
    let version_1 = {
        let mut raw = mavlink::MAVLinkV1MessageRaw::new();
        raw.serialize_message_data(mavlink::MavHeader::default(), &HEARTBEAT_DATA::default());
        raw.raw_bytes().to_vec()
    };
    assert_eq!(verify(&mut verifier(), &version_1), Err(SignatureError::Unsigned));
    let foreign = heartbeat(&mut Encoder::new(255, 190).signed(Signer::new(SigningKey([1; 32]), 3, NOW)));
    assert_eq!(verify(&mut verifier(), &foreign), Err(SignatureError::Wrong));
}

#[test]
fn without_a_key_nothing_passes() {
    let bytes = heartbeat(&mut signer(NOW));
    let frame = Frames::new(&bytes).next().unwrap().unwrap();
    assert_eq!(SignatureGuard::Closed.admit(&frame), Err(SignatureError::KeyMissing));
    assert_eq!(SignatureGuard::Open.admit(&frame), Ok(()));
    assert_eq!(SignatureGuard::Signed(verifier()).admit(&frame), Ok(()));
}

#[test]
fn more_senders_than_are_remembered_are_refused_and_none_is_forgotten() {
    let mut verifier = verifier();
    let bytes_of = |system| heartbeat(&mut Encoder::new(system, 1).signed(Signer::new(key(), 0, NOW)));
    let first = bytes_of(0);
    verify(&mut verifier, &first).unwrap();
    for system in 1..STREAM_LIMIT as u8 {
        verify(&mut verifier, &bytes_of(system)).unwrap();
    }
    assert_eq!(verify(&mut verifier, &bytes_of(99)), Err(SignatureError::Senders));
    assert_eq!(verify(&mut verifier, &first), Err(SignatureError::Replayed));
}

#[test]
fn times_never_go_back() {
    let mut signer = Signer::new(key(), 0, NOW);
    signer.sign(b"frame");
    let last = signer.last();
    signer.advance(SignatureTime(5));
    signer.sign(b"frame");
    assert!(signer.last() > last);
    assert_eq!(SignatureTime::from_unix_micros(1_420_070_400_000_000), SignatureTime(0));
    assert_eq!(SignatureTime::from_unix_micros(1_420_070_400_000_010), SignatureTime(1));
}

#[test]
fn a_key_is_not_shown() {
    assert_eq!(std::format!("{:?}", key()), "Key(secret)");
}

proptest! {
    #[test]
    fn an_altered_frame_is_never_accepted(position in 1_usize..34, bit in 0_u32..8) {
        let mut bytes = heartbeat(&mut signer(NOW));
        let position = position % bytes.len();
        bytes[position] ^= 1 << bit;
        for frame in Frames::new(&bytes).flatten() {
            prop_assert!(verifier().verify(&frame).is_err());
        }
    }
}
