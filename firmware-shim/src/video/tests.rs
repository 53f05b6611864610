use std::io::{Read, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, TcpStream, UdpSocket};
use std::thread;
use std::time::{Duration, Instant, UNIX_EPOCH};

use proptest::prelude::*;

use super::rtp::{AccessUnit, PAYLOAD_LIMIT, RtpPacketizer};
use super::rtsp::{HEAD_LIMIT, Incoming, RtspMethod, RtspParser, RtspTransport, base64, describe};
use super::server::CLIENTS;
use super::*;

/// Nothing here takes longer unless it never happens.
const PATIENCE: Duration = Duration::from_secs(10);

/// Bytes of RTP before a payload.
const RTP_HEADER_LEN: usize = 12;

fn format() -> VideoFormat {
    VideoFormat {
        columns: 640,
        rows: 480,
        rate_hz: 30,
        sequence_parameter_set: vec![0x67, 0x42, 0xC0, 0x1E, 0xD9, 0x01],
        picture_parameter_set: vec![0x68, 0xCB, 0x83],
    }
}

/// A NAL unit with this header that ends with no zero.
fn nal_unit(header: u8, len: usize) -> Vec<u8> {
    let mut bytes: Vec<u8> = (0..len).map(|number| (number % 251) as u8 | 1).collect();
    bytes[0] = header;
    bytes
}

/// Both kinds of start codes.
fn byte_stream(nal_units: &[Vec<u8>]) -> Vec<u8> {
    let codes: [&[u8]; 2] = [&[0, 0, 0, 1], &[0, 0, 1]];
    let pairs = codes.iter().cycle().zip(nal_units);
    pairs.flat_map(|(code, nal_unit)| [*code, nal_unit].concat()).collect()
}

fn key_picture(len: usize) -> Vec<u8> {
    byte_stream(&[format().sequence_parameter_set, format().picture_parameter_set, nal_unit(0x65, len)])
}

fn picture(len: usize) -> Vec<u8> {
    byte_stream(&[nal_unit(0x41, len)])
}

/// What a player does with packets.
fn reassemble(packets: &[Vec<u8>]) -> Vec<Vec<u8>> {
    let mut nal_units: Vec<Vec<u8>> = Vec::new();
    for packet in packets {
        let payload = &packet[RTP_HEADER_LEN..];
        match payload[0] & 0x1F {
            28 if payload[1] & 0x80 != 0 => {
                nal_units.push(vec![payload[0] & 0xE0 | payload[1] & 0x1F]);
                nal_units.last_mut().unwrap().extend(&payload[2..]);
            }
            28 => nal_units.last_mut().unwrap().extend(&payload[2..]),
            _ => nal_units.push(payload.to_vec()),
        }
    }
    nal_units
}

fn sequence(packet: &[u8]) -> u16 {
    u16::from_be_bytes([packet[2], packet[3]])
}

fn timestamp(packet: &[u8]) -> u32 {
    u32::from_be_bytes([packet[4], packet[5], packet[6], packet[7]])
}

fn is_marked(packet: &[u8]) -> bool {
    packet[1] & 0x80 != 0
}

#[test]
fn packets_carry_the_nal_units_and_nothing_else() {
    for len in [1, 2, PAYLOAD_LIMIT, PAYLOAD_LIMIT + 1, 2 * PAYLOAD_LIMIT - 3, 2 * PAYLOAD_LIMIT - 2, 100_000] {
        let nal_units = [nal_unit(0x67, 9), nal_unit(0x65, len), nal_unit(0x65, 33)];
        let packets = RtpPacketizer::new(7, u16::MAX).packetize(&AccessUnit::parse(&byte_stream(&nal_units), 1.0));
        assert_eq!(reassemble(&packets), nal_units, "{len} bytes");
        for (number, packet) in (0..).zip(&packets) {
            assert!(packet.len() <= RTP_HEADER_LEN + PAYLOAD_LIMIT);
            assert_eq!(packet[0], 0x80);
            assert_eq!(packet[1] & 0x7F, 96);
            assert_eq!(sequence(packet), u16::MAX.wrapping_add(number));
            assert_eq!(timestamp(packet), 90_000);
            assert_eq!(packet[8..12], [0, 0, 0, 7]);
            assert_eq!(is_marked(packet), usize::from(number) + 1 == packets.len());
        }
    }
}

