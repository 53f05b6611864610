//! Parameters in a `.params` file.

use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use super::Parameters;
use super::text::TextError;

/// Longer files hold no parameters: PX4's thousand take 40 kB.
const LENGTH_LIMIT: u64 = 1 << 20;

/// Why a file is of no use.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// It cannot be read.
    #[error("cannot read parameters {}: {reason}", path.display())]
    Read {
        /// Of the file.
        path: PathBuf,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// It is far too long.
    #[error("{} holds no parameters: expected at most {LENGTH_LIMIT} bytes, found more", path.display())]
    Length {
        /// Of the file.
        path: PathBuf,
    },
    /// It says something wrong.
    #[error("parameters {}, {reason}", path.display())]
    Text {
        /// Of the file.
        path: PathBuf,
        /// The first wrong line.
        reason: TextError,
    },
    /// It cannot be written.
    #[error("cannot write parameters {}: {reason}", path.display())]
    Write {
        /// Of the file.
        path: PathBuf,
        /// Reason of the operating system.
        reason: io::Error,
    },
}

/// Takes over what a file says.
///
/// # Errors
/// What is wrong with the file; nothing has changed then.
pub fn read(path: &Path, parameters: &mut Parameters) -> Result<(), FileError> {
    let failed = |reason| FileError::Read { path: path.to_owned(), reason };
    let mut text = String::new();
    // Read to one byte beyond the limit: the length of a device or a pipe is not known before.
    File::open(path).map_err(failed)?.take(LENGTH_LIMIT + 1).read_to_string(&mut text).map_err(failed)?;
    if text.len() as u64 > LENGTH_LIMIT {
        return Err(FileError::Length { path: path.to_owned() });
    }
    parameters.read_text(&text).map_err(|reason| FileError::Text { path: path.to_owned(), reason })
}

/// Saves all of them: beside the place of the file, synced, then renamed into it.
///
/// # Errors
/// [`FileError::Write`]; whatever the file held before is then still there, whole.
pub fn save(path: &Path, parameters: &Parameters) -> Result<(), FileError> {
    let unfinished = unfinished(path);
    replace(path, &unfinished, parameters).map_err(|reason| {
        let _absent = fs::remove_file(&unfinished);
        FileError::Write { path: path.to_owned(), reason }
    })
}

/// Where the file is written before it is whole; no other process writes there.
fn unfinished(path: &Path) -> PathBuf {
    let mut name = std::ffi::OsString::from(".unfinished-");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!("-{}", std::process::id()));
    path.with_file_name(name)
}

fn replace(path: &Path, unfinished: &Path, parameters: &Parameters) -> io::Result<()> {
    let mut text = String::new();
    parameters.to_text(&mut text).map_err(io::Error::other)?;
    let mut file = File::create(unfinished)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()?;
    fs::rename(unfinished, path)?;
    let directory = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Makes the renaming itself survive a power cut.
    if cfg!(unix) { File::open(directory)?.sync_all() } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::super::ParameterValue;
    use super::super::table::Parameter;
    use super::*;

    /// A directory of its own for every test.
    struct Directory(PathBuf);

    impl Directory {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("kestrel-parameters-{name}-{}", std::process::id()));
            fs::create_dir_all(&path).unwrap();
            Self(path)
        }
    }

    impl Drop for Directory {
        fn drop(&mut self) {
            let _gone = fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn a_file_is_replaced_whole_and_read_back() {
        let directory = Directory::new("round-trip");
        let path = directory.0.join("vehicle.params");
        fs::write(&path, "something old").unwrap();
        let mut parameters = Parameters::new(1);
        parameters.set(Parameter::MpcXyCruise, ParameterValue::Real(0.1)).unwrap();
        save(&path, &parameters).unwrap();
        let mut again = Parameters::new(1);
        read(&path, &mut again).unwrap();
        assert_eq!(again, parameters);
        assert_eq!(fs::read_dir(&directory.0).unwrap().count(), 1, "nothing is left beside it");
    }

    #[test]
    fn what_cannot_be_written_is_named_and_leaves_nothing_behind() {
        let directory = Directory::new("unwritable");
        let taken = directory.0.join("taken");
        fs::create_dir(&taken).unwrap();
        let error = save(&taken, &Parameters::new(1)).unwrap_err().to_string();
        assert!(error.starts_with(&format!("cannot write parameters {}: ", taken.display())), "{error}");
        assert_eq!(fs::read_dir(&directory.0).unwrap().count(), 1);
        assert!(save(&directory.0.join("no/such/directory"), &Parameters::new(1)).is_err());
    }

    #[test]
    fn what_cannot_be_read_is_named() {
        let directory = Directory::new("unreadable");
        let path = directory.0.join("vehicle.params");
        let told = |path: &Path| read(path, &mut Parameters::new(1)).unwrap_err().to_string();
        assert!(told(&path).starts_with(&format!("cannot read parameters {}: ", path.display())));
        fs::write(&path, "1\t1\tGF_ACTION\t4\t6\n").unwrap();
        let expected = "line 1: GF_ACTION: expected one of [0, 1, 2, 3, 5], found 4";
        assert_eq!(told(&path), format!("parameters {}, {expected}", path.display()));
        fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(told(&path).contains("UTF-8"));
        fs::write(&path, "#".repeat(LENGTH_LIMIT as usize + 1)).unwrap();
        assert!(told(&path).contains("expected at most 1048576 bytes"));
    }
}
