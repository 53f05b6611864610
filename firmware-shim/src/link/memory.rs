//! Two ends in one process: for tests, and for programs that embed a vehicle.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use super::{DATAGRAM_LIMIT, EndpointId, Link, LinkError, Listeners, Received};

/// Datagrams that wait for the other end; one more is lost.
const WAITING: usize = 1024;

/// One of two connected ends, each with a single endpoint; they may live in different threads.
#[derive(Debug)]
pub struct MemoryLink {
    outgoing: SyncSender<Vec<u8>>,
    incoming: Receiver<Vec<u8>>,
}

impl MemoryLink {
    /// Two ends, each of which receives what the other one sends.
    pub fn pair() -> (Self, Self) {
        let (to_second, from_first) = sync_channel(WAITING);
        let (to_first, from_second) = sync_channel(WAITING);
        (Self { outgoing: to_second, incoming: from_second }, Self { outgoing: to_first, incoming: from_first })
    }

    /// Sends a datagram to the other end.
    pub fn send(&mut self, datagram: &[u8]) {
        let _lost = self.outgoing.try_send(datagram.to_vec());
    }
}

impl Link for MemoryLink {
    fn advance(&mut self, _now_secs: f64) -> Result<(), LinkError> {
        Ok(())
    }

    fn receive<'b>(&mut self, buffer: &'b mut [u8; DATAGRAM_LIMIT]) -> Result<Option<Received<'b>>, LinkError> {
        let Ok(datagram) = self.incoming.try_recv() else { return Ok(None) };
        let len = datagram.len().min(DATAGRAM_LIMIT);
        buffer[..len].copy_from_slice(&datagram[..len]);
        Ok(Some(Received { datagram: &buffer[..len], endpoint: EndpointId::ONLY }))
    }

    fn learn(&mut self, _endpoint: EndpointId) {}

    fn listeners(&self) -> Listeners {
        [EndpointId::ONLY].into_iter().collect()
    }

    fn send_to(&mut self, _endpoint: EndpointId, frame: &[u8]) {
        self.send(frame);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_end_hears_the_other_in_order_and_not_itself() {
        let (mut first, mut second) = MemoryLink::pair();
        let mut buffer = [0; DATAGRAM_LIMIT];
        first.send(b"one");
        first.send(b"two");
        assert!(first.receive(&mut buffer).unwrap().is_none());
        for expected in [&b"one"[..], b"two"] {
            let received = second.receive(&mut buffer).unwrap().unwrap();
            assert_eq!(received, Received { datagram: expected, endpoint: EndpointId::ONLY });
        }
        assert!(second.receive(&mut buffer).unwrap().is_none());
    }

    #[test]
    fn an_end_that_does_not_listen_or_has_gone_costs_bounded_memory() {
        let (mut first, mut second) = MemoryLink::pair();
        (0..2 * WAITING).for_each(|_| first.send(&[0; 2 * DATAGRAM_LIMIT]));
        let mut buffer = [0; DATAGRAM_LIMIT];
        let mut heard = 0;
        while let Some(received) = second.receive(&mut buffer).unwrap() {
            assert_eq!(received.datagram.len(), DATAGRAM_LIMIT);
            heard += 1;
        }
        assert_eq!(heard, WAITING);
        drop(second);
        first.send(b"nobody");
        assert!(first.receive(&mut buffer).unwrap().is_none());
    }
}
