//! Files of a recording, however odd they are.

use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::path::Path;

use super::error::RecordingError;

/// Largest file that is read \[bytes\]; a recorded run of a minute has some five million.
const SIZE_LIMIT: u64 = 1 << 28;

/// The text of a file.
///
/// # Errors
/// When it cannot be had or is not UTF-8.
pub(super) fn text_of(path: &Path) -> Result<String, RecordingError> {
    String::from_utf8(bytes_of(path)?).map_err(|error| not_text(path, &error))
}

/// All that is in a file.
///
/// # Errors
/// When there is no such file, it is something else, or larger than 256 MiB.
pub(super) fn bytes_of(path: &Path) -> Result<Vec<u8>, RecordingError> {
    let broken = |error: std::io::Error| {
        if error.kind() == ErrorKind::NotFound {
            return RecordingError::about(path, "no such file", "a file of the recording");
        }
        RecordingError::about(path, format_args!("a file that cannot be read ({error})"), "a readable file")
    };
    if !fs::metadata(path).map_err(broken)?.is_file() {
        return Err(RecordingError::about(path, "no plain file", "a file of the recording"));
    }
    let mut bytes = Vec::new();
    File::open(path).and_then(|file| file.take(SIZE_LIMIT + 1).read_to_end(&mut bytes)).map_err(broken)?;
    if bytes.len() as u64 > SIZE_LIMIT {
        return Err(RecordingError::about(path, "more than 256 MiB", "a recording, which has a few"));
    }
    Ok(bytes)
}

fn not_text(path: &Path, error: &std::string::FromUtf8Error) -> RecordingError {
    let valid = error.utf8_error().valid_up_to();
    let line = line_of(error.as_bytes(), valid);
    let byte = error.as_bytes()[valid];
    RecordingError::at(format_args!("{}:{line}", path.display()), format_args!("the byte 0x{byte:02x}"), "UTF-8")
}

/// The line, counted from one, that holds the byte at `offset`.
pub(super) fn line_of(bytes: &[u8], offset: usize) -> usize {
    bytes[..offset].split(|byte| *byte == b'\n').count()
}
