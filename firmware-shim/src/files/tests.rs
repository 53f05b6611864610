use proptest::prelude::*;

use super::*;

const STATION: [u8; 2] = [255, 190];
const ANOTHER: [u8; 2] = [245, 190];

const ACKNOWLEDGED: u8 = 128;
const REFUSED: u8 = 129;

const NOTHING: u8 = 0;
const TERMINATE: u8 = 1;
const RESET: u8 = 2;
const LIST: u8 = 3;
const OPEN: u8 = 4;
const READ: u8 = 5;
const CHECKSUM: u8 = 14;
const BURST: u8 = 15;

/// Bytes of the long file: more than three bursts, and no whole number of packets.
const LONG: usize = 3 * BURST_PACKETS * DATA_LIMIT + 100;

fn long() -> Vec<u8> {
    (0..LONG).map(|place| (place * 7 % 251) as u8).collect()
}

/// A server and its time.
struct Rig {
    server: FileServer,
    sequence: u16,
    secs: f64,
}

/// An answer, as a client reads it.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Heard {
    sequence: u16,
    session: u8,
    operation: u8,
    asked: u8,
    complete: u8,
    offset: u32,
    data: Vec<u8>,
}

/// A request in words.
#[derive(Clone, Copy)]
struct Asked<'a> {
    operation: u8,
    session: u8,
    offset: u32,
    size: usize,
    data: &'a [u8],
}

fn asked(operation: u8) -> Asked<'static> {
    Asked { operation, session: 0, offset: 0, size: 0, data: &[] }
}

fn of_path(operation: u8, path: &str) -> Asked<'_> {
    Asked { size: path.len(), data: path.as_bytes(), ..asked(operation) }
}

fn packet(sequence: u16, asked: Asked) -> [u8; PACKET_LEN] {
    let mut packet = [0; PACKET_LEN];
    packet[..2].copy_from_slice(&sequence.to_le_bytes());
    packet[2..5].copy_from_slice(&[asked.session, asked.operation, asked.size as u8]);
    packet[8..12].copy_from_slice(&asked.offset.to_le_bytes());
    packet[12..12 + asked.data.len()].copy_from_slice(asked.data);
    packet
}

fn heard(packet: &[u8; PACKET_LEN]) -> Heard {
    Heard {
        sequence: u16::from_le_bytes([packet[0], packet[1]]),
        session: packet[2],
        operation: packet[3],
        asked: packet[5],
        complete: packet[6],
        offset: u32::from_le_bytes([packet[8], packet[9], packet[10], packet[11]]),
        data: packet[12..12 + usize::from(packet[4])].to_vec(),
    }
}

impl Rig {
    fn new() -> Self {
        let files = vec![ServedFile::new("short.txt", b"123456789".to_vec()), ServedFile::new("long.bin", long())];
        Self { server: FileServer::new(files), sequence: 0, secs: 0.0 }
    }

    /// The answers to a new request.
    fn all(&mut self, sender: [u8; 2], asked: Asked) -> Vec<Heard> {
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        let answers: Vec<Heard> =
            self.server.handle(&packet(sequence, asked), sender, self.secs).iter().map(heard).collect();
        for (answer, place) in answers.iter().zip(1..) {
            assert_eq!(answer.sequence, sequence.wrapping_add(place));
            assert_eq!(answer.asked, asked.operation);
        }
        answers
    }

    fn one(&mut self, sender: [u8; 2], asked: Asked) -> Heard {
        let mut answers = self.all(sender, asked);
        assert_eq!(answers.len(), 1);
        answers.remove(0)
    }

    fn open(&mut self, sender: [u8; 2], path: &str) -> u8 {
        let opened = self.one(sender, of_path(OPEN, path));
        assert_eq!(opened.operation, ACKNOWLEDGED, "{opened:?}");
        opened.session
    }

    fn refusal(&mut self, asked: Asked) -> u8 {
        let refused = self.one(STATION, asked);
        assert_eq!((refused.operation, refused.data.len()), (REFUSED, 1), "{refused:?}");
        refused.data[0]
    }

