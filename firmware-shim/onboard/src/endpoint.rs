//! One end of a line: who is heard there, and how it signs what it says.

use crate::frame::{Encoder, FRAME_LIMIT, Frame, Payload};
use crate::signature::{SignatureTime, Signer};
use crate::signature_guard::{SignatureError, SignatureGuard};

/// What admits the frames that a vehicle hears, and writes those that it sends.
#[derive(Debug)]
pub struct Endpoint {
    guard: SignatureGuard,
    encoder: Encoder,
}

impl Endpoint {
    /// Sends as this system and component, unsigned, and hears everybody.
    pub const fn new(system: u8, component: u8) -> Self {
        Self { guard: SignatureGuard::Open, encoder: Encoder::new(system, component) }
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

    /// Whether a frame is to be obeyed.
    ///
    /// # Errors
    /// As [`SignatureGuard::admit`].
    pub fn admit(&mut self, frame: &Frame) -> Result<(), SignatureError> {
        self.guard.admit(frame)
    }

    /// The bytes of one frame to be sent.
    pub fn encode(&mut self, payload: &Payload) -> heapless::Vec<u8, FRAME_LIMIT> {
        self.encoder.encode(payload)
    }
}
