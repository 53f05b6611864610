//! Signatures of MAVLink 2 frames: who sent a frame, and that it is no repetition.
//!
//! A signature is a link number, a time and the first 48 bits of SHA-256 over the secret key, the frame, the link number and
//! the time ([message signing](https://mavlink.io/en/guide/message_signing.html)). Times count 10 µs since the beginning
//! of 2015. Whoever signs never uses a time twice; whoever verifies wants the times of one sender on one link to increase, and
//! those of a sender that is new to be at most a minute behind.
//! After a restart nothing is accepted that is not after all that was accepted before.

use core::fmt;

use crate::frame::{Frame, Version};
use crate::sha256::Sha256;

/// Bytes of a signature.
pub const SIGNATURE_LEN: usize = 13;

/// Bytes of the digest that are sent.
const DIGEST_LEN: usize = 6;

/// Bytes of a time.
const TIME_LEN: usize = 6;

/// Senders on links that are remembered. One more is refused: to forget one would be to accept its old frames.
pub const STREAM_LIMIT: usize = 16;

/// How far the first frame of a sender may be behind the clock: a minute.
const AGE_LIMIT: Time = Time(60 * 100_000);

/// A shared secret, which no log ever shows.
#[derive(Clone)]
pub struct Key(pub [u8; 32]);

/// 10 µs since 2015-01-01 00:00 UTC; 48 bits are sent, which last until 2104.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Time(pub u64);

/// The signature of a frame, as sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signature<'a> {
    /// What it covers: header, payload and checksum.
    signed: &'a [u8],
    link: u8,
    time: Time,
    digest: [u8; DIGEST_LEN],
}

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

/// Signs frames of one link.
#[derive(Clone, Debug)]
pub struct Signer {
    key: Key,
    link: u8,
    last: Time,
}

/// A sender on a link, and the time of its last frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Stream {
    system: u8,
    component: u8,
    link: u8,
    last: Time,
}

/// Verifies signatures.
#[derive(Clone, Debug)]
pub struct Verifier {
    key: Key,
    /// Of the last frame that was accepted before a restart.
    floor: Time,
    /// Of the last frame that was accepted since.
    accepted: Time,
    /// Latest of the clock and of all accepted frames.
    now: Time,
    streams: heapless::Vec<Stream, STREAM_LIMIT>,
}

/// What is demanded of received frames.
#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "a vehicle has one, and no allocator")]
pub enum Guard {
    /// Nothing: signatures are not looked at.
    Open,
    /// A good signature.
    Signed(Verifier),
    /// The key is missing: everything is refused.
    Closed,
}

impl fmt::Debug for Key {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Key(secret)")
    }
}

impl Time {
    /// From microseconds since the Unix epoch; the beginning of 2015 for anything before.
    pub const fn from_unix_micros(micros: u64) -> Self {
        /// 2015-01-01 00:00 UTC \[µs since 1970\].
        const EPOCH_MICROS: u64 = 1_420_070_400_000_000;
        Self(micros.saturating_sub(EPOCH_MICROS) / 10)
    }

    const fn to_bytes(self) -> [u8; TIME_LEN] {
        let [a, b, c, d, e, f, ..] = self.0.to_le_bytes();
        [a, b, c, d, e, f]
    }

    const fn next(self) -> Self {
        Self(self.0 + 1)
    }
}

impl<'a> Signature<'a> {
    /// Of the bytes that follow the checksum, which are 13 in a signed frame.
    pub(crate) fn read(signed: &'a [u8], signature: &[u8]) -> Option<Self> {
        let &[link, a, b, c, d, e, f, ref digest @ ..] = signature else { return None };
        let time = Time(u64::from_le_bytes([a, b, c, d, e, f, 0, 0]));
        Some(Self { signed, link, time, digest: digest.try_into().ok()? })
    }

    /// Whether the key made it; compares in constant time.
    fn is_of(&self, key: &Key) -> bool {
        let expected = digest(key, self.signed, self.link, self.time);
        expected.iter().zip(&self.digest).fold(0, |difference, (a, b)| difference | (a ^ b)) == 0
    }
}