    /// A whole file, read packet by packet.
    fn read(&mut self, sender: [u8; 2], session: u8) -> Vec<u8> {
        let mut content = Vec::new();
        loop {
            let asked = Asked { session, offset: content.len() as u32, size: DATA_LIMIT, ..asked(READ) };
            let answer = self.one(sender, asked);
            assert_eq!((answer.session, answer.offset), (session, asked.offset));
            if answer.operation == REFUSED {
                assert_eq!(answer.data, [FileRefusal::EndOfFile as u8]);
                return content;
            }
            content.extend(answer.data);
        }
    }
}

#[test]
fn a_folder_is_listed_to_its_end() {
    let mut rig = Rig::new();
    for path in ["/", "", ".", "/\0"] {
        let listed = rig.one(STATION, of_path(LIST, path));
        assert_eq!(listed.data, format!("Fshort.txt\t9\0Flong.bin\t{LONG}\0").into_bytes());
        let rest = rig.one(STATION, Asked { offset: 1, ..of_path(LIST, path) });
        assert_eq!(rest.data, format!("Flong.bin\t{LONG}\0").into_bytes());
        for offset in [2, u32::MAX] {
            let end = rig.refusal(Asked { offset, ..of_path(LIST, path) });
            assert_eq!(end, FileRefusal::EndOfFile as u8);
        }
    }
}

#[test]
fn a_folder_that_does_not_fit_a_packet_is_listed_in_parts() {
    let files = (0..20).map(|_| ServedFile::new("one_of_many_with_a_long_name.json", vec![0; 1000])).collect();
    let mut server = FileServer::new(files);
    let mut entries = 0;
    for sequence in 0.. {
        let request = packet(sequence, Asked { offset: entries as u32, ..of_path(LIST, "/") });
        let answer = heard(&server.handle(&request, STATION, 0.0)[0]);
        if answer.operation == REFUSED {
            break;
        }
        assert_eq!(answer.data.last(), Some(&0), "whole entries");
        entries += String::from_utf8(answer.data).unwrap().matches('\0').count();
    }
    assert_eq!(entries, 20);
}

#[test]
fn a_whole_file_is_read_packet_by_packet() {
    let mut rig = Rig::new();
    let opened = rig.one(STATION, of_path(OPEN, "/long.bin"));
    assert_eq!(opened.data, (LONG as u32).to_le_bytes());
    assert!(rig.read(STATION, opened.session) == long());
    let closed = rig.one(STATION, Asked { session: opened.session, ..asked(TERMINATE) });
    assert_eq!((closed.operation, closed.data.len()), (ACKNOWLEDGED, 0));
}

#[test]
fn a_whole_file_is_read_by_bursts_of_any_size() {
    for size in [0, 80, DATA_LIMIT] {
        let mut rig = Rig::new();
        let session = rig.open(STATION, "long.bin");
        let mut content = Vec::new();
        loop {
            let asked = Asked { session, offset: content.len() as u32, size, ..asked(BURST) };
            let burst = rig.all(STATION, asked);
            if burst[0].operation == REFUSED {
                assert_eq!((burst[0].data[0], burst.len()), (FileRefusal::EndOfFile as u8, 1));
                break;
            }
            assert!(burst.len() <= BURST_PACKETS);
            let (last, others) = burst.split_last().unwrap();
            assert!(last.complete == 1 && others.iter().all(|answer| answer.complete == 0));
            for answer in burst {
                assert_eq!((answer.offset as usize, answer.session), (content.len(), session));
                content.extend(answer.data);
                let whole = if size == 0 { DATA_LIMIT } else { size };
                assert!(content.len() == LONG || content.len() % whole == 0, "only the last packet is short");
            }
        }
        assert!(content == long(), "{size}");
    }
}

#[test]
fn a_request_whose_answer_was_lost_is_answered_again_in_the_same_words() {
    let mut rig = Rig::new();
    for asked in [
        of_path(OPEN, "long.bin"),
        Asked { size: DATA_LIMIT, offset: 500, ..asked(BURST) },
        Asked { size: 10, offset: 500, ..asked(READ) },
        asked(TERMINATE),
        asked(RESET),
    ] {
        let first = rig.all(STATION, asked);
        assert_eq!(first[0].operation, ACKNOWLEDGED);
        // Another peer with the same number in between changes nothing.
        rig.server.handle(&packet(rig.sequence, of_path(OPEN, "short.txt")), ANOTHER, rig.secs);
        rig.sequence = rig.sequence.wrapping_sub(1);
        assert_eq!(rig.all(STATION, asked), first);
    }
    assert!(rig.server.sessions.iter().all(|session| session.owner == ANOTHER), "one was opened, once");
}

