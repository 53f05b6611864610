//! The vehicle's end of the protocol: packets in, packets and orders out. No socket and no clock.

use super::access::VehicleAccess;
use super::commander::Commander;
use super::logging::Logging;
use super::maneuver::Maneuver;
use super::packet::{DATA_LIMIT, Packet, Port};
use super::parameter::CrtpParameters;
use super::set_point::{CommanderPacket, CrtpSetPointError, OldCommander};
use super::supervisor::{Supervisor, SupervisorEvent};
use super::variable::LogSource;
use super::{platform, status};
use crate::autopilot::Refusal;

/// The same words are not said again within this time \[s\]: set-points come in streams.
const WORDS_SECS: f64 = 1.0;

/// Channel of the platform on which old clients arm.
const PLATFORM_ORDER_CHANNEL: u8 = 0;

/// Channel of the localization port on which old clients stop the motors.
const LOCALIZATION_ORDER_CHANNEL: u8 = 1;

/// Serves one client at a time.
#[derive(Clone, Debug, Default)]
pub struct CrtpServer {
    parameters: CrtpParameters,
    logging: Logging,
    commander: Commander,
    supervisor: Supervisor,
    last_words: Option<(&'static str, f64)>,
}

impl CrtpServer {
    /// Obeys a packet, and answers it at once.
    pub fn receive(&mut self, packet: &Packet, access: &mut VehicleAccess) {
        let reply = match packet.port {
            Port::Link => {
                self.greet(packet, access);
                platform::answer_link(packet)
            }
            Port::Platform => self.receive_platform(packet, access),
            Port::Memory => platform::answer_memory(packet),
            Port::Parameter => self.receive_parameter(packet, access),
            Port::Log => self.logging.receive(packet, access.millis()),
            Port::Commander | Port::GenericCommander => {
                self.follow(packet, access);
                None
            }
            Port::HighLevelCommander => Some(self.receive_maneuver(packet, access)),
            Port::Supervisor => self.receive_supervisor(packet, access),
            Port::Localization => {
                self.receive_localization(packet, access);
                None
            }
            Port::Console => None,
        };
        if let Some(reply) = reply {
            (access.send)(&reply);
        }
    }

    /// Flies on for one control period, and sends the log blocks that are due.
    pub fn tick(&mut self, access: &mut VehicleAccess) {
        if self.supervisor.is_starved(access) && !self.supervisor.is_locked() {
            self.stop_for_good(access);
        }
        self.commander.steer(access);
        let source = LogSource {
            state: access.state,
            goal: access.goal.position(),
            supervision: self.supervisor.info(self.commander.high_level(access.mode), access),
            ranges: access.ranges,
        };
        self.logging.send_due(&source, access.millis(), access.send);
    }

    /// Forgets the client: its log blocks, not its parameters, and not what flies.
    pub fn part(&mut self) {
        self.logging.reset();
    }

    /// The text that a client gets after its handshake.
    fn greet(&mut self, packet: &Packet, access: &mut VehicleAccess) {
        if platform::is_handshake(packet) {
            self.last_words = None;
            self.send_text(platform::FIRMWARE, access);
            self.send_text("simulated: yaw is counted, not flown; up to 1 m/s", access);
        }
    }

    /// Sends text to the client's console, in as many packets as it takes.
    fn send_text(&mut self, words: &'static str, access: &mut VehicleAccess) {
        if self.last_words.is_some_and(|(last, secs)| last == words && access.secs - secs < WORDS_SECS) {
            return;
        }
        self.last_words = Some((words, access.secs));
        for piece in words.as_bytes().chunks(DATA_LIMIT) {
            (access.send)(&Packet::new(Port::Console, 0).with(piece));
        }
        (access.send)(&Packet::new(Port::Console, 0).with(b"\n"));
    }

    fn receive_platform(&mut self, packet: &Packet, access: &mut VehicleAccess) -> Option<Packet> {
        if packet.channel != PLATFORM_ORDER_CHANNEL {
            return platform::answer_version(packet);
        }
        let mut fields = packet.fields();
        let command = fields.byte()?;
        match command {
            1 => {
                let (event, answer) = self.supervisor.arm(fields.byte().unwrap_or_default(), access);
                self.react(event, access);
                Some(packet.reply().with(&[command]).with(&answer))
            }
            2 => Some(packet.reply().with(&[command, 1, 1])),
            _ => Some(packet.clone()),
        }
    }

