//! The UDP socket of a vehicle: datagrams from peers, frames to them.

use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use super::{
    DATAGRAM_LIMIT, ENDPOINTS, EndpointId, Link, LinkAddress, LinkError, Listeners, Received, is_silence,
};

/// A peer that says nothing for so long, by the wall clock, is told nothing more: whoever listens says so once a second, and
/// nobody can have the vehicle speak for ever to an address that never asked.
const SILENCE_LIMIT: Duration = Duration::from_secs(30);

/// Bytes that wait with the operating system \[B\]; it counts its own for each datagram.
#[cfg(unix)]
const WAITING_BYTES: usize = 1 << 22;

/// Frames leave together in datagrams of up to so many bytes, which no network takes apart: most of what a frame costs is its
/// datagram.
const TOGETHER_BYTES: usize = 1400;

/// Number of the ground station, which is told everything without a word of its own.
const GROUND_STATION: u8 = 0;

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
/// The ground station and the senders of the last datagrams are its endpoints. One more than [`ENDPOINTS`] takes the number
/// of the one silent for longest, of those that are no peers if there are any.
#[derive(Debug)]
pub struct UdpLink {
    socket: UdpSocket,
    address: SocketAddr,
    senders: heapless::Vec<Sender, ENDPOINTS>,
    /// Frames to each of them that wait to leave together.
    outgoing: [Vec<u8>; ENDPOINTS],
    datagrams: u64,
    silence_limit: Duration,
}

#[derive(Clone, Copy, Debug)]
struct Sender {
    address: SocketAddr,
    generation: u32,
    /// Number of its last datagram.
    heard: u64,
    /// When it last sent something good, if it did.
    peer: Option<Instant>,
}

impl UdpLink {
    /// Binds the vehicle's address; port 0 lets the operating system choose.
    ///
    /// # Errors
    /// [`LinkError::Mismatch`], [`LinkError::Busy`] or [`LinkError::Open`].
    pub fn open(addresses: &UdpAddresses) -> Result<Self, LinkError> {
        addresses.check()?;
        let UdpAddresses { vehicle, ground_station } = *addresses;
        let place = LinkAddress::Udp(vehicle);
        let bound = || {
            let socket = UdpSocket::bind(vehicle)?;
            socket.set_nonblocking(true)?;
            make_room(&socket);
            let address = socket.local_addr()?;
            Ok((socket, address))
        };
        let (socket, address) = bound().map_err(|reason| LinkError::opening(place, reason))?;
        // The operating system knows of a way now, or never.
        let reached =
            UdpSocket::bind(SocketAddr::new(address.ip(), 0)).and_then(|trial| trial.connect(ground_station));
        if reached.is_err() {
            let expected =
                "a ground station that can be reached from there (--listen 0.0.0.0:14580 speaks to the network)";
            return Err(LinkError::Mismatch { vehicle, ground_station, expected });
        }
        let ground_station = Sender { address: ground_station, generation: 0, heard: 0, peer: None };
        let senders = [ground_station].into_iter().collect();
        let outgoing = [const { Vec::new() }; ENDPOINTS];
        Ok(Self { socket, address, senders, outgoing, datagrams: 0, silence_limit: SILENCE_LIMIT })
    }

    /// The bound address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The endpoint of a sender, new or known.
    fn endpoint(&mut self, address: SocketAddr) -> EndpointId {
        self.datagrams += 1;
        let mut sender = Sender { address, generation: 0, heard: self.datagrams, peer: None };
        let number = if let Some(known) = self.senders.iter().position(|known| known.address == address) {
            sender = Sender { heard: sender.heard, ..self.senders[known] };
            known
        } else if self.senders.push(sender).is_ok() {
            self.senders.len() - 1
        } else {
            let quietest = self.quietest();
            sender.generation = self.senders[quietest].generation.wrapping_add(1);
            self.outgoing[quietest].clear();
            quietest
        };
        self.senders[number] = sender;
        EndpointId { number: number as u8, generation: sender.generation }
    }

    fn quietest(&self) -> usize {
        let strangers = self.senders.iter().enumerate().skip(1);
        let quietest = strangers.min_by_key(|(_, sender)| (self.listens(sender), sender.heard));
        quietest.map_or(1, |(number, _)| number)
    }

    /// Whether this one has said something good of late.
    fn listens(&self, sender: &Sender) -> bool {
        sender.peer.is_some_and(|since| since.elapsed() < self.silence_limit)
    }

    /// Sends what waits for one of them.
    fn send_outgoing(&mut self, number: usize) {
        let (Some(sender), frames) = (self.senders.get(number), &mut self.outgoing[number]) else { return };
        if !frames.is_empty() {
            let _lost = self.socket.send_to(frames, sender.address);
            frames.clear();
        }
    }

    /// The sender, if it is still that one.
    fn sender(&mut self, endpoint: EndpointId) -> Option<&mut Sender> {
        let sender = self.senders.get_mut(usize::from(endpoint.number))?;
        (sender.generation == endpoint.generation).then_some(sender)
    }
}

/// Asks the operating system to keep what a flood brings while this program does not run: usual are a few hundred datagrams,
/// those of two milliseconds. It gives what this user may have.
#[cfg(unix)]
fn make_room(socket: &UdpSocket) {
    #[cfg(target_os = "linux")]
    if rustix::net::sockopt::set_socket_recv_buffer_size_force(socket, WAITING_BYTES).is_ok() {
        return;
    }
    let _as_usual = rustix::net::sockopt::set_socket_recv_buffer_size(socket, WAITING_BYTES);
}

