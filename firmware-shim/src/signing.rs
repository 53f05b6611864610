//! The key of a vehicle that wants signed frames, and the times that outlive a flight.
//!
//! The key is a file of 64 hexadecimal digits, the 32 bytes that every peer has, too. Beside it, in a file of the same name with
//! `.times` behind it, stand the latest times that were accepted and sent, so that after a restart no old frame is accepted
//! and no time is used twice, whatever the clock says.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use kestrel_onboard::signature::{SignatureTime, Signer, SigningKey};
use kestrel_onboard::signature_guard::Verifier;

/// Bytes of a key.
const KEY_LEN: usize = 32;

/// Longer files are neither keys nor times.
const LENGTH_LIMIT: u64 = 4096;

/// Link number of all signatures: peers tell the vehicle's links apart by their own means.
const LINK: u8 = 0;

/// The key and the times beside it.
#[derive(Debug)]
pub struct Signing {
    key: SigningKey,
    times_path: PathBuf,
    times: SignatureTimes,
}

/// The latest times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SignatureTimes {
    /// Of all accepted frames.
    pub accepted: SignatureTime,
    /// Of the last frame that was sent.
    pub sent: SignatureTime,
}

/// Why no signatures can be made or verified: then no frame is accepted.
#[derive(Debug, thiserror::Error)]
pub enum SigningError {
    /// A file cannot be read.
    #[error("cannot read {}: {reason}", path.display())]
    Read {
        /// Of the file.
        path: PathBuf,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// A file cannot be written.
    #[error("cannot write {}: {reason}", path.display())]
    Write {
        /// Of the file.
        path: PathBuf,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// The key is none.
    #[error("{} is no signing key: expected 64 hexadecimal digits, found {found}", path.display())]
    Key {
        /// Of the file.
        path: PathBuf,
        /// What stands there; never the digits themselves.
        found: String,
    },
    /// The times are none.
    #[error("{}, line {line}: expected \"{expected} NUMBER\"", path.display())]
    Times {
        /// Of the file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// What the line should begin with.
        expected: &'static str,
    },
}

impl Signing {
    /// Reads the key, and the times if there are any.
    ///
    /// # Errors
    /// If a file cannot be read or holds something else.
    pub fn open(path: &Path) -> Result<Self, SigningError> {
        let key = key(path)?;
        let times_path = times_path(path);
        let times = if times_path.exists() { times(&times_path)? } else { SignatureTimes::default() };
        Ok(Self { key, times_path, times })
    }

    /// What verifies frames from `now` on.
    pub fn verifier(&self, now: SignatureTime) -> Verifier {
        Verifier::new(self.key.clone(), now.max(self.times.accepted), self.times.accepted)
    }

    /// What signs frames from `now` on.
    pub fn signer(&self, now: SignatureTime) -> Signer {
        Signer::new(self.key.clone(), LINK, now.max(self.times.sent))
    }

    /// Keeps these times for the next flight.
    ///
    /// # Errors
    /// If they cannot be written; the former ones stay then.
    pub fn keep(&mut self, times: SignatureTimes) -> Result<(), SigningError> {
        if times == self.times {
            return Ok(());
        }
        write(&self.times_path, times)
            .map_err(|reason| SigningError::Write { path: self.times_path.clone(), reason })?;
        self.times = times;
        Ok(())
    }
}

fn times_path(key_path: &Path) -> PathBuf {
    let mut name = key_path.as_os_str().to_owned();
    name.push(".times");
    name.into()
}

/// All of them or nothing: another file takes the place of the former one.
fn write(path: &Path, SignatureTimes { accepted, sent }: SignatureTimes) -> io::Result<()> {
    let mut name = path.as_os_str().to_owned();
    name.push(".new");
    let new = PathBuf::from(name);
    let mut file = File::create(&new)?;
    writeln!(file, "accepted {}\nsent {}", accepted.0, sent.0)?;
    file.sync_all()?;
    fs::rename(&new, path)
}

fn text(path: &Path) -> Result<String, SigningError> {
    let failed = |reason| SigningError::Read { path: path.to_owned(), reason };
    let mut text = String::new();
    File::open(path).map_err(failed)?.take(LENGTH_LIMIT).read_to_string(&mut text).map_err(failed)?;
    Ok(text)
}

fn key(path: &Path) -> Result<SigningKey, SigningError> {
    let text = text(path)?;
    let digits = text.trim();
    let refused = |found: String| SigningError::Key { path: path.to_owned(), found };
    if digits.len() != 2 * KEY_LEN {
        return Err(refused(format!("{} bytes", digits.len())));
    }
    let mut key = [0; KEY_LEN];
    for (index, (byte, pair)) in key.iter_mut().zip(digits.as_bytes().chunks_exact(2)).enumerate() {
        let pair =
            std::str::from_utf8(pair).ok().filter(|pair| pair.bytes().all(|digit| digit.is_ascii_hexdigit()));
        let value = pair.and_then(|pair| u8::from_str_radix(pair, 16).ok());
        *byte = value.ok_or_else(|| refused(format!("something else at digit {}", 2 * index + 1)))?;
    }
    Ok(SigningKey(key))
}

fn times(path: &Path) -> Result<SignatureTimes, SigningError> {
    let text = text(path)?;
    let mut lines = text.lines();
    let mut number = |line, expected| {
        let value =
            lines.next().and_then(|found| found.strip_prefix(expected)).and_then(|rest| rest.trim().parse().ok());
        value.map(SignatureTime).ok_or_else(|| SigningError::Times { path: path.to_owned(), line, expected })
    };
    Ok(SignatureTimes { accepted: number(1, "accepted")?, sent: number(2, "sent")? })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder_with(key: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        fs::write(&path, key).unwrap();
        (folder, path)
    }

    fn good() -> String {
        "000102030405060708090a0b0c0d0e0f".repeat(2)
    }

    #[test]
    fn times_outlive_a_flight_and_never_go_back() {
        let (_folder, path) = folder_with(&(good() + "\n"));
        let mut signing = Signing::open(&path).unwrap();
        let kept = SignatureTimes { accepted: SignatureTime(7_000), sent: SignatureTime(9_000) };
        signing.keep(kept).unwrap();
        let again = Signing::open(&path).unwrap();
        assert_eq!(again.times, kept);
        assert_eq!(again.signer(SignatureTime(5)).last(), SignatureTime(9_000), "a clock that was set back");
        assert_eq!(again.verifier(SignatureTime(5)).now(), SignatureTime(7_000));
        assert_eq!(again.signer(SignatureTime(10_000)).last(), SignatureTime(10_000));
    }

    #[test]
    fn what_is_no_key_is_refused_without_showing_it() {
        let cases = [
            (String::new(), "0 bytes"),
            (good()[1..].to_owned(), "63 bytes"),
            (good() + "00", "66 bytes"),
            (good().replacen("02", "0x", 1), "digit 5"),
            ("ä".repeat(32), "digit 1"),
        ];
        for (text, expected) in cases {
            let (_folder, path) = folder_with(&text);
            let error = Signing::open(&path).unwrap_err().to_string();
            assert!(error.contains(expected) && error.contains("64 hexadecimal digits"), "{error}");
            assert!(text.is_empty() || !error.contains(&text));
        }
        assert!(Signing::open(Path::new("no such key")).unwrap_err().to_string().contains("no such key"));
    }

    #[test]
    fn damaged_times_are_refused() {
        let (_folder, path) = folder_with(&good());
        for (text, line) in
            [("", 1), ("accepted x\nsent 1\n", 1), ("accepted 1\n", 2), ("accepted 1\nsent -1\n", 2)]
        {
            fs::write(times_path(&path), text).unwrap();
            let error = Signing::open(&path).unwrap_err().to_string();
            assert!(error.contains(&format!("line {line}")), "{error}");
        }
    }
}
