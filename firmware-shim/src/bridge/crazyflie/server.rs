//! The loop around [`CrazyflieSimulator`]: a sample out, motor outputs in, a step.

use std::net::SocketAddr;
use std::thread;
use std::time::{Duration, Instant};

use super::{CrazyflieSimulator, HELLO, Said};
use crate::bridge::BridgeError;
use crate::bridge::datagram::DatagramSocket;
use crate::bridge::drone::Drone;
use crate::bridge::event::{BridgeCounts, BridgeEvent};
use crate::lockstep::Next;

/// One look for a firmware waits no longer than this.
const LOOK_LIMIT: Duration = Duration::from_millis(100);

/// Steps that the simulation may be ahead of the last answer: what a firmware hears and says waits for ticks of its clock. Its
/// queue has room for five packets, two of which are a pose and one of a client.
const LEAD: u32 = 2;

/// A firmware that is so far behind is given the last sample again: one may have been lost in its queue.
const ANSWER_LIMIT: Duration = Duration::from_millis(4);

/// Looks for an answer are so far apart. A socket's own time limit is coarser than a period: it is counted in ticks of the
/// operating system.
const LOOK_EVERY: Duration = Duration::from_micros(40);

/// So many samples without an answer, and the firmware has gone.
const SAMPLES_LIMIT: u32 = 300;

/// A client's sign of life, answered here: whoever scans wants to know whether anybody is there.
const NULL_PACKET: [u8; 1] = [0xFF];

/// A firmware's simulation, ready to be served.
pub struct CrazyflieServer<'a, 'p> {
    drone: &'a mut Drone<'p>,
    simulator: CrazyflieSimulator,
    period: Duration,
    /// Where clients look for the drone.
    clients: &'a mut DatagramSocket,
    client: Option<SocketAddr>,
    firmware: Option<SocketAddr>,
    counts: BridgeCounts,
    /// The next sample is sent no earlier.
    due: Instant,
}

impl<'a, 'p> CrazyflieServer<'a, 'p> {
    /// A simulation with steps of `period`, for clients at a socket of their own.
    pub fn new(
        drone: &'a mut Drone<'p>,
        simulator: CrazyflieSimulator,
        period: Duration,
        clients: &'a mut DatagramSocket,
    ) -> Self {
        let counts = BridgeCounts::default();
        Self { drone, simulator, period, clients, client: None, firmware: None, counts, due: Instant::now() }
    }

    /// Serves one firmware after the other, until `watch` ends it. While none is there, the drone stands still.
    ///
    /// # Errors
    /// [`BridgeError::Socket`] if a socket fails.
    pub fn serve(
        mut self,
        socket: &mut DatagramSocket,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Result<BridgeCounts, BridgeError> {
        loop {
            let next = match self.firmware {
                None => self.look(socket, watch)?,
                Some(firmware) => {
                    self.pass_on(socket, firmware)?;
                    self.step(socket, firmware, watch)?
                }
            };
            if next == Next::End {
                break;
            }
            thread::sleep(self.due.saturating_duration_since(Instant::now()));
        }
        self.counts.garbage = self.simulator.garbage();
        Ok(self.counts)
    }

    /// Waits for a firmware.
    fn look(
        &mut self,
        socket: &mut DatagramSocket,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Result<Next, BridgeError> {
        let Some((datagram, sender)) = socket.receive(LOOK_LIMIT)? else {
            return Ok(watch(&BridgeEvent::Waiting));
        };
        if self.simulator.receive(datagram) != Said::Hello {
            return Ok(Next::Fly);
        }
        Ok(self.greet(socket, sender, watch))
    }

    fn greet(
        &mut self,
        socket: &DatagramSocket,
        firmware: SocketAddr,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Next {
        socket.send(&[HELLO], firmware);
        self.firmware = Some(firmware);
        self.simulator.restart();
        self.drone.restart_instruments();
        self.counts.connections += 1;
        self.due = Instant::now();
        watch(&BridgeEvent::Connected(firmware))
    }

    /// A packet of the client goes to the firmware, as soon as that has read what it was sent before.
    fn pass_on(&mut self, socket: &DatagramSocket, firmware: SocketAddr) -> Result<(), BridgeError> {
        if self.simulator.engaged() && self.simulator.waiting() > 0 {
            return Ok(());
        }
        let Some((packet, sender)) = self.clients.poll()? else { return Ok(()) };
        if packet == NULL_PACKET {
            self.clients.send(&NULL_PACKET, sender);
        } else {
            socket.send(packet, firmware);
            self.client = Some(sender);
        }
        Ok(())
    }

    /// Tells a sample and moves the drone by the last answer, if that is not too old.
    fn step(
        &mut self,
        socket: &mut DatagramSocket,
        firmware: SocketAddr,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Result<Next, BridgeError> {
        let engaged_before = self.simulator.engaged();
        if let Some(pose) = self.simulator.pose(self.drone.state()) {
            socket.send(&pose, firmware);
        }
        socket.send(&self.simulator.sample(self.drone.measurement()), firmware);
        let mut heard = self.hear(socket)?;
        while heard.is_none() && self.simulator.engaged() && self.simulator.waiting() > LEAD {
            let end = Instant::now() + ANSWER_LIMIT;
            while heard.is_none() && self.simulator.waiting() > LEAD && Instant::now() < end {
                thread::sleep(LOOK_EVERY);
                heard = self.hear(socket)?;
            }
            if self.simulator.waiting() > LEAD {
                self.counts.unanswered += 1;
                // Somebody may want to end a simulation that stands still.
                if watch(&BridgeEvent::Unanswered) == Next::End {
                    return Ok(Next::End);
                }
                if self.simulator.waiting() > SAMPLES_LIMIT {
                    self.firmware = None;
                    self.simulator.restart();
                    return Ok(watch(&BridgeEvent::Gone));
                }
                socket.send(&self.simulator.sample(self.drone.measurement()), firmware);
            }
        }
        if let Some(restarted) = heard {
            return Ok(self.greet(socket, restarted, watch));
        }
        if self.simulator.engaged() && !engaged_before && watch(&BridgeEvent::Engaged) == Next::End {
            return Ok(Next::End);
        }
        Ok(self.advance(watch))
    }

    /// Hears all that the firmware has said; where it is, if it has started anew.
    fn hear(&mut self, socket: &mut DatagramSocket) -> Result<Option<SocketAddr>, BridgeError> {
        while let Some((datagram, sender)) = socket.poll()? {
            match self.simulator.receive(datagram) {
                Said::Hello => return Ok(Some(sender)),
                Said::ForClient => {
                    if let Some(client) = self.client {
                        self.clients.send(datagram, client);
                    }
                }
                Said::Motors | Said::Garbage => {}
            }
        }
        Ok(None)
    }

    fn advance(&mut self, watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next) -> Next {
        self.counts.answered += u64::from(self.simulator.waiting() == 0);
        self.drone.step(&self.simulator.throttles());
        self.counts.steps += 1;
        // A step that took longer is not caught up with: the firmware's clock goes on.
        self.due = (self.due + self.period).max(Instant::now());
        watch(&self.drone.stepped(self.counts.steps as f64 * self.period.as_secs_f64()))
    }
}
