//! Words for people on standard output, whoever reads them.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::sync::atomic::{AtomicBool, Ordering};

/// Standard output refuses, such as a file on a full disk.
#[derive(Debug, thiserror::Error)]
#[error("cannot write to standard output: {0}")]
pub struct OutputError(io::Error);

/// Prints `text` and a line break.
///
/// A reader that has gone, as `head` does, is no error: the work goes on, and its results are in files.
///
/// # Errors
/// [`OutputError`], for every other reason of the operating system.
pub fn say(text: impl Display) -> Result<(), OutputError> {
    write_to(&mut io::stdout().lock(), &text)
}

/// Prints `text` and a line break on standard error, unless nobody wants to hear; where possible: there is nowhere left to
/// complain.
pub fn warn(text: impl Display) {
    if !is_quiet() {
        fail(text);
    }
}

/// As [`warn`], whoever wants to hear: why there is no result.
pub fn fail(text: impl Display) {
    let _unread = writeln!(io::stderr().lock(), "{text}");
}

/// Whether progress and notes are wanted.
static QUIET: AtomicBool = AtomicBool::new(false);

/// From now on there are no progress bars and no notes, in the whole process.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Whether [`be_quiet`] was called.
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

fn write_to(output: &mut impl Write, text: &dyn Display) -> Result<(), OutputError> {
    match writeln!(output, "{text}").and_then(|()| output.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(OutputError(error)),
        Ok(()) | Err(_) => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Refusing(ErrorKind);

    impl Write for Refusing {
        fn write(&mut self, _bytes: &[u8]) -> io::Result<usize> {
            Err(self.0.into())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_reader_that_has_gone_is_no_error_and_a_full_disk_is() {
        assert!(write_to(&mut Refusing(ErrorKind::BrokenPipe), &"text").is_ok());
        let error = write_to(&mut Refusing(ErrorKind::StorageFull), &"text").unwrap_err();
        assert!(error.to_string().starts_with("cannot write to standard output: "));
    }
}
