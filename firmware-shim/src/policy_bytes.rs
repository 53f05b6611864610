//! A policy file in memory, on the boundary that [`StatePolicy`] wants.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use kestrel_core::pilot::StatePolicy;
use kestrel_core::policy_file::PolicyError;

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
    #[error("{} is no policy: expected at most {LENGTH_LIMIT} bytes, found more", path.display())]
    Length {
        /// Of the file.
        path: PathBuf,
    },
}

impl PolicyBytes {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read or is far too long; what it holds is checked by [`Self::policy`].
    pub fn read(path: &Path) -> Result<Self, PolicyBytesError> {
        let failed = |reason| PolicyBytesError::Read { path: path.to_owned(), reason };
        let mut bytes = Vec::new();
        let file = File::open(path).map_err(failed)?;
        // Read to one byte beyond the limit: the length of a device or a pipe is not known before.
        file.take(LENGTH_LIMIT + 1).read_to_end(&mut bytes).map_err(failed)?;
        if bytes.len() as u64 > LENGTH_LIMIT {
            return Err(PolicyBytesError::Length { path: path.to_owned() });
        }
        Ok(Self::copy_of(&bytes))
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
    pub fn policy(&self) -> Result<StatePolicy<'_>, PolicyError> {
        StatePolicy::parse(self.bytes())
    }

    /// The bytes themselves.
    pub fn bytes(&self) -> &[u8] {
        &self.buffer[self.start..self.start + self.len]
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

    #[cfg(unix)]
    #[test]
    fn a_device_without_end_is_no_policy() {
        let error = PolicyBytes::read(Path::new("/dev/zero")).unwrap_err();
        assert!(matches!(error, PolicyBytesError::Length { .. }), "{error}");
    }

    #[test]
    fn what_is_no_policy_is_refused() {
        assert!(PolicyBytes::copy_of(b"").policy().is_err());
        assert!(PolicyBytes::copy_of(&hover_policy()[..100]).policy().is_err());
        let error = PolicyBytes::read(Path::new("no/such.policy")).unwrap_err();
        assert!(error.to_string().starts_with("cannot read policy no/such.policy: "), "{error}");
    }
}
