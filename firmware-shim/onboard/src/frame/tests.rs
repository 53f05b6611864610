use mavlink::dialects::common::{HEARTBEAT_DATA, MavMessage};
use mavlink::{MAVLinkV1MessageRaw, MAVLinkV2MessageRaw, MavHeader, Message};
use proptest::prelude::*;

use std::vec;
use std::vec::Vec;

use super::*;
use crate::signature::{SignatureTime, Signer, SigningKey};

fn heartbeat() -> Vec<u8> {
    Encoder::new(255, 190).encode(&Payload::of(&HEARTBEAT_DATA::default())).to_vec()
}

fn errors(datagram: &[u8]) -> Vec<FrameError> {
    Frames::new(datagram).filter_map(Result::err).collect()
}

#[test]
fn an_encoded_frame_is_read_back() {
    let bytes = heartbeat();
    let frames: Vec<_> = Frames::new(&bytes).collect::<Result<_, _>>().unwrap();
    assert_eq!(frames.len(), 1);
    assert_eq!((frames[0].system, frames[0].component, frames[0].message_id), (255, 190, 0));
    assert_eq!(frames[0].fields::<9>()[8], 3, "mavlink_version");
}

#[test]
fn mavlink_1_is_understood() {
    let mut raw = MAVLinkV1MessageRaw::new();
    let header = MavHeader { system_id: 7, component_id: 8, sequence: 9 };
    raw.serialize_message(header, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
    let frame = Frames::new(raw.raw_bytes()).next().unwrap().unwrap();
    assert_eq!((frame.system, frame.component, frame.message_id), (7, 8, 0));
}

#[test]
fn frames_are_those_of_the_mavlink_crate() {
    let mut raw = MAVLinkV2MessageRaw::new();
    let header = MavHeader { system_id: 255, component_id: 190, sequence: 0 };
    raw.serialize_message_data(header, &HEARTBEAT_DATA::default());
    assert_eq!(heartbeat(), raw.raw_bytes());
}

#[test]
fn frames_follow_each_other_in_one_datagram() {
    let both = [heartbeat(), heartbeat()].concat();
    assert_eq!(Frames::new(&both).flatten().count(), 2);
}

#[test]
fn a_frame_inside_a_broken_frame_is_never_read() {
    let inner = heartbeat();
    let mut outer = vec![START_V2, inner.len() as u8, 0, 0, 0, 1, 1, 0, 0, 0];
    outer.extend(&inner);
    outer.extend([0, 0]);
    assert_eq!(errors(&outer), [FrameError::Checksum(0)]);
    assert_eq!(Frames::new(&outer).flatten().count(), 0);
}

#[test]
fn what_is_wrong_is_told_apart() {
    assert_eq!(errors(b"hello"), [FrameError::Start(b'h')]);
    assert_eq!(errors(&heartbeat()[..15]), [FrameError::Truncated]);
    assert_eq!(errors(&[START_V1]), [FrameError::Truncated]);
    assert_eq!(errors(&[START_V2]), [FrameError::Truncated]);
    let mut flagged = heartbeat();
    flagged[2] = 0x02;
    assert_eq!(errors(&flagged), [FrameError::Flags(0x02)]);
    let mut unknown = heartbeat();
    unknown[9] = 0xff;
    assert!(matches!(errors(&unknown)[..], [FrameError::Message(_)]));
    let mut flipped = heartbeat();
    flipped[12] ^= 1;
    assert_eq!(errors(&flipped), [FrameError::Checksum(0)]);
}

proptest! {
    #[test]
    fn no_datagram_panics_or_loops(datagram in proptest::collection::vec(any::<u8>(), 0..600)) {
        prop_assert!(Frames::new(&datagram).count() <= datagram.len());
    }

    #[test]
    fn no_damaged_frame_passes(position in 1_usize..19, bit in 0_u32..8) {
        let mut bytes = heartbeat();
        let position = position % bytes.len();
        bytes[position] ^= 1 << bit;
        prop_assert!(Frames::new(&bytes).all(|frame| frame.is_err()));
    }

    #[test]
    fn frames_that_begin_well_never_panic(
        flags in 0_u8..2, rest in proptest::collection::vec(any::<u8>(), 0..300)
    ) {
        let bytes = [&[START_V2, 9, flags][..], &rest].concat();
        prop_assert!(Frames::new(&bytes).count() <= bytes.len());
    }
}

/// What a receiver makes of a stream: the message of each frame, or the error.
fn streamed(bytes: &[u8]) -> Vec<Result<u32, FrameError>> {
    let mut receiver = Receiver::new();
    let answers = bytes.iter().filter_map(|&byte| Some(receiver.push(byte)?.map(|frame| frame.message_id)));
    answers.collect()
}

#[test]
fn a_stream_is_cut_where_its_frames_end() {
    let signed = Encoder::new(1, 1).signed(Signer::new(SigningKey([7; 32]), 0, SignatureTime(9)));
    let mut encoders = [Encoder::new(255, 190), signed];
    let mut bytes = Vec::new();
    for index in 0..10 {
        bytes.extend(encoders[index % 2].encode(&Payload::of(&HEARTBEAT_DATA::default())));
    }
    assert_eq!(streamed(&bytes), [Ok(0); 10]);
}

#[test]
fn noise_between_frames_is_one_error() {
    let bytes = [&b"noise"[..], &heartbeat(), &b"more"[..], &heartbeat()].concat();
    let expected = [Err(FrameError::Start(b'n')), Ok(0), Err(FrameError::Start(b'm')), Ok(0)];
    assert_eq!(streamed(&bytes), expected);
}

#[test]
fn a_frame_inside_a_broken_frame_of_a_stream_is_never_read() {
    let inner = heartbeat();
    let mut outer = vec![START_V2, inner.len() as u8, 0, 0, 0, 1, 1, 0, 0, 0];
    outer.extend(&inner);
    outer.extend([0, 0]);
    outer.extend(heartbeat());
    assert_eq!(streamed(&outer), [Err(FrameError::Checksum(0)), Ok(0)]);
}

#[test]
fn a_stream_finds_its_way_again_after_any_damage() {
    for position in 0..heartbeat().len() {
        let mut bytes = heartbeat();
        bytes[position] ^= 0x55;
        // A damaged length covers at most the longest frame.
        let intact = FRAME_LIMIT / bytes.len() + 2;
        for _ in 0..intact {
            bytes.extend(heartbeat());
        }
        assert_eq!(streamed(&bytes).last(), Some(&Ok(0)), "byte {position}");
    }
}

proptest! {
    #[test]
    fn a_stream_and_its_datagrams_say_the_same(
        payloads in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..255), 1..5)
    ) {
        let mut encoder = Encoder::new(3, 4);
        let frames = payloads.iter().map(|fields| encoder.encode(&Payload::new(253, 83, fields)));
        let bytes: Vec<u8> = frames.flatten().collect();
        let datagram: Vec<_> = Frames::new(&bytes).map(|frame| frame.map(|frame| frame.message_id)).collect();
        prop_assert_eq!(streamed(&bytes), datagram);
    }

    #[test]
    fn no_stream_panics(bytes in proptest::collection::vec(prop_oneof![Just(START_V1), Just(START_V2), any::<u8>()], 0..2000)) {
        prop_assert!(streamed(&bytes).len() <= bytes.len());
    }
}

