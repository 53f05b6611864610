//! One writer per run directory.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::Path;
use std::process;

use super::RunDirectoryError;
use crate::atomic_file::FileError;

/// Name of the lock file; it stays when the lock is gone, since removing it would race with the next owner.
pub(super) const FILE_NAME: &str = ".lock";

/// The system's lock on the lock file, whose content names the owner.
///
/// The system itself lets go of the lock when the owner ends, however it ends, so that a lock is never stale: not
/// after a crash, and not when the owner's process number belongs to another process by now.
#[derive(Debug)]
pub(crate) struct RunLock {
    _file: File,
}

impl RunLock {
    /// Locks the directory at `path` until the lock is dropped.
    pub(crate) fn acquire(path: &Path) -> Result<Self, RunDirectoryError> {
        let lock = path.join(FILE_NAME);
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let mut file = options.open(&lock).map_err(|cause| FileError::new("open", &lock, cause))?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(in_use(path, &mut file)),
            Err(TryLockError::Error(cause)) => return Err(FileError::new("lock", &lock, cause).into()),
        }
        sign(&mut file).map_err(|cause| FileError::new("write", &lock, cause))?;
        Ok(Self { _file: file })
    }
}

fn sign(file: &mut File) -> std::io::Result<()> {
    file.set_len(0)?;
    file.rewind()?;
    write!(file, "{}", process::id())
}

fn in_use(path: &Path, file: &mut File) -> RunDirectoryError {
    let mut owner = String::new();
    let named = file.read_to_string(&mut owner).is_ok_and(|length| length > 0);
    let owner = if named { format!("process {owner}") } else { "another process".to_owned() };
    RunDirectoryError::InUse { path: path.to_owned(), owner }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};

    use super::*;

    const ROLE: &str = "KESTREL_LOCK_TEST_DIRECTORY";

    #[test]
    fn a_second_owner_is_told_who_the_first_is() {
        let directory = tempfile::tempdir().unwrap();
        let first = RunLock::acquire(directory.path()).unwrap();
        let error = RunLock::acquire(directory.path()).unwrap_err().to_string();
        let (path, owner) = (directory.path().display(), process::id());
        let expected = format!("{path} is in use by process {owner}: wait for it to end, or stop it first");
        assert_eq!(error, expected);
        drop(first);
        assert!(RunLock::acquire(directory.path()).is_ok());
    }

    #[test]
    fn the_file_of_a_process_that_is_gone_locks_nothing() {
        let directory = tempfile::tempdir().unwrap();
        // A process number that exists (init's) must not make an abandoned file look owned either.
        for stale in ["999999999", "1", "", "no number"] {
            fs::write(directory.path().join(FILE_NAME), stale).unwrap();
            drop(RunLock::acquire(directory.path()).unwrap());
        }
    }

    /// Holds the lock until killed when the test below starts this binary again; passes at once otherwise.
    #[test]
    fn owner() {
        let Ok(directory) = std::env::var(ROLE) else { return };
        let _lock = RunLock::acquire(Path::new(&directory)).unwrap();
        eprintln!("locked");
        loop {
            std::thread::park();
        }
    }

    #[test]
    fn a_killed_owner_lets_go() {
        let directory = tempfile::tempdir().unwrap();
        let mut owner = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "run_directory::lock::tests::owner", "--nocapture"])
            .env(ROLE, directory.path())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(owner.stderr.take().unwrap()).lines();
        assert!(lines.any(|line| line.unwrap() == "locked"));
        let error = RunLock::acquire(directory.path()).unwrap_err().to_string();
        assert!(error.contains(&format!("in use by process {}", owner.id())), "{error}");
        owner.kill().unwrap();
        owner.wait().unwrap();
        assert!(RunLock::acquire(directory.path()).is_ok());
    }
}
