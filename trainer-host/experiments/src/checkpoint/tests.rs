use super::*;

#[derive(Debug, PartialEq, Serialize, serde::Deserialize)]
struct Model {
    weights: Vec<f32>,
    steps: u64,
}

fn model(steps: u64) -> Model {
    Model { weights: vec![0.5, -1.0, f32::MIN_POSITIVE], steps }
}

fn checkpoints() -> (tempfile::TempDir, Checkpoints) {
    let directory = tempfile::tempdir().unwrap();
    let checkpoints = Checkpoints::in_directory(directory.path());
    (directory, checkpoints)
}

/// A disk with room for so many bytes.
struct SmallDisk<'a> {
    file: &'a mut File,
    room: usize,
}

impl Write for SmallDisk<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.room == 0 {
            return Err(io::Error::from_raw_os_error(28)); // ENOSPC
        }
        let written = self.file.write(&bytes[..bytes.len().min(self.room)])?;
        self.room -= written;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

#[test]
fn what_was_saved_is_restored() {
    let (_directory, checkpoints) = checkpoints();
    let path = checkpoints.save(7, &model(70)).unwrap();
    let restored = checkpoints.load_newest::<Model>().unwrap();
    assert_eq!((restored.state, restored.updates, restored.path), (model(70), 7, path));
}

#[test]
fn the_last_two_are_kept() {
    let (_directory, checkpoints) = checkpoints();
    for updates in [1, 2, 9, 10, 200_000_000_000] {
        checkpoints.save(updates, &model(updates)).unwrap();
    }
    assert_eq!(checkpoints.saved().unwrap(), [10, 200_000_000_000]);
    assert_eq!(checkpoints.load_newest::<Model>().unwrap().state, model(200_000_000_000));
}

#[test]
fn saving_twice_after_the_same_update_keeps_the_one_before() {
    let (_directory, checkpoints) = checkpoints();
    for updates in [1, 2, 2] {
        checkpoints.save(updates, &model(updates)).unwrap();
    }
    assert_eq!(checkpoints.saved().unwrap(), [1, 2]);
}

#[test]
fn a_damaged_newest_gives_way_to_the_one_before_and_says_so() {
    let (_directory, checkpoints) = checkpoints();
    checkpoints.save(1, &model(1)).unwrap();
    let newest = checkpoints.save(2, &model(2)).unwrap();
    let mut bytes = fs::read(&newest).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(&newest, bytes).unwrap();

    let restored = checkpoints.load_newest::<Model>().unwrap();
    assert_eq!((restored.state, restored.updates), (model(1), 1));
    let warning = load::<Model>(&newest).unwrap_err().to_string();
    assert!(warning.starts_with(&format!("{} is damaged: found CRC-32 ", newest.display())), "{warning}");
}

#[test]
fn a_run_set_back_forgets_the_future_it_left() {
    let (_directory, checkpoints) = checkpoints();
    for updates in [10, 20] {
        checkpoints.save(updates, &model(updates)).unwrap();
    }
    checkpoints.save(15, &model(15)).unwrap();
    assert_eq!(checkpoints.saved().unwrap(), [10, 15]);
}

#[test]
fn when_both_are_damaged_the_newest_is_blamed() {
    let (_directory, checkpoints) = checkpoints();
    let paths = [1, 2].map(|updates| checkpoints.save(updates, &model(updates)).unwrap());
    for path in &paths {
        fs::write(path, "").unwrap();
    }
    let error = checkpoints.load_newest::<Model>().unwrap_err().to_string();
    assert_eq!(error, format!("{} is truncated: found 0 bytes, expected 24", paths[1].display()));
}

#[test]
fn without_a_checkpoint_the_error_says_what_to_do() {
    let (directory, checkpoints) = checkpoints();
    let error = checkpoints.load_newest::<Model>().unwrap_err().to_string();
    let path = directory.path().display();
    assert_eq!(error, format!("{path} holds no checkpoint: the run ended before its first one, start it anew"));
}

#[test]
fn a_disk_that_fills_up_leaves_the_old_checkpoints_and_one_error() {
    let (directory, checkpoints) = checkpoints();
    checkpoints.save(1, &model(1)).unwrap();
    checkpoints.save(2, &model(2)).unwrap();
    let bytes = KIND.encode(&model(3));
    for room in 0..bytes.len() {
        let fill = |file: &mut File| SmallDisk { file, room }.write_all(&bytes);
        let error = checkpoints.save_through(3, fill).unwrap_err().to_string();
        let expected = "update-00000003.checkpoint: No space left on device (os error 28)";
        assert!(error.starts_with("cannot write ") && error.ends_with(expected), "{error}");
    }
    assert_eq!(checkpoints.saved().unwrap(), [1, 2]);
    assert_eq!(checkpoints.load_newest::<Model>().unwrap().state, model(2));
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 2, "no half files are left");
}
