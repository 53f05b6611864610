//! A PX4-compatible simulator as the [`Plant`] of our vehicle: the TCP socket behind [`Producer`].

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use super::is_pause;
use super::producer::{Producer, SensorReadings};
use crate::bridge::motors::Motors;
use crate::plant::Plant;

/// A simulator that says nothing for so long is not there: PX4 complains after the same time.
const SILENCE_LIMIT: Duration = Duration::from_secs(1);

/// One look for a simulator, or for its next message, waits no longer than this, so that the vehicle goes on speaking.
const LOOK_LIMIT: Duration = Duration::from_millis(20);

/// A state that is not known.
const UNKNOWN: State<f32> = State {
    position: Vector3::new(f32::NAN, f32::NAN, f32::NAN),
    world_from_body: Attitude { w: 1.0, x: 0.0, y: 0.0, z: 0.0 },
    velocity: Vector3::new(0.0, 0.0, 0.0),
    body_rates: Vector3::new(0.0, 0.0, 0.0),
    rotor_speeds: [0.0; 4],
};

/// The world of a simulator elsewhere, as seen through PX4's interface.
///
/// Its state is unknown, with a position that is not finite, while no simulator is there or it does not tell
/// `HIL_STATE_QUATERNION`; the autopilot then stops the motors and does not arm. A simulator that comes back is another
/// world with an origin of its own.
#[derive(Debug)]
pub struct ExternalSimulator {
    address: SocketAddr,
    motors: Motors,
    control_micros: u64,
    link: Option<Link>,
    state: State<f32>,
}

/// One connection.
#[derive(Debug)]
struct Link {
    stream: TcpStream,
    producer: Producer,
    bytes: [u8; 2048],
    /// The part of `bytes` that is not read yet.
    unread: core::ops::Range<usize>,
    /// The sensor message that waits for the vehicle's decision.
    open: Option<SensorReadings>,
    /// Simulated time at which the next decision is due \[µs\].
    due_micros: Option<u64>,
    heard: Instant,
}

/// What came of waiting for the next decision.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wait {
    Due,
    /// Not yet; the simulator may be slow.
    Silent,
    Gone,
}

impl ExternalSimulator {
    /// The simulator at this address, for a vehicle that decides every `control_secs`.
    pub fn new(address: SocketAddr, motors: Motors, control_secs: f32) -> Self {
        let control_micros = (f64::from(control_secs) * 1e6).round() as u64;
        Self { address, motors, control_micros, link: None, state: UNKNOWN }
    }

    fn connect(&mut self) {
        let end = Instant::now() + LOOK_LIMIT;
        self.link = Link::open(self.address, self.motors).ok();
        if self.link.is_none() {
            thread::sleep(end.saturating_duration_since(Instant::now()));
        }
    }
}

impl Plant for ExternalSimulator {
    fn state(&self) -> &State<f32> {
        &self.state
    }

    /// Advances the simulator by one control period, or waits a moment for one that is not there.
    fn step(&mut self, rotor_targets: &[f32; 4]) {
        let Some(link) = &mut self.link else {
            self.state = UNKNOWN;
            return self.connect();
        };
        link.producer.command(rotor_targets);
        let silent = link.heard.elapsed() > SILENCE_LIMIT;
        match link.advance(self.control_micros) {
            Wait::Due | Wait::Silent if !silent => {
                self.state = link.producer.state().map_or(UNKNOWN, |state| State {
                    // Rotors are not told; no observation shows them.
                    rotor_speeds: *rotor_targets,
                    ..*state
                });
            }
            Wait::Due | Wait::Silent => self.state = UNKNOWN,
            Wait::Gone => {
                self.link = None;
                self.state = UNKNOWN;
            }
        }
    }
}

impl Link {
    fn open(address: SocketAddr, motors: Motors) -> std::io::Result<Self> {
        let mut stream = TcpStream::connect_timeout(&address, LOOK_LIMIT)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(LOOK_LIMIT))?;
        stream.set_write_timeout(Some(SILENCE_LIMIT))?;
        let mut producer = Producer::new(motors);
        let mut words = Vec::new();
        producer.introduce(&mut |frame| words.extend_from_slice(frame));
        stream.write_all(&words)?;
        let heard = Instant::now();
        Ok(Self { stream, producer, bytes: [0; 2048], unread: 0..0, open: None, due_micros: None, heard })
    }

    /// Answers sensor messages until one comes at which the vehicle has to decide again; that one stays open.
    fn advance(&mut self, control_micros: u64) -> Wait {
        if self.decide(control_micros).is_err() {
            return Wait::Gone;
        }
        let end = Instant::now() + SILENCE_LIMIT;
        while Instant::now() < end {
            while let Some(byte) = self.next_byte() {
                let Some(sensed) = self.producer.receive(byte) else { continue };
                if self.is_due(sensed, control_micros) {
                    self.open = Some(sensed);
                    return Wait::Due;
                }
                if self.answer(sensed).is_err() {
                    return Wait::Gone;
                }
            }
            match self.stream.read(&mut self.bytes) {
                Ok(0) => return Wait::Gone,
                Ok(len) => {
                    self.unread = 0..len;
                    self.heard = Instant::now();
                }
                Err(error) if is_pause(&error) => return Wait::Silent,
                Err(_) => return Wait::Gone,
            }
        }
        Wait::Silent
    }

    /// Answers the open sensor message with the vehicle's decision, and sets the time of the next.
    fn decide(&mut self, control_micros: u64) -> std::io::Result<()> {
        let Some(sensed) = self.open.take() else { return Ok(()) };
        // Counted from when this one was due: a simulator's step need not divide the control period.
        let next = self.due_micros.map_or(0, |due| due + control_micros);
        let after = sensed.time_micros + control_micros;
        self.due_micros = Some(if (sensed.time_micros + 1..=after).contains(&next) { next } else { after });
        self.answer(sensed)
    }

    /// Whether the vehicle has to decide again, also because the simulator's time began anew.
    fn is_due(&self, sensed: SensorReadings, control_micros: u64) -> bool {
        let now = sensed.time_micros;
        self.due_micros.is_none_or(|due| now >= due || now + control_micros < due)
    }

    fn next_byte(&mut self) -> Option<u8> {
        let index = self.unread.next()?;
        self.bytes.get(index).copied()
    }

    fn answer(&mut self, sensed: SensorReadings) -> std::io::Result<()> {
        let mut frame = Vec::new();
        self.producer.answer(sensed, &mut |bytes| frame.extend_from_slice(bytes));
        self.stream.write_all(&frame)
    }
}
