//! Ways for frames between a vehicle and its peers, and the gates that keep a flood from the vehicle.
//!
//! A vehicle has a few [`Links`], each over one medium: a socket, a serial line, memory. A datagram reaches the vehicle
//! with the [`Peer`] that sent it; every endpoint has its own share of a control period and its own allowance of commands,
//! so that no flood starves anybody else. A peer is answered at once; who listens is told what the vehicle says unasked.
//! Frames are not forwarded from one link to another.

pub mod faulty;
pub mod memory;
pub mod serial;
mod stream;
pub mod tcp;
pub mod udp;

use std::fmt;
use std::io::{self, ErrorKind};
use std::net::SocketAddr;
use std::path::PathBuf;

use crate::frame::Frames;

/// Longer datagrams are cut; MAVLink senders keep to the 1,500 bytes of an Ethernet frame.
pub const DATAGRAM_LIMIT: usize = 2048;

/// Endpoints that a link tells apart.
pub const ENDPOINTS: usize = 32;

/// Links of one vehicle.
pub const LINKS: usize = 8;

/// Datagrams that are taken from one link at once. More than what one endpoint may have heard in a control period, so that
/// its flood is thrown away here and does not fill the operating system's queue, where the others wait too.
pub const DATAGRAMS_AT_ONCE: usize = 1024;

/// Datagrams, or frames of a stream, of one endpoint that are heard in one control period: hundreds of times what ground
/// stations send.
pub const DATAGRAMS_PER_ENDPOINT: u16 = 256;

/// Commands of one endpoint that are heard in one simulated second, in the long run; clients repeat one every 0.5 s.
pub const COMMANDS_PER_SEC: f64 = 50.0;

/// Commands that one endpoint may send at once: ground stations ask for everything when they connect.
pub const COMMANDS_AT_ONCE: f64 = 100.0;

/// `SET_MODE`, `COMMAND_INT` and `COMMAND_LONG`.
const COMMAND_IDS: [u32; 3] = [11, 75, 76];

/// What a link is bound to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum LinkAddress {
    /// UDP.
    Udp(SocketAddr),
    /// TCP.
    Tcp(SocketAddr),
    /// A serial line.
    Serial(PathBuf),
}

impl fmt::Display for LinkAddress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp(address) => write!(formatter, "UDP address {address}"),
            Self::Tcp(address) => write!(formatter, "TCP address {address}"),
            Self::Serial(path) => write!(formatter, "serial device {}", path.display()),
        }
    }
}

/// Whether a socket has nothing to say: a peer that is gone makes noise, too.
pub(crate) fn is_silence(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::Interrupted | ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset
    )
}

impl LinkError {
    /// Why a place could not be opened.
    pub(crate) fn opening(place: LinkAddress, reason: io::Error) -> Self {
        if matches!(reason.kind(), ErrorKind::AddrInUse | ErrorKind::ResourceBusy) {
            return Self::Busy { place };
        }
        Self::Open { place, reason }
    }
}

/// Why a link cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// Another program has it.
    #[error("{place} is in use by another program (another vehicle?); choose another one")]
    Busy {
        /// Wanted place.
        place: LinkAddress,
    },
    /// A datagram from one address cannot reach the other, or comes back.
    #[error("UDP address {vehicle} cannot speak to a ground station at {ground_station}: expected {expected}")]
    Mismatch {
        /// Of the vehicle.
        vehicle: SocketAddr,
        /// Of the ground station.
        ground_station: SocketAddr,
        /// What goes together.
        expected: &'static str,
    },
    /// It cannot be opened.
    #[error("cannot open {place}: {reason}")]
    Open {
        /// Wanted place.
        place: LinkAddress,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// What the path names is something else.
    #[error("expected a serial device, found that {path} is none")]
    NotSerial {
        /// Of what was found.
        path: String,
    },
    /// The line is slower, or knows other rates.
    #[error("serial device {path} cannot run at {baud} baud: {reason}")]
    Baud {
        /// Of the device.
        path: String,
        /// Wanted rate \[bit/s\].
        baud: u32,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// It worked until now.
    #[error("{place} fails: {reason}")]
    Failed {
        /// Where.
        place: LinkAddress,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// One link too many.
    #[error("a vehicle has at most {LINKS} links")]
    TooMany,
}

/// One end that a link tells apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EndpointId {
    /// Below [`ENDPOINTS`]. It belongs to one peer for as long as that peer is heard.
    pub number: u8,
    /// Which of those that have had this number.
    pub generation: u32,
}

impl EndpointId {
    /// The only one of a link that has no more.
    pub const ONLY: Self = Self { number: 0, generation: 0 };
}

/// Those who are told what the vehicle says unasked.
pub type Listeners = heapless::Vec<EndpointId, ENDPOINTS>;

/// Somebody who speaks to a vehicle, or listens to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Peer {
    /// Number of the link.
    pub link: u8,
    /// Its end of it.
    pub endpoint: EndpointId,
}

/// What came through a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received<'b> {
    /// A datagram as it came; of a stream one whole frame.
    pub datagram: &'b [u8],
    /// Who sent it.
    pub endpoint: EndpointId,
}

/// A way to peers. No call ever waits, and what cannot be sent is lost, as datagrams may be.
pub trait Link: Send {
    /// Once in every control period, before anything else in it: simulated time is `now_secs` \[s\].
    ///
    /// # Errors
    /// [`LinkError::Failed`] if the link will never work again; a peer that has gone is no failure.
    fn advance(&mut self, now_secs: f64) -> Result<(), LinkError>;

