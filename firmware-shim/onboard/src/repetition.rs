//! Commands that are sent again because their acknowledgement was lost.

use crate::acknowledgement::CommandResult;
use crate::autopilot::Mode;
use crate::flight_mode::FlightMode;
use crate::frame::Frame;
use crate::request::{CommandLocation, CommandRequest};

/// Commands that are remembered: a few of each of a few senders, who do not wait for one acknowledgement before the next
/// command.
const COMMANDS: usize = 16;

/// A repetition within this time of its original is not executed again \[s\]: clients give up after 2 s to 5 s.
const REPETITION_SECS: f64 = 10.0;

/// A link that duplicates a frame does it within this time \[s\]; later the same number is that of another frame.
const DUPLICATE_SECS: f64 = 1.0;

/// MAVSDK sends a command four times within this time \[s\] and does not say which is a repetition.
const UNMARKED_SECS: f64 = 2.0;

/// `MAV_CMD_NAV_TAKEOFF` and `MAV_CMD_DO_SET_MODE`.
const TAKE_OFF: u16 = 22;
const SET_MODE: u16 = 176;

/// Who sent a frame, and which of its frames it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// System and component.
    pub address: [u8; 2],
    /// Number of the frame, modulo 256.
    pub sequence: u8,
}

/// The last command of each number and sender, and what became of it.
#[derive(Debug, Default)]
pub struct Repetitions {
    executed: [Option<Executed>; COMMANDS],
}

#[derive(Debug)]
struct Executed {
    sender: Sender,
    command: CommandRequest,
    result: CommandResult,
    secs: f64,
}

impl Sender {
    /// Of a frame.
    pub const fn of(frame: &Frame) -> Self {
        Self { address: [frame.system, frame.component], sequence: frame.sequence }
    }
}

impl Repetitions {
    /// The result of the sender's last command if this is a repetition of it, to a vehicle in a mode.
    pub fn result(
        &self,
        command: &CommandRequest,
        sender: Sender,
        mode: Mode,
        now_secs: f64,
    ) -> Option<CommandResult> {
        let last = self.last(command, sender)?;
        let age_secs = now_secs - last.secs;
        let again = command.confirmation > last.command.confirmation && age_secs <= REPETITION_SECS;
        let duplicate = sender.sequence == last.sender.sequence && age_secs <= DUPLICATE_SECS;
        let begun = last.has_lifted_off() && mode.flies() && age_secs <= UNMARKED_SECS;
        (again || duplicate || begun).then_some(last.result)
    }

    /// Whether the sender seems to have missed an acknowledgement: it sends the same command in another frame.
    pub fn is_sent_again(&self, command: &CommandRequest, sender: Sender, now_secs: f64) -> bool {
        self.last(command, sender)
            .is_some_and(|last| sender.sequence != last.sender.sequence && now_secs - last.secs <= UNMARKED_SECS)
    }

    /// The sender's last command of this number, if it was the same in all else.
    fn last(&self, command: &CommandRequest, sender: Sender) -> Option<&Executed> {
        let last = self.executed.iter().flatten().find(|last| last.is_of(command, sender))?;
        (bits(command) == bits(&last.command)).then_some(last)
    }

    /// Remembers what became of a command, in the place of the sender's last one of its number or of the oldest.
    pub fn remember(&mut self, command: &CommandRequest, sender: Sender, result: CommandResult, secs: f64) {
        let age = |place: &Option<Executed>| match place {
            Some(last) if last.is_of(command, sender) => f64::INFINITY,
            Some(last) => secs - last.secs,
            None => f64::MAX,
        };
        if let Some(place) = self.executed.iter_mut().max_by(|a, b| age(a).total_cmp(&age(b))) {
            *place = Some(Executed { sender, command: *command, result, secs });
        }
    }
}

impl Executed {
    fn is_of(&self, command: &CommandRequest, sender: Sender) -> bool {
        self.sender.address == sender.address && self.command.command == command.command
    }

    /// Whether it was the one thing that works and would be refused if it were done again: everything else is either refused
    /// both times or does no harm.
    fn has_lifted_off(&self) -> bool {
        let [_, main, sub, _] = self.command.parameters;
        let takes_off = match self.command.command {
            TAKE_OFF => true,
            SET_MODE => FlightMode::of_numbers(main, sub) == Some(FlightMode::TakeOff),
            _ => false,
        };
        takes_off && self.result == CommandResult::Accepted
    }
}

/// All that makes a command what it is; NaN is equal to itself there.
fn bits(command: &CommandRequest) -> (u16, [u32; 4], [u32; 3]) {
    let place = match command.place {
        CommandLocation::Floats(floats) => floats.map(f32::to_bits),
        CommandLocation::Integers { integers: [x, y], height, .. } => [x as u32, y as u32, height.to_bits()],
    };
    (command.command, command.parameters.map(f32::to_bits), place)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SENDER: Sender = Sender { address: [255, 190], sequence: 7 };

    fn command(command: u16) -> CommandRequest {
        CommandRequest {
            command,
            confirmation: 0,
            parameters: [f32::NAN; 4],
            place: CommandLocation::Floats([0.0; 3]),
        }
    }

    /// The result for a sender who repeats a command that was executed at zero, to a vehicle on the ground.
    fn again(
        repetitions: &Repetitions,
        command: &CommandRequest,
        sequence: u8,
        secs: f64,
    ) -> Option<CommandResult> {
        repetitions.result(command, Sender { sequence, ..SENDER }, Mode::Armed, secs)
    }

    #[test]
    fn a_repetition_says_so_or_is_the_same_frame() {
        let mut repetitions = Repetitions::default();
        repetitions.remember(&command(400), SENDER, CommandResult::Denied, 0.0);
        let marked = CommandRequest { confirmation: 1, ..command(400) };
        let denied = Some(CommandResult::Denied);
        assert_eq!(again(&repetitions, &marked, 8, REPETITION_SECS), denied);
        assert_eq!(again(&repetitions, &marked, 8, REPETITION_SECS + 0.01), None);
        assert_eq!(again(&repetitions, &command(400), 7, DUPLICATE_SECS), denied);
        assert_eq!(again(&repetitions, &command(400), 7, DUPLICATE_SECS + 0.01), None);
        assert_eq!(again(&repetitions, &command(400), 8, 0.0), None);
        let other = CommandRequest { parameters: [0.0; 4], ..marked };
        assert_eq!(again(&repetitions, &other, 8, 1.0), None, "it asks for something else");
    }

    #[test]
    fn the_oldest_command_is_forgotten_first_and_a_number_has_one_place() {
        let mut repetitions = Repetitions::default();
        for (number, secs) in (0..COMMANDS as u16).zip(0_u8..) {
            repetitions.remember(&command(number), SENDER, CommandResult::Accepted, f64::from(secs) * 0.01);
        }
        repetitions.remember(&command(0), SENDER, CommandResult::Accepted, 0.5);
        repetitions.remember(&command(COMMANDS as u16), SENDER, CommandResult::Accepted, 0.6);
        let known = |number| again(&repetitions, &command(number), 7, 0.6).is_some();
        assert!(known(0) && !known(1) && known(2) && known(COMMANDS as u16));
    }
}
