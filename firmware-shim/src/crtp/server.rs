//! The vehicle's end of the protocol: packets in, packets and orders out. No socket and no clock.

use super::bridge::Bridge;
use super::commander::Commander;
use super::logging::Logging;
use super::maneuver::Maneuver;
use super::packet::{DATA_LIMIT, Packet, Port};
use super::parameter::Parameters;
use super::set_point::{OldCommander, SetPointError, Wish};
use super::supervisor::{Event, Supervisor};
use super::variable::Truth;
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
pub struct Server {
    parameters: Parameters,
    logging: Logging,
    commander: Commander,
    supervisor: Supervisor,
    last_words: Option<(&'static str, f64)>,
}

impl Server {
    /// Obeys a packet, and answers it at once.
    pub fn receive(&mut self, packet: &Packet, bridge: &mut Bridge) {
        let reply = match packet.port {
            Port::Link => {
                self.greet(packet, bridge);
                platform::answer_link(packet)
            }
            Port::Platform => self.receive_platform(packet, bridge),
            Port::Memory => platform::answer_memory(packet),
            Port::Parameter => self.receive_parameter(packet, bridge),
            Port::Log => self.logging.receive(packet, bridge.millis()),
            Port::Commander | Port::GenericCommander => {
                self.follow(packet, bridge);
                None
            }
            Port::HighLevelCommander => Some(self.receive_maneuver(packet, bridge)),
            Port::Supervisor => self.receive_supervisor(packet, bridge),
            Port::Localization => {
                self.receive_localization(packet, bridge);
                None
            }
            Port::Console => None,
        };
        if let Some(reply) = reply {
            (bridge.send)(&reply);
        }
    }

    /// Flies on for one control period, and sends the log blocks that are due.
    pub fn tick(&mut self, bridge: &mut Bridge) {
        if self.supervisor.is_starved(bridge) && !self.supervisor.is_locked() {
            self.stop_for_good(bridge);
        }
        self.commander.steer(bridge);
        let truth = Truth {
            state: bridge.state,
            goal: bridge.goal.position(),
            supervision: self.supervisor.info(self.commander.high_level(bridge.mode), bridge),
        };
        self.logging.send_due(&truth, bridge.millis(), bridge.send);
    }

    /// Forgets the client: its log blocks, not its parameters, and not what flies.
    pub fn part(&mut self) {
        self.logging.reset();
    }

    /// Words for whoever shakes hands.
    fn greet(&mut self, packet: &Packet, bridge: &mut Bridge) {
        if platform::is_handshake(packet) {
            self.last_words = None;
            self.say(platform::FIRMWARE, bridge);
            self.say("simulated: yaw is counted, not flown; up to 1 m/s", bridge);
        }
    }

    /// Sends text to the client's console, in as many packets as it takes.
    fn say(&mut self, words: &'static str, bridge: &mut Bridge) {
        if self.last_words.is_some_and(|(last, secs)| last == words && bridge.secs - secs < WORDS_SECS) {
            return;
        }
        self.last_words = Some((words, bridge.secs));
        for piece in words.as_bytes().chunks(DATA_LIMIT) {
            (bridge.send)(&Packet::new(Port::Console, 0).with(piece));
        }
        (bridge.send)(&Packet::new(Port::Console, 0).with(b"\n"));
    }

    fn receive_platform(&mut self, packet: &Packet, bridge: &mut Bridge) -> Option<Packet> {
        if packet.channel != PLATFORM_ORDER_CHANNEL {
            return platform::answer_version(packet);
        }
        let mut fields = packet.fields();
        let command = fields.byte()?;
        match command {
            1 => {
                let (event, answer) = self.supervisor.arm(fields.byte().unwrap_or_default(), bridge);
                self.react(event, bridge);
                Some(packet.reply().with(&[command]).with(&answer))
            }
            2 => Some(packet.reply().with(&[command, 1, 1])),
            _ => Some(packet.clone()),
        }
    }

    fn receive_parameter(&mut self, packet: &Packet, bridge: &mut Bridge) -> Option<Packet> {
        let reply = self.parameters.receive(packet);
        if self.parameters.stop() && !self.supervisor.is_locked() {
            self.stop_for_good(bridge);
        }
        reply
    }

    fn receive_supervisor(&mut self, packet: &Packet, bridge: &mut Bridge) -> Option<Packet> {
        let info = self.supervisor.info(self.commander.high_level(bridge.mode), bridge);
        let (event, reply) = self.supervisor.receive(packet, info, bridge);
        self.react(event, bridge);
        reply
    }

    /// Positions from outside are not needed: the true one is known.
    fn receive_localization(&mut self, packet: &Packet, bridge: &mut Bridge) {
        match (packet.channel, packet.fields().byte()) {
            (LOCALIZATION_ORDER_CHANNEL, Some(3)) => self.stop_for_good(bridge),
            (LOCALIZATION_ORDER_CHANNEL, Some(4)) => self.supervisor.feed_watchdog(bridge),
            _ => {}
        }
    }

    fn react(&mut self, event: Event, bridge: &mut Bridge) {
        match event {
            Event::Answered => {}
            Event::EmergencyStop => self.stop_for_good(bridge),
            Event::Refused(refusal) => self.say(refusal.text(), bridge),
        }
    }

    fn stop_for_good(&mut self, bridge: &mut Bridge) {
        self.supervisor.stop(bridge);
        self.say("emergency stop: locked until the simulator starts anew", bridge);
    }

    fn follow(&mut self, packet: &Packet, bridge: &mut Bridge) {
        if self.supervisor.is_locked() {
            return;
        }
        let old_commander =
            if self.parameters.sets_positions() { OldCommander::Position } else { OldCommander::Attitude };
        match Wish::of(packet, old_commander) {
            Ok(Wish::Release) => self.commander.release(),
            Ok(Wish::Follow(set_point)) => {
                if let Err(refusal) = self.commander.follow(set_point, bridge) {
                    self.say(refusal.text(), bridge);
                }
            }
            Err(error) => self.say(error.text(), bridge),
        }
    }

    /// As from the firmware, the answer is the beginning of the packet, and a status.
    fn receive_maneuver(&mut self, packet: &Packet, bridge: &mut Bridge) -> Packet {
        let outcome = self.begin(packet, bridge);
        let mut head = [0; 3];
        head.iter_mut().zip(packet.data()).for_each(|(byte, sent)| *byte = *sent);
        packet.reply().with(&head).with(&[outcome.err().unwrap_or(status::OK)])
    }

    fn begin(&mut self, packet: &Packet, bridge: &mut Bridge) -> Result<(), u8> {
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
        let outcome = self.commander.begin(maneuver, &self.parameters, bridge);
        outcome.map_err(|(status, refusal)| {
            self.say(refusal.map_or(maneuver_text(status), Refusal::text), bridge);
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

impl SetPointError {
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
