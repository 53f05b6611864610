//! Signatures of MAVLink 2 frames: who sent a frame.
//!
//! A signature is a link number, a time and the first 48 bits of SHA-256 over the secret key, the frame, the link number and
//! the time ([message signing](https://mavlink.io/en/guide/message_signing.html)). Times count 10 µs since the beginning
//! of 2015. A signer never uses a time twice; [`signature_guard`](crate::signature_guard) checks that.

use core::fmt;

use crate::sha256::Sha256;

/// Bytes of a signature.
pub const SIGNATURE_LEN: usize = 13;

/// Bytes of the digest that are sent.
const DIGEST_LEN: usize = 6;

/// Bytes of a time.
const TIME_LEN: usize = 6;

/// A shared secret, which no log ever shows.
#[derive(Clone)]
pub struct SigningKey(pub [u8; 32]);

/// 10 µs since 2015-01-01 00:00 UTC; 48 bits are sent, which last until 2104.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct SignatureTime(pub u64);

/// The signature of a frame, as sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signature<'a> {
    /// What it covers: header, payload and checksum.
    signed: &'a [u8],
    pub(crate) link: u8,
    pub(crate) time: SignatureTime,
    digest: [u8; DIGEST_LEN],
}

/// Signs frames of one link.
#[derive(Clone, Debug)]
pub struct Signer {
    key: SigningKey,
    link: u8,
    last: SignatureTime,
}

impl fmt::Debug for SigningKey {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("Key(secret)")
    }
}

impl SignatureTime {
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
        let time = SignatureTime(u64::from_le_bytes([a, b, c, d, e, f, 0, 0]));
        Some(Self { signed, link, time, digest: digest.try_into().ok()? })
    }

    /// Whether the key made it; compares in constant time.
    pub(crate) fn is_of(&self, key: &SigningKey) -> bool {
        let expected = digest(key, self.signed, self.link, self.time);
        expected.iter().zip(&self.digest).fold(0, |difference, (a, b)| difference | (a ^ b)) == 0
    }
}

/// The first eight bytes of SHA-256 over some bytes: enough to tell files apart.
pub fn fingerprint(bytes: &[u8]) -> [u8; 8] {
    let [a, b, c, d, e, f, g, h, ..] = Sha256::new().with(bytes).finish();
    [a, b, c, d, e, f, g, h]
}

fn digest(key: &SigningKey, signed: &[u8], link: u8, time: SignatureTime) -> [u8; DIGEST_LEN] {
    let hash = Sha256::new().with(&key.0).with(signed).with(&[link]).with(&time.to_bytes());
    let [a, b, c, d, e, f, ..] = hash.finish();
    [a, b, c, d, e, f]
}

impl Signer {
    /// Signs on a link of this number, with times after `last`.
    pub const fn new(key: SigningKey, link: u8, last: SignatureTime) -> Self {
        Self { key, link, last }
    }

    /// Lets the clock have reached `now`; it never goes back.
    pub fn advance(&mut self, now: SignatureTime) {
        self.last = self.last.max(now);
    }

    /// Time of the last signature: what must be kept over a restart.
    pub const fn last(&self) -> SignatureTime {
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