    fn receive_parameter(&mut self, packet: &Packet, access: &mut VehicleAccess) -> Option<Packet> {
        let reply = self.parameters.receive(packet);
        if self.parameters.stop() && !self.supervisor.is_locked() {
            self.stop_for_good(access);
        }
        reply
    }

    fn receive_supervisor(&mut self, packet: &Packet, access: &mut VehicleAccess) -> Option<Packet> {
        let info = self.supervisor.info(self.commander.high_level(access.mode), access);
        let (event, reply) = self.supervisor.receive(packet, info, access);
        self.react(event, access);
        reply
    }

    /// Positions from outside are not needed: the true one is known.
    fn receive_localization(&mut self, packet: &Packet, access: &mut VehicleAccess) {
        match (packet.channel, packet.fields().byte()) {
            (LOCALIZATION_ORDER_CHANNEL, Some(3)) => self.stop_for_good(access),
            (LOCALIZATION_ORDER_CHANNEL, Some(4)) => self.supervisor.feed_watchdog(access),
            _ => {}
        }
    }

    fn react(&mut self, event: SupervisorEvent, access: &mut VehicleAccess) {
        match event {
            SupervisorEvent::Answered => {}
            SupervisorEvent::EmergencyStop => self.stop_for_good(access),
            SupervisorEvent::Refused(refusal) => self.send_text(refusal.text(), access),
        }
    }

    fn stop_for_good(&mut self, access: &mut VehicleAccess) {
        self.supervisor.stop(access);
        self.send_text("emergency stop: locked until the simulator starts anew", access);
    }

    fn follow(&mut self, packet: &Packet, access: &mut VehicleAccess) {
        if self.supervisor.is_locked() {
            return;
        }
        let old_commander =
            if self.parameters.sets_positions() { OldCommander::Position } else { OldCommander::Attitude };
        match CommanderPacket::of(packet, old_commander) {
            Ok(CommanderPacket::Release) => self.commander.release(),
            Ok(CommanderPacket::Follow(set_point)) => {
                if let Err(refusal) = self.commander.follow(set_point, access) {
                    self.send_text(refusal.text(), access);
                }
            }
            Err(error) => self.send_text(error.text(), access),
        }
    }

    /// As from the firmware, the answer is the beginning of the packet, and a status.
    fn receive_maneuver(&mut self, packet: &Packet, access: &mut VehicleAccess) -> Packet {
        let outcome = self.begin(packet, access);
        let mut head = [0; 3];
        head.iter_mut().zip(packet.data()).for_each(|(byte, sent)| *byte = *sent);
        packet.reply().with(&head).with(&[outcome.err().unwrap_or(status::OK)])
    }

    fn begin(&mut self, packet: &Packet, access: &mut VehicleAccess) -> Result<(), u8> {
        let (groups, maneuver) = Maneuver::of(packet)?;
        if let Maneuver::JoinGroups(groups) = maneuver {
            self.parameters.join_groups(groups);
            return Ok(());
        }
        if groups != 0 && groups & self.parameters.groups() == 0 {
            return Ok(());
        }
        if self.supervisor.is_locked() {
            return Err(status::BUSY);
        }
        let outcome = self.commander.begin(maneuver, &self.parameters, access);
        outcome.map_err(|(status, refusal)| {
            self.send_text(refusal.map_or(maneuver_text(status), Refusal::text), access);
            status
        })
    }
}

/// Words for a status that is not the autopilot's.
fn maneuver_text(status: u8) -> &'static str {
    match status {
        status::BUSY => "maneuver refused: set-points are streaming",
        status::NOT_PERMITTED => "maneuver refused: already flying, or not yet",
        _ => "maneuver refused: out of range",
    }
}

impl CrtpSetPointError {
    const fn text(self) -> &'static str {
        match self {
            Self::Malformed => "set-point refused: unknown kind, too short or not finite",
            Self::Outside => "set-point refused: under the floor or over 1 km",
            Self::Attitude => "set-point refused: a policy chooses its attitude itself",
        }
    }
}

#[cfg(test)]
mod tests;