#[test]
fn the_first_and_the_last_fragment_are_flagged() {
    let access_unit = AccessUnit::parse(&byte_stream(&[nal_unit(0x65, 3 * PAYLOAD_LIMIT)]), 0.0);
    let packets = RtpPacketizer::new(0, 0).packetize(&access_unit);
    let headers: Vec<[u8; 2]> = packets.iter().map(|packet| [packet[12], packet[13]]).collect();
    assert_eq!(headers, [[0x7C, 0x85], [0x7C, 0x05], [0x7C, 0x05], [0x7C, 0x45]]);
}

#[test]
fn zeros_around_nal_units_belong_to_none() {
    let expected = AccessUnit::parse(&[0, 0, 1, 0x41, 5, 0, 0, 1, 0x41, 6], 0.0);
    let padded = [0, 0, 0, 0, 1, 0x41, 5, 0, 0, 0, 0, 1, 0, 0, 1, 0x41, 6, 0, 0];
    assert_eq!(AccessUnit::parse(&padded, 0.0), expected);
    for empty in [&[][..], &[0, 0], &[0, 0, 1], &[5; 9]] {
        assert!(RtpPacketizer::new(0, 0).packetize(&AccessUnit::parse(empty, 0.0)).is_empty());
    }
}

#[test]
fn only_a_picture_with_a_key_slice_is_a_key_picture() {
    assert!(AccessUnit::parse(&key_picture(50), 0.0).is_key());
    assert!(!AccessUnit::parse(&picture(50), 0.0).is_key());
}

#[test]
fn time_stamps_wrap_after_thirteen_hours() {
    let stamp = |secs| timestamp(&RtpPacketizer::new(0, 0).packetize(&AccessUnit::parse(&picture(9), secs))[0]);
    assert_eq!(stamp(1.0 / 30.0), 3000);
    assert_eq!(stamp((1_u64 << 32) as f64 / 90_000.0 + 1.0), 90_000);
    assert_eq!(stamp(-1.0), 0);
}

#[test]
fn a_sender_report_counts_what_was_sent() {
    let access_unit = AccessUnit::parse(&picture(PAYLOAD_LIMIT + 1), 2.0);
    let mut packetizer = RtpPacketizer::new(0xABCD, 0);
    packetizer.packetize(&access_unit);
    let report = packetizer.sender_report(&access_unit, UNIX_EPOCH + Duration::from_millis(1500));
    let words: Vec<u32> =
        report.chunks(4).map(|word| word.iter().fold(0, |bits, byte| bits << 8 | u32::from(*byte))).collect();
    let sent = PAYLOAD_LIMIT as u32 + 4;
    let expected = [0x80C8_0006, 0xABCD, 2_208_988_801, 1 << 31, 180_000, 2, sent, 0x81CA_0004, 0xABCD];
    assert_eq!(words[..9], expected);
    assert_eq!(report.len(), (7 + 5) * 4);
    assert_eq!(report[36..], *b"\x01\x09kestrel-0\0");
}

#[test]
fn base64_is_that_of_the_standard() {
    // RFC 4648, section 10.
    for (plain, encoded) in [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")] {
        assert_eq!(base64(plain.as_bytes()), encoded);
    }
    assert_eq!(base64(&[0xFB, 0xFF]), "+/8=");
}

