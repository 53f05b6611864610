//! What commands that show flights have in common: their arguments' ranges, and the files that they write.

use std::path::Path;

use anyhow::{Result, bail};
use kestrel_draw::video::VideoError;
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::progress::Progress;

/// What kind of file is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    /// A moment.
    Png,
    /// The whole flight.
    Gif,
}

impl Format {
    /// By the ending of a file's name.
    pub(crate) fn of(output: &Path) -> Result<Self> {
        match output.extension().and_then(|ending| ending.to_str()) {
            Some("png") => Ok(Self::Png),
            Some("gif") => Ok(Self::Gif),
            Some(_) | None => bail!("{}: found another ending, expected .png or .gif", output.display()),
        }
    }
}

/// A video of so many pictures, with a progress bar, unless the user stops it; `video` asks after each whether to go on.
pub(crate) fn filmed(
    pictures: usize,
    video: impl FnOnce(&mut dyn FnMut(usize) -> bool) -> Result<Option<Vec<u8>>, VideoError>,
) -> Result<Option<Vec<u8>>> {
    let interrupt = Interrupt::watch("Stopping: nothing is written.")?;
    let mut progress = Progress::counting("pictures", pictures as u64, 0);
    let file = video(&mut |done| {
        progress.show_steps(done as u64, String::new);
        !interrupt.requested()
    })?;
    progress.finish();
    Ok(file)
}

pub(crate) fn view_angle(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(angle) if (1.0..=170.0).contains(&angle) => Ok(angle),
        Ok(_) | Err(_) => Err("expected 1 to 170 degrees".to_owned()),
    }
}

pub(crate) fn seconds(text: &str) -> Result<f32, String> {
    match text.parse() {
        Ok(secs) if (0.0..=1e6).contains(&secs) => Ok(secs),
        Ok(_) | Err(_) => Err("expected 0 to 1e6 seconds".to_owned()),
    }
}
