//! A stream of bytes as a link needs it: frames in, frames out, and never a wait.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use super::{DATAGRAM_LIMIT, DATAGRAMS_PER_ENDPOINT};
use crate::frame::Receiver;

/// Bytes that are read at once.
const CHUNK: usize = 1024;

/// Bytes of the shortest frame, one of MAVLink 1 without a payload.
const SHORTEST_FRAME: usize = 8;

/// Bytes that are read in one control period: no more than an endpoint's share of frames. What a flood brings beyond
/// waits with its sender.
const BYTES_PER_PERIOD: usize = SHORTEST_FRAME * DATAGRAMS_PER_ENDPOINT as usize;

/// A peer at the other end of a non-blocking stream. Its memory is a chunk, a frame and the frames that wait.
#[derive(Debug)]
pub(super) struct Stream<S> {
    bytes: S,
    receiver: Receiver,
    chunk: [u8; CHUNK],
    /// What of the chunk is not yet read.
    unread: std::ops::Range<usize>,
    bytes_left: usize,
    waiting: VecDeque<u8>,
    waiting_limit: usize,
    /// When the other end last took something, or nothing waited.
    moved: Instant,
}

impl<S: Read + Write> Stream<S> {
    /// A stream `bytes` that does not block, for which at most `waiting_limit` bytes wait to be taken.
    pub(super) fn new(bytes: S, waiting_limit: usize) -> Self {
        Self {
            bytes,
            receiver: Receiver::new(),
            chunk: [0; CHUNK],
            unread: 0..0,
            bytes_left: 0,
            waiting: VecDeque::new(),
            waiting_limit,
            moved: Instant::now(),
        }
    }

    /// Begins a control period: sends what waits.
    pub(super) fn advance(&mut self) -> io::Result<()> {
        self.bytes_left = BYTES_PER_PERIOD;
        self.flush()
    }

    /// Bytes of the next good frame in `buffer`, if it has arrived; anything else is skipped.
    pub(super) fn receive(&mut self, buffer: &mut [u8; DATAGRAM_LIMIT]) -> io::Result<Option<usize>> {
        loop {
            let Some(position) = self.unread.next() else {
                if self.read()? {
                    continue;
                }
                return Ok(None);
            };
            if let Some(Ok(frame)) = self.receiver.push(self.chunk[position]) {
                buffer[..frame.bytes.len()].copy_from_slice(frame.bytes);
                return Ok(Some(frame.bytes.len()));
            }
        }
    }

    /// Whether there was anything to read.
    fn read(&mut self) -> io::Result<bool> {
        let wanted = self.bytes_left.min(CHUNK);
        if wanted == 0 {
            return Ok(false);
        }
        match self.bytes.read(&mut self.chunk[..wanted]) {
            Ok(0) => Err(ErrorKind::UnexpectedEof.into()),
            Ok(len) => {
                self.bytes_left -= len;
                self.unread = 0..len;
                Ok(true)
            }
            Err(error) if is_momentary(&error) => Ok(false),
            Err(error) => Err(error),
        }
    }

    /// Sends a whole frame, or loses it if too much waits already.
    pub(super) fn send(&mut self, frame: &[u8]) -> io::Result<()> {
        if self.waiting.len() + frame.len() <= self.waiting_limit {
            self.waiting.extend(frame);
        }
        self.flush()
    }

    fn flush(&mut self) -> io::Result<()> {
        while !self.waiting.is_empty() {
            match self.bytes.write(self.waiting.as_slices().0) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(len) => drop(self.waiting.drain(..len)),
                Err(error) if is_momentary(&error) => return Ok(()),
                Err(error) => return Err(error),
            }
            self.moved = Instant::now();
        }
        self.moved = Instant::now();
        Ok(())
    }

    /// Bytes that wait.
    #[cfg(test)]
    pub(super) fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// How long the other end has taken nothing of what waits.
    pub(super) fn stalled(&self) -> Duration {
        self.moved.elapsed()
    }
}

