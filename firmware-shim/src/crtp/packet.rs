//! A CRTP packet: a header byte with port and channel, and up to 30 bytes of data, all numbers little-endian.

use nalgebra::Vector3;

/// Greatest number of bytes after the header.
pub const DATA_LIMIT: usize = 30;

/// Greatest number of bytes of a packet.
pub const PACKET_LIMIT: usize = 1 + DATA_LIMIT;

/// Channel of the link port on which nothing is carried: 0xFF is the packet with which clients look for drones.
const NULL_CHANNEL: u8 = 3;

/// Whom a packet is for; the numbers are those of Bitcraze's protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port {
    /// Text for people.
    Console = 0,
    /// Table and values of parameters.
    Parameter = 2,
    /// Set-points of roll, pitch, yaw rate and thrust.
    Commander = 3,
    /// Memories of decks, of which there are none.
    Memory = 4,
    /// Table and blocks of log variables.
    Log = 5,
    /// Positions from outside, and the emergency stop of old clients.
    Localization = 6,
    /// Set-points of all kinds.
    GenericCommander = 7,
    /// Take-offs, landings and flights to points.
    HighLevelCommander = 8,
    /// Arming and the emergency stop.
    Supervisor = 9,
    /// Versions, and the arming of old clients.
    Platform = 13,
    /// Echo and handshake.
    Link = 15,
}

/// One packet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packet {
    /// Whom it is for.
    pub port: Port,
    /// 0 to 3.
    pub channel: u8,
    data: heapless::Vec<u8, DATA_LIMIT>,
}

impl Port {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Console,
        Self::Parameter,
        Self::Commander,
        Self::Memory,
        Self::Log,
        Self::Localization,
        Self::GenericCommander,
        Self::HighLevelCommander,
        Self::Supervisor,
        Self::Platform,
        Self::Link,
    ];
}

impl Packet {
    /// A packet without data; of the channel the lowest two bits count.
    pub const fn new(port: Port, channel: u8) -> Self {
        Self { port, channel: channel & 3, data: heapless::Vec::new() }
    }

    /// The packet in a datagram, unless it is empty, too long or for a port that does not exist.
    pub fn parse(datagram: &[u8]) -> Option<Self> {
        let (header, data) = datagram.split_first()?;
        let port = Port::ALL.into_iter().find(|port| *port as u8 == header >> 4)?;
        let data = heapless::Vec::from_slice(data).ok()?;
        Some(Self { port, channel: header & 3, data })
    }

    /// With `bytes` behind its data; what would be beyond [`DATA_LIMIT`] is cut.
    #[must_use]
    pub fn with(mut self, bytes: &[u8]) -> Self {
        let room = DATA_LIMIT - self.data.len();
        self.data.extend(bytes.iter().take(room).copied());
        self
    }

    /// An empty packet for the same port and channel.
    #[must_use]
    pub const fn reply(&self) -> Self {
        Self::new(self.port, self.channel)
    }

    /// Whether it carries nothing, and only asks who is there.
    pub fn is_null(&self) -> bool {
        self.port == Port::Link && self.channel == NULL_CHANNEL
    }

    /// What follows the header.
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// Its fields from the first one on.
    pub fn fields(&self) -> Fields<'_> {
        Fields(&self.data)
    }

    /// The bytes of the datagram.
    pub fn encode(&self) -> heapless::Vec<u8, PACKET_LIMIT> {
        let mut bytes = heapless::Vec::new();
        bytes.extend([(self.port as u8) << 4 | self.channel]);
        bytes.extend(self.data.iter().copied());
        bytes
    }
}

/// Fields of a packet, taken one after the other; nothing where the packet is too short.
#[derive(Clone, Copy, Debug)]
pub struct Fields<'a>(pub &'a [u8]);

impl<'a> Fields<'a> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (field, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*field)
    }

    /// A byte.
    pub fn byte(&mut self) -> Option<u8> {
        self.take().map(u8::from_le_bytes)
    }

    /// Two bytes.
    pub fn short(&mut self) -> Option<u16> {
        self.take().map(u16::from_le_bytes)
    }

    /// Two bytes with a sign.
    pub fn signed_short(&mut self) -> Option<i16> {
        self.take().map(i16::from_le_bytes)
    }

    /// A finite number.
    pub fn float(&mut self) -> Option<f32> {
        self.take().map(f32::from_le_bytes).filter(|value| value.is_finite())
    }

    /// Three finite numbers.
    pub fn vector(&mut self) -> Option<Vector3<f32>> {
        Some(Vector3::new(self.float()?, self.float()?, self.float()?))
    }

    /// Three numbers in thousandths.
    pub fn thousandths(&mut self) -> Option<Vector3<f32>> {
        let mut thousandth = || self.signed_short().map(|value| f32::from(value) / 1e3);
        Some(Vector3::new(thousandth()?, thousandth()?, thousandth()?))
    }

    /// The bytes up to a zero, which is taken too.
    pub fn text(&mut self) -> Option<&'a [u8]> {
        let end = self.0.iter().position(|byte| *byte == 0)?;
        let (text, rest) = self.0.split_at(end);
        self.0 = &rest[1..];
        Some(text)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_header_holds_port_and_channel() {
        let packet = Packet::new(Port::GenericCommander, 1).with(&[1, 2]);
        assert_eq!(packet.encode(), [0x71, 1, 2]);
        assert_eq!(Packet::parse(&[0x7D, 1, 2]), Some(packet), "the two bits of the link do not count");
    }

    #[test]
    fn the_ping_of_a_scan_is_a_null_packet() {
        assert!(Packet::parse(&[0xFF]).unwrap().is_null());
        assert!(!Packet::parse(&[0xFD, 0]).unwrap().is_null());
    }

    #[test]
    fn what_is_no_packet_is_refused() {
        for wrong in [&[][..], &[0x10], &[0xA0, 1], &[0x70; PACKET_LIMIT + 1]] {
            assert_eq!(Packet::parse(wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn data_beyond_the_limit_is_cut() {
        let packet = Packet::new(Port::Console, 0).with(&[7; 20]).with(&[8; 20]);
        assert_eq!(packet.data().len(), DATA_LIMIT);
        assert_eq!(packet.data()[29], 8);
    }

    #[test]
    fn fields_come_one_after_the_other_and_end() {
        let mut bytes = vec![5, 0x34, 0x12];
        bytes.extend(1.5_f32.to_le_bytes());
        bytes.extend(f32::NAN.to_le_bytes());
        bytes.extend(b"ab\0c");
        let mut fields = Fields(&bytes);
        assert_eq!((fields.byte(), fields.short(), fields.float()), (Some(5), Some(0x1234), Some(1.5)));
        assert_eq!(fields.float(), None, "no number");
        assert_eq!((fields.text(), fields.text(), fields.byte()), (Some(&b"ab"[..]), None, Some(b'c')));
        assert_eq!(fields.byte(), None);
    }

    proptest! {
        #[test]
        fn packets_survive_the_wire(port in 0_usize..11, channel in 0_u8..4, data in proptest::collection::vec(any::<u8>(), 0..=30)) {
            let packet = Packet::new(Port::ALL[port], channel).with(&data);
            prop_assert_eq!(Packet::parse(&packet.encode()), Some(packet));
        }
    }
}