    /// The next datagram that has arrived, if any.
    ///
    /// # Errors
    /// As [`Link::advance`].
    fn receive<'b>(&mut self, buffer: &'b mut [u8; DATAGRAM_LIMIT]) -> Result<Option<Received<'b>>, LinkError>;

    /// What this endpoint sent was good: from now on it listens.
    fn learn(&mut self, endpoint: EndpointId);

    /// Who is to be told what the vehicle says unasked.
    fn listeners(&self) -> Listeners;

    /// Sends a frame to an endpoint that spoke or listens, at the latest with the next [`Link::flush`]; one that is gone hears
    /// nothing.
    fn send_to(&mut self, endpoint: EndpointId, frame: &[u8]);

    /// Sends what waits to be sent together.
    fn flush(&mut self) {}
}

/// Takes what a peer sent, says whether it was good, and answers the peer.
pub type Handler<'a> = dyn FnMut(Peer, &[u8], &mut dyn FnMut(&[u8])) -> bool + 'a;

/// What was thrown away for the sake of others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LinkCounts {
    /// Datagrams beyond an endpoint's share of a control period.
    pub flooding: u64,
    /// Datagrams with commands beyond an endpoint's allowance.
    pub commands: u64,
}

/// All links of one vehicle.
#[derive(Default)]
pub struct Links {
    attached: heapless::Vec<Attached, LINKS>,
    now_secs: f64,
    counts: LinkCounts,
}

/// A link and the gates of its endpoints.
struct Attached {
    link: Box<dyn Link>,
    gates: [Gate; ENDPOINTS],
}

/// What an endpoint may still send.
#[derive(Clone, Copy)]
struct Gate {
    datagrams: u16,
    commands: f64,
}

impl Links {
    /// Attaches a link.
    ///
    /// # Errors
    /// [`LinkError::TooMany`].
    pub fn attach(&mut self, link: Box<dyn Link>) -> Result<(), LinkError> {
        let gates = [Gate { datagrams: 0, commands: COMMANDS_AT_ONCE }; ENDPOINTS];
        self.attached.push(Attached { link, gates }).map_err(|_| LinkError::TooMany)
    }

    /// What was thrown away so far.
    pub fn counts(&self) -> LinkCounts {
        self.counts
    }

    /// Begins the control period at `now_secs` \[s, simulated\], and has `handle` take what has arrived.
    ///
    /// # Errors
    /// The first [`LinkError::Failed`].
    pub fn begin_period(&mut self, now_secs: f64, handle: &mut Handler<'_>) -> Result<(), LinkError> {
        let elapsed_secs = (now_secs - self.now_secs).max(0.0);
        self.now_secs = now_secs;
        for attached in &mut self.attached {
            attached.link.advance(now_secs)?;
            attached.gates.iter_mut().for_each(|gate| gate.open(elapsed_secs));
        }
        self.receive(handle)
    }

    /// Has `handle` take what has arrived; within a control period, as often as one likes.
    ///
    /// # Errors
    /// As [`Links::begin_period`].
    pub fn receive(&mut self, handle: &mut Handler<'_>) -> Result<(), LinkError> {
        let Self { attached, counts, .. } = self;
        (0..).zip(attached).try_for_each(|(link, attached)| attached.receive(link, handle, counts))
    }

    /// Everybody who is to be told what the vehicle says unasked, in the order of the links.
    pub fn listeners(&self) -> Vec<Peer> {
        let numbered = (0..).zip(&self.attached);
        let peers = numbered.flat_map(|(link, attached)| {
            attached.link.listeners().into_iter().map(move |endpoint| (link, endpoint))
        });
        peers.map(|(link, endpoint)| Peer { link, endpoint }).collect()
    }

    /// Sends what waits to be sent together.
    pub fn flush(&mut self) {
        self.attached.iter_mut().for_each(|attached| attached.link.flush());
    }

    /// Sends a frame to a peer, at the latest with the next [`Links::flush`].
    pub fn send_to(&mut self, peer: Peer, frame: &[u8]) {
        if let Some(attached) = self.attached.get_mut(usize::from(peer.link)) {
            attached.link.send_to(peer.endpoint, frame);
        }
    }
}

impl Attached {
    fn receive(&mut self, link: u8, handle: &mut Handler<'_>, counts: &mut LinkCounts) -> Result<(), LinkError> {
        let mut buffer = [0; DATAGRAM_LIMIT];
        for _ in 0..DATAGRAMS_AT_ONCE {
            let Some(Received { datagram, endpoint }) = self.link.receive(&mut buffer)? else { break };
            let Some(gate) = self.gates.get_mut(usize::from(endpoint.number)) else { continue };
            if !gate.admits_datagram() {
                counts.flooding += 1;
            } else if !gate.admits_commands(datagram) {
                counts.commands += 1;
            } else {
                let mut answer = |frame: &[u8]| self.link.send_to(endpoint, frame);
                if handle(Peer { link, endpoint }, datagram, &mut answer) {
                    self.link.learn(endpoint);
                }
            }
        }
        self.link.flush();
        Ok(())
    }
}

impl Gate {
    fn open(&mut self, elapsed_secs: f64) {
        self.datagrams = DATAGRAMS_PER_ENDPOINT;
        self.commands = (self.commands + elapsed_secs * COMMANDS_PER_SEC).min(COMMANDS_AT_ONCE);
    }

    fn admits_datagram(&mut self) -> bool {
        let left = self.datagrams.checked_sub(1);
        self.datagrams = left.unwrap_or(0);
        left.is_some()
    }

    /// All commands of a datagram, or none of them.
    fn admits_commands(&mut self, datagram: &[u8]) -> bool {
        let ids = Frames::new(datagram).flatten().map(|frame| frame.message_id);
        let commands = ids.filter(|id| COMMAND_IDS.contains(id)).count() as f64;
        let admitted = commands <= self.commands;
        if admitted {
            self.commands -= commands;
        }
        admitted
    }
}

#[cfg(test)]
mod tests;
