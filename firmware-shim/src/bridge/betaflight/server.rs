//! The loop around [`BetaflightSimulator`]: a state out, motor outputs in, a step.

use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::thread;
use std::time::{Duration, Instant};

use super::BetaflightSimulator;
use crate::bridge::BridgeError;
use crate::bridge::datagram::DatagramSocket;
use crate::bridge::drone::Drone;
use crate::bridge::event::{BridgeCounts, BridgeEvent};
use crate::lockstep::{Clock, Next, SimulationRate};

/// Motor outputs are awaited this long: Betaflight answers within a millisecond of its own clock, or not at all.
const ANSWER_LIMIT: Duration = Duration::from_millis(50);

/// So many states without an answer, and Betaflight has gone.
const UNANSWERED_LIMIT: u64 = 20;

/// Share of a period that lies at least between two states. Betaflight takes the speed of its own clock from that time
/// alone: after a state that follows at once, to catch up, its clock races until the next one.
const SHORTEST_SHARE: f64 = 0.9;

/// The same between an answer, before which Betaflight has read the state, and the next state.
const SHORTEST_SHARE_AFTER_ANSWER: f64 = 0.5;

/// As long as no autopilot flies, states are so far apart \[s\] that Betaflight takes no speed from them: those that queue up
/// while it starts are read all at once.
const IDLE_SECS: f64 = 0.025;

/// Sticks are sent this often \[s\], as radios do.
const STICKS_SECS: f64 = 0.02;

/// Where a Betaflight is, and where its motor outputs arrive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BetaflightAddresses {
    /// Motor outputs arrive here.
    pub outputs: SocketAddr,
    /// It takes states here.
    pub state: SocketAddr,
    /// It takes sticks here.
    pub sticks: SocketAddr,
}

impl Default for BetaflightAddresses {
    /// Betaflight's own; they cannot be changed there.
    fn default() -> Self {
        let loopback = |port| SocketAddr::from(([127, 0, 0, 1], port));
        Self { outputs: loopback(9001), state: loopback(9003), sticks: loopback(9004) }
    }
}

/// States wait this long after Betaflight's port has opened: one that comes before its sensors exist ends its thread, and its
/// motors never turn.
const PATIENCE: Duration = Duration::from_millis(500);

/// Its port is knocked at this often.
const KNOCK_PERIOD: Duration = Duration::from_millis(20);

/// Knocks at a port of this machine, with datagrams of a length that Betaflight does not read.
struct Knocker {
    socket: Option<UdpSocket>,
    open_since: Option<Instant>,
    knocked: Option<Instant>,
}

impl Knocker {
    fn at(address: SocketAddr) -> Self {
        let connected = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).and_then(|socket| {
            socket.connect(address)?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        });
        Self { socket: connected.ok(), open_since: None, knocked: None }
    }

    /// Whether the port has been open for long enough. The second knock is refused where the first has found nobody.
    fn is_ready(&mut self) -> bool {
        let now = Instant::now();
        if self.knocked.is_none_or(|knocked| now - knocked >= KNOCK_PERIOD) {
            self.knocked = Some(now);
            let refused = |socket: &UdpSocket| {
                let _first = socket.send(&[0]);
                socket.recv(&mut [0]).is_err_and(|error| is_refusal(&error))
            };
            // Where one cannot knock, one does not wait.
            let is_closed = self.socket.as_ref().is_some_and(refused);
            self.open_since = if is_closed { None } else { self.open_since.or(Some(now)) };
        }
        self.open_since.is_some_and(|since| now - since >= PATIENCE)
    }
}

/// Linux says the one, Windows the other.
fn is_refusal(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::ConnectionRefused | ErrorKind::ConnectionReset)
}

/// How an exchange of a state for motor outputs ended.
enum Exchange {
    /// The simulation goes on.
    Answered,
    /// It waits.
    Unanswered,
    /// The autopilot does not want it any more.
    Ended,
}

/// Betaflight's simulation, ready to be served.
pub struct BetaflightServer<'a, 'p> {
    drone: &'a mut Drone<'p>,
    simulator: BetaflightSimulator,
    addresses: BetaflightAddresses,
    period: Duration,
    clock: Clock,
    /// Wall time of a step; none if unthrottled.
    period_wall: Option<Duration>,
    /// The next state follows no earlier.
    earliest: Instant,
    /// The next state is due \[s\].
    due_secs: f64,
    counts: BridgeCounts,
    unanswered_in_a_row: u64,
    sticks_due_secs: f64,
    knocker: Knocker,
}