/// Every message of the dialect with random fields, as far as the crate accepts them.
#[test]
fn every_message_is_framed_and_read_as_by_the_mavlink_crate() {
    let mut random = 0x2545_f491_u32;
    let mut byte = || {
        random ^= random << 13;
        random ^= random >> 17;
        random ^= random << 5;
        random as u8
    };
    let mut compared = std::collections::BTreeSet::new();
    let ids = (0..=u32::from(u16::MAX)).filter(|id| checksum_seed(*id).is_some());
    for (id, sequence) in ids.flat_map(|id| (0..40_u8).map(move |sequence| (id, sequence))) {
        let mut fields = [0; PAYLOAD_LIMIT];
        // The first time all zeros: not every message has a valid enumeration in random bytes.
        for field in &mut fields {
            *field = if sequence == 0 { 0 } else { byte() };
        }
        let Ok(message) = MavMessage::parse(mavlink::MavlinkVersion::V2, id, &fields) else { continue };
        let mut theirs = MAVLinkV2MessageRaw::new();
        theirs.serialize_message(MavHeader { system_id: 7, component_id: 8, sequence }, &message);
        let frame = Frames::new(theirs.raw_bytes()).next().unwrap().unwrap();
        assert_eq!((frame.message_id, frame.sequence, frame.payload), (id, sequence, theirs.payload()));
        let payload = Payload::new(id, checksum_seed(id).unwrap(), frame.payload);
        let mut ours = Encoder::new(7, 8);
        ours.sequence = sequence;
        assert_eq!(ours.encode(&payload), theirs.raw_bytes(), "{message:?}");
        compared.insert(id);
    }
    assert!(compared.len() > 200, "{} messages", compared.len());
}
