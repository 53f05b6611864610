//! Packets of H.264 video in RTP (RFC 3550, RFC 6184), and sender reports in RTCP.

use std::time::{SystemTime, UNIX_EPOCH};

/// Payload type of the stream; 96 to 127 are free for use (RFC 3551, section 6).
pub(super) const PAYLOAD_TYPE: u8 = 96;

/// Ticks of a time stamp in a second \[Hz\] (RFC 6184, section 8.2.1).
pub(super) const CLOCK_HZ: u32 = 90_000;

/// Bytes of a payload: with the headers of RTP, UDP and IPv6 it fits into the 1,500 bytes of an Ethernet frame.
pub(super) const PAYLOAD_LIMIT: usize = 1400;

/// Version 2 without padding, extension or contributing sources (RFC 3550, section 5.1).
const VERSION: u8 = 2 << 6;

/// On the last packet of an access unit (RFC 6184, section 5.1).
const MARKER: u8 = 1 << 7;

/// Low five bits of a NAL unit's header (RFC 6184, section 1.3).
const TYPE_MASK: u8 = 0x1F;

/// NAL unit type of a slice of a key picture (ITU-T H.264, table 7-1).
const KEY_SLICE: u8 = 5;

/// NAL unit type of a fragment (FU-A), and the flags of the first and the last one (RFC 6184, section 5.8).
const FRAGMENT: u8 = 28;
const FRAGMENT_START: u8 = 1 << 7;
const FRAGMENT_END: u8 = 1 << 6;

/// Bytes before a fragment: FU indicator and FU header (RFC 6184, section 5.8).
const FRAGMENT_HEADER_LEN: usize = 2;

/// What a NAL unit follows in a byte stream (ITU-T H.264, annex B).
const START_CODE: [u8; 3] = [0, 0, 1];

/// Packet types of RTCP (RFC 3550, section 12.1).
const SENDER_REPORT: u8 = 200;
const SOURCE_DESCRIPTION: u8 = 202;

/// Item of a source description that names the sender (RFC 3550, section 6.5.1). With its two bytes and the terminating zero
/// the name fills three words.
const CANONICAL_NAME: u8 = 1;
const NAME: &[u8; 9] = b"kestrel-0";

/// From 1900, where NTP begins, to 1970 \[s\] (RFC 868).
const NTP_OFFSET_SECS: u64 = 2_208_988_800;

/// Type of the NAL unit with this header.
pub(super) fn nal_unit_type(header: u8) -> u8 {
    header & TYPE_MASK
}

/// One encoded picture.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct AccessUnit {
    /// Without start codes; none is empty.
    nal_units: Vec<Vec<u8>>,
    /// \[1/90,000 s\].
    timestamp: u32,
}

impl AccessUnit {
    /// Splits a byte stream with start codes; `secs` \[s\] counts from the start of the stream.
    pub(super) fn parse(byte_stream: &[u8], secs: f64) -> Self {
        let timestamp = (secs * f64::from(CLOCK_HZ)).round() as u64 as u32;
        Self { nal_units: nal_units(byte_stream), timestamp }
    }

    /// Whether decoding can begin here.
    pub(super) fn is_key(&self) -> bool {
        self.nal_units
            .iter()
            .filter_map(|nal_unit| nal_unit.first())
            .any(|header| nal_unit_type(*header) == KEY_SLICE)
    }
}

/// Numbers the packets of one session.
#[derive(Debug)]
pub(super) struct RtpPacketizer {
    /// SSRC of the session.
    pub(super) source: u32,
    /// Number of the next packet.
    pub(super) sequence: u16,
    packets_sent: u32,
    payload_bytes_sent: u32,
}

impl RtpPacketizer {
    /// Begins a session.
    pub(super) fn new(source: u32, sequence: u16) -> Self {
        Self { source, sequence, packets_sent: 0, payload_bytes_sent: 0 }
    }

