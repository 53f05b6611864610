//! Flight logs in the formats that loggers write: [`read`] takes the first reader that knows the file.

mod crazyflie;
mod dataflash;
mod table;
mod ulog;

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;

use crate::alignment::aligned;
use crate::error::LogError;
use crate::flight::{CommandRecord, Flight, Recording};
use crate::track::Track;

pub use crazyflie::Crazyflie;
pub use dataflash::DataFlash;
pub use table::Table;
pub use ulog::Ulog;

/// Largest log that is read \[bytes\], unpacked: an hour at 1 kHz has a tenth of it.
const LARGEST_LOG: u64 = 2 << 30;

/// Motors of a quadrotor X in PX4, and `ArduPilot` by default (front right, rear left, front left, rear right), clockwise.
const PX4_CLOCKWISE: [usize; 4] = [0, 3, 1, 2];

/// Longest time between samples of all commands \[s\]: the controllers of both run at 250 Hz and more.
const COMPLETE_PERIOD_SECS: f64 = 0.005;

/// A format of flight logs.
pub trait LogReader: Sync {
    /// Its name, for messages.
    fn format(&self) -> &'static str;

    /// Whether a file that begins so is of this format.
    fn recognises(&self, bytes: &[u8]) -> bool;

    /// The signals of the file called `name`.
    ///
    /// # Errors
    /// Where it is damaged, or what it lacks.
    fn recording(&self, name: &str, bytes: &[u8]) -> Result<Recording, LogError>;
}

/// Every reader, the one that accepts any text last.
pub const READERS: [&dyn LogReader; 4] = [&Crazyflie, &Ulog, &DataFlash, &Table];

/// The flight of a log, packed with gzip or not.
///
/// # Errors
/// When the file cannot be read, no reader knows it, or it holds no flight.
pub fn read(path: &Path) -> Result<Flight, LogError> {
    let name = path.display().to_string();
    let bytes = unpacked(path).map_err(|error| LogError::at(&name, error, "a readable file"))?;
    parse(&name, &bytes)
}

/// The flight of a log's bytes.
///
/// # Errors
/// When no reader knows it, or it holds no flight.
pub fn parse(name: &str, bytes: &[u8]) -> Result<Flight, LogError> {
    let Some(reader) = READERS.into_iter().find(|reader| reader.recognises(bytes)) else {
        let formats = READERS.map(LogReader::format).join(", ");
        return Err(LogError::at(name, "a file of no known format", formats));
    };
    Flight::resampled(&aligned(reader.recording(name, bytes)?))
}

/// Whether commands of an autopilot are all that it gave.
fn completeness(commands: &Track<4>) -> CommandRecord {
    match commands.period_secs() {
        Some(period) if period <= COMPLETE_PERIOD_SECS => CommandRecord::Complete,
        Some(_) | None => CommandRecord::Sampled,
    }
}

/// A vector in axes north, east, down, or forward, right, down, half a turn about x: north, west, up.
fn turned([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, -y, -z]
}

fn unpacked(path: &Path) -> io::Result<Vec<u8>> {
    let mut file = BufReader::new(File::open(path)?);
    let mut magic = [0; 2];
    let packed = file.read_exact(&mut magic).is_ok() && magic == [0x1f, 0x8b];
    let file = BufReader::new(File::open(path)?);
    let mut bytes = Vec::new();
    if packed {
        MultiGzDecoder::new(file).take(LARGEST_LOG).read_to_end(&mut bytes)?;
    } else {
        file.take(LARGEST_LOG).read_to_end(&mut bytes)?;
    }
    Ok(bytes)
}