/// The first eight bytes of SHA-256 over some bytes: enough to tell files apart.
pub fn fingerprint(bytes: &[u8]) -> [u8; 8] {
    let [a, b, c, d, e, f, g, h, ..] = Sha256::new().with(bytes).finish();
    [a, b, c, d, e, f, g, h]
}

fn digest(key: &Key, signed: &[u8], link: u8, time: Time) -> [u8; DIGEST_LEN] {
    let hash = Sha256::new().with(&key.0).with(signed).with(&[link]).with(&time.to_bytes());
    let [a, b, c, d, e, f, ..] = hash.finish();
    [a, b, c, d, e, f]
}

impl Signer {
    /// Signs on a link of this number, with times after `last`.
    pub const fn new(key: Key, link: u8, last: Time) -> Self {
        Self { key, link, last }
    }

    /// Lets the clock have reached `now`; it never goes back.
    pub fn advance(&mut self, now: Time) {
        self.last = self.last.max(now);
    }

    /// Time of the last signature: what must be kept over a restart.
    pub const fn last(&self) -> Time {
        self.last
    }

    /// The signature of a frame from its first byte to its checksum.
    pub fn sign(&mut self, frame: &[u8]) -> [u8; SIGNATURE_LEN] {
        self.last = self.last.next();
        let mut signature = [0; SIGNATURE_LEN];
        let parts = [self.link]
            .into_iter()
            .chain(self.last.to_bytes())
            .chain(digest(&self.key, frame, self.link, self.last));
        for (byte, value) in signature.iter_mut().zip(parts) {
            *byte = value;
        }
        signature
    }
}

impl Verifier {
    /// Wants signatures of `key` that are at most a minute older than `now`, and after `floor`: what
    /// [`Verifier::accepted`] told before a restart, zero if there was none.
    pub const fn new(key: Key, now: Time, floor: Time) -> Self {
        Self { key, floor, accepted: floor, now, streams: heapless::Vec::new() }
    }

    /// Lets the clock have reached `now`; it never goes back.
    pub fn advance(&mut self, now: Time) {
        self.now = self.now.max(now);
    }

    /// Latest time that it knows, of the clock or of a frame.
    pub const fn now(&self) -> Time {
        self.now
    }

    /// Latest time of all accepted frames: what must be kept over a restart, so that none of them is accepted again.
    pub const fn accepted(&self) -> Time {
        self.accepted
    }

    /// Accepts a frame once.
    ///
    /// # Errors
    /// Why it is not accepted; nothing is remembered of it then.
    pub fn verify(&mut self, frame: &Frame) -> Result<(), SignatureError> {
        let signature = match frame.version {
            Version::V1 => None,
            Version::V2 => frame.signature(),
        };
        let signature = signature.ok_or(SignatureError::Unsigned)?;
        if !signature.is_of(&self.key) {
            return Err(SignatureError::Wrong);
        }
        let stream = Stream {
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

    fn remember(&mut self, stream: Stream) -> Result<(), SignatureError> {
        let sender = |stream: &Stream| (stream.system, stream.component, stream.link);
        match self.streams.iter_mut().find(|known| sender(known) == sender(&stream)) {
            Some(known) if stream.last > known.last => {
                *known = stream;
                Ok(())
            }
            Some(_) => Err(SignatureError::Replayed),
            None if stream.last <= self.floor => Err(SignatureError::Replayed),
            None if Time(stream.last.0.saturating_add(AGE_LIMIT.0)) < self.now => Err(SignatureError::Stale),
            None => self.streams.push(stream).map_err(|_| SignatureError::Senders),
        }
    }
}

impl Guard {
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
    pub fn advance(&mut self, now: Time) {
        if let Self::Signed(verifier) = self {
            verifier.advance(now);
        }
    }

    /// As [`Verifier::accepted`], if signatures are looked at.
    pub const fn accepted(&self) -> Option<Time> {
        match self {
            Self::Signed(verifier) => Some(verifier.accepted()),
            Self::Open | Self::Closed => None,
        }
    }
}

#[cfg(test)]
mod tests;
