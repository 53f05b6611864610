use std::io::{Read, Write};
use std::net::UdpSocket;
use std::thread;
use std::time::Instant;

use mavlink::dialects::common::HEARTBEAT_DATA;

use super::*;
use crate::frame::{Frames, Receiver};
use crate::testing::datagram;

/// Nothing here takes longer unless it never happens.
const PATIENCE: Duration = Duration::from_secs(20);

fn link() -> TcpLink {
    TcpLink::open(SocketAddr::from(([127, 0, 0, 1], 0))).unwrap()
}

fn client(link: &TcpLink) -> TcpStream {
    let stream = TcpStream::connect(link.address()).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

fn heartbeat() -> Vec<u8> {
    datagram(&HEARTBEAT_DATA::default())
}

/// What a control period brings.
fn period(link: &mut TcpLink) -> Vec<(u8, Vec<u8>)> {
    let mut buffer = [0; DATAGRAM_LIMIT];
    link.advance(0.0).unwrap();
    let mut next = || {
        let Received { datagram, endpoint } = link.receive(&mut buffer).unwrap()?;
        let bytes = datagram.to_vec();
        link.learn(endpoint);
        Some((endpoint.number, bytes))
    };
    std::iter::from_fn(&mut next).collect()
}

fn tell(link: &mut TcpLink, frame: &[u8]) {
    for endpoint in link.listeners() {
        link.send_to(endpoint, frame);
    }
}

/// Flies on until something has happened.
fn until(link: &mut TcpLink, mut happened: impl FnMut(&mut TcpLink) -> bool) {
    let start = Instant::now();
    while !happened(link) {
        assert!(start.elapsed() < PATIENCE, "it never happened");
        thread::sleep(Duration::from_millis(1));
    }
}

fn until_clients(link: &mut TcpLink, count: usize) {
    until(link, |link| {
        period(link);
        link.clients() == count
    });
}

#[test]
fn clients_come_speak_listen_and_go() {
    let mut link = link();
    let mut clients = [client(&link), client(&link)];
    until_clients(&mut link, 2);
    for (number, client) in (0..).zip(&mut clients) {
        let bytes = [b"noise", &heartbeat()[..]].concat();
        let (first, second) = bytes.split_at(11);
        client.write_all(first).unwrap();
        assert!(period(&mut link).is_empty());
        client.write_all(second).unwrap();
        let mut heard = Vec::new();
        until(&mut link, |link| {
            heard = period(link);
            !heard.is_empty()
        });
        assert_eq!(heard, [(number, heartbeat())]);
    }
    tell(&mut link, &heartbeat());
    for client in &mut clients {
        let mut bytes = vec![0; heartbeat().len()];
        client.read_exact(&mut bytes).unwrap();
        assert_eq!(bytes, heartbeat());
    }
    let [first, _second] = clients;
    drop(first);
    until_clients(&mut link, 1);
    let _third = client(&link);
    until_clients(&mut link, 2);
}

/// Clients that all have spoken.
fn speaking(link: &mut TcpLink, count: usize) -> Vec<TcpStream> {
    let clients: Vec<_> = (1..=count)
        .map(|count| {
            let mut client = client(link);
            until_clients(link, count);
            client.write_all(&heartbeat()).unwrap();
            client
        })
        .collect();
    until(link, |link| {
        period(link);
        link.clients.iter().flatten().all(|client| client.heard.is_some())
    });
    clients
}

fn is_sent_away(client: &mut TcpStream) -> bool {
    matches!(client.read(&mut [0; 1]), Ok(0) | Err(_))
}

#[test]
fn one_client_too_many_is_sent_away_while_all_others_speak() {
    let mut link = link();
    let clients = speaking(&mut link, CLIENTS);
    let mut late = client(&link);
    period(&mut link);
    assert!(is_sent_away(&mut late));
    assert_eq!(link.clients(), clients.len());
}

#[test]
fn who_never_spoke_gives_way_and_then_who_fell_silent() {
    let mut link = TcpLink { silence_limit: Duration::ZERO, ..link() };
    let mut spoke = speaking(&mut link, 1);
    let mut mute: Vec<_> = (1..CLIENTS)
        .map(|count| {
            let client = client(&link);
            until_clients(&mut link, count + 1);
            client
        })
        .collect();
    let mut honest = client(&link);
    until(&mut link, |link| {
        period(link);
        link.generation > CLIENTS as u32
    });
    assert!(is_sent_away(&mut mute[0]), "the first of those that never spoke");
    honest.write_all(&heartbeat()).unwrap();
    until(&mut link, |link| !period(link).is_empty());
    for _ in 2..CLIENTS {
        speaking_too(&mut link, &mut spoke);
    }
    let _one_more = client(&link);
    until(&mut link, |link| {
        period(link);
        link.generation > 2 * CLIENTS as u32 - 1
    });
    assert!(is_sent_away(&mut spoke[0]), "the one silent for longest");
    assert_eq!(link.clients(), CLIENTS);
}

/// One more client, which takes the place of one that never spoke.
fn speaking_too(link: &mut TcpLink, clients: &mut Vec<TcpStream>) {
    let mut client = client(link);
    client.write_all(&heartbeat()).unwrap();
    until(link, |link| !period(link).is_empty());
    clients.push(client);
}

#[test]
fn a_client_that_takes_nothing_is_dropped_and_nobody_waits_for_it() {
    let mut link = TcpLink { stall_limit: Duration::from_millis(100), ..link() };
    let _stalled = client(&link);
    until_clients(&mut link, 1);
    let mut listening = client(&link);
    until_clients(&mut link, 2);
    let frame = heartbeat();
    let mut taken = vec![0; frame.len()];
    // Whatever the operating system keeps for a connection, it is full at some time.
    until(&mut link, |link| {
        for _ in 0..20_000 {
            tell(link, &frame);
            listening.read_exact(&mut taken).unwrap();
        }
        period(link);
        link.clients() == 1
    });
    tell(&mut link, &frame);
    listening.read_exact(&mut taken).unwrap();
    assert_eq!(taken, frame);
}

#[test]
fn a_client_that_lags_loses_whole_frames() {
    let mut link = link();
    let mut slow = client(&link);
    until_clients(&mut link, 1);
    let frame = heartbeat();
    let mut sent = 0_usize;
    let waiting =
        |link: &TcpLink| link.clients.iter().flatten().map(|client| client.stream.waiting()).sum::<usize>();
    while waiting(&link) + frame.len() <= WAITING_LIMIT {
        tell(&mut link, &frame);
        sent += 1;
    }
    (0..1000).for_each(|_| tell(&mut link, &frame));
    assert!(waiting(&link) <= WAITING_LIMIT);
    let reader = thread::spawn(move || {
        let (mut bytes, mut receiver) = (Vec::new(), Receiver::new());
        slow.read_to_end(&mut bytes).unwrap();
        bytes.into_iter().filter_map(|byte| receiver.push(byte).map(|frame| frame.is_ok())).collect::<Vec<_>>()
    });
    until(&mut link, |link| {
        period(link);
        waiting(link) == 0
    });
    drop(link);
    let frames = reader.join().unwrap();
    assert!(frames.iter().all(|&good| good));
    // Room may have come while the last thousand were sent, for all that it matters.
    assert!((sent..sent + 1000).contains(&frames.len()), "{} of {sent}", frames.len());
}

#[test]
fn clients_that_flood_take_turns_and_are_heard_a_share_at_a_time_beside_a_third() {
    let mut link = link();
    let mut clients: Vec<TcpStream> = (1..=3)
        .map(|count| {
            let client = client(&link);
            until_clients(&mut link, count);
            client
        })
        .collect();
    let flood = heartbeat().repeat(1000);
    for flooding in &mut clients[..2] {
        flooding.set_nonblocking(true).unwrap();
        while flooding.write(&flood).is_ok_and(|len| len == flood.len()) {}
    }
    let turns: Vec<u8> = period(&mut link).into_iter().map(|(endpoint, _)| endpoint).collect();
    let frames = 2048 / heartbeat().len();
    assert_eq!(turns, [0, 1].repeat(frames));
    clients[2].write_all(&heartbeat()).unwrap();
    until(&mut link, |link| {
        let heard = period(link);
        assert!(heard.len() <= 2 * (frames + 1) + 1, "{}", heard.len());
        heard.iter().any(|(endpoint, _)| *endpoint == 2)
    });
}

#[test]
fn noise_is_never_a_frame() {
    let mut link = link();
    let mut noisy = client(&link);
    until_clients(&mut link, 1);
    let noise: Vec<u8> = (0..20_000_u32).map(|number| (number.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    noisy.write_all(&noise).unwrap();
    noisy.write_all(&[0; 300]).unwrap();
    noisy.write_all(&heartbeat()).unwrap();
    let mut heard = Vec::new();
    until(&mut link, |link| {
        heard.extend(period(link));
        !heard.is_empty()
    });
    assert_eq!(heard, [(0, heartbeat())]);
    assert!(Frames::new(&heard[0].1).all(|frame| frame.is_ok()));
}

#[test]
fn a_busy_port_is_named_and_udp_does_not_make_it_busy() {
    let first = link();
    let address = first.address();
    let _udp = UdpSocket::bind(address);
    let error = TcpLink::open(address).unwrap_err();
    assert!(matches!(error, LinkError::Busy { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains(&format!("TCP address {address} is in use")), "{text}");
}

#[test]
fn an_address_of_another_machine_is_refused() {
    let error = TcpLink::open(SocketAddr::from(([192, 0, 2, 1], DEFAULT_PORT))).unwrap_err();
    assert!(matches!(error, LinkError::Open { .. }), "{error}");
}
