//! The UDP socket of a vehicle: datagrams from peers, frames to all of them.

use std::net::{SocketAddr, UdpSocket};

use super::{DATAGRAM_LIMIT, ENDPOINTS, Link, LinkAddress, LinkError, Received, is_silence};

/// Peers besides the ground station; a fifth takes the place of the one silent for longest.
const PEERS: usize = 4;

/// Where a vehicle listens, and whom it tells without being asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UdpAddresses {
    /// The vehicle's own address, for clients that speak first (`udpout:` of pymavlink).
    pub vehicle: SocketAddr,
    /// Where a ground station listens (`udpin:` of pymavlink, QGroundControl).
    pub ground_station: SocketAddr,
}

impl Default for UdpAddresses {
    /// Loopback only: 14580, where PX4's simulation listens for companions too, and 14550, where ground stations
    /// listen by custom.
    fn default() -> Self {
        Self {
            vehicle: SocketAddr::from(([127, 0, 0, 1], 14580)),
            ground_station: SocketAddr::from(([127, 0, 0, 1], 14550)),
        }
    }
}

impl UdpAddresses {
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
///
/// The senders of the last datagrams are its endpoints. One more than [`ENDPOINTS`] takes the number of the one silent for
/// longest that is no peer.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    address: SocketAddr,
    ground_station: SocketAddr,
    senders: heapless::Vec<Sender, ENDPOINTS>,
    peers: heapless::Vec<SocketAddr, PEERS>,
    datagrams: u64,
}

#[derive(Clone, Copy, Debug)]
struct Sender {
    address: SocketAddr,
    /// Number of its last datagram.
    heard: u64,
}

impl UdpLink {
    /// Binds the vehicle's address; port 0 lets the operating system choose.
    ///
    /// # Errors
    /// [`LinkError::Mismatch`], [`LinkError::Busy`] or [`LinkError::Open`].
    pub fn open(addresses: &UdpAddresses) -> Result<Self, LinkError> {
        addresses.check()?;
        let place = LinkAddress::Udp(addresses.vehicle);
        let bound = || {
            let socket = UdpSocket::bind(addresses.vehicle)?;
            socket.set_nonblocking(true)?;
            let address = socket.local_addr()?;
            Ok((socket, address))
        };
        let (socket, address) = bound().map_err(|reason| LinkError::opening(place, reason))?;
        Ok(Self {
            socket,
            address,
            ground_station: addresses.ground_station,
            senders: heapless::Vec::new(),
            peers: heapless::Vec::new(),
            datagrams: 0,
        })
    }

    /// The bound address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The number of a sender, new or known.
    fn endpoint(&mut self, address: SocketAddr) -> usize {
        self.datagrams += 1;
        let sender = Sender { address, heard: self.datagrams };
        let known = self.senders.iter().position(|known| known.address == address);
        let endpoint = known.unwrap_or_else(|| {
            if self.senders.push(sender).is_ok() { self.senders.len() - 1 } else { self.quietest() }
        });
        self.senders[endpoint] = sender;
        endpoint
    }

    /// The endpoint silent for longest that is no peer; there are fewer peers than endpoints.
    fn quietest(&self) -> usize {
        const { assert!(PEERS < ENDPOINTS) };
        let strangers =
            self.senders.iter().enumerate().filter(|(_, sender)| !self.peers.contains(&sender.address));
        strangers.min_by_key(|(_, sender)| sender.heard).map_or(0, |(endpoint, _)| endpoint)
    }

    fn remember(&mut self, peer: SocketAddr) {
        if peer == self.ground_station || self.peers.last() == Some(&peer) {
            return;
        }
        self.peers.retain(|known| *known != peer);
        if self.peers.is_full() {
            self.peers.remove(0);
        }
        self.peers.extend([peer]);
    }
}

impl Link for UdpLink {
    fn advance(&mut self, _now_secs: f64) -> Result<(), LinkError> {
        Ok(())
    }

    fn receive<'b>(&mut self, buffer: &'b mut [u8; DATAGRAM_LIMIT]) -> Result<Option<Received<'b>>, LinkError> {
        match self.socket.recv_from(buffer) {
            Ok((len, sender)) => Ok(Some(Received { datagram: &buffer[..len], endpoint: self.endpoint(sender) })),
            Err(reason) if is_silence(&reason) => Ok(None),
            Err(reason) => Err(LinkError::Failed { place: LinkAddress::Udp(self.address), reason }),
        }
    }

    fn learn(&mut self, endpoint: usize) {
        if let Some(sender) = self.senders.get(endpoint) {
            self.remember(sender.address);
        }
    }

    fn send(&mut self, frame: &[u8]) {
        for peer in self.peers.iter().chain([&self.ground_station]) {
            let _lost = self.socket.send_to(frame, peer);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn anywhere() -> UdpAddresses {
        let port = SocketAddr::from(([127, 0, 0, 1], 0));
        UdpAddresses { vehicle: port, ground_station: SocketAddr::from(([127, 0, 0, 1], 9)) }
    }

    #[test]
    fn a_busy_port_is_named() {
        let first = UdpLink::open(&anywhere()).unwrap();
        let vehicle = first.address();
        let error = UdpLink::open(&UdpAddresses { vehicle, ..anywhere() }).unwrap_err();
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
            let addresses = UdpAddresses {
                vehicle: vehicle.parse().unwrap(),
                ground_station: ground_station.parse().unwrap(),
            };
            let text = UdpLink::open(&addresses).unwrap_err().to_string();
            assert!(text.contains(vehicle) && text.contains(ground_station), "{text}");
        }
    }

    #[test]
    fn an_address_of_another_machine_is_refused() {
        let vehicle = SocketAddr::from(([192, 0, 2, 1], 14580));
        let error = UdpLink::open(&UdpAddresses { vehicle, ..anywhere() }).unwrap_err();
        assert!(matches!(error, LinkError::Open { .. }), "{error}");
    }

    #[test]
    fn datagrams_arrive_with_their_sender_and_frames_reach_all_peers() {
        let mut link = UdpLink::open(&anywhere()).unwrap();
        let peers: Vec<UdpSocket> = (0..2).map(|_| UdpSocket::bind("127.0.0.1:0").unwrap()).collect();
        let mut buffer = [0; DATAGRAM_LIMIT];
        for (number, peer) in peers.iter().enumerate() {
            peer.send_to(b"hello", link.address()).unwrap();
            let received = link.receive(&mut buffer).unwrap().unwrap();
            assert_eq!(received, Received { datagram: b"hello", endpoint: number });
            link.learn(number);
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
            let endpoint = link.endpoint(peer(port));
            link.learn(endpoint);
        }
        let endpoint = link.endpoint(link.ground_station);
        link.learn(endpoint);
        assert_eq!(link.peers, [peer(3), peer(4), peer(1), peer(5)]);
    }

    #[test]
    fn a_peer_keeps_its_number_whatever_strangers_come() {
        let mut link = UdpLink::open(&anywhere()).unwrap();
        let peer = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let first = link.endpoint(peer(1));
        link.learn(first);
        for port in 2..1000 {
            assert_ne!(link.endpoint(peer(port)), first);
        }
        assert_eq!(link.endpoint(peer(1)), first);
        assert_eq!(link.senders.len(), ENDPOINTS);
    }
}
