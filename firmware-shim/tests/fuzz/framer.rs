//! Bytes to frames: of a datagram, and of a stream.

use kestrel_shim::frame::{FRAME_LIMIT, Frame, FrameError, Frames, Receiver};

use crate::effort::{self, Effort};
use crate::sample::{FuzzSamples, Kind};

const FRAMES: u64 = 300_000;

#[test]
fn no_bytes_make_the_framer_panic_hang_grow_or_believe() {
    let count = effort::number("FUZZ_FRAMES", FRAMES);
    let mut samples = FuzzSamples::new(effort::seed());
    let mut stream = Stream { receiver: Receiver::new(), synchronous: true };
    // What is allocated once is allocated now.
    stream.read(samples.next());
    let effort = Effort::begin();
    let mut good = 0;
    for _ in 0..count {
        let (kind, bytes) = samples.next();
        good += u64::from(read_datagram(kind, bytes));
        stream.read((kind, bytes));
    }
    effort.end(count, "frames of datagrams and of a stream");
    assert!(good > count / 10, "{good} good frames of {count}");
}

#[test]
fn the_state_of_a_stream_is_small() {
    assert!(size_of::<Receiver>() <= 600, "{} bytes", size_of::<Receiver>());
}

/// How many frames were good.
fn read_datagram(kind: Kind, bytes: &[u8]) -> u32 {
    let mut good = 0;
    let mut read = 0;
    for found in Frames::new(bytes) {
        read += 1;
        assert!(read <= bytes.len(), "more frames than bytes");
        judge(kind, found, bytes);
        good += u32::from(found.is_ok());
    }
    if expected(kind) {
        assert_eq!(read, 1, "{kind:?}: {bytes:02x?}");
    }
    good
}

/// A stream through all of what comes.
struct Stream {
    receiver: Receiver,
    /// Whether the next byte begins a frame.
    synchronous: bool,
}

impl Stream {
    fn read(&mut self, (kind, bytes): (Kind, &[u8])) {
        // Every other time what follows garbage is read without a chance to recover.
        if !self.synchronous && bytes.len() % 2 == 0 {
            self.recover();
        }
        let mut read = 0;
        for (index, byte) in bytes.iter().enumerate() {
            let Some(found) = self.receiver.push(*byte) else { continue };
            read += 1;
            if self.synchronous {
                judge(kind, found, bytes);
            } else if let Ok(frame) = found {
                check(&frame);
            }
            assert!(
                !self.synchronous || !expected(kind) || index + 1 == bytes.len(),
                "it ends with its last byte"
            );
        }
        if self.synchronous && expected(kind) {
            assert_eq!(read, u32::from(kind != Kind::Truncated), "{kind:?}: {bytes:02x?}");
        }
        self.synchronous &= !matches!(kind, Kind::Noise | Kind::Truncated | Kind::Mutated);
    }

    /// However long the frame was that never came, so many bytes end it.
    fn recover(&mut self) {
        for _ in 0..FRAME_LIMIT {
            if let Some(Ok(frame)) = self.receiver.push(0) {
                check(&frame);
            }
        }
        self.synchronous = true;
    }
}

/// Whether it is known what must be found.
fn expected(kind: Kind) -> bool {
    match kind {
        Kind::Good | Kind::Damaged | Kind::Unknown | Kind::Flagged | Kind::Truncated | Kind::Nested => true,
        Kind::Noise | Kind::Mutated => false,
    }
}

fn judge(kind: Kind, found: Result<Frame, FrameError>, bytes: &[u8]) {
    let right = match (kind, &found) {
        (Kind::Good, Ok(frame)) => frame.bytes == bytes,
        (Kind::Damaged | Kind::Nested, Err(FrameError::Checksum(_)))
        | (Kind::Unknown | Kind::Nested, Err(FrameError::Message(_)))
        | (Kind::Flagged | Kind::Nested, Err(FrameError::Flags(_)))
        | (Kind::Truncated, Err(FrameError::Truncated))
        | (Kind::Noise | Kind::Mutated, _) => true,
        (_, _) => false,
    };
    assert!(right, "{kind:?} became {found:?}: {bytes:02x?}");
    if let Ok(frame) = found {
        check(&frame);
    }
}

/// What is believed is a whole frame, however it is read.
fn check(frame: &Frame) {
    let mut again = Frames::new(frame.bytes);
    assert_eq!(again.next(), Some(Ok(*frame)));
    assert_eq!(again.next(), None);
}
