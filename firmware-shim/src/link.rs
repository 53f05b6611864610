//! The UDP socket of a vehicle: datagrams from peers, frames to all of them.

use std::io::{self, ErrorKind};
use std::net::{SocketAddr, UdpSocket};

/// Peers besides the ground station; a fifth takes the place of the one silent for longest.
const PEERS: usize = 4;

/// Longer datagrams are cut; MAVLink senders keep to the 1,500 bytes of an Ethernet frame.
pub const DATAGRAM_LIMIT: usize = 2048;

/// Why a socket cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// Somebody else has the port.
    #[error("UDP address {address} is in use by another program (another vehicle?); choose another port")]
    Busy {
        /// Wanted address.
        address: SocketAddr,
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
    /// The address cannot be bound.
    #[error("cannot open UDP address {address}: {reason}")]
    Open {
        /// Wanted address.
        address: SocketAddr,
        /// Reason of the operating system.
        reason: io::Error,
    },
    /// The socket fails.
    #[error("cannot receive on the UDP socket: {0}")]
    Receive(io::Error),
}

/// Where a vehicle listens, and whom it tells without being asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Addresses {
    /// The vehicle's own address, for clients that speak first (`udpout:` of pymavlink).
    pub vehicle: SocketAddr,
    /// Where a ground station listens (`udpin:` of pymavlink, QGroundControl).
    pub ground_station: SocketAddr,
}

impl Default for Addresses {
    /// Loopback only: 14580, where PX4's simulation listens for companions too, and 14550, where ground stations
    /// listen by custom.
    fn default() -> Self {
        Self {
            vehicle: SocketAddr::from(([127, 0, 0, 1], 14580)),
            ground_station: SocketAddr::from(([127, 0, 0, 1], 14550)),
        }
    }
}

impl Addresses {
    fn check(&self) -> Result<(), LinkError> {
        let Self { vehicle, ground_station } = *self;
        let expected = if vehicle.is_ipv4() != ground_station.is_ipv4() {
            "both IPv4, or both IPv6"
        } else if ground_station.port() == 0 {
            "a port of the ground station above 0"
        } else if vehicle == ground_station {
            "two different addresses"
        } else {
            return Ok(());
        };
        Err(LinkError::Mismatch { vehicle, ground_station, expected })
    }
}

/// A bound socket and the peers behind it.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    ground_station: SocketAddr,
    peers: heapless::Vec<SocketAddr, PEERS>,
}

impl UdpLink {
    /// Binds the vehicle's address; port 0 lets the operating system choose.
    ///
    /// # Errors
    /// [`LinkError::Mismatch`], [`LinkError::Busy`] or [`LinkError::Open`].
    pub fn open(addresses: &Addresses) -> Result<Self, LinkError> {
        addresses.check()?;
        let address = addresses.vehicle;
        let failed = |reason: io::Error| match reason.kind() {
            ErrorKind::AddrInUse => LinkError::Busy { address },
            _ => LinkError::Open { address, reason },
        };
        let socket = UdpSocket::bind(address).map_err(failed)?;
        socket.set_nonblocking(true).map_err(failed)?;
        Ok(Self { socket, ground_station: addresses.ground_station, peers: heapless::Vec::new() })
    }

    /// The bound address.
    ///
    /// # Errors
    /// [`LinkError::Receive`] if the operating system does not tell.
    pub fn address(&self) -> Result<SocketAddr, LinkError> {
        self.socket.local_addr().map_err(LinkError::Receive)
    }