#[test]
fn the_description_says_how_to_decode() {
    let description = describe(&format(), Ipv4Addr::LOCALHOST.into());
    for line in [
        "o=- 0 0 IN IP4 127.0.0.1",
        "c=IN IP4 0.0.0.0",
        "m=video 0 RTP/AVP 96",
        "a=rtpmap:96 H264/90000",
        "a=fmtp:96 packetization-mode=1;profile-level-id=42C01E;sprop-parameter-sets=Z0LAHtkB,aMuD",
        "a=framerate:30",
        "a=framesize:96 640-480",
        "a=control:track1",
    ] {
        assert!(description.contains(&format!("\r\n{line}\r\n")), "{line} in {description}");
    }
    assert!(describe(&format(), Ipv6Addr::LOCALHOST.into()).contains("\r\nc=IN IP6 ::\r\n"));
}

#[test]
fn transports_are_those_of_players() {
    let interleaved = |rtp_channel, rtcp_channel| Some(RtspTransport::Interleaved { rtp_channel, rtcp_channel });
    let udp = |rtp_port, rtcp_port| Some(RtspTransport::Udp { rtp_port, rtcp_port });
    for (offers, expected) in [
        ("RTP/AVP/TCP;unicast;interleaved=0-1", interleaved(0, 1)),
        ("rtp/avp/tcp; unicast; Interleaved=4-7", interleaved(4, 7)),
        ("RTP/AVP/TCP;unicast", interleaved(0, 1)),
        ("RTP/AVP;unicast;client_port=5000-5001", udp(5000, 5001)),
        ("RTP/AVP/UDP;unicast;client_port=5000;mode=play", udp(5000, 5001)),
        ("RTP/AVP;multicast,RTP/SAVP;client_port=1-2,RTP/AVP/TCP;interleaved=2-3", interleaved(2, 3)),
        ("RTP/AVP;multicast;client_port=5000-5001", None),
        ("RTP/AVP/TCP;interleaved=255-256", None),
        ("RTP/AVP;unicast;client_port=0-1", None),
        ("RTP/AVP;unicast;client_port=65535", None),
        ("RTP/AVP;unicast", None),
        ("", None),
    ] {
        assert_eq!(RtspTransport::parse(offers), expected, "{offers}");
    }
}

/// Methods and packets of what comes in chunks of `chunk_len` bytes.
fn parse(bytes: &[u8], chunk_len: usize) -> Vec<Option<RtspMethod>> {
    let mut parser = RtspParser::default();
    let mut found = Vec::new();
    for chunk in bytes.chunks(chunk_len) {
        parser.push(chunk);
        while let Some(incoming) = parser.take().unwrap() {
            found.push(match incoming {
                Incoming::Request(request) => Some(request.method),
                Incoming::Packet => None,
            });
        }
    }
    found
}

#[test]
fn packets_and_bodies_between_requests_are_skipped() {
    let mut bytes = b"OPTIONS * RTSP/1.0\r\nCSeq: 1\r\n\r\n$\x01\x00\x06OPTION\r\n".to_vec();
    bytes.extend(b"SET_PARAMETER * RTSP/1.0\r\ncseq:2\r\nContent-Length: 4\r\n\r\n$$$$");
    bytes.extend(b"PLAY * RTSP/1.0\nCSeq: 3\n\n$\x00\x01\x00");
    bytes.extend([b'$'; 256]);
    bytes.extend(b"BREW * RTSP/1.0\r\nCSeq: 4\r\n\r\n");
    let expected = [
        Some(RtspMethod::Options),
        None,
        Some(RtspMethod::SetParameter),
        Some(RtspMethod::Play),
        None,
        Some(RtspMethod::Unknown),
    ];
    for chunk_len in [1, 2, 3, 7, 64, bytes.len()] {
        assert_eq!(parse(&bytes, chunk_len), expected, "{chunk_len} bytes at a time");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn garbage_is_refused_or_waits_for_more(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        let mut parser = RtspParser::default();
        parser.push(&bytes);
        while let Ok(Some(_)) = parser.take() {}
        AccessUnit::parse(&bytes, f64::NAN);
        let text = String::from_utf8_lossy(&bytes);
        RtspTransport::parse(&format!("RTP/AVP;client_port={text}"));
    }
}

fn server() -> RtspServer {
    RtspServer::open(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), format()).unwrap()
}

