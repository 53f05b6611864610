//! A policy file in memory, on the boundary that [`PolicyFile`] wants.

use std::fs;
use std::path::{Path, PathBuf};

use kestrel_core::policy_file::{PolicyError, PolicyFile};

/// The boundary: parameters are read in place, four bytes at a time.
const ALIGNMENT: usize = 4;

/// Longer files are no policies: the largest network of the format has less than 300 kB.
const LENGTH_LIMIT: u64 = 16 << 20;

/// Bytes of a policy file.
#[derive(Clone, Debug)]
pub struct PolicyBytes {
    buffer: Vec<u8>,
    start: usize,
    len: usize,
}

/// Why a policy cannot be flown.
#[derive(Debug, thiserror::Error)]
pub enum PolicyBytesError {
    /// The file cannot be read.
    #[error("cannot read policy {}: {reason}", path.display())]
    Read {
        /// Of the file.
        path: PathBuf,
        /// Reason of the operating system.
        reason: std::io::Error,
    },
    /// The file is far too long.
    #[error("{} is no policy: expected at most {LENGTH_LIMIT} bytes, found {found}", path.display())]
    Length {
        /// Of the file.
        path: PathBuf,
        /// Bytes.
        found: u64,
    },
}

impl PolicyBytes {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read or is far too long; what it holds is checked by [`Self::policy`].
    pub fn read(path: &Path) -> Result<Self, PolicyBytesError> {
        let failed = |reason| PolicyBytesError::Read { path: path.to_owned(), reason };
        let found = fs::metadata(path).map_err(failed)?.len();
        if found > LENGTH_LIMIT {
            return Err(PolicyBytesError::Length { path: path.to_owned(), found });
        }
        fs::read(path).map(|bytes| Self::copy_of(&bytes)).map_err(failed)
    }

    /// Copies bytes to where they can be parsed.
    pub fn copy_of(bytes: &[u8]) -> Self {
        let mut buffer = vec![0; bytes.len() + ALIGNMENT];
        let start = buffer.as_ptr().align_offset(ALIGNMENT).min(ALIGNMENT);
        buffer[start..start + bytes.len()].copy_from_slice(bytes);
        Self { buffer, start, len: bytes.len() }
    }

    /// The policy in them.
    ///
    /// # Errors
    /// What is wrong with the file.
    pub fn policy(&self) -> Result<PolicyFile<'_>, PolicyError> {
        PolicyFile::parse(&self.buffer[self.start..self.start + self.len])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::hover_policy;

    #[test]
    fn bytes_from_anywhere_can_be_parsed() {
        let policy = hover_policy();
        for shift in 0..4 {
            let shifted = [vec![0; shift], policy.clone()].concat();
            assert_eq!(PolicyBytes::copy_of(&shifted[shift..]).policy().unwrap().metadata().name, "linear hover");
        }
    }

    #[test]
    fn what_is_no_policy_is_refused() {
        assert!(PolicyBytes::copy_of(b"").policy().is_err());
        assert!(PolicyBytes::copy_of(&hover_policy()[..100]).policy().is_err());
        let error = PolicyBytes::read(Path::new("no/such.policy")).unwrap_err();
        assert!(error.to_string().starts_with("cannot read policy no/such.policy: "), "{error}");
    }
}
