//! Arming, the emergency stop, and the bits that say whether the vehicle can fly.

use super::access::VehicleAccess;
use super::commander::HighLevel;
use super::packet::Packet;
use super::variable::supervision::{CAN_FLY, FLYING, TUMBLED};
use crate::autopilot::{Command, Refusal};

/// Channel of questions, and that of orders.
const QUESTION_CHANNEL: u8 = 0;
const ORDER_CHANNEL: u8 = 1;

/// Bit of a command byte that marks the answer.
const ANSWER: u8 = 0x80;

/// The question for all bits at once; the eleven before it ask for one bit each, the lowest first.
const ALL_BITS: u8 = 12;

/// A client that once set the watchdog must set it again within this time \[s\]
/// (`DEFAULT_EMERGENCY_STOP_WATCHDOG_TIMEOUT`).
const WATCHDOG_SECS: f64 = 1.0;

/// Beyond 60° of tilt a drone counts as tumbled (`SUPERVISOR_TUMBLE_CHECK_ACCEPTED_TILT_ACCZ`).
const TUMBLED_COSINE: f32 = 0.5;

/// More bits of `supervisor.info`.
const CAN_BE_ARMED: u16 = 1;
const ARMED: u16 = 1 << 1;
const ARMS_ITSELF: u16 = 1 << 2;
const LOCKED: u16 = 1 << 6;
const HIGH_LEVEL_FLIES: u16 = 1 << 8;
const HIGH_LEVEL_FINISHED: u16 = 1 << 9;
const HIGH_LEVEL_DISABLED: u16 = 1 << 10;

/// Whether the vehicle may ever fly again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lock {
    Open,
    /// After an emergency stop, until the program ends: as a Crazyflie until it is switched off.
    Closed,
}

/// What a client wants of the supervisor, and what there is to answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SupervisorEvent {
    /// Nothing but the answer, if there is one.
    Answered,
    /// Motors must stop, and flying ends for good.
    EmergencyStop,
    /// It was not armed or disarmed, for this reason.
    Refused(Refusal),
}

/// Decides whether to fly.
#[derive(Clone, Debug)]
pub struct Supervisor {
    lock: Lock,
    watchdog_secs: Option<f64>,
}

impl Default for Supervisor {
    fn default() -> Self {
        Self { lock: Lock::Open, watchdog_secs: None }
    }
}

impl Supervisor {
    /// Whether an emergency stop has ended all flying.
    pub fn is_locked(&self) -> bool {
        self.lock == Lock::Closed
    }

    /// Stops the motors, and ends all flying.
    pub fn stop(&mut self, access: &mut VehicleAccess) {
        self.lock = Lock::Closed;
        access.stop_in_emergency();
    }

    /// From now on the client must come again and again, or the motors stop.
    pub fn feed_watchdog(&mut self, access: &VehicleAccess) {
        self.watchdog_secs = Some(access.secs);
    }

    /// Whether a watchdog was set and has not been set again in time.
    pub fn is_starved(&self, access: &VehicleAccess) -> bool {
        self.watchdog_secs.is_some_and(|secs| access.secs - secs >= WATCHDOG_SECS)
    }

    /// The bits of `supervisor.info`.
    pub fn info(&self, high_level: HighLevel, access: &VehicleAccess) -> u16 {
        let mode = access.mode;
        let tumbled = access.state.world_from_body.up_cosine() < TUMBLED_COSINE;
        let ready = self.lock == Lock::Open && !tumbled;
        let conditions = [
            (CAN_BE_ARMED, ready && !mode.armed()),
            (ARMED, mode.armed()),
            (ARMS_ITSELF, true),
            (CAN_FLY, ready),
            (FLYING, mode.flies()),
            (TUMBLED, tumbled),
            (LOCKED, self.lock == Lock::Closed),
            (HIGH_LEVEL_FLIES, matches!(high_level, HighLevel::Flying | HighLevel::Finished)),
            (HIGH_LEVEL_FINISHED, high_level != HighLevel::Flying),
            (HIGH_LEVEL_DISABLED, high_level == HighLevel::Disabled),
        ];
        conditions.iter().filter(|(_, holds)| *holds).fold(0, |bits, (bit, _)| bits | bit)
    }

    /// Obeys and answers a packet at the supervisor's port; `info` are the bits of [`Self::info`].
    pub fn receive(
        &mut self,
        packet: &Packet,
        info: u16,
        access: &mut VehicleAccess,
    ) -> (SupervisorEvent, Option<Packet>) {
        let mut fields = packet.fields();
        let Some(command) = fields.byte() else { return (SupervisorEvent::Answered, None) };
        let reply = packet.reply().with(&[command | ANSWER]);
        match (packet.channel, command) {
            (QUESTION_CHANNEL, 1..ALL_BITS) => {
                (SupervisorEvent::Answered, Some(reply.with(&[(info >> (command - 1)) as u8 & 1])))
            }
            (QUESTION_CHANNEL, ALL_BITS) => (SupervisorEvent::Answered, Some(reply.with(&info.to_le_bytes()))),
            (ORDER_CHANNEL, 1) => {
                let (event, answer) = self.arm(fields.byte().unwrap_or_default(), access);
                (event, Some(reply.with(&answer)))
            }
            // There are no crashes to recover from.
            (ORDER_CHANNEL, 2) => (SupervisorEvent::Answered, Some(reply.with(&[1, 1]))),
            (ORDER_CHANNEL, 3) => (SupervisorEvent::EmergencyStop, None),
            (ORDER_CHANNEL, 4) => {
                self.feed_watchdog(access);
                (SupervisorEvent::Answered, None)
            }
            _ => (SupervisorEvent::Answered, None),
        }
    }

    /// Arms, or disarms for a `commander_packet` of zero. Whether it did, and whether the vehicle is armed now, as bytes.
    pub fn arm(&self, commander_packet: u8, access: &mut VehicleAccess) -> (SupervisorEvent, [u8; 2]) {
        let command = if commander_packet == 0 { Command::Disarm } else { Command::Arm };
        if command == Command::Arm && self.is_locked() {
            return (SupervisorEvent::Answered, [0, 0]);
        }
        match access.order(command) {
            Ok(()) => (SupervisorEvent::Answered, [1, access.mode.armed().into()]),
            Err(refusal) => (SupervisorEvent::Refused(refusal), [0, access.mode.armed().into()]),
        }
    }
}
