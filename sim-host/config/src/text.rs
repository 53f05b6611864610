//! Files as text, however odd they are.

use std::fmt;
use std::fs::File;
use std::io::{self, ErrorKind, Read};
use std::path::Path;

/// Largest configuration file \[bytes\]; the examples have a few thousand, but a resolved one holds its meshes.
const SIZE_LIMIT: u64 = 8 << 20;

/// Why a file is no text.
#[derive(Debug)]
pub enum Unreadable {
    /// There is none.
    Missing,
    /// It is a directory.
    Folder,
    /// More than so many bytes.
    Long(u64),
    /// The system refuses.
    Broken(io::Error),
    /// Not UTF-8, from this byte on; line and column count from one.
    Bytes {
        /// Of the byte, from one.
        line: usize,
        /// Of the byte, from one \[characters\].
        column: usize,
        /// The byte.
        byte: u8,
    },
}

/// What a message says was found.
impl fmt::Display for Unreadable {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => formatter.write_str("no such file"),
            Self::Folder => formatter.write_str("a directory"),
            Self::Long(bytes) => write!(formatter, "more than {} MiB", bytes >> 20),
            Self::Broken(error) => write!(formatter, "a file that cannot be read ({error})"),
            Self::Bytes { byte, .. } => write!(formatter, "the byte 0x{byte:02x}"),
        }
    }
}

/// The text of the file at `path`.
///
/// # Errors
/// When it is missing, a directory, larger than 8 MiB, not readable or not UTF-8.
pub fn read_text(path: &Path) -> Result<String, Unreadable> {
    String::from_utf8(read_bytes(path, SIZE_LIMIT)?).map_err(|error| {
        let (line, column, byte) = not_text(&error);
        Unreadable::Bytes { line, column, byte }
    })
}

/// What is in the file at `path`, at most so many bytes.
///
/// # Errors
/// When it is missing, a directory, larger or not readable.
pub fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>, Unreadable> {
    if path.is_dir() {
        return Err(Unreadable::Folder);
    }
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(limit + 1).read_to_end(&mut bytes));
    read.map_err(|error| {
        let missing = error.kind() == ErrorKind::NotFound;
        if missing { Unreadable::Missing } else { Unreadable::Broken(error) }
    })?;
    if bytes.len() as u64 > limit { Err(Unreadable::Long(limit)) } else { Ok(bytes) }
}

/// Line and column, from one, of the first byte that is no text, and the byte.
///
/// # Panics
/// Never: such an error has a byte that is no text.
pub fn not_text(error: &std::string::FromUtf8Error) -> (usize, usize, u8) {
    let valid = error.utf8_error().valid_up_to();
    let before = String::from_utf8_lossy(&error.as_bytes()[..valid]);
    let line = before.matches('\n').count() + 1;
    let column = before.chars().rev().take_while(|letter| *letter != '\n').count() + 1;
    (line, column, error.as_bytes()[valid])
}