    /// All packets of a picture.
    pub(super) fn packetize(&mut self, access_unit: &AccessUnit) -> Vec<Vec<u8>> {
        let payloads: Vec<_> = access_unit.nal_units.iter().flat_map(|nal_unit| payloads(nal_unit)).collect();
        let mut left = payloads.len();
        let mut packets = Vec::with_capacity(left);
        for payload in payloads {
            left -= 1;
            let marker = if left == 0 { MARKER } else { 0 };
            let mut packet = vec![VERSION, marker | PAYLOAD_TYPE];
            packet.extend(self.sequence.to_be_bytes());
            packet.extend(access_unit.timestamp.to_be_bytes());
            packet.extend(self.source.to_be_bytes());
            packet.extend(&payload);
            packets.push(packet);
            self.sequence = self.sequence.wrapping_add(1);
            self.packets_sent = self.packets_sent.wrapping_add(1);
            self.payload_bytes_sent = self.payload_bytes_sent.wrapping_add(payload.len() as u32);
        }
        packets
    }

    /// A compound RTCP packet (RFC 3550, sections 6.4.1 and 6.5): the time stamp of this picture is the time `now`.
    pub(super) fn sender_report(&self, access_unit: &AccessUnit, now: SystemTime) -> Vec<u8> {
        let since_1970 = now.duration_since(UNIX_EPOCH).unwrap_or_default();
        let ntp_secs = since_1970.as_secs().wrapping_add(NTP_OFFSET_SECS) as u32;
        let ntp_fraction = ((u64::from(since_1970.subsec_nanos()) << 32) / 1_000_000_000) as u32;
        let words = [
            self.source,
            ntp_secs,
            ntp_fraction,
            access_unit.timestamp,
            self.packets_sent,
            self.payload_bytes_sent,
        ];
        let mut report = vec![VERSION, SENDER_REPORT, 0, words.len() as u8];
        report.extend(words.iter().flat_map(|word| word.to_be_bytes()));

        report.extend([VERSION | 1, SOURCE_DESCRIPTION, 0, 4]);
        report.extend(self.source.to_be_bytes());
        report.extend([CANONICAL_NAME, NAME.len() as u8]);
        report.extend(NAME);
        report.push(0);
        report
    }
}

/// NAL units of a byte stream, without the zeros that may follow each.
fn nal_units(byte_stream: &[u8]) -> Vec<Vec<u8>> {
    let (_, mut rest) = split_at_start_code(byte_stream);
    let mut found = Vec::new();
    while let Some(after) = rest {
        let (nal_unit, following) = split_at_start_code(after);
        let len = nal_unit.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        found.extend(nal_unit.get(..len).filter(|nal_unit| !nal_unit.is_empty()).map(<[u8]>::to_vec));
        rest = following;
    }
    found
}

/// What comes before the first start code, and what comes after it.
fn split_at_start_code(bytes: &[u8]) -> (&[u8], Option<&[u8]>) {
    let start = bytes.windows(START_CODE.len()).position(|window| window == START_CODE);
    start.map_or((bytes, None), |start| {
        let (before, after) = bytes.split_at(start);
        (before, after.get(START_CODE.len()..))
    })
}

/// A NAL unit as it is, or in fragments.
fn payloads(nal_unit: &[u8]) -> Vec<Vec<u8>> {
    let Some((&header, body)) = nal_unit.split_first() else { return Vec::new() };
    if nal_unit.len() <= PAYLOAD_LIMIT {
        return vec![nal_unit.to_vec()];
    }
    let indicator = header & !TYPE_MASK | FRAGMENT;
    let fragments = body.chunks(PAYLOAD_LIMIT - FRAGMENT_HEADER_LEN);
    let count = fragments.len();
    let with_header = |(number, fragment): (usize, &[u8])| {
        let start = if number == 1 { FRAGMENT_START } else { 0 };
        let end = if number == count { FRAGMENT_END } else { 0 };
        [&[indicator, start | end | nal_unit_type(header)], fragment].concat()
    };
    (1..).zip(fragments).map(with_header).collect()
}