/// What a client reads.
#[derive(Debug)]
struct Reply {
    status: u16,
    head: String,
    body: String,
}

impl Reply {
    fn header(&self, name: &str) -> Option<&str> {
        let fields = self.head.lines().filter_map(|line| line.split_once(": "));
        fields.into_iter().find(|(found, _)| *found == name).map(|(_, value)| value)
    }

    fn session(&self) -> String {
        self.header("Session").unwrap().split(';').next().unwrap().to_owned()
    }
}

struct Player {
    stream: TcpStream,
    url: String,
    sequence: u32,
}

impl Player {
    fn connect(server: &RtspServer) -> Self {
        let stream = TcpStream::connect(server.address()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        Self { stream, url: server.url(), sequence: 0 }
    }

    /// One that plays on channels 0 and 1, and its session.
    fn playing(server: &RtspServer) -> (Self, String) {
        let mut player = Self::connect(server);
        let session = player.set_up("RTP/AVP/TCP;unicast;interleaved=0-1").session();
        assert_eq!(player.ask("PLAY", &format!("Session: {session}\r\n")).status, 200);
        (player, session)
    }

    fn set_up(&mut self, transport: &str) -> Reply {
        let track = format!("{}/track1", self.url);
        self.ask_about("SETUP", &track, &format!("Transport: {transport}\r\n"))
    }

    fn ask(&mut self, method: &str, headers: &str) -> Reply {
        let url = self.url.clone();
        self.ask_about(method, &url, headers)
    }

    fn ask_about(&mut self, method: &str, url: &str, headers: &str) -> Reply {
        self.send(method, url, headers);
        let reply = self.reply();
        assert_eq!(reply.header("CSeq"), Some(self.sequence.to_string().as_str()));
        reply
    }

    fn send(&mut self, method: &str, url: &str, headers: &str) {
        self.sequence += 1;
        let request = format!("{method} {url} RTSP/1.0\r\nCSeq: {}\r\n{headers}\r\n", self.sequence);
        self.stream.write_all(request.as_bytes()).unwrap();
    }

    /// The next reply; packets before it are thrown away.
    fn reply(&mut self) -> Reply {
        let mut head = self.bytes(1);
        while head[0] == b'$' {
            self.rest_of_packet();
            head = self.bytes(1);
        }
        while !head.ends_with(b"\r\n\r\n") {
            head.extend(self.bytes(1));
        }
        let head = String::from_utf8(head).unwrap();
        let status = head.strip_prefix("RTSP/1.0 ").unwrap()[..3].parse().unwrap();
        let mut reply = Reply { status, head, body: String::new() };
        let body_len = reply.header("Content-Length").map_or(0, |len| len.parse().unwrap());
        reply.body = String::from_utf8(self.bytes(body_len)).unwrap();
        reply
    }

    fn bytes(&mut self, len: usize) -> Vec<u8> {
        let mut bytes = vec![0; len];
        self.stream.read_exact(&mut bytes).unwrap();
        bytes
    }

    fn rest_of_packet(&mut self) -> (u8, Vec<u8>) {
        let header = self.bytes(3);
        let len = u16::from_be_bytes([header[1], header[2]]);
        (header[0], self.bytes(len.into()))
    }

    fn packet(&mut self) -> (u8, Vec<u8>) {
        assert_eq!(self.bytes(1), b"$");
        self.rest_of_packet()
    }

    /// Packets on a channel up to the end of a picture; those of others are thrown away.
    fn picture(&mut self, channel: u8) -> Vec<Vec<u8>> {
        let mut packets = Vec::new();
        while !packets.last().is_some_and(|packet: &Vec<u8>| is_marked(packet)) {
            let (found, packet) = self.packet();
            packets.extend((found == channel).then_some(packet));
        }
        packets
    }

    fn is_closed(&mut self) -> bool {
        match self.stream.read(&mut [0; 64]) {
            Ok(len) => len == 0,
            Err(error) => error.kind() == io::ErrorKind::ConnectionReset,
        }
    }

    fn has_more(&self) -> bool {
        self.stream.set_nonblocking(true).unwrap();
        let more = self.stream.peek(&mut [0]).is_ok();
        self.stream.set_nonblocking(false).unwrap();
        more
    }
}

fn until(mut happened: impl FnMut() -> bool) {
    let start = Instant::now();
    while !happened() {
        assert!(start.elapsed() < PATIENCE, "it never happened");
        thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_player_gets_pictures_over_its_connection() {
    let server = server();
    let mut player = Player::connect(&server);
    assert!(player.ask("OPTIONS", "").header("Public").unwrap().contains("DESCRIBE"));
    let described = player.ask("DESCRIBE", "Accept: application/sdp\r\n");
    assert_eq!(described.header("Content-Type"), Some("application/sdp"));
    assert_eq!(described.header("Content-Base"), Some(format!("{}/", server.url()).as_str()));
    assert_eq!(described.body, describe(&format(), IpAddr::from(Ipv4Addr::LOCALHOST)));
    let set_up = player.set_up("RTP/AVP/TCP;unicast;interleaved=2-3");
    assert!(set_up.header("Transport").unwrap().starts_with("RTP/AVP/TCP;unicast;interleaved=2-3;ssrc="));
    let session = format!("Session: {}\r\n", set_up.session());
    assert!(!server.is_watched() && !server.take_newcomers());

    let played = player.ask("PLAY", &(session.clone() + "Range: npt=0.000-\r\n"));
    assert!(server.is_watched() && server.take_newcomers() && !server.take_newcomers());
    server.send(&picture(20), 0.0);
    server.send(&key_picture(5000), 1.0);
    server.send(&picture(30), 2.0);
    let packets = player.picture(2);
    assert!(played.header("RTP-Info").unwrap().ends_with(&format!("/track1;seq={}", sequence(&packets[0]))));
    assert_eq!(timestamp(&packets[0]), 90_000, "the picture before the key picture is of no use");
    assert_eq!(reassemble(&packets)[2], nal_unit(0x65, 5000));
    let (channel, report) = player.packet();
    assert_eq!((channel, report[1]), (3, 200));
    assert_eq!(reassemble(&player.picture(2)), [nal_unit(0x41, 30)]);

    player.stream.write_all(b"$\x03\x00\x08\x81\xC9\x00\x01RRRR").unwrap();
    assert_eq!(player.ask("GET_PARAMETER", &session).status, 200);
    assert_eq!(player.ask("PAUSE", &session).status, 200);
    assert!(!server.is_watched());
    assert_eq!(player.ask("PLAY", &session).status, 200);
    assert!(server.take_newcomers());
    assert_eq!(player.ask("TEARDOWN", &session).status, 200);
    assert!(!server.is_watched());
    assert_eq!(player.ask("PLAY", &session).status, 454);
}

#[test]
fn a_player_gets_pictures_by_udp() {
    let server = server();
    let sockets = [0; 2].map(|port| UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).unwrap());
    for socket in &sockets {
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
    }
    let [rtp_port, rtcp_port] = sockets.each_ref().map(|socket| socket.local_addr().unwrap().port());
    let mut player = Player::connect(&server);
    let set_up = player.set_up(&format!("RTP/AVP;unicast;client_port={rtp_port}-{rtcp_port}"));
    let transport = set_up.header("Transport").unwrap();
    let server_port = transport.split("server_port=").nth(1).unwrap().split('-').next().unwrap();
    let server_port: u16 = server_port.parse().unwrap();
    assert!(server_port.is_multiple_of(2) && transport.contains(&format!("-{};", server_port + 1)), "{transport}");
    assert_eq!(player.ask("PLAY", &format!("Session: {}\r\n", set_up.session())).status, 200);

    server.send(&key_picture(4000), 0.0);
    let receive = |socket: &UdpSocket| {
        let mut bytes = [0; 2048];
        let (len, from) = socket.recv_from(&mut bytes).unwrap();
        (bytes[..len].to_vec(), from.port())
    };
    let mut packets: Vec<Vec<u8>> = Vec::new();
    while !packets.last().is_some_and(|packet| is_marked(packet)) {
        let (packet, port) = receive(&sockets[0]);
        assert_eq!(port, server_port);
        packets.push(packet);
    }
    assert_eq!(reassemble(&packets)[2], nal_unit(0x65, 4000));
    let (report, port) = receive(&sockets[1]);
    assert_eq!((report[1], port), (200, server_port + 1));
}

#[test]
fn two_players_have_sessions_of_their_own() {
    let server = server();
    let [(mut one, session), (mut other, other_session)] = [(); 2].map(|()| Player::playing(&server));
    assert_ne!(session, other_session);
    assert_eq!(one.ask("PAUSE", &format!("Session: {other_session}\r\n")).status, 454);
    server.send(&key_picture(100), 0.0);
    let [first, second] = [&mut one, &mut other].map(|player| player.picture(0));
    assert_eq!(reassemble(&first), reassemble(&second));
    assert_ne!(first[0][8..12], second[0][8..12], "each has its own source");
    assert_eq!(one.ask("TEARDOWN", &format!("Session: {session}; timeout=60\r\n")).status, 200);
    assert!(server.is_watched());
    drop(other);
    until(|| !server.is_watched());
}

#[test]
fn what_is_not_offered_is_refused() {
    let server = server();
    let mut player = Player::connect(&server);
    let other_path = server.url().replace("camera", "kamera");
    assert_eq!(player.ask_about("DESCRIBE", &other_path, "").status, 404);
    assert_eq!(player.ask_about("DESCRIBE", &(server.url() + "/?tcp"), "").status, 200);
    assert_eq!(player.ask("RECORD", "").status, 405);
    assert_eq!(player.ask("BREW", "").status, 501);
    assert_eq!(player.ask("PLAY", "").status, 454);
    assert_eq!(player.ask("SETUP", "").status, 461);
    assert_eq!(player.set_up("RTP/AVP;multicast").status, 461);
    assert_eq!(player.ask("GET_PARAMETER", "Session: 1\r\n").status, 454);
    assert_eq!(player.ask("SET_PARAMETER", "").status, 200);
    let (mut playing, _) = Player::playing(&server);
    assert_eq!(playing.set_up("RTP/AVP/TCP;interleaved=0-1").status, 455);
}

#[test]
fn garbage_ends_only_its_own_connection() {
    let server = server();
    let mut huge = b"OPTIONS * RTSP/1.0\r\nCSeq: 1\r\nJunk: ".to_vec();
    huge.extend([b'x'; 2 * HEAD_LIMIT]);
    for (bytes, status) in [
        (&b"GET / HTTP/1.1\r\nHost: a\r\n\r\n"[..], 400),
        (b"OPTIONS * RTSP/1.0\r\n\r\n", 400),
        (b"OPTIONS * RTSP/1.0\r\nCSeq: 1\r\njunk\r\n\r\n", 400),
        (b"OPTIONS * RTSP/1.0\r\nCSeq: 1\r\nContent-Length: -1\r\n\r\n", 400),
        (b"\xFF\xFE\x00\n\n", 400),
        (b"OPTIONS * RTSP/2.0\r\nCSeq: 1\r\n\r\n", 505),
        (&huge, 413),
    ] {
        let mut player = Player::connect(&server);
        player.stream.write_all(bytes).unwrap();
        assert_eq!(player.reply().status, status);
        assert!(player.is_closed());
    }
    let mut halved = Player::connect(&server);
    halved.stream.write_all(b"OPTIONS rtsp://").unwrap();
    drop(halved);
    assert_eq!(Player::connect(&server).ask("OPTIONS", "").status, 200);
}

#[test]
fn one_client_too_many_is_told_so() {
    let server = server();
    let mut players: Vec<Player> = (0..CLIENTS).map(|_| Player::connect(&server)).collect();
    assert!(players.iter_mut().all(|player| player.ask("OPTIONS", "").status == 200));
    let mut late = Player::connect(&server);
    late.send("OPTIONS", &server.url(), "");
    assert_eq!(late.reply().status, 503);
    assert!(late.is_closed());
    players.pop();
    until(|| {
        let mut late = Player::connect(&server);
        late.send("OPTIONS", &server.url(), "");
        late.reply().status == 200
    });
}

#[test]
fn a_slow_client_delays_no_other_and_goes_on_from_a_key_picture() {
    let server = server();
    let [(mut slow, _), (mut quick, _)] = [(); 2].map(|()| Player::playing(&server));
    assert!(server.take_newcomers());
    // More than the sockets between two ends on one machine can hold.
    let pictures = 40;
    let len = 1 << 20;
    server.send(&key_picture(len), 0.0);
    quick.picture(0);
    for number in 1..=pictures {
        server.send(&picture(len), f64::from(number));
        assert_eq!(timestamp(&quick.picture(0)[0]), number * 90_000);
    }

    // What waited comes without a gap; then a key picture is asked for.
    let mut seen = Vec::new();
    until(|| {
        while slow.has_more() {
            seen.push(timestamp(&slow.picture(0)[0]) / 90_000);
        }
        server.take_newcomers()
    });
    server.send(&picture(9), 98.0);
    server.send(&key_picture(9), 99.0);
    while seen.last() != Some(&99) {
        seen.push(timestamp(&slow.picture(0)[0]) / 90_000);
    }
    seen.pop();
    assert_eq!(seen, (0..seen.len() as u32).collect::<Vec<_>>());
    assert!(seen.len() < pictures as usize);
}

#[test]
fn a_silent_client_is_dropped_unless_it_plays() {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let server = RtspServer::with_silence_limit(address, format(), Duration::from_millis(600)).unwrap();
    let (mut playing, session) = Player::playing(&server);
    let mut silent = Player::connect(&server);
    assert!(silent.is_closed());
    assert!(server.is_watched());
    assert_eq!(playing.ask("PLAY", &format!("Session: {session}\r\n")).status, 200);
}

#[test]
fn dropping_the_server_closes_its_connections() {
    let server = server();
    let (mut playing, _) = Player::playing(&server);
    let mut idle = Player::connect(&server);
    assert_eq!(idle.ask("OPTIONS", "").status, 200);
    drop(server);
    assert!(playing.is_closed() && idle.is_closed());
}

#[test]
fn an_address_in_use_and_a_wrong_format_are_errors() {
    let server = server();
    let taken = RtspServer::open(server.address(), format()).unwrap_err().to_string();
    assert!(taken.starts_with(&format!("cannot listen at {}: ", server.address())), "{taken}");
    let wrong = VideoFormat { sequence_parameter_set: vec![0, 0, 0, 1, 0x67, 0x42], ..format() };
    let error = RtspServer::open(SocketAddr::from((Ipv4Addr::LOCALHOST, 0)), wrong).unwrap_err();
    assert!(error.to_string().ends_with("found 6 bytes that are none"), "{error}");
}

#[test]
fn the_url_of_any_address_is_that_of_this_machine() {
    let server = RtspServer::open(SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)), format()).unwrap();
    assert_eq!(server.url(), format!("rtsp://127.0.0.1:{}/camera", server.address().port()));
}
