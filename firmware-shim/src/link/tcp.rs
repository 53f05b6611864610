//! A TCP server: ground stations and scripts connect to the vehicle.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

use super::stream::Stream;
use super::{DATAGRAM_LIMIT, Link, LinkAddress, LinkError, Received};

/// Where ground stations look for a vehicle in simulation, as the one of `ArduPilot` offers it.
pub const DEFAULT_PORT: u16 = 5760;

/// Clients at a time; the connection of one more is closed.
pub const CLIENTS: usize = 8;

/// Connections that are accepted in one control period.
const CONNECTIONS_PER_PERIOD: usize = 16;

/// Bytes that wait for one client: more than ten seconds of telemetry in real time. What does not fit is lost.
const WAITING_LIMIT: usize = 1 << 16;

/// A client that takes nothing for so long, by the wall clock, is gone \[s\]: networks recover within a few seconds.
const STALL_LIMIT: Duration = Duration::from_secs(5);

/// A listening socket and its clients. A client is told everything from its first moment on, as ground stations expect it.
#[derive(Debug)]
pub struct TcpLink {
    listener: TcpListener,
    address: SocketAddr,
    clients: [Option<Stream<TcpStream>>; CLIENTS],
    /// Whose turn it is to be heard.
    turn: usize,
    stall_limit: Duration,
}

impl TcpLink {
    /// Listens at an address; port 0 lets the operating system choose.
    ///
    /// # Errors
    /// [`LinkError::Busy`] or [`LinkError::Open`].
    pub fn open(address: SocketAddr) -> Result<Self, LinkError> {
        let place = LinkAddress::Tcp(address);
        let bound = || {
            let listener = TcpListener::bind(address)?;
            listener.set_nonblocking(true)?;
            let address = listener.local_addr()?;
            Ok((listener, address))
        };
        let (listener, address) = bound().map_err(|reason| LinkError::opening(place, reason))?;
        let clients = [const { None }; CLIENTS];
        Ok(Self { listener, address, clients, turn: 0, stall_limit: STALL_LIMIT })
    }

    /// The bound address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// How many are connected.
    pub fn clients(&self) -> usize {
        self.clients.iter().flatten().count()
    }

    fn accept(&mut self) {
        for _ in 0..CONNECTIONS_PER_PERIOD {
            // Whatever the reason, the others fly on: a connection that broke, or no more file descriptors.
            let Ok((stream, _)) = self.listener.accept() else { return };
            let Some(place) = self.clients.iter_mut().find(|client| client.is_none()) else { continue };
            let prepared = stream.set_nonblocking(true).and_then(|()| stream.set_nodelay(true));
            *place = prepared.ok().map(|()| Stream::new(stream, WAITING_LIMIT));
        }
    }

    /// Has every client do something; those that fail at it are gone.
    fn each(&mut self, act: impl Fn(&mut Stream<TcpStream>) -> io::Result<()>) {
        for place in &mut self.clients {
            if place.as_mut().is_some_and(|client| act(client).is_err()) {
                *place = None;
            }
        }
    }
}

impl Link for TcpLink {
    fn advance(&mut self, _now_secs: f64) -> Result<(), LinkError> {
        self.accept();
        let stall_limit = self.stall_limit;
        self.each(|client| {
            client.advance()?;
            if client.stalled() > stall_limit { Err(ErrorKind::TimedOut.into()) } else { Ok(()) }
        });
        Ok(())
    }

    fn receive<'b>(&mut self, buffer: &'b mut [u8; DATAGRAM_LIMIT]) -> Result<Option<Received<'b>>, LinkError> {
        for offset in 0..CLIENTS {
            let endpoint = (self.turn + offset) % CLIENTS;
            let Some(client) = &mut self.clients[endpoint] else { continue };
            match client.receive(buffer) {
                Ok(Some(len)) => {
                    self.turn = endpoint + 1;
                    return Ok(Some(Received { datagram: &buffer[..len], endpoint }));
                }
                Ok(None) => (),
                Err(_) => self.clients[endpoint] = None,
            }
        }
        Ok(None)
    }

    fn learn(&mut self, _endpoint: usize) {}

    fn send(&mut self, frame: &[u8]) {
        self.each(|client| client.send(frame));
    }
}

#[cfg(test)]
mod tests;
