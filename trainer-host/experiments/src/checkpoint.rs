//! Checkpoints: all that a run needs to go on, in files that are whole or refused.
//!
//! Each is a [sealed file](crate::sealed_file). Numbers and nothing else decide what is newest, never the clock.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::atomic_file::{FileError, replace_atomically};
use crate::output::warn;
use crate::sealed_file::{Kind, SealError};

/// What every checkpoint is.
const KIND: Kind = Kind { noun: "checkpoint", magic: *b"KESTRELC", version: 1 };

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
    /// The file is no whole checkpoint, or cannot be read.
    #[error(transparent)]
    Sealed(#[from] SealError),
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
        let bytes = KIND.encode(state);
        self.save_through(updates, |file| file.write_all(&bytes))
    }

    /// Reads the newest, or, when that is damaged, the one before, and warns the user.
    ///
    /// # Errors
    /// No checkpoint, or the reason why the newest cannot be read when the one before cannot either.
    pub fn load_newest<T: DeserializeOwned>(&self) -> Result<Restored<T>, CheckpointError> {
        let mut damage = None;
        for updates in self.saved()?.into_iter().rev() {
            let path = self.path_after(updates);
            match load(&path) {
                Ok(state) => {
                    if let Some(damage) = damage {
                        warn(format_args!("warning: {damage}; going on from the checkpoint before it"));
                    }
                    return Ok(Restored { state, updates, path });
                }
                Err(error) => damage = damage.or(Some(error)),
            }
        }
        Err(damage.unwrap_or_else(|| CheckpointError::None(self.directory.clone())))
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
/// A variant of [`SealError`] for each way in which a file can be none.
pub fn load<T: DeserializeOwned>(path: &Path) -> Result<T, CheckpointError> {
    Ok(KIND.read(path)?)
}

#[cfg(test)]
mod tests;
