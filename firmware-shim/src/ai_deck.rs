//! The stream of the AI-deck's camera, as Bitcraze's example `wifi-img-streamer` sends it: grey pictures in CPX packets over
//! TCP.
//!
//! A packet is the length of what follows, two bytes of routing, and at most 1,020 bytes. A picture is a packet with
//! its size, then packets with its pixels. Source: `bitcraze/aideck-gap8-examples`, `cpx_stream.c`; `cflib.cpx` and the
//! example's viewer read it.

use std::io::{self, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::Duration;

/// Columns and rows of the Himax HM01B0 as the example opens it \[px\].
pub const SIZE: [u16; 2] = [324, 244];

/// TCP port of the AI-deck.
pub const PORT: u16 = 5000;

/// From the GAP8 to the host, for the application; version 0.
const ROUTE: [u8; 2] = [4 << 3 | 3, 5];

/// What a picture begins with, and an 8-bit picture that is not compressed.
const MAGIC: u8 = 0xBC;
const DEPTH: u8 = 1;
const RAW: u8 = 0;

/// Bytes of a picture in one packet.
const CHUNK: usize = 1020;

/// Clients at once; a real deck has one.
const CLIENTS: usize = 4;

/// A client that takes a picture more slowly is let go.
const PATIENCE: Duration = Duration::from_millis(500);

/// Why there is no stream.
#[derive(Debug, thiserror::Error)]
#[error("cannot listen at {address}: {source}")]
pub struct AiDeckError {
    address: SocketAddr,
    source: io::Error,
}

/// The socket of an AI-deck, and who looks at its pictures.
#[derive(Debug)]
pub struct AiDeck {
    listener: TcpListener,
    address: SocketAddr,
    clients: Vec<TcpStream>,
}

impl AiDeck {
    /// Listens at an address.
    ///
    /// # Errors
    /// If it cannot.
    pub fn open(address: SocketAddr) -> Result<Self, AiDeckError> {
        let failed = |source| AiDeckError { address, source };
        let listener = TcpListener::bind(address).map_err(failed)?;
        listener.set_nonblocking(true).map_err(failed)?;
        let address = listener.local_addr().map_err(failed)?;
        Ok(Self { listener, address, clients: Vec::new() })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Lets clients in; whether anybody looks.
    pub fn is_watched(&mut self) -> bool {
        while let Ok((client, _)) = self.listener.accept() {
            let ready = client.set_nonblocking(false).and_then(|()| client.set_write_timeout(Some(PATIENCE)));
            if ready.is_ok() && self.clients.len() < CLIENTS {
                self.clients.push(client);
            }
        }
        !self.clients.is_empty()
    }

    /// Sends everybody a grey picture of [`SIZE`], row by row from the top; whoever does not take it is let go.
    pub fn send(&mut self, pixels: &[u8]) {
        let bytes = packets(pixels);
        self.clients.retain_mut(|client| client.write_all(&bytes).is_ok());
    }
}

/// All packets of a picture.
fn packets(pixels: &[u8]) -> Vec<u8> {
    let [columns, rows] = SIZE.map(u16::to_le_bytes);
    let size = (pixels.len() as u32).to_le_bytes();
    let head: Vec<u8> = [MAGIC].into_iter().chain(columns).chain(rows).chain([DEPTH, RAW]).chain(size).collect();
    let mut bytes = Vec::with_capacity(pixels.len() + pixels.len() / CHUNK * 4 + 32);
    for chunk in [&head[..]].into_iter().chain(pixels.chunks(CHUNK)) {
        bytes.extend((chunk.len() as u16 + 2).to_le_bytes());
        bytes.extend(ROUTE);
        bytes.extend(chunk);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    fn received(client: &mut TcpStream, count: usize) -> Vec<u8> {
        let mut bytes = vec![0; count];
        client.read_exact(&mut bytes).unwrap();
        bytes
    }

    /// The next packet, without its length and its routing.
    fn packet(client: &mut TcpStream) -> Vec<u8> {
        let head = received(client, 4);
        assert_eq!(head[2..], [0x23, 0x05]);
        received(client, usize::from(u16::from_le_bytes([head[0], head[1]])) - 2)
    }

    fn client(deck: &mut AiDeck) -> TcpStream {
        let client = TcpStream::connect(deck.address()).unwrap();
        client.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        while !deck.is_watched() {
            std::thread::sleep(Duration::from_millis(1));
        }
        client
    }

    #[test]
    fn a_picture_arrives_as_the_example_sends_it() {
        let mut deck = AiDeck::open("127.0.0.1:0".parse().unwrap()).unwrap();
        assert!(!deck.is_watched());
        let mut client = client(&mut deck);
        let pixels: Vec<u8> = (0..324 * 244).map(|index: u32| (index % 251) as u8).collect();
        let expected = pixels.clone();
        let sending = std::thread::spawn(move || deck.send(&pixels));
        assert_eq!(packet(&mut client), [0xBC, 0x44, 0x01, 0xF4, 0x00, 1, 0, 0xD0, 0x34, 0x01, 0x00]);
        let mut picture = Vec::new();
        while picture.len() < expected.len() {
            picture.extend(packet(&mut client));
        }
        assert!(picture == expected);
        sending.join().unwrap();
    }

    #[test]
    fn who_takes_nothing_is_let_go_and_a_fifth_is_not_let_in() {
        let mut deck = AiDeck::open("127.0.0.1:0".parse().unwrap()).unwrap();
        let _idle = client(&mut deck);
        let pixels = vec![0; 8_000_000];
        deck.send(&pixels);
        assert!(!deck.is_watched());
        let clients: Vec<TcpStream> = (0..6).map(|_| TcpStream::connect(deck.address()).unwrap()).collect();
        std::thread::sleep(Duration::from_millis(50));
        assert!(deck.is_watched() && deck.clients.len() <= CLIENTS, "{clients:?}");
        let taken = AiDeck::open(deck.address()).unwrap_err().to_string();
        assert!(taken.starts_with(&format!("cannot listen at {}: ", deck.address())), "{taken}");
    }
}
