//! The log of a flight: every frame as it was received or sent, behind its time, as pymavlink and ground stations write it
//! (`.tlog`).

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crate::frame::Frames;

/// What is written appears in the file after so much simulated time \[s\].
const FLUSH_SECS: f64 = 1.0;

/// A log that cannot be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write the flight log {}: {reason}", path.display())]
pub struct FlightLogError {
    /// Of the log.
    pub path: PathBuf,
    /// Reason of the operating system.
    pub reason: io::Error,
}

/// A log that grows: for each frame eight bytes, the time in µs since 1970 as a big-endian number, and the frame.
#[derive(Debug)]
pub struct FlightLog {
    path: PathBuf,
    file: BufWriter<File>,
    /// Since 1970.
    start: Duration,
    flush_due_secs: f64,
    /// What went wrong in this control period.
    failure: Option<io::Error>,
}

impl FlightLog {
    /// An empty file for a flight whose simulated time began `start` after 1970.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn create(path: &Path, start: Duration) -> Result<Self, FlightLogError> {
        let file = File::create(path).map_err(|reason| FlightLogError { path: path.to_owned(), reason })?;
        Ok(Self {
            path: path.to_owned(),
            file: BufWriter::new(file),
            start,
            flush_due_secs: FLUSH_SECS,
            failure: None,
        })
    }

    /// Notes the good frames of a datagram, received or sent at `now_secs` \[s, simulated\]. A failure shows in
    /// [`FlightLog::end_period`].
    pub fn note(&mut self, now_secs: f64, datagram: &[u8]) {
        let time_us = (self.start + Duration::from_secs_f64(now_secs)).as_micros() as u64;
        for frame in Frames::new(datagram).flatten() {
            let written =
                self.file.write_all(&time_us.to_be_bytes()).and_then(|()| self.file.write_all(frame.bytes));
            self.failure = self.failure.take().or(written.err());
        }
    }

    /// Ends a control period at `now_secs` \[s, simulated\].
    ///
    /// # Errors
    /// If something could not be written.
    pub fn end_period(&mut self, now_secs: f64) -> Result<(), FlightLogError> {
        if now_secs >= self.flush_due_secs {
            self.flush_due_secs = now_secs + FLUSH_SECS;
            return self.finish();
        }
        self.failure.take().map_or(Ok(()), |reason| Err(self.error(reason)))
    }

    /// Has everything in the file.
    ///
    /// # Errors
    /// If something could not be written.
    pub fn finish(&mut self) -> Result<(), FlightLogError> {
        let flushed = self.file.flush();
        let failure = self.failure.take().or(flushed.err());
        failure.map_or(Ok(()), |reason| Err(self.error(reason)))
    }

    fn error(&self, reason: io::Error) -> FlightLogError {
        FlightLogError { path: self.path.clone(), reason }
    }
}

/// Time since 1970 by the clock of this machine; zero if that stands before 1970.
pub fn now() -> Duration {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use mavlink::dialects::common::{HEARTBEAT_DATA, MavCmd};

    use super::*;
    use crate::testing::{command_long, datagram, read_flight_log};

    fn place() -> tempfile::TempDir {
        tempfile::tempdir().unwrap()
    }

    #[test]
    fn a_log_is_read_back_frame_by_frame() {
        let folder = place();
        let path = folder.path().join("flight.tlog");
        let mut log = FlightLog::create(&path, Duration::from_secs(1_000_000_000)).unwrap();
        let heartbeat = datagram(&HEARTBEAT_DATA::default());
        let command = datagram(&command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0; 7]));
        log.note(0.0, &heartbeat);
        log.note(0.25, &[&command[..], &heartbeat, b"noise"].concat());
        log.note(0.5, b"nothing but noise");
        log.finish().unwrap();
        let expected = [(0, &heartbeat), (250_000, &command), (250_000, &heartbeat)]
            .map(|(after_us, frame)| (1_000_000_000_000_000 + after_us, frame.clone()));
        assert_eq!(read_flight_log(&fs::read(&path).unwrap()), expected);
    }

    #[test]
    fn it_is_in_the_file_after_a_second() {
        let folder = place();
        let path = folder.path().join("flight.tlog");
        let mut log = FlightLog::create(&path, Duration::ZERO).unwrap();
        let mut lengths = Vec::new();
        for now_secs in [0.0, 0.5, 1.0, 1.5, 2.0] {
            log.note(now_secs, &datagram(&HEARTBEAT_DATA::default()));
            log.end_period(now_secs).unwrap();
            lengths.push(fs::metadata(&path).unwrap().len() / 29);
        }
        assert_eq!(lengths, [0, 0, 3, 3, 5]);
    }

    #[test]
    fn a_log_that_cannot_be_created_is_named() {
        let error = FlightLog::create(Path::new("no/such/folder/flight.tlog"), Duration::ZERO).unwrap_err();
        assert!(
            error.to_string().starts_with("cannot write the flight log no/such/folder/flight.tlog: "),
            "{error}"
        );
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_shows_within_a_second() {
        let mut log = FlightLog::create(Path::new("/dev/full"), Duration::ZERO).unwrap();
        log.note(0.0, &datagram(&HEARTBEAT_DATA::default()));
        log.end_period(0.0).unwrap();
        assert!(log.end_period(1.0).is_err());
    }
}
