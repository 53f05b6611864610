use std::thread;

use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::Pilot;

use super::*;
use crate::plant::{FlatFloor, Plant};
use crate::testing::{hover_policy, pilot, profile};

const HANDSHAKE: [u8; 2] = [0xFD, 0];
const ECHO: [u8; 3] = [0xFC, 7, 8];

/// A link on any free port, its vehicle and the plant.
struct Rig {
    link: CrtpLink,
    vehicle: Vehicle<Pilot<'static>>,
    plant: FlatFloor,
}

impl Rig {
    fn new() -> Self {
        let link = CrtpLink::open(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
        let vehicle = Vehicle::new(pilot(hover_policy()), &CF2X, profile(1));
        Self { link, vehicle, plant: FlatFloor::new(&CF2X, 0.01) }
    }

    fn client(&self) -> UdpSocket {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(self.link.address().unwrap()).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
        socket
    }

    /// What a client hears in one control period after it has said something; text apart.
    fn ask(&mut self, client: &UdpSocket, bytes: &[u8]) -> Vec<Vec<u8>> {
        client.send(bytes).unwrap();
        self.heard(client)
    }

    fn heard(&mut self, client: &UdpSocket) -> Vec<Vec<u8>> {
        self.link.exchange(&mut self.vehicle, self.plant.state()).unwrap();
        let mut heard = Vec::new();
        let mut buffer = [0; 64];
        while let Ok(len) = client.recv(&mut buffer) {
            if buffer[0] != 0 {
                heard.push(buffer[..len].to_vec());
            }
        }
        heard
    }
}

#[test]
fn a_busy_port_is_named() {
    let first = CrtpLink::open(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap();
    let error = CrtpLink::open(first.address().unwrap()).unwrap_err();
    assert!(matches!(error, LinkError::Busy { .. }), "{error}");
}

#[test]
fn a_scan_is_answered_and_makes_nobody_a_client() {
    let mut rig = Rig::new();
    let (scanner, client) = (rig.client(), rig.client());
    assert_eq!(rig.ask(&scanner, &[0xFF]), [vec![0xFF]]);
    assert_eq!(rig.ask(&client, &ECHO), [vec![0xF0, 7, 8]]);
    assert_eq!(rig.ask(&scanner, &[0xFF]), [vec![0xFF]], "while there is a client, too");
}

#[test]
fn what_is_no_packet_is_not_heard() {
    let mut rig = Rig::new();
    let client = rig.client();
    for wrong in [&[0xF0; 32][..], &[0xF0; 60], &[0xA0, 1], &[]] {
        assert!(rig.ask(&client, wrong).is_empty(), "{wrong:?}");
    }
    assert_eq!(rig.ask(&client, &ECHO).len(), 1);
}

#[test]
fn a_second_client_waits_until_the_first_is_silent() {
    let mut rig = Rig::new();
    let (first, second) = (rig.client(), rig.client());
    assert_eq!(rig.ask(&first, &HANDSHAKE).len(), 1);
    assert!(rig.ask(&second, &HANDSHAKE).is_empty());
    assert!(rig.ask(&second, &ECHO).is_empty());
    thread::sleep(PATIENCE);
    let heard = rig.heard(&second);
    assert!(heard.len() == 1 && heard[0][1..].starts_with(b"Bitcraze"), "{heard:?}");
    assert_eq!(rig.ask(&second, &ECHO).len(), 1);
    assert!(rig.ask(&first, &ECHO).is_empty());
}

#[test]
fn a_client_that_is_silent_for_long_is_forgotten_with_its_log_blocks() {
    let mut rig = Rig::new();
    let client = rig.client();
    rig.ask(&client, &[0x51, 6, 1, 7, 2, 0]);
    rig.ask(&client, &[0x51, 3, 1, 1]);
    let now = Instant::now();
    rig.link.change_client(now + MEMORY / 2, &mut rig.vehicle, rig.plant.state());
    assert!(rig.link.client.is_some());
    rig.link.change_client(now + MEMORY, &mut rig.vehicle, rig.plant.state());
    assert!(rig.link.client.is_none());
    for _ in 0..10 {
        rig.vehicle.tick(rig.plant.state(), &[], &mut |_, _| {});
        assert!(rig.heard(&client).is_empty());
    }
}