#[test]
fn another_request_of_the_same_number_is_no_repetition() {
    let mut rig = Rig::new();
    let answer =
        |rig: &mut Rig, path| heard(&rig.server.handle(&packet(0, of_path(CHECKSUM, path)), STATION, 0.0)[0]);
    let (short, long) = (answer(&mut rig, "short.txt"), answer(&mut rig, "long.bin"));
    assert_ne!(short.data, long.data);
}

#[test]
fn several_stations_read_at_once_each_in_its_own_session_0() {
    let mut rig = Rig::new();
    assert_eq!([rig.open(STATION, "long.bin"), rig.open(ANOTHER, "short.txt")], [0, 0]);
    assert_eq!(rig.open(STATION, "short.txt"), 1);
    assert!(rig.read(STATION, 0) == long());
    assert_eq!(rig.read(ANOTHER, 0), b"123456789");
    assert_eq!(rig.read(STATION, 1), b"123456789");
    rig.one(STATION, asked(RESET));
    assert_eq!(rig.refusal(Asked { size: 1, ..asked(READ) }), FileRefusal::InvalidSession as u8);
    assert_eq!(rig.read(ANOTHER, 0), b"123456789", "it keeps its own");
    assert_eq!(rig.open(STATION, "long.bin"), 0);
}

#[test]
fn when_all_sessions_are_taken_the_one_that_lies_idle_longest_is_given_up() {
    let mut rig = Rig::new();
    for station in 0..SESSIONS as u8 {
        rig.secs = f64::from(station) * 0.1;
        rig.open([station, 1], "long.bin");
    }
    assert_eq!(rig.refusal(of_path(OPEN, "long.bin")), FileRefusal::NoSessionsAvailable as u8);
    // Reading keeps the first one.
    let first = Asked { size: 5, ..asked(READ) };
    assert_eq!(rig.one([0, 1], first).operation, ACKNOWLEDGED);
    rig.secs = IDLE_SECS + 0.15;
    assert_eq!(rig.open(STATION, "long.bin"), 0);
    assert_eq!(rig.one([1, 1], first).data, [FileRefusal::InvalidSession as u8]);
    for station in [0, 2, 3] {
        assert_eq!(rig.one([station, 1], first).operation, ACKNOWLEDGED);
    }
    assert_eq!(rig.one(ANOTHER, of_path(OPEN, "long.bin")).operation, REFUSED, "no other lies idle");
}

#[test]
fn what_a_client_left_open_is_closed_when_it_comes_back() {
    let mut rig = Rig::new();
    assert_eq!(rig.open(STATION, "short.txt"), 0);
    rig.secs = IDLE_SECS;
    assert_eq!(rig.open(STATION, "long.bin"), 0, "a client that speaks of session 0 only reads this file");
    assert_eq!(rig.server.sessions.len(), 1);
}

#[test]
fn what_cannot_be_done_is_refused_with_its_reason() {
    use FileRefusal::{EndOfFile, FileNotFound, FileProtected, InvalidDataSize, InvalidSession, UnknownCommand};
    let mut rig = Rig::new();
    rig.open(STATION, "short.txt");
    let too_long = DATA_LIMIT + 1;
    let cases = [
        (of_path(OPEN, "/absent.json"), FileNotFound),
        (of_path(OPEN, "/folder/short.txt"), FileNotFound),
        (of_path(OPEN, "/"), FileNotFound),
        (of_path(LIST, "/folder"), FileNotFound),
        (of_path(CHECKSUM, "/absent.json"), FileNotFound),
        (Asked { size: 2, data: &[0xff, 0xfe], ..asked(OPEN) }, FileNotFound),
        (Asked { size: too_long, ..of_path(OPEN, "short.txt") }, InvalidDataSize),
        (Asked { size: too_long, ..asked(LIST) }, InvalidDataSize),
        (Asked { size: too_long, ..asked(READ) }, InvalidDataSize),
        (Asked { size: too_long, ..asked(BURST) }, InvalidDataSize),
        (asked(READ), InvalidDataSize),
        (Asked { size: 5, session: 1, ..asked(READ) }, InvalidSession),
        (Asked { session: 1, ..asked(BURST) }, InvalidSession),
        (Asked { session: 1, ..asked(TERMINATE) }, InvalidSession),
        (Asked { size: 5, offset: 9, ..asked(READ) }, EndOfFile),
        (Asked { offset: u32::MAX, ..asked(BURST) }, EndOfFile),
        (asked(16), UnknownCommand),
        (asked(255), UnknownCommand),
    ];
    for (asked, refusal) in cases {
        assert_eq!(rig.refusal(asked), refusal as u8, "operation {} offset {}", asked.operation, asked.offset);
    }
    for writing in 6..=13 {
        assert_eq!(rig.refusal(of_path(writing, "short.txt")), FileProtected as u8);
    }
    assert_eq!(rig.one(STATION, asked(NOTHING)).operation, ACKNOWLEDGED);
    assert_eq!(rig.read(STATION, 0), b"123456789", "nothing has changed");
}

