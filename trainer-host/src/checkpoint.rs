//! Checkpoints: all that a run needs to go on, in files that are whole or refused.
//!
//! A file is, little-endian: magic (8 bytes), format version (`u32`), payload length (`u64`), CRC-32 of the payload
//! (`u32`), payload (postcard). Numbers and nothing else decide what is newest, never the clock.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use kestrel_core::crc32::crc32;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::atomic_file::{FileError, read, replace_atomically};

/// First bytes of every checkpoint.
const MAGIC: [u8; 8] = *b"KESTRELC";

/// Version of the layout described above; changes when old files cannot be read any more.
pub const FORMAT_VERSION: u32 = 1;

/// Magic, version, length, CRC-32.
const HEADER_LEN: usize = 8 + 4 + 8 + 4;

/// Checkpoints that are kept: the newest and, in case it is damaged later, the one before.
const KEPT: usize = 2;

const PREFIX: &str = "update-";
const SUFFIX: &str = ".checkpoint";

/// Why a checkpoint cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// There is none yet.
    #[error("{} holds no checkpoint: the run ended before its first one, start it anew", .0.display())]
    None(PathBuf),
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
    #[error("{} is too long: found {found} bytes, expected {expected}", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Bytes in the file.
        found: u64,
        /// Bytes announced by the header.
        expected: u64,
    },
    /// Not a checkpoint at all.
    #[error("{} is no checkpoint: it begins with {found:?}, expected {:?}", path.display(), MAGIC.escape_ascii().to_string())]
    Magic {
        /// The file.
        path: PathBuf,
        /// Its first bytes, escaped.
        found: String,
    },
    /// Written in a format that this program does not know.
    #[error(
        "{} has checkpoint format {found}, expected {FORMAT_VERSION}: use the version of kestrel that wrote it",
        path.display()
    )]
    Version {
        /// The file.
        path: PathBuf,
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
    #[error("{} holds other content than expected ({cause}): it was written by a different version of kestrel", path.display())]
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

/// The checkpoints of one run.
#[derive(Clone, Debug)]
pub struct Checkpoints {
    directory: PathBuf,
}

/// A checkpoint that was read.
#[derive(Debug)]
pub struct Restored<T> {
    /// What was saved.
    pub state: T,
    /// The update after which it was saved.
    pub updates: u64,
    /// Where it was.
    pub path: PathBuf,
    /// Why a newer one could not be used, for the user to know.
    pub warning: Option<CheckpointError>,
}

impl Checkpoints {
    /// The checkpoints in an existing `directory`.
    pub fn in_directory(directory: &Path) -> Self {
        Self { directory: directory.to_owned() }
    }

    /// Saves `state` as the newest, after `updates` updates, and returns where.
    ///
    /// Only when it is on the disk, whole, are older ones than the previous removed, and with them those of later
    /// updates: they belong to a future from which the run was set back.
    ///
    /// # Errors
    /// The system's reason; all earlier checkpoints are then still there.
    ///
    /// # Panics
    /// When `state` cannot be serialised by postcard, such as a sequence of unknown length.
    pub fn save(&self, updates: u64, state: &impl Serialize) -> Result<PathBuf, CheckpointError> {
        let bytes = encode(state);
        self.save_through(updates, |file| file.write_all(&bytes))
    }

    /// Reads the newest, or, when that is damaged, the one before, with a warning.
    ///
    /// # Errors
    /// No checkpoint, or the reason why the newest cannot be read when the one before cannot either.
    pub fn load_newest<T: DeserializeOwned>(&self) -> Result<Restored<T>, CheckpointError> {
        let mut warning = None;
        for updates in self.saved()?.into_iter().rev() {
            let path = self.path_after(updates);
            match load(&path) {
                Ok(state) => return Ok(Restored { state, updates, path, warning }),
                Err(error) => warning = warning.or(Some(error)),
            }
        }
        Err(warning.unwrap_or_else(|| CheckpointError::None(self.directory.clone())))
    }

    /// Numbers of updates after which there are checkpoints, ascending.
    ///
    /// # Errors
    /// The system's reason.
    pub fn saved(&self) -> Result<Vec<u64>, CheckpointError> {
        let refused = |cause| FileError::new("read", &self.directory, cause);
        let entries = fs::read_dir(&self.directory).map_err(refused)?;
        let number = |name: &str| name.strip_prefix(PREFIX)?.strip_suffix(SUFFIX)?.parse().ok();
        let mut saved: Vec<u64> =
            entries.flatten().filter_map(|entry| number(&entry.file_name().to_string_lossy())).collect();
        saved.sort_unstable();
        Ok(saved)
    }

    fn save_through(
        &self,
        updates: u64,
        fill: impl FnOnce(&mut File) -> io::Result<()>,
    ) -> Result<PathBuf, CheckpointError> {
        let path = self.path_after(updates);
        replace_atomically(&path, fill)?;
        self.remove_all_but_last(updates)?;
        Ok(path)
    }

    fn remove_all_but_last(&self, newest: u64) -> Result<(), CheckpointError> {
        let saved = self.saved()?;
        let past = saved.iter().filter(|&&updates| updates <= newest);
        let kept: Vec<u64> = past.rev().take(KEPT).copied().collect();
        for updates in saved.into_iter().filter(|updates| !kept.contains(updates)) {
            let path = self.path_after(updates);
            fs::remove_file(&path).map_err(|cause| FileError::new("remove", &path, cause))?;
        }
        Ok(())
    }

    fn path_after(&self, updates: u64) -> PathBuf {
        self.directory.join(format!("{PREFIX}{updates:08}{SUFFIX}"))
    }
}

/// Reads one checkpoint.
///
/// # Errors
/// A variant of [`CheckpointError`] for each way in which a file can be none.
pub fn load<T: DeserializeOwned>(path: &Path) -> Result<T, CheckpointError> {
    decode(path, &read(path)?)
}

fn encode(state: &impl Serialize) -> Vec<u8> {
    let payload = postcard::to_allocvec(state).expect("states are plain data");
    let mut bytes = Vec::with_capacity(HEADER_LEN + payload.len());
    bytes.extend(MAGIC);
    bytes.extend(FORMAT_VERSION.to_le_bytes());
    bytes.extend((payload.len() as u64).to_le_bytes());
    bytes.extend(crc32(&payload).to_le_bytes());
    bytes.extend(payload);
    bytes
}

fn decode<T: DeserializeOwned>(path: &Path, bytes: &[u8]) -> Result<T, CheckpointError> {
    let payload = whole_payload(path, bytes)?;
    let content = |cause: String| CheckpointError::Content { path: path.to_owned(), cause };
    match postcard::take_from_bytes(payload) {
        Ok((state, [])) => Ok(state),
        Ok((_, rest)) => Err(content(format!("{} bytes too many", rest.len()))),
        Err(cause) => Err(content(cause.to_string())),
    }
}

/// Takes the payload out of a file that is what it says it is.
fn whole_payload<'a>(path: &Path, bytes: &'a [u8]) -> Result<&'a [u8], CheckpointError> {
    let path = path.to_owned();
    if !bytes.starts_with(&MAGIC[..bytes.len().min(MAGIC.len())]) {
        let found = bytes[..MAGIC.len().min(bytes.len())].escape_ascii().to_string();
        return Err(CheckpointError::Magic { path, found });
    }
    let found = bytes.len() as u64;
    let Some((header, payload)) = bytes.split_first_chunk::<HEADER_LEN>() else {
        return Err(CheckpointError::Truncated { path, found, expected: HEADER_LEN as u64 });
    };
    let Header { version, payload_len, crc32: expected_crc32 } = Header::parse(header);
    if version != FORMAT_VERSION {
        return Err(CheckpointError::Version { path, found: version });
    }
    let expected = payload_len.saturating_add(HEADER_LEN as u64);
    if found < expected {
        return Err(CheckpointError::Truncated { path, found, expected });
    }
    if found > expected {
        return Err(CheckpointError::TooLong { path, found, expected });
    }
    let (found, expected) = (crc32(payload), expected_crc32);
    if found == expected { Ok(payload) } else { Err(CheckpointError::Damaged { path, found, expected }) }
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
