//! A stream of bytes to frames.

use super::{FRAME_LIMIT, Frame, FrameError, frame_len};

/// Cuts the stream of a serial line or of TCP into frames, byte by byte, in constant memory.
///
/// What follows a damaged frame is looked at only from that frame's end on: a length that was damaged costs what it
/// covers, at most [`FRAME_LIMIT`] bytes, and nothing that stands in a payload is ever taken for a frame. Bytes between
/// frames are skipped up to the next that may begin one.
#[derive(Clone, Debug, Default)]
pub struct Receiver {
    bytes: heapless::Vec<u8, FRAME_LIMIT>,
    state: State,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum State {
    /// Between frames.
    #[default]
    Idle,
    /// Between frames, behind a byte that begins none: one error for all of them.
    Lost,
    /// Inside a frame.
    Collecting,
}

impl Receiver {
    /// At the beginning of a stream.
    pub const fn new() -> Self {
        Self { bytes: heapless::Vec::new(), state: State::Idle }
    }

    /// The frame that this byte completes, or what was found instead of one; nothing while one is on its way.
    pub fn push(&mut self, byte: u8) -> Option<Result<Frame<'_>, FrameError>> {
        if self.state != State::Collecting {
            self.bytes.clear();
        }
        // There is room: no length is beyond the limit, and a frame is taken as soon as it is complete.
        let _ = self.bytes.push(byte);
        match frame_len(&self.bytes) {
            Err(error) => {
                let known = core::mem::replace(&mut self.state, State::Lost) == State::Lost;
                (!known).then_some(Err(error))
            }
            Ok(Some(len)) if self.bytes.len() >= len => {
                self.state = State::Idle;
                Some(Frame::read(&self.bytes))
            }
            Ok(_) => {
                self.state = State::Collecting;
                None
            }
        }
    }
}