#[cfg(not(unix))]
fn make_room(_socket: &UdpSocket) {}

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

    fn learn(&mut self, endpoint: EndpointId) {
        if let Some(sender) = self.sender(endpoint) {
            sender.peer = Some(Instant::now());
        }
    }

    fn listeners(&self) -> Listeners {
        let numbered = (0..).zip(&self.senders);
        let listening = numbered.filter(|(number, sender)| *number == GROUND_STATION || self.listens(sender));
        listening.map(|(number, sender)| EndpointId { number, generation: sender.generation }).collect()
    }

    fn send_to(&mut self, endpoint: EndpointId, frame: &[u8]) {
        if self.sender(endpoint).is_none() {
            return;
        }
        let number = usize::from(endpoint.number);
        if self.outgoing[number].len() + frame.len() > TOGETHER_BYTES {
            self.send_outgoing(number);
        }
        self.outgoing[number].extend_from_slice(frame);
    }

    fn flush(&mut self) {
        (0..self.senders.len()).for_each(|number| self.send_outgoing(number));
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
    fn a_ground_station_that_cannot_be_reached_is_refused() {
        let ground_station = SocketAddr::from(([192, 0, 2, 1], 14550));
        let error = UdpLink::open(&UdpAddresses { ground_station, ..anywhere() }).unwrap_err();
        assert!(matches!(error, LinkError::Mismatch { .. }), "{error}");
        assert!(
            error.to_string().contains("192.0.2.1:14550: expected a ground station that can be reached"),
            "{error}"
        );
    }

    fn told(link: &UdpLink) -> Vec<u8> {
        link.listeners().iter().map(|endpoint| endpoint.number).collect()
    }

    #[test]
    fn datagrams_arrive_with_their_sender_and_each_is_answered() {
        let mut link = UdpLink::open(&anywhere()).unwrap();
        let peers: Vec<UdpSocket> = (0..2).map(|_| UdpSocket::bind("127.0.0.1:0").unwrap()).collect();
        let mut buffer = [0; DATAGRAM_LIMIT];
        for (number, peer) in (1..).zip(&peers) {
            peer.send_to(b"hello", link.address()).unwrap();
            let Received { datagram, endpoint } = link.receive(&mut buffer).unwrap().unwrap();
            assert_eq!((datagram, endpoint), (&b"hello"[..], EndpointId { number, generation: 0 }));
            assert!(!told(&link).contains(&number), "it said nothing good yet");
            link.learn(endpoint);
            link.send_to(endpoint, &[number]);
            link.send_to(endpoint, &[10 + number]);
            link.flush();
        }
        assert!(link.receive(&mut buffer).unwrap().is_none());
        assert_eq!(told(&link), [0, 1, 2]);
        for (number, peer) in (1..).zip(&peers) {
            peer.set_nonblocking(true).unwrap();
            let (len, _) = peer.recv_from(&mut buffer).unwrap();
            assert_eq!(buffer[..len], [number, 10 + number], "together");
            assert!(peer.recv_from(&mut buffer).is_err(), "what others are told");
        }
    }

    #[test]
    fn a_peer_that_falls_silent_is_told_nothing_more_but_the_ground_station_is() {
        let mut link = UdpLink { silence_limit: Duration::from_millis(50), ..UdpLink::open(&anywhere()).unwrap() };
        let endpoint = link.endpoint(SocketAddr::from(([127, 0, 0, 1], 1)));
        link.learn(endpoint);
        assert_eq!(told(&link), [0, 1]);
        std::thread::sleep(link.silence_limit);
        assert_eq!(told(&link), [0]);
        link.learn(endpoint);
        assert_eq!(told(&link), [0, 1]);
    }

    #[test]
    fn a_peer_keeps_its_number_whatever_strangers_come() {
        let mut link = UdpLink::open(&anywhere()).unwrap();
        let peer = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let first = link.endpoint(peer(1));
        link.learn(first);
        let second = link.endpoint(peer(2));
        for port in 3..1000 {
            assert_ne!(link.endpoint(peer(port)).number, first.number);
        }
        assert_eq!(link.endpoint(peer(1)), first);
        assert_eq!(link.senders.len(), ENDPOINTS);
        let again = link.endpoint(peer(2));
        link.send_to(second, b"to one who is gone");
        assert_ne!(again, second, "another had its number meanwhile");
    }

    #[test]
    fn more_peers_than_numbers_take_the_place_of_the_one_silent_for_longest() {
        let mut link = UdpLink::open(&anywhere()).unwrap();
        let peer = |port| SocketAddr::from(([127, 0, 0, 1], port));
        for port in (101..100 + ENDPOINTS as u16).chain([101, 500]) {
            let endpoint = link.endpoint(peer(port));
            link.learn(endpoint);
        }
        let ports: Vec<u16> = link.senders.iter().skip(1).map(|sender| sender.address.port()).collect();
        assert!(ports.contains(&101) && !ports.contains(&102) && ports.contains(&500), "{ports:?}");
        assert_eq!(told(&link).len(), ENDPOINTS);
    }
}