impl<'a, 'p> BetaflightServer<'a, 'p> {
    /// A simulation with steps of `period`.
    pub fn new(
        drone: &'a mut Drone<'p>,
        simulator: BetaflightSimulator,
        addresses: BetaflightAddresses,
        period: Duration,
        pace: SimulationRate,
    ) -> Self {
        Self {
            drone,
            simulator,
            addresses,
            period,
            clock: Clock::new(pace, period),
            period_wall: match pace {
                SimulationRate::Speed(speed) => Some(period.div_f64(speed)),
                SimulationRate::Unthrottled => None,
            },
            earliest: Instant::now(),
            due_secs: 0.0,
            counts: BridgeCounts::default(),
            unanswered_in_a_row: 0,
            sticks_due_secs: 0.0,
            knocker: Knocker::at(addresses.state),
        }
    }

    /// Serves until `watch` ends it. While no Betaflight answers, the drone stands with its motors stopped.
    ///
    /// # Errors
    /// [`BridgeError::Socket`] if the socket fails.
    pub fn serve(
        mut self,
        socket: &mut DatagramSocket,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Result<BridgeCounts, BridgeError> {
        loop {
            if !self.simulator.engaged() && !self.knocker.is_ready() {
                if watch(&BridgeEvent::Waiting) == Next::End {
                    break;
                }
                thread::sleep(KNOCK_PERIOD);
                continue;
            }
            if self.secs() >= self.due_secs {
                match self.exchange(socket, watch)? {
                    Exchange::Answered => {}
                    // The same state again: a newer one could be read together with it.
                    Exchange::Unanswered => continue,
                    Exchange::Ended => break,
                }
            }
            if self.step(watch) == Next::End {
                break;
            }
            self.clock.wait();
            thread::sleep(self.earliest.saturating_duration_since(Instant::now()));
        }
        self.counts.garbage = self.simulator.garbage();
        Ok(self.counts)
    }

    /// Tells a state and waits for the answer to it; without a Betaflight none is needed.
    fn exchange(
        &mut self,
        socket: &mut DatagramSocket,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Result<Exchange, BridgeError> {
        let engaged_before = self.simulator.engaged();
        socket.drain()?;
        self.send(socket);
        let told_at = Instant::now();
        let sender = self.listen(socket)?;
        self.pause_after(told_at);
        self.due_secs = if engaged_before { self.secs() } else { self.secs() + IDLE_SECS };
        if !engaged_before && let Some(sender) = sender {
            self.counts.connections += 1;
            self.drone.restart_instruments();
            if watch(&BridgeEvent::Connected(sender)) == Next::End || watch(&BridgeEvent::Engaged) == Next::End {
                return Ok(Exchange::Ended);
            }
        }
        if self.count(engaged_before, watch) == Next::End {
            return Ok(Exchange::Ended);
        }
        let waits = self.simulator.engaged() && !self.simulator.answered();
        Ok(if waits { Exchange::Unanswered } else { Exchange::Answered })
    }

    fn secs(&self) -> f64 {
        self.counts.steps as f64 * self.period.as_secs_f64()
    }

    fn pause_after(&mut self, told_at: Instant) {
        if let Some(period) = self.period_wall {
            let since_answer = Instant::now() + period.mul_f64(SHORTEST_SHARE_AFTER_ANSWER);
            self.earliest = since_answer.max(told_at + period.mul_f64(SHORTEST_SHARE));
        }
    }

    fn send(&mut self, socket: &DatagramSocket) {
        let secs = self.secs();
        let state = self.simulator.send(self.drone.measurement(), self.drone.state(), secs);
        socket.send(&state, self.addresses.state);
        if secs >= self.sticks_due_secs
            && let Some(sticks) = self.simulator.sticks(secs)
        {
            socket.send(&sticks, self.addresses.sticks);
            self.sticks_due_secs = secs + STICKS_SECS;
        }
    }

    /// Who answered in time, if anybody did.
    fn listen(&mut self, socket: &mut DatagramSocket) -> Result<Option<SocketAddr>, BridgeError> {
        // Before the first answer the bridge does not wait.
        let limit = if self.simulator.engaged() { ANSWER_LIMIT } else { self.period };
        let end = Instant::now() + limit;
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let Some((datagram, sender)) = socket.receive(left)? else { continue };
            self.simulator.receive(datagram);
            if self.simulator.answered() {
                return Ok(Some(sender));
            }
        }
    }

    fn count(&mut self, engaged: bool, watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next) -> Next {
        if self.simulator.answered() {
            self.counts.answered += 1;
            self.unanswered_in_a_row = 0;
            return Next::Fly;
        }
        if !engaged {
            return watch(&BridgeEvent::Waiting);
        }
        self.counts.unanswered += 1;
        self.unanswered_in_a_row += 1;
        if self.unanswered_in_a_row == UNANSWERED_LIMIT {
            self.simulator.disengage();
            return watch(&BridgeEvent::Gone);
        }
        watch(&BridgeEvent::Unanswered)
    }

    fn step(&mut self, watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next) -> Next {
        self.drone.step(&self.simulator.throttles());
        self.counts.steps += 1;
        watch(&self.drone.stepped(self.secs()))
    }
}