#[test]
fn an_answer_is_not_answered() {
    let mut rig = Rig::new();
    for operation in [ACKNOWLEDGED, REFUSED] {
        assert!(rig.all(STATION, asked(operation)).is_empty());
    }
}

/// The number is `zlib.crc32(b"123456789", 0xffffffff) ^ 0xffffffff` of Python.
#[test]
fn the_checksum_of_a_file_is_that_of_px4() {
    let mut rig = Rig::new();
    let told = rig.one(STATION, of_path(CHECKSUM, "/short.txt"));
    assert_eq!(told.data, 0x2dfd_2d88_u32.to_le_bytes());
    assert_eq!(rig.server.checksum("short.txt"), Some(0x2dfd_2d88));
    assert_eq!(rig.server.checksum("absent"), None);
}

#[test]
fn numbers_of_answers_go_round() {
    let mut rig = Rig::new();
    rig.sequence = u16::MAX - 4;
    rig.open(STATION, "long.bin");
    assert_eq!(rig.all(STATION, asked(BURST)).len(), BURST_PACKETS);
}

fn any_packet() -> impl Strategy<Value = ([u8; PACKET_LEN], u8, f64)> {
    let header = (any::<u8>(), 0..3_u8, prop_oneof![0..16_u8, any::<u8>()], any::<u8>());
    let offset = prop_oneof![Just(0_u32), 0..LONG as u32 + 300, any::<u32>()];
    let path =
        prop_oneof![Just(b"/long.bin".to_vec()), Just(Vec::new()), prop::collection::vec(any::<u8>(), 0..239)];
    (header, offset, path, 0..12_u8, 0.0..30.0).prop_map(|(header, offset, path, sender, secs)| {
        let (sequence, session, operation, size) = header;
        let size = if path.is_empty() { size.into() } else { path.len() };
        let asked = Asked { operation, session, offset, size, data: &path };
        (packet(sequence.into(), asked), sender, secs)
    })
}

proptest! {
    #[test]
    fn whatever_comes_the_answers_are_few_and_right_and_nothing_grows(
        packets in prop::collection::vec(any_packet(), 1..60)
    ) {
        let mut rig = Rig::new();
        for (packet, sender, secs) in packets {
            let answers = rig.server.handle(&packet, [sender, 1], secs).to_vec();
            prop_assert!(answers.len() <= BURST_PACKETS);
            for answer in answers {
                let answer = heard(&answer);
                prop_assert!([ACKNOWLEDGED, REFUSED].contains(&answer.operation));
                if answer.operation == ACKNOWLEDGED && [READ, BURST].contains(&answer.asked) {
                    let (offset, len) = (answer.offset as usize, answer.data.len());
                    let (whole, short) = (long(), b"123456789");
                    let right = whole.get(offset..offset + len) == Some(&answer.data[..])
                        || short.get(offset..offset + len) == Some(&answer.data[..]);
                    prop_assert!(right && len > 0);
                }
            }
            prop_assert!(rig.server.sessions.len() <= SESSIONS);
            prop_assert!(rig.server.exchanges.len() <= EXCHANGES);
        }
    }

    #[test]
    fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), PACKET_LEN), secs in any::<f64>()) {
        let mut rig = Rig::new();
        rig.open(STATION, "long.bin");
        let bytes: [u8; PACKET_LEN] = bytes.try_into().unwrap();
        prop_assert!(rig.server.handle(&bytes, STATION, secs).len() <= BURST_PACKETS);
    }
}
