//! The MAVLink vehicle: datagrams and states in, rotor targets and frames out. No socket and no clock.

use core::time::Duration;

use kestrel_core::vehicle::State;
use mavlink::dialects::common::{MavResult, MavSeverity};

use crate::autopilot::{Autopilot, Command, DEFAULT_ALTITUDE_M, Mode, Refusal};
use crate::frame::{Encoder, Frame, Frames, Payload};
use crate::goal::MovingGoal;
use crate::message::received::{self, CommandLong, PositionTarget, Request, SetPointError};
use crate::message::sent;
use crate::processor::Processor;
use crate::telemetry::{Schedule, Stream};

/// `MAV_COMP_ID_AUTOPILOT1`.
const COMPONENT: u8 = 1;

/// Answers that wait for the next tick; what a flood asks beyond it goes unanswered.
const ANSWERS: usize = 32;

/// Senders whose last command is remembered.
const SENDERS: usize = 4;

/// A repetition within this time of its original is not executed again \[s\]: clients give up after 2 s to 5 s.
const REPETITION_SECS: f64 = 10.0;

/// The same refusal is not worded again within this time \[s\]: set-points come in streams.
const TEXT_SECS: f64 = 1.0;

/// Second parameter of a disarm command that shall work in flight (`MAV_CMD_COMPONENT_ARM_DISARM`).
const FORCED: f32 = 21196.0;

/// What became of the datagrams so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames with a right checksum.
    pub frames: u64,
    /// Frames with a wrong one, and anything else that is no frame.
    pub garbage: u64,
    /// Answers that a flood of requests left no room for.
    pub unanswered: u64,
}

/// An [`Autopilot`] that speaks MAVLink.
pub struct MavlinkVehicle<P> {
    autopilot: Autopilot<P>,
    system: u8,
    encoder: Encoder,
    schedule: Schedule,
    answers: heapless::Vec<Payload, ANSWERS>,
    last_commands: heapless::Deque<Executed, SENDERS>,
    last_text: Option<(&'static str, f64)>,
    counts: Counts,
    ticks: u64,
}

/// The last command of a sender, and its result.
struct Executed {
    sender: [u8; 2],
    command: CommandLong,
    result: MavResult,
    secs: f64,
}

/// Result of a request, and the words for it if it is refused.
struct Answer {
    result: MavResult,
    text: Option<&'static str>,
}

impl<P: Processor> MavlinkVehicle<P> {
    /// A disarmed vehicle whose policy `processor` computes, as MAVLink system `system`, 1 to 250 by custom.
    pub fn new(processor: P, system: u8) -> Self {
        let autopilot = Autopilot::new(processor);
        Self {
            schedule: Schedule::new(autopilot.control_secs()),
            autopilot,
            system,
            encoder: Encoder::new(system, COMPONENT),
            answers: heapless::Vec::new(),
            last_commands: heapless::Deque::new(),
            last_text: None,
            counts: Counts::default(),
            ticks: 0,
        }
    }

    /// What the autopilot is doing.
    pub fn mode(&self) -> Mode {
        self.autopilot.mode()
    }

    /// Where it is going.
    pub fn goal(&self) -> &MovingGoal {
        self.autopilot.goal()
    }

    /// Has the autopilot execute a command that did not come by MAVLink.
    ///
    /// # Errors
    /// As [`Autopilot::command`].
    pub fn order(&mut self, command: Command) -> Result<(), Refusal> {
        self.autopilot.command(command)
    }

    /// What became of the datagrams so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Simulated time since the first tick \[s\].
    pub fn elapsed_secs(&self) -> f64 {
        self.ticks as f64 * f64::from(self.autopilot.control_secs())
    }

    /// Time between two ticks.
    pub fn control_period(&self) -> Duration {
        Duration::from_secs_f32(self.autopilot.control_secs())
    }

    /// Obeys what a datagram asks for; answers leave with the next tick. Whether any frame in it was good: if not,
    /// its sender is no peer.
    pub fn receive(&mut self, datagram: &[u8]) -> bool {
        let good_before = self.counts.frames;
        for frame in Frames::new(datagram) {
            if let Ok(frame) = frame {
                self.counts.frames += 1;
                self.obey(&frame);
            } else {
                self.counts.garbage += 1;
            }
        }
        self.counts.frames > good_before
    }

