//! Admission of signed frames: each once, and none that is old.
//!
//! The times of one sender on one link must increase, and those of a sender that is new may be at most a minute behind.
//! After a restart nothing is accepted that is not after all that was accepted before.

use crate::frame::{Frame, FrameVersion};
use crate::signature::{SignatureTime, SigningKey};

/// Senders on links that are remembered. One more is refused: to forget one would be to accept its old frames.
pub const STREAM_LIMIT: usize = 16;

/// How far the first frame of a sender may be behind the clock: a minute.
const AGE_LIMIT: SignatureTime = SignatureTime(60 * 100_000);

/// Why a frame is not accepted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignatureError {
    /// It has no signature, or is of MAVLink 1, which has none.
    #[error("expected a signed frame, found an unsigned one")]
    Unsigned,
    /// The key of its sender is another, or it was altered.
    #[error("wrong signature")]
    Wrong,
    /// It, or one after it, was accepted before.
    #[error("a repetition: its time is not after that of the last frame")]
    Replayed,
    /// The first frame of a sender, and more than a minute old.
    #[error("more than a minute old")]
    Stale,
    /// More senders than can be remembered.
    #[error("more than {STREAM_LIMIT} senders")]
    Senders,
    /// Signatures are wanted, and there is no key to verify them.
    #[error("no key is there to verify signatures")]
    KeyMissing,
}

/// A sender on a link, and the time of its last frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct SenderLink {
    system: u8,
    component: u8,
    link: u8,
    last: SignatureTime,
}

/// Verifies signatures.
#[derive(Clone, Debug)]
pub struct Verifier {
    key: SigningKey,
    /// Of the last frame that was accepted before a restart.
    floor: SignatureTime,
    /// Of the last frame that was accepted since.
    accepted: SignatureTime,
    /// Latest of the clock and of all accepted frames.
    now: SignatureTime,
    streams: heapless::Vec<SenderLink, STREAM_LIMIT>,
}

/// What is demanded of received frames.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a vehicle has one, and no allocator")]
pub enum SignatureGuard {
    /// Nothing: signatures are not looked at.
    Open,
    /// A good signature.
    Signed(Verifier),
    /// The key is missing: everything is refused.
    Closed,
}

impl Verifier {
    /// Wants signatures of `key` that are at most a minute older than `now`, and after `floor`: what
    /// [`Verifier::accepted`] told before a restart, zero if there was none.
    pub const fn new(key: SigningKey, now: SignatureTime, floor: SignatureTime) -> Self {
        Self { key, floor, accepted: floor, now, streams: heapless::Vec::new() }
    }

    /// Lets the clock have reached `now`; it never goes back.
    pub fn advance(&mut self, now: SignatureTime) {
        self.now = self.now.max(now);
    }

    /// Latest time that it knows, of the clock or of a frame.
    pub const fn now(&self) -> SignatureTime {
        self.now
    }

    /// Latest time of all accepted frames: what must be kept over a restart, so that none of them is accepted again.
    pub const fn accepted(&self) -> SignatureTime {
        self.accepted
    }

    /// Accepts a frame once.
    ///
    /// # Errors
    /// Why it is not accepted; nothing is remembered of it then.
    pub fn verify(&mut self, frame: &Frame) -> Result<(), SignatureError> {
        let signature = match frame.version {
            FrameVersion::V1 => None,
            FrameVersion::V2 => frame.signature(),
        };
        let signature = signature.ok_or(SignatureError::Unsigned)?;
        if !signature.is_of(&self.key) {
            return Err(SignatureError::Wrong);
        }
        let stream = SenderLink {
            system: frame.system,
            component: frame.component,
            link: signature.link,
            last: signature.time,
        };
        self.remember(stream)?;
        self.accepted = self.accepted.max(signature.time);
        self.now = self.now.max(signature.time);
        Ok(())
    }

    fn remember(&mut self, stream: SenderLink) -> Result<(), SignatureError> {
        let sender = |stream: &SenderLink| (stream.system, stream.component, stream.link);
        match self.streams.iter_mut().find(|known| sender(known) == sender(&stream)) {
            Some(known) if stream.last > known.last => {
                *known = stream;
                Ok(())
            }
            Some(_) => Err(SignatureError::Replayed),
            None if stream.last <= self.floor => Err(SignatureError::Replayed),
            None if SignatureTime(stream.last.0.saturating_add(AGE_LIMIT.0)) < self.now => {
                Err(SignatureError::Stale)
            }
            None => self.streams.push(stream).map_err(|_| SignatureError::Senders),
        }
    }
}

impl SignatureGuard {
    /// Whether a frame may pass.
    ///
    /// # Errors
    /// Why it may not.
    pub fn admit(&mut self, frame: &Frame) -> Result<(), SignatureError> {
        match self {
            Self::Open => Ok(()),
            Self::Signed(verifier) => verifier.verify(frame),
            Self::Closed => Err(SignatureError::KeyMissing),
        }
    }

    /// Lets the clock have reached `now`; it never goes back.
    pub fn advance(&mut self, now: SignatureTime) {
        if let Self::Signed(verifier) = self {
            verifier.advance(now);
        }
    }

    /// As [`Verifier::accepted`], if signatures are looked at.
    pub const fn accepted(&self) -> Option<SignatureTime> {
        match self {
            Self::Signed(verifier) => Some(verifier.accepted()),
            Self::Open | Self::Closed => None,
        }
    }
}

#[cfg(test)]
mod tests;
