//! A TCP server: ground stations and scripts connect to the vehicle.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

use super::stream::Stream;
use super::{DATAGRAM_LIMIT, EndpointId, Link, LinkAddress, LinkError, Listeners, Received};

/// Where ground stations look for a vehicle in simulation, as the one of `ArduPilot` offers it.
pub const DEFAULT_PORT: u16 = 5760;

/// Clients at a time; one more takes the place of one that says nothing.
pub const CLIENTS: usize = 8;

/// Connections that are accepted in one control period.
const CONNECTIONS_PER_PERIOD: usize = 16;

/// Bytes that wait for one client: more than ten seconds of telemetry in real time. What does not fit is lost.
const WAITING_LIMIT: usize = 1 << 16;

/// A client that takes nothing for so long, by the wall clock, is gone \[s\]: networks recover within a few seconds.
const STALL_LIMIT: Duration = Duration::from_secs(5);

/// A client that has said nothing good for so long, by the wall clock, gives way to another one \[s\]: whoever listens says so
/// once a second.
const SILENCE_LIMIT: Duration = Duration::from_secs(30);

/// A listening socket and its clients. A client is told everything from its first moment on, as ground stations expect it.
#[derive(Debug)]
pub struct TcpLink {
    listener: TcpListener,
    address: SocketAddr,
    clients: [Option<Client>; CLIENTS],
    /// Clients that came so far.
    generation: u32,
    /// Whose turn it is to be heard.
    turn: usize,
    stall_limit: Duration,
    silence_limit: Duration,
}

#[derive(Debug)]
struct Client {
    stream: Stream<TcpStream>,
    generation: u32,
    came: Instant,
    /// When it last said something good, if it did.
    heard: Option<Instant>,
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
        let (stall_limit, silence_limit) = (STALL_LIMIT, SILENCE_LIMIT);
        Ok(Self { listener, address, clients, generation: 0, turn: 0, stall_limit, silence_limit })
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
            let Some(place) = self.place() else { continue };
            self.generation = self.generation.wrapping_add(1);
            let prepared = stream.set_nonblocking(true).and_then(|()| stream.set_nodelay(true));
            self.clients[place] = prepared.ok().map(|()| Client {
                stream: Stream::new(stream, WAITING_LIMIT),
                generation: self.generation,
                came: Instant::now(),
                heard: None,
            });
        }
    }

    /// For one more client: a free place, or that of the one that came first of those that never said anything, or of one
    /// that fell silent.
    fn place(&self) -> Option<usize> {
        let numbered = || self.clients.iter().enumerate();
        let free = numbered().find(|(_, client)| client.is_none()).map(|(number, _)| number);
        let present = || numbered().filter_map(|(number, client)| Some((number, client.as_ref()?)));
        let mute = present().filter(|(_, client)| client.heard.is_none()).min_by_key(|(_, client)| client.came);
        let silent = present()
            .filter(|(_, client)| client.heard.is_some_and(|heard| heard.elapsed() >= self.silence_limit))
            .min_by_key(|(_, client)| client.heard);
        free.or(mute.or(silent).map(|(number, _)| number))
    }

    /// Has a client do something; if it fails at it, it is gone.
    fn has(&mut self, number: usize, act: impl FnOnce(&mut Stream<TcpStream>) -> io::Result<()>) {
        let Some(place) = self.clients.get_mut(number) else { return };
        if place.as_mut().is_some_and(|client| act(&mut client.stream).is_err()) {
            *place = None;
        }
    }

    /// The client, if it is still that one.
    fn client(&mut self, endpoint: EndpointId) -> Option<&mut Client> {
        let client = self.clients.get_mut(usize::from(endpoint.number))?.as_mut()?;
        (client.generation == endpoint.generation).then_some(client)
    }
}

impl Link for TcpLink {
    fn advance(&mut self, _now_secs: f64) -> Result<(), LinkError> {
        self.accept();
        let stall_limit = self.stall_limit;
        for number in 0..CLIENTS {
            self.has(number, |client| {
                client.advance()?;
                if client.stalled() > stall_limit { Err(ErrorKind::TimedOut.into()) } else { Ok(()) }
            });
        }
        Ok(())
    }

    fn receive<'b>(&mut self, buffer: &'b mut [u8; DATAGRAM_LIMIT]) -> Result<Option<Received<'b>>, LinkError> {
        for offset in 0..CLIENTS {
            let number = (self.turn + offset) % CLIENTS;
            let Some(client) = &mut self.clients[number] else { continue };
            match client.stream.receive(buffer) {
                Ok(Some(len)) => {
                    self.turn = number + 1;
                    let endpoint = EndpointId { number: number as u8, generation: client.generation };
                    return Ok(Some(Received { datagram: &buffer[..len], endpoint }));
                }
                Ok(None) => (),
                Err(_) => self.clients[number] = None,
            }
        }
        Ok(None)
    }

    fn learn(&mut self, endpoint: EndpointId) {
        if let Some(client) = self.client(endpoint) {
            client.heard = Some(Instant::now());
        }
    }

    fn listeners(&self) -> Listeners {
        let numbered = (0..).zip(&self.clients);
        numbered
            .filter_map(|(number, client)| Some(EndpointId { number, generation: client.as_ref()?.generation }))
            .collect()
    }

    fn send_to(&mut self, endpoint: EndpointId, frame: &[u8]) {
        if self.client(endpoint).is_some() {
            self.has(usize::from(endpoint.number), |client| client.send(frame));
        }
    }
}

#[cfg(test)]
mod tests;
