//! Commands that are sent again because their acknowledgement was lost.

use mavlink::dialects::common::MavResult;

use crate::message::received::{CommandRequest, Place};

/// Senders whose last command is remembered.
const SENDERS: usize = 4;

/// A repetition within this time of its original is not executed again \[s\]: clients give up after 2 s to 5 s.
const REPETITION_SECS: f64 = 10.0;

/// A link that duplicates a frame does it within this time \[s\]; later the same number is that of another frame.
const DUPLICATE_SECS: f64 = 1.0;

/// Who sent a frame, and which of its frames it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sender {
    /// System and component.
    pub(super) address: [u8; 2],
    /// Number of the frame, modulo 256.
    pub(super) sequence: u8,
}

/// The last command of each sender, and what became of it.
#[derive(Debug, Default)]
pub(super) struct Repetitions {
    executed: heapless::Deque<Executed, SENDERS>,
}

#[derive(Debug)]
struct Executed {
    sender: Sender,
    command: CommandRequest,
    result: MavResult,
    secs: f64,
}

impl Repetitions {
    /// The result of the sender's last command if this is a repetition of it.
    pub(super) fn result(&self, command: &CommandRequest, sender: Sender, now_secs: f64) -> Option<MavResult> {
        let last = self.executed.iter().find(|last| last.sender.address == sender.address)?;
        let age_secs = now_secs - last.secs;
        let again = command.confirmation > last.command.confirmation && age_secs <= REPETITION_SECS;
        let duplicate = sender.sequence == last.sender.sequence && age_secs <= DUPLICATE_SECS;
        ((again || duplicate) && bits(command) == bits(&last.command)).then_some(last.result)
    }

    /// Remembers what became of a command.
    pub(super) fn remember(&mut self, command: &CommandRequest, sender: Sender, result: MavResult, secs: f64) {
        self.executed.retain(|last| last.sender.address != sender.address);
        if self.executed.is_full() {
            self.executed.pop_front();
        }
        // There is room: the oldest has just left.
        let _ = self.executed.push_back(Executed { sender, command: *command, result, secs });
    }
}

/// All that makes a command what it is; NaN is equal to itself there.
fn bits(command: &CommandRequest) -> (u16, [u32; 4], [u32; 3]) {
    let place = match command.place {
        Place::Floats(floats) => floats.map(f32::to_bits),
        Place::Integers { integers: [x, y], height, .. } => [x as u32, y as u32, height.to_bits()],
    };
    (command.command, command.parameters.map(f32::to_bits), place)
}