fn is_momentary(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

#[cfg(test)]
mod tests {
    use mavlink::dialects::common::HEARTBEAT_DATA;

    use super::*;
    use crate::testing::datagram;

    /// Gives a few bytes at a time and takes a few, or none.
    struct Trickle {
        given: VecDeque<u8>,
        taken: Vec<u8>,
        at_once: usize,
        room: usize,
    }

    impl Read for Trickle {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            if self.given.is_empty() {
                return Err(ErrorKind::WouldBlock.into());
            }
            let len = self.at_once.min(buffer.len());
            self.given.read(&mut buffer[..len])
        }
    }

    impl Write for Trickle {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let len = self.at_once.min(bytes.len()).min(self.room - self.taken.len());
            if len == 0 {
                return Err(ErrorKind::WouldBlock.into());
            }
            self.taken.extend(&bytes[..len]);
            Ok(len)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn stream(given: &[u8], at_once: usize, room: usize) -> Stream<Trickle> {
        let given = given.iter().copied().collect();
        Stream::new(Trickle { given, taken: Vec::new(), at_once, room }, 100)
    }

    fn frames(stream: &mut Stream<Trickle>) -> usize {
        let mut buffer = [0; DATAGRAM_LIMIT];
        std::iter::from_fn(|| stream.receive(&mut buffer).unwrap()).count()
    }

    #[test]
    fn frames_are_cut_wherever_the_bytes_are_torn() {
        let heartbeat = datagram(&HEARTBEAT_DATA::default());
        for at_once in 1..30 {
            let mut stream = stream(&[&b"noise"[..], &heartbeat, &heartbeat].concat(), at_once, 0);
            stream.advance().unwrap();
            let mut buffer = [0; DATAGRAM_LIMIT];
            for _ in 0..2 {
                let len = stream.receive(&mut buffer).unwrap().unwrap();
                assert_eq!(buffer[..len], heartbeat);
            }
            assert_eq!(stream.receive(&mut buffer).unwrap(), None);
        }
    }

    #[test]
    fn a_flood_waits_for_later_periods_and_nothing_of_it_is_torn() {
        let heartbeat = datagram(&HEARTBEAT_DATA::default());
        assert_eq!((heartbeat.len(), BYTES_PER_PERIOD), (21, 2048));
        let mut stream = stream(&heartbeat.repeat(200), usize::MAX, 0);
        assert_eq!(frames(&mut stream), 0, "no period has begun");
        for expected in [97, 98, 5, 0] {
            stream.advance().unwrap();
            assert_eq!(frames(&mut stream), expected);
        }
    }

    #[test]
    fn noise_is_read_a_share_at_a_time() {
        let mut stream = stream(&vec![0; 3 * BYTES_PER_PERIOD], usize::MAX, 0);
        for left in [2 * BYTES_PER_PERIOD, BYTES_PER_PERIOD, 0] {
            stream.advance().unwrap();
            assert_eq!(frames(&mut stream), 0);
            assert_eq!(stream.bytes.given.len(), left);
        }
    }

    #[test]
    fn what_is_not_taken_waits_up_to_the_limit_and_frames_stay_whole() {
        let mut stream = stream(&[], 7, 13);
        (0..9_u8).for_each(|number| stream.send(&[number; 30]).unwrap());
        assert_eq!(stream.waiting(), 3 * 30 - 13, "of a limit of 100");
        stream.bytes.room = usize::MAX;
        stream.advance().unwrap();
        let whole: Vec<u8> = (0..3).flat_map(|number| [number; 30]).collect();
        assert_eq!(stream.bytes.taken, whole);
    }

    #[test]
    fn an_end_is_told_and_a_full_stream_stalls() {
        let mut stream = stream(&[], 7, 0);
        stream.send(&[1; 30]).unwrap();
        let before = stream.stalled();
        std::thread::sleep(Duration::from_millis(2));
        stream.advance().unwrap();
        assert!(stream.stalled() > before);
        stream.bytes.room = usize::MAX;
        stream.advance().unwrap();
        assert!(stream.stalled() < Duration::from_secs(1));
        let mut ended = Stream::new(io::Cursor::new(Vec::new()), 100);
        ended.advance().unwrap();
        let error = ended.receive(&mut [0; DATAGRAM_LIMIT]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::UnexpectedEof);
    }
}