    /// Rotor targets \[rad/s\] for the next control period; `send` gets the frames that are due, one by one.
    pub fn tick(&mut self, state: &State<f32>, send: &mut dyn FnMut(&[u8])) -> [f32; 4] {
        let before = self.mode();
        let rotor_targets = self.autopilot.tick(state);
        self.announce(before);
        for answer in core::mem::take(&mut self.answers) {
            send(&self.encoder.encode(&answer));
        }
        for stream in Stream::ALL {
            if self.schedule.due(stream, self.ticks) {
                let payload = self.payload(stream, state);
                send(&self.encoder.encode(&payload));
            }
        }
        self.ticks += 1;
        rotor_targets
    }

    fn payload(&mut self, stream: Stream, state: &State<f32>) -> Payload {
        let time_boot_ms = (self.elapsed_secs() * 1e3) as u32;
        match stream {
            Stream::Heartbeat => sent::heartbeat(self.mode()),
            Stream::SysStatus => {
                sent::sys_status(self.autopilot.healthy(), self.counts.garbage.min(u16::MAX.into()) as u16)
            }
            Stream::ExtendedSysState => sent::extended_sys_state(self.mode()),
            Stream::Attitude => sent::attitude(state, time_boot_ms),
            Stream::LocalPosition => sent::local_position_ned(state, time_boot_ms),
        }
    }

    /// Words for the changes of mode that nobody commanded.
    fn announce(&mut self, before: Mode) {
        let (severity, text) = match (before, self.mode()) {
            (before, after) if before == after => return,
            (Mode::Armed | Mode::Landed, Mode::Disarmed) => (MavSeverity::MAV_SEVERITY_INFO, "disarmed"),
            (_, Mode::Disarmed) => (MavSeverity::MAV_SEVERITY_CRITICAL, "state is not finite: motors stopped"),
            (Mode::TakingOff, _) => (MavSeverity::MAV_SEVERITY_INFO, "take-off complete"),
            (_, _) => (MavSeverity::MAV_SEVERITY_INFO, "landed"),
        };
        self.answer(sent::status_text(severity, text));
    }

    fn obey(&mut self, frame: &Frame) {
        let Some((address, request)) = received::request(frame) else { return };
        if !address.reaches(self.system, COMPONENT) {
            return;
        }
        let sender = [frame.system, frame.component];
        match request {
            Request::Command(command) => self.obey_command(&command, sender),
            Request::CommandInt(command) => {
                self.acknowledge(command, MavResult::MAV_RESULT_COMMAND_LONG_ONLY, sender);
            }
            Request::PositionTarget(target) => self.follow(&target),
        }
    }

    fn obey_command(&mut self, command: &CommandLong, sender: [u8; 2]) {
        let (result, text) = match self.repeated(command, sender) {
            Some(result) => (result, None),
            None => self.execute_and_remember(command, sender),
        };
        self.acknowledge(command.command, result, sender);
        if let Some(text) = text {
            self.refuse(text);
        }
    }

    /// The result of the sender's last command if this is a repetition of it.
    fn repeated(&self, command: &CommandLong, sender: [u8; 2]) -> Option<MavResult> {
        let last = self.last_commands.iter().find(|last| last.sender == sender)?;
        let recent = self.elapsed_secs() - last.secs <= REPETITION_SECS;
        let repeats = command.confirmation > last.command.confirmation
            && command.command == last.command.command
            && command.parameters.map(f32::to_bits) == last.command.parameters.map(f32::to_bits);
        (recent && repeats).then_some(last.result)
    }

    fn execute_and_remember(
        &mut self,
        command: &CommandLong,
        sender: [u8; 2],
    ) -> (MavResult, Option<&'static str>) {
        let Answer { result, text } = self.execute(command);
        self.last_commands.retain(|last| last.sender != sender);
        if self.last_commands.is_full() {
            self.last_commands.pop_front();
        }
        let executed = Executed { sender, command: *command, result, secs: self.elapsed_secs() };
        // There is room: the oldest has just left.
        let _ = self.last_commands.push_back(executed);
        (result, text)
    }

    fn execute(&mut self, command: &CommandLong) -> Answer {
        let [first, second, _, _, latitude, longitude, altitude] = command.parameters;
        match command.command {
            400 if first == 1.0 => self.command(Command::Arm),
            400 if first == 0.0 && second == FORCED => self.command(Command::StopMotors),
            400 if first == 0.0 => self.command(Command::Disarm),
            22 if is_here(latitude, longitude) => {
                self.command(Command::TakeOff { altitude_m: or_default(altitude) })
            }
            21 if is_here(latitude, longitude) => self.command(Command::Land),
            21 | 22 => Answer::denied("no global position: takes off and lands in place"),
            193 if first == 0.0 => self.command(Command::Pause),
            511 => self.set_interval(first, second),
            512 => self.send_once(first),
            400 | 193 => Answer::denied("command refused: unknown parameter 1"),
            _ => Answer { result: MavResult::MAV_RESULT_UNSUPPORTED, text: None },
        }
    }

