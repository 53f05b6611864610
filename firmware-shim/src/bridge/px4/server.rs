//! The TCP socket behind [`Px4Simulator`]: PX4 connects, flies, goes and comes back.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

use super::{Px4Simulator, is_pause};
use crate::bridge::BridgeError;
use crate::bridge::drone::Drone;
use crate::bridge::event::{BridgeCounts, BridgeEvent};
use crate::lockstep::{Clock, Next, SimulationRate};

/// An answer is awaited this long; PX4 itself gives up on a silent simulator after a second.
pub const ANSWER_LIMIT: Duration = Duration::from_secs(1);

/// A connection is looked for this often: a restarted PX4 is back at once.
const LOOK_PERIOD: Duration = Duration::from_millis(5);

/// A socket that listens for PX4.
#[derive(Debug)]
pub struct Listener {
    socket: TcpListener,
}

/// How a step went.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Answer {
    Given,
    Missing,
    /// The connection is closed.
    Gone,
}

impl Listener {
    /// Binds an address; port 0 lets the operating system choose.
    ///
    /// # Errors
    /// [`BridgeError::Busy`] or [`BridgeError::Open`].
    pub fn open(address: SocketAddr) -> Result<Self, BridgeError> {
        let socket = TcpListener::bind(address).map_err(|reason| BridgeError::opening("TCP", address, reason))?;
        socket.set_nonblocking(true).map_err(BridgeError::Socket)?;
        Ok(Self { socket })
    }

    /// The bound address.
    ///
    /// # Errors
    /// [`BridgeError::Socket`] if the operating system does not tell.
    pub fn address(&self) -> Result<SocketAddr, BridgeError> {
        self.socket.local_addr().map_err(BridgeError::Socket)
    }

    /// The client that has connected, if one has.
    fn accept(&self) -> Result<Option<(TcpStream, SocketAddr)>, BridgeError> {
        match self.socket.accept() {
            Ok((stream, address)) => {
                let ready = stream.set_nonblocking(false).and_then(|()| stream.set_nodelay(true));
                let ready = ready.and_then(|()| stream.set_write_timeout(Some(ANSWER_LIMIT)));
                Ok(ready.is_ok().then_some((stream, address)))
            }
            Err(error) if error.kind() == ErrorKind::ConnectionAborted || is_pause(&error) => Ok(None),
            Err(error) => Err(BridgeError::Socket(error)),
        }
    }
}

/// A simulation that serves one PX4 after the other.
pub struct Px4Server<'a, 'p> {
    drone: &'a mut Drone<'p>,
    simulator: Px4Simulator,
    period: Duration,
    clock: Clock,
    counts: BridgeCounts,
    /// Who connected while the other was silent.
    successor: Option<(TcpStream, SocketAddr)>,
    frames: Vec<u8>,
}

impl<'a, 'p> Px4Server<'a, 'p> {
    /// A simulation with steps of `period`.
    pub fn new(drone: &'a mut Drone<'p>, simulator: Px4Simulator, period: Duration, pace: SimulationRate) -> Self {
        let (clock, counts) = (Clock::new(pace, period), BridgeCounts::default());
        Self { drone, simulator, period, clock, counts, successor: None, frames: Vec::new() }
    }

    /// Serves until `watch` ends it.
    ///
    /// # Errors
    /// [`BridgeError::Socket`] if the listening socket fails; a connection that fails is one that ended.
    pub fn serve(
        mut self,
        listener: &Listener,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Result<BridgeCounts, BridgeError> {
        loop {
            let Some((mut stream, address)) =
                self.successor.take().map_or_else(|| listener.accept(), |it| Ok(Some(it)))?
            else {
                if watch(&BridgeEvent::Waiting) == Next::End {
                    break;
                }
                thread::sleep(LOOK_PERIOD);
                continue;
            };
            self.counts.connections += 1;
            self.simulator.reconnect();
            let next = match watch(&BridgeEvent::Connected(address)) {
                Next::Fly => self.fly(&mut stream, listener, watch)?,
                Next::End => Next::End,
            };
            if next == Next::End {
                break;
            }
        }
        self.counts.garbage = self.simulator.garbage();
        Ok(self.counts)
    }

    /// Flies with one connection until it ends, a new one waits while this one is silent, or `watch` ends it.
    fn fly(
        &mut self,
        stream: &mut TcpStream,
        listener: &Listener,
        watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next,
    ) -> Result<Next, BridgeError> {
        loop {
            let engaged_before = self.simulator.engaged();
            let answer = self.exchange(stream);
            if answer == Answer::Gone {
                return Ok(watch(&BridgeEvent::Gone));
            }
            if !engaged_before && self.simulator.engaged() {
                // How many steps PX4 needed to wake up is up to the wall clock; nothing after may depend on it.
                self.drone.restart_instruments();
                if watch(&BridgeEvent::Engaged) == Next::End {
                    return Ok(Next::End);
                }
            }
            if self.step(answer, engaged_before, watch) == Next::End {
                return Ok(Next::End);
            }
            if answer == Answer::Missing && engaged_before {
                self.successor = listener.accept()?;
                if self.successor.is_some() {
                    return Ok(watch(&BridgeEvent::Gone));
                }
            }
            self.clock.wait();
        }
    }

    /// Tells what the instruments say, and waits for the answer.
    fn exchange(&mut self, stream: &mut TcpStream) -> Answer {
        self.frames.clear();
        let frames = &mut self.frames;
        self.simulator
            .send(self.drone.measurement(), self.drone.state(), &mut |frame| frames.extend_from_slice(frame));
        if stream.write_all(&self.frames).is_err() {
            return Answer::Gone;
        }
        self.listen(stream)
    }

    fn listen(&mut self, stream: &mut TcpStream) -> Answer {
        let mut bytes = [0; 1024];
        let start = Instant::now();
        while !self.simulator.answered() {
            // In simulated time the bridge does not wait for a PX4 that has not woken up; on the wall clock it gets a chance to.
            let limit = if self.simulator.awake() { ANSWER_LIMIT } else { self.period };
            let left = limit.saturating_sub(start.elapsed());
            if left.is_zero() {
                return Answer::Missing;
            }
            if stream.set_read_timeout(Some(left)).is_err() {
                return Answer::Gone;
            }
            match stream.read(&mut bytes) {
                Ok(0) => return Answer::Gone,
                Ok(len) => self.simulator.receive(&bytes[..len]),
                Err(error) if is_pause(&error) => {}
                Err(_) => return Answer::Gone,
            }
        }
        Answer::Given
    }

    fn step(&mut self, answer: Answer, engaged: bool, watch: &mut dyn FnMut(&BridgeEvent<'_>) -> Next) -> Next {
        self.drone.step(&self.simulator.throttles());
        self.counts.steps += 1;
        self.counts.answered += u64::from(answer == Answer::Given);
        if answer == Answer::Missing && engaged {
            self.counts.unanswered += 1;
            if watch(&BridgeEvent::Unanswered) == Next::End {
                return Next::End;
            }
        }
        watch(&self.drone.stepped(self.counts.steps as f64 * self.period.as_secs_f64()))
    }
}
