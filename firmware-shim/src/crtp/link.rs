//! The UDP socket of a server: one packet a datagram, one client at a time.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use kestrel_core::vehicle::State;

use super::access::{ClientOrder, CommandOutcome, VehicleAccess};
use super::packet::{PACKET_LIMIT, Packet};
use super::platform;
use super::server::CrtpServer;
use crate::autopilot::Command;
use crate::link::{LinkAddress, LinkError, is_silence};
use crate::plant::Ranges;
use crate::policy_backend::PolicyBackend;
use crate::vehicle::{Operator, Vehicle};

/// Where clients look for simulated drones first.
pub const DEFAULT_PORT: u16 = 19850;

/// Datagrams that are read in one control period; a flood waits in the socket, and then is lost.
const DATAGRAMS_PER_TICK: usize = 64;

/// A client that is silent for so long gives way to one that waits. Living ones ask for an echo every 0.1 s.
const PATIENCE: Duration = Duration::from_millis(500);

/// A client that is silent for so long is forgotten.
const MEMORY: Duration = Duration::from_secs(5);

/// What answers the ping of a scan: a packet with nothing in it.
const NULL_PACKET: [u8; 1] = [0xFF];

/// A bound socket, the server behind it and the client before it.
#[derive(Debug)]
pub struct CrtpLink {
    socket: UdpSocket,
    /// As wanted, for messages.
    address: SocketAddr,
    server: CrtpServer,
    client: Option<Client>,
    /// Who has shaken hands while another client was served.
    waiting: Option<SocketAddr>,
    ranges: Option<Ranges>,
}

#[derive(Clone, Copy, Debug)]
struct Client {
    address: SocketAddr,
    heard: Instant,
}

impl CrtpLink {
    /// Binds an address; port 0 lets the operating system choose.
    ///
    /// # Errors
    /// [`LinkError::Busy`] or [`LinkError::Open`].
    pub fn open(address: SocketAddr) -> Result<Self, LinkError> {
        let place = || LinkAddress::Udp(address);
        let failed = |reason| LinkError::opening(place(), reason);
        let socket = UdpSocket::bind(address).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(Self { socket, address, server: CrtpServer::default(), client: None, waiting: None, ranges: None })
    }

    /// The bound address.
    ///
    /// # Errors
    /// [`LinkError::Failed`] if the operating system does not tell.
    pub fn address(&self) -> Result<SocketAddr, LinkError> {
        self.socket.local_addr().map_err(|reason| self.failed(reason))
    }

    fn failed(&self, reason: io::Error) -> LinkError {
        LinkError::Failed { place: LinkAddress::Udp(self.address), reason }
    }

    /// Takes note of what rangers measure.
    pub fn note_ranges(&mut self, ranges: Option<Ranges>) {
        self.ranges = ranges;
    }

    /// Serves the client for one control period: what it has sent is obeyed, what is due is sent to it.
    ///
    /// # Errors
    /// [`LinkError::Failed`] if the socket itself fails; a client that has gone is no failure.
    pub fn exchange<P: PolicyBackend>(
        &mut self,
        vehicle: &mut Vehicle<P>,
        state: &State<f32>,
    ) -> Result<(), LinkError> {
        self.change_client(Instant::now(), vehicle, state);
        for _ in 0..DATAGRAMS_PER_TICK {
            let Some((packet, sender)) = self.receive()? else { break };
            if let Some(packet) = packet.filter(|packet| self.is_served(packet, sender)) {
                self.serve(vehicle, state, |server, access| server.receive(&packet, access));
            }
        }
        self.serve(vehicle, state, CrtpServer::tick);
        Ok(())
    }

    /// The next datagram's packet, if it is one, and who sent it.
    fn receive(&self) -> Result<Option<(Option<Packet>, SocketAddr)>, LinkError> {
        // One byte more than a packet shows what is too long.
        let mut buffer = [0; PACKET_LIMIT + 1];
        match self.socket.recv_from(&mut buffer) {
            Ok((len, sender)) => Ok(Some((Packet::parse(&buffer[..len]), sender))),
            Err(error) if is_silence(&error) => Ok(None),
            Err(error) => Err(self.failed(error)),
        }
    }

    /// Whether a packet is the client's, or its sender is the client from now on. Answers pings of scans.
    fn is_served(&mut self, packet: &Packet, sender: SocketAddr) -> bool {
        if packet.is_null() {
            let _lost = self.socket.send_to(&NULL_PACKET, sender);
            return false;
        }
        match &mut self.client {
            Some(client) if client.address == sender => client.heard = Instant::now(),
            Some(_) => {
                if platform::is_handshake(packet) {
                    self.waiting = Some(sender);
                }
                return false;
            }
            None => self.client = Some(Client { address: sender, heard: Instant::now() }),
        }
        true
    }

    /// Forgets a client that is silent; a client that waits takes its place, and its handshake is answered then.
    fn change_client<P: PolicyBackend>(&mut self, now: Instant, vehicle: &mut Vehicle<P>, state: &State<f32>) {
        let Some(client) = self.client else { return };
        let silence = now.saturating_duration_since(client.heard);
        if silence < if self.waiting.is_some() { PATIENCE } else { MEMORY } {
            return;
        }
        self.server.part();
        self.client = self.waiting.take().map(|address| Client { address, heard: now });
        if self.client.is_some() {
            self.serve(vehicle, state, |server, access| server.receive(&platform::handshake(), access));
        }
    }

    /// Has the server act on the vehicle, and toward the client.
    fn serve<P: PolicyBackend>(
        &mut self,
        vehicle: &mut Vehicle<P>,
        state: &State<f32>,
        act: impl FnOnce(&mut CrtpServer, &mut VehicleAccess),
    ) {
        let mut access = VehicleAccess {
            secs: vehicle.elapsed_secs(),
            state,
            ranges: self.ranges,
            mode: vehicle.mode(),
            goal: *vehicle.goal(),
            order: &mut |order| {
                let result = match order {
                    ClientOrder::Command(command) => vehicle.order_as(Operator::CrazyflieClient, command),
                    ClientOrder::EmergencyStop => vehicle.order(Command::StopMotors),
                };
                CommandOutcome { result, mode: vehicle.mode(), goal: *vehicle.goal() }
            },
            send: &mut |packet| {
                if let Some(client) = self.client {
                    let _lost = self.socket.send_to(&packet.encode(), client.address);
                }
            },
        };
        act(&mut self.server, &mut access);
    }
}

#[cfg(test)]
mod tests;
