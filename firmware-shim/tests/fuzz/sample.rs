//! What the framer is fed with.

use kestrel_onboard::dialect::checksum_seed;
use kestrel_onboard::signature::SIGNATURE_LEN;
use kestrel_shim::frame::{Frame, FrameVersion, PAYLOAD_LIMIT};

use crate::corpus;
use crate::draft::{FrameDraft, SIGNED, Seal};
use crate::random::Random;

/// Longest noise, and longest of what is mutated \[bytes\].
const NOISE_LIMIT: usize = 600;

/// What became of bytes in the making, and so what must be read in them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Anything, often with the first byte of a frame.
    Noise,
    /// A right checksum over any payload.
    Good,
    /// A wrong checksum.
    Damaged,
    /// A message that no dialect knows.
    Unknown,
    /// Flags that are not known.
    Flagged,
    /// The beginning of a good frame.
    Truncated,
    /// One of the three before it, with a good frame in its payload.
    Nested,
    /// A frame of a client with bytes changed, inserted, doubled or left out.
    Mutated,
}

impl Kind {
    const ALL: [Self; 8] = [
        Self::Noise,
        Self::Good,
        Self::Damaged,
        Self::Unknown,
        Self::Flagged,
        Self::Truncated,
        Self::Nested,
        Self::Mutated,
    ];
}

/// Makes them.
pub(crate) struct FuzzSamples {
    random: Random,
    known: Vec<u32>,
    corpus: Vec<Frame<'static>>,
    bytes: Vec<u8>,
    payload: [u8; PAYLOAD_LIMIT],
}

impl FuzzSamples {
    pub(crate) fn new(seed: u64) -> Self {
        Self {
            random: Random::new(seed),
            known: (0..=u32::from(u16::MAX)).filter(|id| checksum_seed(*id).is_some()).collect(),
            corpus: corpus::frames(),
            bytes: Vec::with_capacity(2 * NOISE_LIMIT),
            payload: [0; PAYLOAD_LIMIT],
        }
    }

    /// The next one.
    pub(crate) fn next(&mut self) -> (Kind, &[u8]) {
        let kind = self.random.pick(&Kind::ALL);
        self.bytes.clear();
        match kind {
            Kind::Noise => self.noise(),
            Kind::Good => self.good(),
            Kind::Damaged | Kind::Unknown | Kind::Flagged => self.bad(kind, None),
            Kind::Truncated => self.truncated(),
            Kind::Nested => self.nested(),
            Kind::Mutated => self.mutated(),
        }
        (kind, &self.bytes)
    }

    fn noise(&mut self) {
        let len = self.random.below(NOISE_LIMIT);
        self.bytes.resize(len, 0);
        self.random.fill(&mut self.bytes);
        for _ in 0..self.random.below(4) {
            if let Some(first) = self.bytes.first_mut() {
                *first = self.random.pick(&[0xfd, 0xfe]);
            }
        }
    }

    fn good(&mut self) {
        let len = self.random.below(PAYLOAD_LIMIT + 1);
        let mut payload = self.payload;
        self.random.fill(&mut payload[..len]);
        let draft = self.draft(&payload[..len]);
        let seal = self.seal();
        draft.write(0, &seal, &mut self.bytes);
    }

    /// A frame that is bad as `kind` says, around `inner` if there is one.
    fn bad(&mut self, kind: Kind, inner: Option<&[u8]>) {
        let len = self.random.below(PAYLOAD_LIMIT + 1);
        let mut payload = self.payload;
        self.random.fill(&mut payload[..len]);
        let payload = if let Some(inner) = inner {
            let at = self.random.below(PAYLOAD_LIMIT + 1 - inner.len());
            payload[at..at + inner.len()].copy_from_slice(inner);
            &payload[..len.max(at + inner.len())]
        } else {
            &payload[..len]
        };
        let mut draft = self.draft(payload);
        let damage = if kind == Kind::Damaged { 1 + self.random.below(0xffff) as u16 } else { 0 };
        if kind == Kind::Unknown {
            (draft.version, draft.flags) = (FrameVersion::V2, draft.flags & SIGNED);
            draft.message_id = 0x01_0000 + self.random.below(0xfe_0000) as u32;
        } else if kind == Kind::Flagged {
            let unknown = self.random.pick(&[0x02, 0x80, 0x44, 0xfe]);
            (draft.version, draft.flags) = (FrameVersion::V2, draft.flags | unknown);
        }
        let seal = self.seal();
        draft.write(damage, &seal, &mut self.bytes);
    }

    fn truncated(&mut self) {
        self.good();
        let len = 1 + self.random.below(self.bytes.len() - 1);
        self.bytes.truncate(len);
    }

    fn nested(&mut self) {
        let client = self.random.pick(&self.corpus);
        let kind = self.random.pick(&[Kind::Damaged, Kind::Unknown, Kind::Flagged]);
        // What does not fit cannot be hidden.
        self.bad(kind, Some(client.bytes).filter(|inner| inner.len() <= PAYLOAD_LIMIT));
    }

    fn mutated(&mut self) {
        let client = self.random.pick(&self.corpus).bytes;
        self.bytes.extend(client);
        for _ in 0..=self.random.below(4) {
            let at = self.random.below(self.bytes.len());
            match self.random.below(5) {
                0 => self.bytes[at] = self.random.byte(),
                1 => self.bytes[at] ^= 1 << self.random.below(8),
                2 => self.bytes.insert(at, self.random.byte()),
                3 if self.bytes.len() > 1 => drop(self.bytes.remove(at)),
                _ => self.bytes.extend_from_within(at..),
            }
        }
        self.bytes.truncate(NOISE_LIMIT);
    }

    /// A frame of a known message.
    fn draft<'p>(&mut self, payload: &'p [u8]) -> FrameDraft<'p> {
        let version = if self.random.one_in(4) { FrameVersion::V1 } else { FrameVersion::V2 };
        let message_id = match version {
            FrameVersion::V1 => loop {
                let id = self.random.pick(&self.known);
                if id <= 0xff {
                    break id;
                }
            },
            FrameVersion::V2 => self.random.pick(&self.known),
        };
        let sender = [self.random.pick(&[1, 2, 42, 255]), self.random.byte()];
        let flags = self.random.pick(&[0, SIGNED]);
        FrameDraft { version, flags, sequence: self.random.byte(), sender, message_id, payload }
    }

    fn seal(&mut self) -> Seal {
        let mut bytes = [0; SIGNATURE_LEN];
        self.random.fill(&mut bytes);
        Seal::Bytes(bytes)
    }
}