    /// The next datagram that has arrived, if any, and who sent it. Never waits.
    ///
    /// # Errors
    /// [`LinkError::Receive`] if the socket itself fails; a peer that has gone is no failure.
    pub fn receive<'b>(
        &self,
        buffer: &'b mut [u8; DATAGRAM_LIMIT],
    ) -> Result<Option<(&'b [u8], SocketAddr)>, LinkError> {
        match self.socket.recv_from(buffer) {
            Ok((len, sender)) => Ok(Some((&buffer[..len], sender))),
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock
                | ErrorKind::Interrupted
                | ErrorKind::ConnectionRefused
                | ErrorKind::ConnectionReset => Ok(None),
                _ => Err(LinkError::Receive(error)),
            },
        }
    }

    /// From now on tells this peer too.
    pub fn learn(&mut self, peer: SocketAddr) {
        if peer == self.ground_station || self.peers.last() == Some(&peer) {
            return;
        }
        self.peers.retain(|known| *known != peer);
        if self.peers.is_full() {
            self.peers.remove(0);
        }
        self.peers.extend([peer]);
    }

    /// Sends a frame to the ground station and to every peer. What cannot be sent is lost, as datagrams may be.
    pub fn send(&self, frame: &[u8]) {
        for peer in self.peers.iter().chain([&self.ground_station]) {
            let _lost = self.socket.send_to(frame, peer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn anywhere() -> Addresses {
        let port = SocketAddr::from(([127, 0, 0, 1], 0));
        Addresses { vehicle: port, ground_station: SocketAddr::from(([127, 0, 0, 1], 9)) }
    }

    #[test]
    fn a_busy_port_is_named() {
        let first = UdpLink::open(&anywhere()).unwrap();
        let vehicle = first.address().unwrap();
        let error = UdpLink::open(&Addresses { vehicle, ..anywhere() }).unwrap_err();
        assert!(matches!(error, LinkError::Busy { .. }));
        let text = error.to_string();
        assert!(text.contains(&vehicle.to_string()) && text.contains("in use"), "{text}");
    }

    #[test]
    fn addresses_that_cannot_speak_to_each_other_are_refused() {
        let pairs = [
            ("[::1]:0", "127.0.0.1:14550"),
            ("127.0.0.1:14550", "127.0.0.1:14550"),
            ("127.0.0.1:0", "127.0.0.1:0"),
        ];
        for (vehicle, ground_station) in pairs {
            let addresses =
                Addresses { vehicle: vehicle.parse().unwrap(), ground_station: ground_station.parse().unwrap() };
            let text = UdpLink::open(&addresses).unwrap_err().to_string();
            assert!(text.contains(vehicle) && text.contains(ground_station), "{text}");
        }
    }

    #[test]
    fn an_address_of_another_machine_is_refused() {
        let vehicle = SocketAddr::from(([192, 0, 2, 1], 14580));
        let error = UdpLink::open(&Addresses { vehicle, ..anywhere() }).unwrap_err();
        assert!(matches!(error, LinkError::Open { .. }), "{error}");
    }

    #[test]
    fn datagrams_arrive_with_their_sender_and_frames_reach_all_peers() {
        let mut link = UdpLink::open(&anywhere()).unwrap();
        let peers: Vec<UdpSocket> = (0..2).map(|_| UdpSocket::bind("127.0.0.1:0").unwrap()).collect();
        let mut buffer = [0; DATAGRAM_LIMIT];
        for peer in &peers {
            peer.send_to(b"hello", link.address().unwrap()).unwrap();
            let (datagram, sender) = link.receive(&mut buffer).unwrap().unwrap();
            assert_eq!((datagram, sender), (&b"hello"[..], peer.local_addr().unwrap()));
            link.learn(sender);
        }
        assert!(link.receive(&mut buffer).unwrap().is_none());
        link.send(b"frame");
        for peer in &peers {
            let (len, _) = peer.recv_from(&mut buffer).unwrap();
            assert_eq!(&buffer[..len], b"frame");
        }
    }

    #[test]
    fn the_peer_silent_for_longest_is_forgotten() {
        let mut link = UdpLink::open(&anywhere()).unwrap();
        let peer = |port| SocketAddr::from(([127, 0, 0, 1], port));
        for port in [1, 2, 3, 4, 1, 5] {
            link.learn(peer(port));
        }
        link.learn(link.ground_station);
        assert_eq!(link.peers, [peer(3), peer(4), peer(1), peer(5)]);
    }
}
