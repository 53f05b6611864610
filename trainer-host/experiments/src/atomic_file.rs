//! Files that are whole or absent: written beside their place, synced, then renamed into it.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Names of files whose writer has not finished begin so; what a killed process leaves behind is recognised by it.
const UNFINISHED_PREFIX: &str = ".unfinished-";

/// A file operation that failed; the message names the file and what the system said.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} {}: {cause}", path.display())]
pub struct FileError {
    action: &'static str,
    path: PathBuf,
    // Not called `source`: the one-line message already holds it, and error chains would repeat it.
    cause: io::Error,
}

impl FileError {
    /// A failed `action` (a verb) on the file at `path`.
    pub fn new(action: &'static str, path: &Path, cause: io::Error) -> Self {
        Self { action, path: path.to_owned(), cause }
    }

    /// What kind of failure the system reported.
    pub fn kind(&self) -> io::ErrorKind {
        self.cause.kind()
    }
}

/// Makes `contents` the contents of `path`.
///
/// # Errors
/// The system's reason; whatever `path` held before is then still there, whole.
pub fn write_atomically(path: &Path, contents: &[u8]) -> Result<(), FileError> {
    replace_atomically(path, |file| file.write_all(contents))
}

/// Replaces `path` by what `fill` writes.
///
/// # Errors
/// The reason of `fill` or of the system; whatever `path` held before is then still there, whole.
pub fn replace_atomically(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> Result<(), FileError> {
    replace(path, fill).map_err(|cause| FileError::new("write", path, cause))
}

/// Finds out whether a file could be written there, before what it is to hold has taken its time.
///
/// # Errors
/// The system's reason.
pub fn check_writable(path: &Path) -> Result<(), FileError> {
    let trial =
        if path.is_dir() { Err(io::ErrorKind::IsADirectory.into()) } else { unfinished_file(directory_of(path)) };
    trial.map(drop).map_err(|cause| FileError::new("write", path, cause))
}

/// Reads the whole file.
///
/// # Errors
/// The system's reason.
pub fn read(path: &Path) -> Result<Vec<u8>, FileError> {
    fs::read(path).map_err(|cause| FileError::new("read", path, cause))
}

/// Removes what writers that were killed have left in `directory`.
///
/// # Errors
/// The system's reason.
pub fn remove_unfinished(directory: &Path) -> Result<(), FileError> {
    let unfinished = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with(UNFINISHED_PREFIX);
    let entries = fs::read_dir(directory).map_err(|cause| FileError::new("read", directory, cause))?;
    for entry in entries.flatten().filter(|entry| unfinished(&entry.file_name())) {
        fs::remove_file(entry.path()).map_err(|cause| FileError::new("remove", &entry.path(), cause))?;
    }
    Ok(())
}

fn replace(path: &Path, fill: impl FnOnce(&mut File) -> io::Result<()>) -> io::Result<()> {
    let directory = directory_of(path);
    let mut unfinished = unfinished_file(directory)?;
    fill(unfinished.as_file_mut())?;
    unfinished.as_file().sync_all()?;
    unfinished.persist(path).map_err(|error| error.error)?;
    sync_directory(directory)
}

fn directory_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn unfinished_file(directory: &Path) -> io::Result<tempfile::NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(UNFINISHED_PREFIX);
    #[cfg(unix)]
    let readable = std::os::unix::fs::PermissionsExt::from_mode(0o666); // less the umask, as any created file
    #[cfg(unix)]
    builder.permissions(readable);
    builder.tempfile_in(directory)
}

/// Makes the renaming itself survive a power cut.
fn sync_directory(directory: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(directory)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_replaced_and_nothing_else_is_left_beside_it() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("report.json");
        write_atomically(&path, b"one").unwrap();
        write_atomically(&path, b"two").unwrap();
        assert_eq!(read(&path).unwrap(), b"two");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_failed_writer_leaves_the_old_file_and_no_litter() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("report.json");
        write_atomically(&path, b"one").unwrap();
        let error = replace_atomically(&path, |file| {
            file.write_all(b"half")?;
            Err(io::ErrorKind::StorageFull.into())
        })
        .unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull);
        assert!(error.to_string().starts_with(&format!("cannot write {}: ", path.display())), "{error}");
        assert_eq!(read(&path).unwrap(), b"one");
        assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_a_killed_writer_left_is_removed() {
        let directory = tempfile::tempdir().unwrap();
        let (_, left) = unfinished_file(directory.path()).unwrap().keep().unwrap();
        let kept = directory.path().join("config.yaml");
        write_atomically(&kept, b"name: hover").unwrap();
        remove_unfinished(directory.path()).unwrap();
        assert!(!left.exists() && kept.exists());
    }

    #[test]
    fn a_missing_directory_is_one_clear_error() {
        let error = write_atomically(Path::new("/nowhere/at/all.json"), b"").unwrap_err();
        assert!(error.to_string().starts_with("cannot write /nowhere/at/all.json: No such file"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn others_may_read_a_written_file_as_the_umask_allows() {
        use std::os::unix::fs::PermissionsExt;
        let directory = tempfile::tempdir().unwrap();
        let (plain, atomic) = (directory.path().join("plain"), directory.path().join("atomic"));
        fs::write(&plain, b"").unwrap();
        write_atomically(&atomic, b"").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&plain), mode(&atomic));
    }
}
