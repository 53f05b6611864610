//! A serial line to a radio or a companion computer, or a pseudo-terminal.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::stream::Stream;
use super::{DATAGRAM_LIMIT, EndpointId, Link, LinkAddress, LinkError, Listeners, Received};

/// What telemetry radios run at, and PX4's first telemetry port \[bit/s\].
pub const DEFAULT_BAUD: u32 = 57_600;

/// Bytes that wait for the line: 0.7 s of it at the default rate, for older telemetry is of no use. What does not fit is
/// lost.
const WAITING_LIMIT: usize = 4096;

/// A device and its rate, written `PATH` or `PATH:BAUD`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SerialPort {
    /// Of the device.
    pub path: PathBuf,
    /// Rate \[bit/s\]; pseudo-terminals and USB devices do not care.
    pub baud: u32,
}

/// What is no [`SerialPort`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected PATH or PATH:BAUD with a rate of 1 or more, found \"{0}\"")]
pub struct SerialPortError(String);

impl FromStr for SerialPort {
    type Err = SerialPortError;

    fn from_str(text: &str) -> Result<Self, SerialPortError> {
        let wrong = || SerialPortError(text.to_owned());
        // Names of devices may hold colons; only digits behind the last one are a rate.
        let (path, baud) = match text.rsplit_once(':') {
            Some((path, digits)) if digits.bytes().all(|byte| byte.is_ascii_digit()) => {
                (path, digits.parse().map_err(|_| wrong())?)
            }
            Some(_) | None => (text, DEFAULT_BAUD),
        };
        if path.is_empty() || baud == 0 {
            return Err(wrong());
        }
        Ok(Self { path: path.into(), baud })
    }
}

/// A serial line: eight data bits, no parity, one stop bit, no flow control, no other program at the same end.
///
/// The line is its one endpoint, and gets every frame from the start: a radio cannot ask for them.
#[derive(Debug)]
pub struct SerialLink {
    stream: Stream<File>,
    path: PathBuf,
    /// What went wrong while sending.
    failure: Option<io::Error>,
}

impl SerialLink {
    /// Opens a device.
    ///
    /// # Errors
    /// [`LinkError::Busy`], [`LinkError::Open`], [`LinkError::NotSerial`] or [`LinkError::Baud`].
    pub fn open(port: &SerialPort) -> Result<Self, LinkError> {
        let stream = Stream::new(device::open(port)?, WAITING_LIMIT);
        Ok(Self { stream, path: port.path.clone(), failure: None })
    }

    fn failed(&self, reason: io::Error) -> LinkError {
        failed(&self.path, reason)
    }
}

fn failed(path: &Path, reason: io::Error) -> LinkError {
    LinkError::Failed { place: LinkAddress::Serial(path.to_owned()), reason }
}

impl Link for SerialLink {
    fn advance(&mut self, _now_secs: f64) -> Result<(), LinkError> {
        if let Some(reason) = self.failure.take() {
            return Err(self.failed(reason));
        }
        self.stream.advance().map_err(|reason| self.failed(reason))
    }

    fn receive<'b>(&mut self, buffer: &'b mut [u8; DATAGRAM_LIMIT]) -> Result<Option<Received<'b>>, LinkError> {
        match self.stream.receive(buffer) {
            Ok(None) => Ok(None),
            Ok(Some(len)) => Ok(Some(Received { datagram: &buffer[..len], endpoint: EndpointId::ONLY })),
            Err(reason) => Err(self.failed(reason)),
        }
    }

    fn learn(&mut self, _endpoint: EndpointId) {}

    fn listeners(&self) -> Listeners {
        [EndpointId::ONLY].into_iter().collect()
    }

    fn send_to(&mut self, _endpoint: EndpointId, frame: &[u8]) {
        if let Err(reason) = self.stream.send(frame) {
            self.failure = Some(reason);
        }
    }
}

#[cfg(unix)]
mod device {
    use std::fs::{File, TryLockError};
    use std::io;

    use rustix::fs::{Mode, OFlags, open as open_file};
    use rustix::termios::{ControlModes, OptionalActions, Termios, ioctl_tiocexcl, isatty, tcgetattr, tcsetattr};

    use super::super::{LinkAddress, LinkError};
    use super::SerialPort;

    /// Opens a device for this program alone, raw and never blocking.
    pub(super) fn open(port: &SerialPort) -> Result<File, LinkError> {
        let place = || LinkAddress::Serial(port.path.clone());
        let refused = |reason| LinkError::opening(place(), reason);
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let file = File::from(open_file(&port.path, flags, Mode::empty()).map_err(|error| refused(error.into()))?);
        let path = || port.path.display().to_string();
        if !isatty(&file) {
            return Err(LinkError::NotSerial { path: path() });
        }
        match file.try_lock() {
            Ok(()) => (),
            Err(TryLockError::WouldBlock) => return Err(LinkError::Busy { place: place() }),
            Err(TryLockError::Error(reason)) => return Err(refused(reason)),
        }
        // The lock is a custom that terminal programs share; this one is the kernel's.
        ioctl_tiocexcl(&file).map_err(|error| refused(error.into()))?;
        let settings = tcgetattr(&file).map_err(|error| refused(error.into()))?;
        configure(&file, settings, port.baud).map_err(|reason| LinkError::Baud {
            path: path(),
            baud: port.baud,
            reason,
        })?;
        Ok(file)
    }

    fn configure(file: &File, mut settings: Termios, baud: u32) -> io::Result<()> {
        settings.make_raw();
        settings.control_modes |= ControlModes::CLOCAL | ControlModes::CREAD;
        settings.control_modes -= ControlModes::CSTOPB | ControlModes::CRTSCTS;
        settings.set_speed(baud)?;
        Ok(tcsetattr(file, OptionalActions::Now, &settings)?)
    }
}

#[cfg(not(unix))]
mod device {
    use std::fs::File;
    use std::io::ErrorKind;

    use super::super::{LinkAddress, LinkError};
    use super::SerialPort;

    /// Serial lines elsewhere have other interfaces.
    pub(super) fn open(port: &SerialPort) -> Result<File, LinkError> {
        Err(LinkError::Open {
            place: LinkAddress::Serial(port.path.clone()),
            reason: ErrorKind::Unsupported.into(),
        })
    }
}

#[cfg(test)]
mod tests;
