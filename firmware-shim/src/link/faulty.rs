//! A bad radio: a link that loses, duplicates, reorders, delays and corrupts what passes through another one.

use std::collections::VecDeque;
use std::str::FromStr;

use kestrel_core::philox::philox;

use super::{DATAGRAM_LIMIT, EndpointId, Link, LinkError, Listeners, Received};

/// Datagrams on their way in one direction; one more is lost. At most [`DATAGRAM_LIMIT`] bytes each, 2 MiB together.
const UNDERWAY: usize = 1024;

/// Longest delay \[s\]: with longer ones a vehicle's telemetry would not fit underway.
const DELAY_LIMIT_SECS: f64 = 5.0;

/// A datagram that nothing overtakes is held back no longer than this \[s\].
const HELD_LIMIT_SECS: f64 = 0.1;

/// What becomes of the datagrams of one direction. Probabilities are of 0 to 1 and independent of each other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// Probability that it never arrives.
    pub loss: f64,
    /// Probability that it arrives twice.
    pub duplicate: f64,
    /// Probability that it is held back until another one has overtaken it; only one at a time is.
    pub reorder: f64,
    /// How late everything arrives \[s\].
    pub delay_secs: f64,
    /// Probability that one of its bits is flipped.
    pub corrupt: f64,
}

/// The faults of both directions.
///
/// Written `loss=0.1,duplicate=0.05,reorder=0.2,delay=0.03,corrupt=0.01,seed=1`, each as often as one likes; with `received.`
/// or `sent.` before the name it goes for one direction, as the vehicle sees it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FaultPlan {
    /// From peers to the vehicle.
    pub received: Faults,
    /// From the vehicle to its peers, which share each frame's fate.
    pub sent: Faults,
    /// The same seed and the same datagrams at the same times have the same faults.
    pub seed: u64,
}

/// What is no [`FaultPlan`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FaultPlanError {
    /// Not of the form NAME=VALUE, or a name that means nothing.
    #[error(
        "expected loss=, duplicate=, reorder=, delay=, corrupt=, any of them behind \"received.\" or \"sent.\", or seed=, found \"{0}\""
    )]
    Name(String),
    /// A number that means nothing.
    #[error("expected {expected}, found \"{found}\"")]
    Value {
        /// What the name takes.
        expected: &'static str,
        /// The whole part.
        found: String,
    },
}

impl FromStr for FaultPlan {
    type Err = FaultPlanError;

    fn from_str(text: &str) -> Result<Self, FaultPlanError> {
        let mut plan = Self::default();
        for part in text.split(',') {
            plan.set(part.trim())?;
        }
        Ok(plan)
    }
}

impl FaultPlan {
    /// Takes in one NAME=VALUE.
    fn set(&mut self, part: &str) -> Result<(), FaultPlanError> {
        let unknown = || FaultPlanError::Name(part.to_owned());
        let (name, value) = part.split_once('=').ok_or_else(unknown)?;
        if name == "seed" {
            let wrong =
                |_| FaultPlanError::Value { expected: "a whole number of 0 or more", found: part.to_owned() };
            self.seed = value.parse().map_err(wrong)?;
            return Ok(());
        }
        let (directions, fault) = if let Some(fault) = name.strip_prefix("received.") {
            (vec![&mut self.received], fault)
        } else if let Some(fault) = name.strip_prefix("sent.") {
            (vec![&mut self.sent], fault)
        } else {
            (vec![&mut self.received, &mut self.sent], name)
        };
        for faults in directions {
            let number = faults.named(fault).ok_or_else(unknown)?;
            *number = if fault == "delay" {
                within(part, value, DELAY_LIMIT_SECS, "a delay of 0 to 5 s")?
            } else {
                within(part, value, 1.0, "a probability of 0 to 1")?
            };
        }
        Ok(())
    }
}

impl Faults {
    fn named(&mut self, name: &str) -> Option<&mut f64> {
        match name {
            "loss" => Some(&mut self.loss),
            "duplicate" => Some(&mut self.duplicate),
            "reorder" => Some(&mut self.reorder),
            "delay" => Some(&mut self.delay_secs),
            "corrupt" => Some(&mut self.corrupt),
            _ => None,
        }
    }
}

fn within(part: &str, value: &str, limit: f64, expected: &'static str) -> Result<f64, FaultPlanError> {
    match value.parse() {
        Ok(number) if (0.0..=limit).contains(&number) => Ok(number),
        Ok(_) | Err(_) => Err(FaultPlanError::Value { expected, found: part.to_owned() }),
    }
}

/// Another link behind the faults of a [`FaultPlan`], in the time that [`Link::advance`] is given: simulated in a flight.
pub struct FaultyLink {
    link: Box<dyn Link>,
    received: Lane,
    sent: Lane,
    now_secs: f64,
}

impl FaultyLink {
    /// What passes through `link` from now on meets the faults of `plan`.
    pub fn new(link: Box<dyn Link>, plan: &FaultPlan) -> Self {
        Self {
            link,
            received: Lane::new(plan.received, plan.seed),
            // Another stream: its seed differs in every bit.
            sent: Lane::new(plan.sent, !plan.seed),
            now_secs: 0.0,
        }
    }

