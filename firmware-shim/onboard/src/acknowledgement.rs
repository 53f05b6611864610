//! What a peer is told about its command.

use crate::autopilot::Refusal;
use crate::frame::Payload;

/// `COMMAND_ACK`, and the seed of its checksum.
const COMMAND_ACK: (u32, u8) = (77, 143);

/// `MAV_RESULT`: what became of a command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommandResult {
    /// It is executed.
    Accepted = 0,
    /// Not now.
    TemporarilyRejected = 1,
    /// It can never work.
    Denied = 2,
    /// It is not known.
    Unsupported = 3,
    /// Something is broken.
    Failed = 4,
}

impl From<Refusal> for CommandResult {
    fn from(refusal: Refusal) -> Self {
        match refusal {
            Refusal::Altitude | Refusal::Speed | Refusal::Fence => Self::Denied,
            // That another one has the control is a failure, as the protocol has it.
            Refusal::SelfTest | Refusal::OtherOperator => Self::Failed,
            Refusal::StateUnknown
            | Refusal::NotLevel
            | Refusal::Moving
            | Refusal::NotArmed
            | Refusal::InFlight
            | Refusal::NotCruising
            | Refusal::NotFlying
            | Refusal::Battery
            | Refusal::NoSetPoints
            | Refusal::NotOffboard
            | Refusal::NoMission
            | Refusal::OnMission
            | Refusal::Failsafe
            | Refusal::Intervention
            | Refusal::NoSticks => Self::TemporarilyRejected,
        }
    }
}

/// What a command comes to, and why if it is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommandAnswer {
    /// What its sender is told.
    pub result: CommandResult,
    /// Why it is refused, in at most the 50 bytes of a `STATUSTEXT`.
    pub text: Option<&'static str>,
}

impl CommandAnswer {
    /// It is executed.
    pub const ACCEPTED: Self = Self::silent(CommandResult::Accepted);

    /// A result without a text.
    pub const fn silent(result: CommandResult) -> Self {
        Self { result, text: None }
    }

    /// It can never work, for this reason.
    pub const fn denied(text: &'static str) -> Self {
        Self { result: CommandResult::Denied, text: Some(text) }
    }
}

impl From<Result<(), Refusal>> for CommandAnswer {
    fn from(outcome: Result<(), Refusal>) -> Self {
        let refused = |refusal: Refusal| Self { result: refusal.into(), text: Some(refusal.text()) };
        outcome.map_or_else(refused, |()| Self::ACCEPTED)
    }
}

/// `COMMAND_ACK` to a system and component, for any command number, whether the dialect knows it or not.
pub fn command_ack(command: u16, result: CommandResult, [system, component]: [u8; 2]) -> Payload {
    let (message_id, seed) = COMMAND_ACK;
    let [low, high] = command.to_le_bytes();
    // The four bytes of the second result and the progress before them are not used.
    Payload::new(message_id, seed, &[low, high, result as u8, 0, 0, 0, 0, 0, system, component])
}

#[cfg(test)]
mod tests {
    use mavlink::dialects::common::{COMMAND_ACK_DATA, MavCmd, MavResult};
    use mavlink::{MavlinkVersion, MessageData};

    use super::*;
    use crate::frame::{Encoder, Frames};

    #[test]
    fn every_result_is_read_by_the_mavlink_crate() {
        let results = [
            (CommandResult::Accepted, MavResult::MAV_RESULT_ACCEPTED),
            (CommandResult::TemporarilyRejected, MavResult::MAV_RESULT_TEMPORARILY_REJECTED),
            (CommandResult::Denied, MavResult::MAV_RESULT_DENIED),
            (CommandResult::Unsupported, MavResult::MAV_RESULT_UNSUPPORTED),
            (CommandResult::Failed, MavResult::MAV_RESULT_FAILED),
        ];
        for (ours, result) in results {
            let bytes = Encoder::new(1, 1).encode(&command_ack(400, ours, [255, 190]));
            let frame = Frames::new(&bytes).next().unwrap().unwrap();
            let found = COMMAND_ACK_DATA::deser(MavlinkVersion::V2, frame.payload).unwrap();
            assert_eq!(found, COMMAND_ACK_DATA { command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, result });
            assert_eq!(frame.payload.get(8..), Some(&[255, 190][..]), "extensions, which that crate leaves out");
        }
    }
}
