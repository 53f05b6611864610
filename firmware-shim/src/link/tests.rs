use std::collections::VecDeque;
use std::net::UdpSocket;

use mavlink::dialects::common::{HEARTBEAT_DATA, MavCmd};

use super::memory::MemoryLink;
use super::udp::{UdpAddresses, UdpLink};
use super::*;
use crate::testing::{command_long, datagram};

/// Gives what it was told to give, and tells whom it learned.
#[derive(Default)]
struct Script {
    given: VecDeque<(u8, Vec<u8>)>,
    learned: Option<std::sync::mpsc::Sender<u8>>,
}

impl Link for Script {
    fn advance(&mut self, _now_secs: f64) -> Result<(), LinkError> {
        Ok(())
    }

    fn receive<'b>(&mut self, buffer: &'b mut [u8; DATAGRAM_LIMIT]) -> Result<Option<Received<'b>>, LinkError> {
        let Some((number, bytes)) = self.given.pop_front() else { return Ok(None) };
        buffer[..bytes.len()].copy_from_slice(&bytes);
        let endpoint = EndpointId { number, generation: 0 };
        Ok(Some(Received { datagram: &buffer[..bytes.len()], endpoint }))
    }

    fn learn(&mut self, endpoint: EndpointId) {
        self.learned.iter().for_each(|learned| learned.send(endpoint.number).unwrap());
    }

    fn listeners(&self) -> Listeners {
        Listeners::new()
    }

    fn send_to(&mut self, _endpoint: EndpointId, _frame: &[u8]) {}
}

fn heartbeat() -> Vec<u8> {
    datagram(&HEARTBEAT_DATA::default())
}

fn command() -> Vec<u8> {
    datagram(&command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0; 7]))
}

fn links_of(given: impl IntoIterator<Item = (u8, Vec<u8>)>) -> Links {
    let mut links = Links::default();
    links.attach(Box::new(Script { given: given.into_iter().collect(), learned: None })).unwrap();
    links
}

/// Datagrams that are heard in the control period at this time \[s\].
fn heard(links: &mut Links, now_secs: f64) -> usize {
    let mut heard = 0;
    let mut handle = |_: Peer, _: &[u8], _: &mut dyn FnMut(&[u8])| {
        heard += 1;
        true
    };
    links.begin_period(now_secs, &mut handle).unwrap();
    heard
}

#[test]
fn a_flood_leaves_room_for_everybody_else() {
    let flood = (0..900).map(|_| (0, heartbeat()));
    let mut links = links_of(flood.chain([(1, command())]));
    let mut last = Vec::new();
    links
        .begin_period(0.0, &mut |_, datagram, _| {
            last = datagram.to_vec();
            true
        })
        .unwrap();
    assert_eq!(last, command());
    assert_eq!(links.counts(), LinkCounts { flooding: 900 - u64::from(DATAGRAMS_PER_ENDPOINT), commands: 0 });
}

#[test]
fn a_control_period_ends_however_many_flood() {
    let mut links = links_of((0..5000).map(|number| ((number % ENDPOINTS) as u8, heartbeat())));
    assert_eq!(heard(&mut links, 0.0), DATAGRAMS_AT_ONCE);
}

#[test]
fn a_flood_through_one_link_is_no_matter_to_another() {
    let mut links = links_of((0..5000).map(|_| (0, heartbeat())));
    let (mut peer, end) = MemoryLink::pair();
    links.attach(Box::new(end)).unwrap();
    peer.send(&heartbeat());
    assert_eq!(heard(&mut links, 0.0), usize::from(DATAGRAMS_PER_ENDPOINT) + 1);
}

#[test]
fn commands_have_an_allowance_that_grows_with_time_and_nothing_else_counts() {
    let (mut peer, end) = MemoryLink::pair();
    let mut links = Links::default();
    links.attach(Box::new(end)).unwrap();
    let mut after = |secs: f64, count: usize, bytes: &[u8]| {
        (0..count).for_each(|_| peer.send(bytes));
        heard(&mut links, secs)
    };
    assert_eq!([after(0.0, 60, &command()), after(0.0, 60, &command())], [60, 40]);
    assert_eq!(after(0.0, 60, &heartbeat()), 60);
    assert_eq!(after(0.1, 60, &command()), 5);
    assert_eq!(after(1.1, 60, &command()), 50);
    assert_eq!([after(99.0, 60, &command()), after(99.0, 60, &command())], [60, 40], "no more than at once");
    assert_eq!(links.counts(), LinkCounts { flooding: 0, commands: 20 + 55 + 10 + 20 });
}