    fn command(&mut self, command: Command) -> Answer {
        self.autopilot.command(command).map_or_else(Answer::from, |()| Answer::ACCEPTED)
    }

    /// `MAV_CMD_SET_MESSAGE_INTERVAL`; the interval is in µs.
    fn set_interval(&mut self, message_id: f32, interval_us: f32) -> Answer {
        let Some(stream) = Stream::of_message(message_id as u32) else {
            return Answer::denied("this message is not streamed");
        };
        self.schedule.set_interval(stream, interval_us * 1e-6);
        Answer::ACCEPTED
    }

    /// `MAV_CMD_REQUEST_MESSAGE`, of what is not streamed anyway.
    fn send_once(&mut self, message_id: f32) -> Answer {
        if message_id as u32 != sent::AUTOPILOT_VERSION_ID {
            return Answer::denied("this message cannot be requested");
        }
        self.answer(sent::autopilot_version());
        Answer::ACCEPTED
    }

    fn follow(&mut self, target: &PositionTarget) {
        let outcome = match target.set_point() {
            Ok(point) => self.autopilot.command(Command::GoTo(point)).map_err(Refusal::text),
            Err(error) => Err(error.text()),
        };
        if let Err(text) = outcome {
            self.refuse(text);
        }
    }

    fn acknowledge(&mut self, command: u16, result: MavResult, sender: [u8; 2]) {
        self.answer(sent::command_ack(command, result, sender));
    }

    fn refuse(&mut self, text: &'static str) {
        let now = self.elapsed_secs();
        if self.last_text.is_some_and(|(last, secs)| last == text && now - secs < TEXT_SECS) {
            return;
        }
        self.last_text = Some((text, now));
        self.answer(sent::status_text(MavSeverity::MAV_SEVERITY_WARNING, text));
    }

    fn answer(&mut self, payload: Payload) {
        if self.answers.push(payload).is_err() {
            self.counts.unanswered += 1;
        }
    }
}

/// Whether the place of a take-off or landing is left open; clients write NaN or zero then.
fn is_here(latitude: f32, longitude: f32) -> bool {
    [latitude, longitude].iter().all(|angle| angle.is_nan() || *angle == 0.0)
}

fn or_default(altitude_m: f32) -> f32 {
    if altitude_m.is_nan() { DEFAULT_ALTITUDE_M } else { altitude_m }
}

impl Answer {
    const ACCEPTED: Self = Self { result: MavResult::MAV_RESULT_ACCEPTED, text: None };

    fn denied(text: &'static str) -> Self {
        Self { result: MavResult::MAV_RESULT_DENIED, text: Some(text) }
    }
}

impl From<Refusal> for Answer {
    fn from(refusal: Refusal) -> Self {
        Self { result: refusal.result(), text: Some(refusal.text()) }
    }
}

impl Refusal {
    /// Denied: can never work. Failed: something is broken. Temporarily rejected: not now.
    fn result(self) -> MavResult {
        match self {
            Self::Altitude | Self::Speed => MavResult::MAV_RESULT_DENIED,
            Self::SelfTest => MavResult::MAV_RESULT_FAILED,
            Self::StateUnknown
            | Self::NotLevel
            | Self::Moving
            | Self::NotArmed
            | Self::InFlight
            | Self::NotCruising
            | Self::NotFlying => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
        }
    }

    /// At most the 50 bytes of a `STATUSTEXT`.
    pub(crate) fn text(self) -> &'static str {
        match self {
            Self::SelfTest => "arming refused: policy self-test failed",
            Self::StateUnknown => "refused: state unknown",
            Self::NotLevel => "arming refused: tilted more than 25 degrees",
            Self::Moving => "arming refused: moving",
            Self::NotArmed => "take-off refused: not armed",
            Self::InFlight => "refused: in flight",
            Self::NotCruising => "refused: not flying, or taking off or landing",
            Self::NotFlying => "landing refused: not flying",
            Self::Altitude => "take-off refused: altitude must be 0.2 m to 20 m",
            Self::Speed => "velocity refused: faster than 1 m/s",
        }
    }
}

impl SetPointError {
    /// At most the 50 bytes of a `STATUSTEXT`.
    fn text(self) -> &'static str {
        match self {
            Self::Frame => "set-point refused: frame must be LOCAL_NED",
            Self::Motion => "set-point refused: only positions are followed",
            Self::Position => "set-point refused: north, east or down missing",
            Self::NotFinite => "set-point refused: not a finite number",
            Self::Outside => "set-point refused: under the floor or over 1 km",
        }
    }
}

#[cfg(test)]
mod tests;
