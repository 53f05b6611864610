//! One end of a line: which frames are accepted there, what is answered, and how that is signed.

use crate::frame::{Encoder, FRAME_LIMIT, Frame, FrameError, Payload};
use crate::signature::{SignatureTime, Signer};
use crate::signature_guard::SignatureGuard;

/// What became of the bytes so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames with a right checksum.
    pub frames: u64,
    /// Frames with a wrong one, and anything else that is no frame.
    pub garbage: u64,
    /// Good frames that were not signed as they must be.
    pub refused: u64,
    /// Answers that a flood of requests left no room for.
    pub unanswered: u64,
}

/// Accepts the frames that a vehicle receives, and writes those that it sends; at most `ANSWERS` wait.
#[derive(Debug)]
pub struct Endpoint<const ANSWERS: usize> {
    guard: SignatureGuard,
    encoder: Encoder,
    answers: heapless::Deque<Payload, ANSWERS>,
    counts: Counts,
}

impl<const ANSWERS: usize> Endpoint<ANSWERS> {
    /// Sends as this system and component, unsigned, and accepts everybody's frames.
    pub const fn new(system: u8, component: u8) -> Self {
        Self {
            guard: SignatureGuard::Open,
            encoder: Encoder::new(system, component),
            answers: heapless::Deque::new(),
            counts: Counts { frames: 0, garbage: 0, refused: 0, unanswered: 0 },
        }
    }

    /// From now on admits only what `guard` does, and signs what it sends.
    pub fn secure(&mut self, guard: SignatureGuard, signer: Signer) {
        self.guard = guard;
        self.encoder = self.encoder.clone().signed(signer);
    }

    /// Lets the clock have reached a time, for signatures.
    pub fn advance_clock(&mut self, now: SignatureTime) {
        self.guard.advance(now);
        if let Some(signer) = self.encoder.signer_mut() {
            signer.advance(now);
        }
    }

    /// Latest times of accepted and of sent frames, if they are signed: what must be kept over a restart.
    pub fn signature_times(&self) -> Option<[SignatureTime; 2]> {
        Some([self.guard.accepted()?, self.encoder.signer()?.last()])
    }

    /// The frame, if it is one and signed as it must be.
    pub fn admit<'a>(&mut self, frame: Result<Frame<'a>, FrameError>) -> Option<Frame<'a>> {
        let admitted = frame.ok().filter(|frame| self.guard.admit(frame).is_ok());
        let count = match (&frame, &admitted) {
            (Err(_), _) => &mut self.counts.garbage,
            (Ok(_), None) => &mut self.counts.refused,
            (Ok(_), Some(_)) => &mut self.counts.frames,
        };
        *count = count.wrapping_add(1);
        admitted
    }

    /// Has a message wait to be sent, if there is room.
    pub fn answer(&mut self, payload: Payload) {
        if self.answers.push_back(payload).is_err() {
            self.counts.unanswered = self.counts.unanswered.wrapping_add(1);
        }
    }

    /// The next answer that waits.
    pub fn next_payload(&mut self) -> Option<Payload> {
        self.answers.pop_front()
    }

    /// Its bytes.
    pub fn next_answer(&mut self) -> Option<heapless::Vec<u8, FRAME_LIMIT>> {
        let payload = self.next_payload()?;
        Some(self.encode(&payload))
    }

    /// The bytes of one frame to be sent.
    pub fn encode(&mut self, payload: &Payload) -> heapless::Vec<u8, FRAME_LIMIT> {
        self.encoder.encode(payload)
    }

    /// The bytes of one frame to somebody whose frames are numbered by `sequence`.
    pub fn encode_numbered(&mut self, payload: &Payload, sequence: &mut u8) -> heapless::Vec<u8, FRAME_LIMIT> {
        self.encoder.encode_numbered(payload, sequence)
    }

    /// What became of the bytes so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }
}