    fn send_due(&mut self) {
        while let Some(packet) = self.sent.take(self.now_secs) {
            self.link.send_to(packet.endpoint, &packet.bytes);
        }
    }
}

impl Link for FaultyLink {
    fn advance(&mut self, now_secs: f64) -> Result<(), LinkError> {
        self.now_secs = now_secs;
        self.link.advance(now_secs)?;
        let mut buffer = [0; DATAGRAM_LIMIT];
        for _ in 0..UNDERWAY {
            let Some(Received { datagram, endpoint }) = self.link.receive(&mut buffer)? else { break };
            self.received.put(datagram, endpoint, now_secs);
        }
        self.send_due();
        Ok(())
    }

    fn receive<'b>(&mut self, buffer: &'b mut [u8; DATAGRAM_LIMIT]) -> Result<Option<Received<'b>>, LinkError> {
        let Some(packet) = self.received.take(self.now_secs) else { return Ok(None) };
        let len = packet.bytes.len().min(DATAGRAM_LIMIT);
        buffer[..len].copy_from_slice(&packet.bytes[..len]);
        Ok(Some(Received { datagram: &buffer[..len], endpoint: packet.endpoint }))
    }

    fn learn(&mut self, endpoint: EndpointId) {
        self.link.learn(endpoint);
    }

    fn listeners(&self) -> Listeners {
        self.link.listeners()
    }

    fn send_to(&mut self, endpoint: EndpointId, frame: &[u8]) {
        self.sent.put(frame, endpoint, self.now_secs);
        self.send_due();
    }

    fn flush(&mut self) {
        self.link.flush();
    }
}

/// A datagram on its way.
#[derive(Clone, Debug, PartialEq)]
struct Packet {
    bytes: Vec<u8>,
    endpoint: EndpointId,
    due_secs: f64,
}

/// One direction: first in, first out, but for the one that is held back.
#[derive(Debug)]
struct Lane {
    faults: Faults,
    random: Random,
    underway: VecDeque<Packet>,
    held: Option<Packet>,
}

impl Lane {
    fn new(faults: Faults, seed: u64) -> Self {
        Self { faults, random: Random { seed, count: 0 }, underway: VecDeque::new(), held: None }
    }

    fn put(&mut self, datagram: &[u8], endpoint: EndpointId, now_secs: f64) {
        // Every draw is made for every datagram, so that one fault's probability changes no other fault.
        let [lost, doubled, late, corrupt] =
            [self.faults.loss, self.faults.duplicate, self.faults.reorder, self.faults.corrupt]
                .map(|probability| self.random.happens(probability));
        let position = self.random.next();
        if lost {
            return;
        }
        let mut packet =
            Packet { bytes: datagram.to_vec(), endpoint, due_secs: now_secs + self.faults.delay_secs };
        if corrupt {
            flip(&mut packet.bytes, position);
        }
        if doubled {
            self.push(packet.clone());
        }
        self.release(now_secs);
        if late && self.held.is_none() {
            self.held = Some(packet);
        } else {
            self.push(packet);
            let overtaken = self.held.take();
            self.push_if_any(overtaken);
        }
    }

    fn push(&mut self, packet: Packet) {
        if self.underway.len() < UNDERWAY {
            self.underway.push_back(packet);
        }
    }

    fn push_if_any(&mut self, packet: Option<Packet>) {
        if let Some(packet) = packet {
            self.push(packet);
        }
    }

    /// Lets go what has been held back for long enough.
    fn release(&mut self, now_secs: f64) {
        let deadline_secs = now_secs + self.faults.delay_secs - HELD_LIMIT_SECS;
        let overdue = self.held.take_if(|held| held.due_secs < deadline_secs);
        self.push_if_any(overdue);
    }

    /// The next datagram that is due.
    fn take(&mut self, now_secs: f64) -> Option<Packet> {
        self.release(now_secs);
        let due = self.underway.front().is_some_and(|packet| packet.due_secs <= now_secs);
        if due { self.underway.pop_front() } else { None }
    }
}

/// Flips one bit, if there is any.
fn flip(bytes: &mut [u8], position: u64) {
    let Some(bits) = (8 * bytes.len() as u64).checked_sub(1) else { return };
    let bit = position % (bits + 1);
    bytes[(bit / 8) as usize] ^= 1 << (bit % 8);
}

/// The random numbers of a seed, in order.
#[derive(Clone, Debug)]
struct Random {
    seed: u64,
    count: u64,
}

impl Random {
    fn next(&mut self) -> u64 {
        let [count, key] = [self.count, self.seed].map(|number| [number as u32, (number >> 32) as u32]);
        self.count += 1;
        let [low, high, ..] = philox([count[0], count[1], 0, 0], key);
        u64::from(low) | u64::from(high) << 32
    }

    fn happens(&mut self, probability: f64) -> bool {
        // 53 bits: of 0 to below 1, exactly.
        ((self.next() >> 11) as f64) < probability * (1_u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests;
