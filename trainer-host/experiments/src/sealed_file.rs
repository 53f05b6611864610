//! Files that are what they say or are refused: a kind and a version in front, a checksum over the rest.
//!
//! A file is, little-endian: magic (8 bytes), format version (`u32`), payload length (`u64`), CRC-32 of the payload
//! (`u32`), payload (postcard).

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use kestrel_core::crc32::crc32;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::atomic_file::FileError;

/// Magic, version, length, CRC-32.
pub const HEADER_LEN: usize = 8 + 4 + 8 + 4;

/// A kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kind {
    /// What people call such a file.
    pub noun: &'static str,
    /// Its first bytes.
    pub magic: [u8; 8],
    /// Version of what is in it; changes when old files cannot be read any more.
    pub version: u32,
}

/// Why a file is not of its kind, whole and known.
#[derive(Debug, thiserror::Error)]
pub enum SealError {
    /// The file ends too early.
    #[error("{} is truncated: found {found} bytes, expected {expected}", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Bytes in the file.
        found: u64,
        /// Bytes a whole file has, or its header alone where that is cut.
        expected: u64,
    },
    /// The file goes on after its end.
    #[error("{} is too long: found {found} bytes or more, expected {expected}", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Bytes in the file, as far as it was read.
        found: u64,
        /// Bytes announced by the header.
        expected: u64,
    },
    /// Something else.
    #[error("{} is no {}: it begins with \"{found}\", expected \"{}\"", path.display(), kind.noun, kind.magic.escape_ascii())]
    Magic {
        /// The file.
        path: PathBuf,
        /// What was expected.
        kind: Kind,
        /// Its first bytes, escaped.
        found: String,
    },
    /// Written in a format that this program does not know.
    #[error(
        "{} has {} format {found}, expected {}: use the version of kestrel that wrote it",
        path.display(), kind.noun, kind.version
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// What was expected.
        kind: Kind,
        /// Its format version.
        found: u32,
    },
    /// Bits have changed since it was written.
    #[error("{} is damaged: found CRC-32 {found:08x}, expected {expected:08x}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// CRC-32 of the payload as it is.
        found: u32,
        /// CRC-32 of the payload when it was written.
        expected: u32,
    },
    /// Whole, but of something else.
    #[error(
        "{} holds other content than expected ({cause}): it was written by a different version of kestrel",
        path.display()
    )]
    Content {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        cause: String,
    },
    /// The system refused a file operation.
    #[error(transparent)]
    File(#[from] FileError),
}

impl Kind {
    /// The bytes of a file with this content.
    ///
    /// # Panics
    /// When postcard cannot serialise it, such as a sequence of unknown length.
    pub fn encode(&self, content: &impl Serialize) -> Vec<u8> {
        let payload = postcard::to_allocvec(content).expect("contents are plain data");
        let mut bytes = Vec::with_capacity(HEADER_LEN + payload.len());
        bytes.extend(self.magic);
        bytes.extend(self.version.to_le_bytes());
        bytes.extend((payload.len() as u64).to_le_bytes());
        bytes.extend(crc32(&payload).to_le_bytes());
        bytes.extend(payload);
        bytes
    }

    /// Reads the file at `path`; of one that is of another kind, no more than the beginning.
    ///
    /// # Errors
    /// A variant of [`SealError`] for each way in which a file can be none.
    pub fn read<T: DeserializeOwned>(&self, path: &Path) -> Result<T, SealError> {
        self.decode(path, &self.bytes(path).map_err(|cause| FileError::new("read", path, cause))?)
    }

    /// The content of the `bytes` that the file at `path` holds.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn decode<T: DeserializeOwned>(&self, path: &Path, bytes: &[u8]) -> Result<T, SealError> {
        let payload = self.whole_payload(path, bytes)?;
        let content = |cause: String| SealError::Content { path: path.to_owned(), cause };
        match postcard::take_from_bytes(payload) {
            Ok((decoded, [])) => Ok(decoded),
            Ok((_, rest)) => Err(content(format!("{} bytes too many", rest.len()))),
            Err(cause) => Err(content(cause.to_string())),
        }
    }

    /// The header and, if it is ours, what it announces and one byte more, to notice what is too long.
    fn bytes(&self, path: &Path) -> io::Result<Vec<u8>> {
        let mut file = File::open(path)?;
        let mut bytes = Vec::new();
        file.by_ref().take(HEADER_LEN as u64).read_to_end(&mut bytes)?;
        if let Some(header) = bytes.first_chunk::<HEADER_LEN>().filter(|header| header.starts_with(&self.magic)) {
            let announced = Header::parse(header).payload_len;
            file.take(announced.saturating_add(1)).read_to_end(&mut bytes)?;
        }
        Ok(bytes)
    }

    /// Takes the payload out of a file that is what it says it is.
    fn whole_payload<'a>(&self, path: &Path, bytes: &'a [u8]) -> Result<&'a [u8], SealError> {
        let path = path.to_owned();
        let beginning = &bytes[..self.magic.len().min(bytes.len())];
        if !self.magic.starts_with(beginning) {
            return Err(SealError::Magic { path, kind: *self, found: beginning.escape_ascii().to_string() });
        }
        let found = bytes.len() as u64;
        let Some((header, payload)) = bytes.split_first_chunk::<HEADER_LEN>() else {
            return Err(SealError::Truncated { path, found, expected: HEADER_LEN as u64 });
        };
        let Header { version, payload_len, crc32: expected_crc32 } = Header::parse(header);
        if version != self.version {
            return Err(SealError::Version { path, kind: *self, found: version });
        }
        let expected = payload_len.saturating_add(HEADER_LEN as u64);
        if found < expected {
            return Err(SealError::Truncated { path, found, expected });
        }
        if found > expected {
            return Err(SealError::TooLong { path, found, expected });
        }
        let (found, expected) = (crc32(payload), expected_crc32);
        if found == expected { Ok(payload) } else { Err(SealError::Damaged { path, found, expected }) }
    }
}

/// What stands between the magic and the payload.
struct Header {
    version: u32,
    payload_len: u64,
    crc32: u32,
}

impl Header {
    fn parse(header: &[u8; HEADER_LEN]) -> Self {
        let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
        let payload_len = u64::from(word(12)) | u64::from(word(16)) << 32;
        Self { version: word(8), payload_len, crc32: word(20) }
    }
}

#[cfg(test)]
mod tests;
