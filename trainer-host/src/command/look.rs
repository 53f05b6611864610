//! What commands that show flights have in common: their arguments' ranges, and the files that they write.

use std::path::Path;

use anyhow::{Result, bail};
use kestrel_draw::video::{VideoError, VideoFormat};
use kestrel_experiments::interrupt::Interrupt;
use kestrel_experiments::progress::Progress;

/// What kind of file is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    /// A moment.
    Png,
    /// The whole flight.
    Video(VideoFormat),
}

impl Format {
    /// By the ending of a file's name.
    pub(crate) fn of(output: &Path) -> Result<Self> {
        if output.extension().is_some_and(|ending| ending == "png") {
            return Ok(Self::Png);
        }
        let Some(format) = VideoFormat::of(output) else {
            bail!("{}: found another ending, expected .png, .gif or .mp4", output.display());
        };
        Ok(Self::Video(format))
    }
}

/// A video of so many pictures, with a progress bar, unless the user stops it.
pub(crate) fn filmed_unless_stopped(
    pictures: usize,
    video: impl FnOnce(&mut dyn FnMut(usize) -> bool) -> Result<Option<Vec<u8>>, VideoError>,
) -> Result<Option<Vec<u8>>> {
    let interrupt = Interrupt::watch("Stopping: nothing is written.")?;
    filmed(pictures, &|| !interrupt.requested(), video)
}

/// A video of so many pictures, with a progress bar; it asks after each whether it `goes_on`.
pub(crate) fn filmed(
    pictures: usize,
    goes_on: &dyn Fn() -> bool,
    video: impl FnOnce(&mut dyn FnMut(usize) -> bool) -> Result<Option<Vec<u8>>, VideoError>,
) -> Result<Option<Vec<u8>>> {
    let mut progress = Progress::counting("pictures", pictures as u64, 0);
    let file = video(&mut |done| {
        progress.show_steps(done as u64, String::new);
        goes_on()
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
