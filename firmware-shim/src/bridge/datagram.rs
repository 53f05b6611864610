//! A UDP socket that waits for datagrams, but not for ever.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

use super::BridgeError;

/// Longer datagrams are cut, and then are none that any peer sends.
const DATAGRAM_LIMIT: usize = 512;

/// A bound socket.
#[derive(Debug)]
pub struct DatagramSocket {
    socket: UdpSocket,
    bytes: Vec<u8>,
}

impl DatagramSocket {
    /// Binds an address; port 0 lets the operating system choose.
    ///
    /// # Errors
    /// [`BridgeError::Busy`] or [`BridgeError::Open`].
    pub fn open(address: SocketAddr) -> Result<Self, BridgeError> {
        let socket = UdpSocket::bind(address).map_err(|reason| BridgeError::opening("UDP", address, reason))?;
        Ok(Self { socket, bytes: vec![0; DATAGRAM_LIMIT] })
    }

    /// The bound address.
    ///
    /// # Errors
    /// [`BridgeError::Socket`] if the operating system does not tell.
    pub fn address(&self) -> Result<SocketAddr, BridgeError> {
        self.socket.local_addr().map_err(BridgeError::Socket)
    }

    /// The next datagram and its sender; nothing if none arrives within `limit`, which is above zero.
    ///
    /// # Errors
    /// [`BridgeError::Socket`] if the socket itself fails; a peer that has gone is no failure.
    pub fn receive(&mut self, limit: Duration) -> Result<Option<(&[u8], SocketAddr)>, BridgeError> {
        self.socket.set_read_timeout(Some(limit)).map_err(BridgeError::Socket)?;
        match self.socket.recv_from(&mut self.bytes) {
            Ok((len, sender)) => Ok(Some((&self.bytes[..len], sender))),
            Err(error) if passes(&error) => Ok(None),
            Err(error) => Err(BridgeError::Socket(error)),
        }
    }

    /// The next datagram and its sender, if one has arrived.
    ///
    /// # Errors
    /// [`BridgeError::Socket`] if the socket itself fails.
    pub fn poll(&mut self) -> Result<Option<(&[u8], SocketAddr)>, BridgeError> {
        self.socket.set_nonblocking(true).map_err(BridgeError::Socket)?;
        let received = self.socket.recv_from(&mut self.bytes);
        self.socket.set_nonblocking(false).map_err(BridgeError::Socket)?;
        match received {
            Ok((len, sender)) => Ok(Some((&self.bytes[..len], sender))),
            Err(error) if passes(&error) => Ok(None),
            Err(error) => Err(BridgeError::Socket(error)),
        }
    }

    /// Forgets what has arrived.
    ///
    /// # Errors
    /// [`BridgeError::Socket`] if the socket itself fails.
    pub fn drain(&mut self) -> Result<(), BridgeError> {
        self.socket.set_nonblocking(true).map_err(BridgeError::Socket)?;
        while self.socket.recv_from(&mut self.bytes).is_ok() {}
        self.socket.set_nonblocking(false).map_err(BridgeError::Socket)
    }

    /// Sends a datagram. What cannot be sent is lost, as datagrams may be.
    pub fn send(&self, datagram: &[u8], peer: SocketAddr) {
        let _lost = self.socket.send_to(datagram, peer);
    }
}

/// Whether the next datagram may arrive all the same.
fn passes(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock
            | ErrorKind::TimedOut
            | ErrorKind::Interrupted
            | ErrorKind::ConnectionRefused
            | ErrorKind::ConnectionReset
    )
}