#[test]
fn commands_in_one_datagram_are_heard_together_or_not_at_all() {
    let mut links = links_of([(0, command().repeat(40)), (0, command().repeat(40)), (0, command().repeat(40))]);
    assert_eq!(heard(&mut links, 0.0), 2);
    assert_eq!(links.counts().commands, 1);
}

#[test]
fn only_who_sends_something_good_is_learned() {
    let (sender, learned) = std::sync::mpsc::channel();
    let mut links = Links::default();
    let given = [(3, heartbeat()), (4, b"noise".to_vec())].into();
    links.attach(Box::new(Script { given, learned: Some(sender) })).unwrap();
    links.begin_period(0.0, &mut |_, datagram, _| datagram != b"noise").unwrap();
    assert_eq!(learned.try_iter().collect::<Vec<_>>(), [3]);
}

#[test]
fn a_link_too_many_is_refused() {
    let mut links = Links::default();
    (0..LINKS).for_each(|_| links.attach(Box::new(Script::default())).unwrap());
    let error = links.attach(Box::new(Script::default())).unwrap_err();
    assert!(matches!(error, LinkError::TooMany), "{error}");
}

#[test]
fn every_peer_of_every_link_is_told() {
    let mut links = Links::default();
    let (mut first, end) = MemoryLink::pair();
    links.attach(Box::new(end)).unwrap();
    let (mut second, end) = MemoryLink::pair();
    links.attach(Box::new(end)).unwrap();
    let listeners = links.listeners();
    assert_eq!(listeners.iter().map(|peer| peer.link).collect::<Vec<_>>(), [0, 1]);
    let mut buffer = [0; DATAGRAM_LIMIT];
    for (peer, end) in listeners.into_iter().zip([&mut first, &mut second]) {
        links.send_to(peer, &[peer.link]);
        assert_eq!(end.receive(&mut buffer).unwrap().unwrap().datagram, [peer.link]);
        assert!(end.receive(&mut buffer).unwrap().is_none());
    }
}

#[test]
fn an_answer_goes_to_who_asked_and_to_nobody_else() {
    let mut links = Links::default();
    let mut ends = [(); 2].map(|()| {
        let (far, near) = MemoryLink::pair();
        links.attach(Box::new(near)).unwrap();
        far
    });
    ends[1].send(&heartbeat());
    links.begin_period(0.0, &mut |_, _, _| false).unwrap();
    ends[1].send(&heartbeat());
    let mut echo = |_: Peer, datagram: &[u8], answer: &mut dyn FnMut(&[u8])| {
        answer(datagram);
        true
    };
    links.receive(&mut echo).unwrap();
    let mut buffer = [0; DATAGRAM_LIMIT];
    assert_eq!(ends[1].receive(&mut buffer).unwrap().unwrap().datagram, heartbeat());
    assert!(ends.iter_mut().all(|end| end.receive(&mut buffer).unwrap().is_none()));
}

#[test]
fn a_client_is_heard_beside_one_that_floods_the_same_socket() {
    let port = SocketAddr::from(([127, 0, 0, 1], 0));
    let addresses = UdpAddresses { vehicle: port, ground_station: SocketAddr::from(([127, 0, 0, 1], 9)) };
    let link = UdpLink::open(&addresses).unwrap();
    let vehicle = link.address();
    let mut links = Links::default();
    links.attach(Box::new(link)).unwrap();
    let [flooding, client] = [(); 2].map(|()| UdpSocket::bind(port).unwrap());
    // As many as the operating system surely keeps for a socket; their commands are more than the allowance.
    for _ in 0..150 {
        flooding.send_to(&command(), vehicle).unwrap();
    }
    client.send_to(&command(), vehicle).unwrap();
    assert_eq!(heard(&mut links, 0.0), 100 + 1);
    assert_eq!(links.counts(), LinkCounts { flooding: 0, commands: 50 });
}
