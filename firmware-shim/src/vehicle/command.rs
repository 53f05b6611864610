//! What the vehicle does on command.

use mavlink::dialects::common::MavResult;

use super::MavlinkVehicle;
use crate::autopilot::{ALTITUDES_M, Command, Refusal};
use crate::flight_mode::FlightMode;
use crate::flyer::Flyer;
use crate::message::received::CommandRequest;
use crate::message::sent::identity::{self, Personality};
use crate::mission::fence::Zones;
use crate::processor::Processor;
use crate::telemetry::Stream;

/// Second parameter of a disarm command that shall work in flight (`MAV_CMD_COMPONENT_ARM_DISARM`).
const FORCED: f32 = 21196.0;

/// How pymavlink and `MAVProxy` have a vehicle that is not PX4 return (`mode RTL`), which they take for `ArduCopter`; with PX4's
/// numbers it is the offboard mode, of all modes the one to leave so. Clients of PX4 that ask for that one in flight set the
/// armed bit in the first parameter, or send a whole `custom_mode`.
const RETURN_OF_ARDUCOPTER: [f32; 3] = [1.0, 6.0, 0.0];

/// Result of a request, and the words for it if it is refused.
pub(super) struct Answer {
    pub(super) result: MavResult,
    pub(super) text: Option<&'static str>,
}

impl Answer {
    pub(super) const ACCEPTED: Self = Self { result: MavResult::MAV_RESULT_ACCEPTED, text: None };

    const fn denied(text: &'static str) -> Self {
        Self { result: MavResult::MAV_RESULT_DENIED, text: Some(text) }
    }
}

impl From<Refusal> for Answer {
    fn from(refusal: Refusal) -> Self {
        Self { result: refusal.result(), text: Some(refusal.text()) }
    }
}

impl From<Result<(), Refusal>> for Answer {
    fn from(outcome: Result<(), Refusal>) -> Self {
        outcome.map_or_else(Self::from, |()| Self::ACCEPTED)
    }
}

impl Refusal {
    /// Denied: can never work. Failed: something is broken. Temporarily rejected: not now.
    fn result(self) -> MavResult {
        match self {
            Self::Altitude | Self::Speed | Self::Fence => MavResult::MAV_RESULT_DENIED,
            Self::SelfTest => MavResult::MAV_RESULT_FAILED,
            Self::StateUnknown
            | Self::NotLevel
            | Self::Moving
            | Self::NotArmed
            | Self::InFlight
            | Self::NotCruising
            | Self::NotFlying
            | Self::Battery
            | Self::NoSetPoints
            | Self::NotOffboard
            | Self::NoMission
            | Self::OnMission
            | Self::Failsafe => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
        }
    }
}

impl<P: Processor> MavlinkVehicle<P> {
    pub(super) fn execute(&mut self, request: &CommandRequest) -> Answer {
        let [first, second, third, _] = request.parameters;
        match request.command {
            17 => self.order(Command::Pause).into(),
            20 => self.order(Command::Return).into(),
            21 if request.place.is_here() => self.order(Command::Land).into(),
            22 if request.place.is_here() => self.take_off(request.place.height()).into(),
            21 | 22 => Answer::denied("refused: takes off and lands in place"),
            176 => self.set_mode([first, second, third]),
            178 => self.change_speed(second),
            185 if first > 0.5 => self.order(Command::StopMotors).into(),
            192 => self.reposition(request),
            193 if first == 0.0 => self.order(Command::Pause).into(),
            193 if first == 1.0 => self.start_mission().into(),
            207 => self.enable_fence(first),
            300 => self.start_mission().into(),
            400 => self.arm_or_disarm(first, second),
            410 => self.send_once(242.0, 0.0),
            511 => self.set_interval(first, second),
            512 => self.send_once(first, second),
            520 => self.send_once(148.0, 0.0),
            185 | 193 => Answer::denied("command refused: unknown parameter 1"),
            _ => Answer { result: MavResult::MAV_RESULT_UNSUPPORTED, text: Some("this command is not supported") },
        }
    }

    fn arm_or_disarm(&mut self, first: f32, second: f32) -> Answer {
        if first == 1.0 {
            self.order(Command::Arm).into()
        } else if first == 0.0 && second == FORCED {
            self.order(Command::StopMotors).into()
        } else if first == 0.0 {
            self.order(Command::Disarm).into()
        } else {
            Answer::denied("command refused: unknown parameter 1")
        }
    }

    /// Climbs by a height \[m\]. Ground stations mean one above the ground or one above sea level; what can be the former is.
    fn take_off(&mut self, height: f32) -> Result<(), Refusal> {
        let above_origin = (f64::from(height) - self.profile.origin.altitude_m) as f32;
        let altitude_m = if height.is_nan() {
            self.autopilot.settings().takeoff_altitude_m
        } else if !ALTITUDES_M.contains(&height) && ALTITUDES_M.contains(&above_origin) {
            above_origin
        } else {
            height
        };
        self.order(Command::TakeOff { altitude_m })
    }

    /// `MAV_CMD_DO_REPOSITION`: there, at the present height if it is left open.
    fn reposition(&mut self, request: &CommandRequest) -> Answer {
        let goal = self.autopilot.goal().position();
        let Some(mut point) = request.place.point(&self.profile.origin) else {
            return Answer::denied("refused: no place on Earth, or unknown frame");
        };
        if point.z.is_nan() {
            point.z = goal.z;
        }
        if request.place.is_here() {
            (point.x, point.y) = (goal.x, goal.y);
        }
        let far = point.iter().any(|coordinate| coordinate.is_nan() || coordinate.abs() > 1000.0) || point.z < 0.0;
        if far {
            return Answer::denied("refused: under the floor or over 1 km away");
        }
        self.order(Command::GoTo(point)).into()
    }

    /// `MAV_CMD_DO_CHANGE_SPEED` \[m/s\].
    fn change_speed(&mut self, speed: f32) -> Answer {
        self.order(Command::Speed(speed)).into()
    }

    /// `MAV_CMD_DO_SET_MODE`.
    fn set_mode(&mut self, parameters: [f32; 3]) -> Answer {
        let ambiguous = self.profile.personality == Personality::Generic && self.autopilot.mode().flies();
        if ambiguous && parameters == RETURN_OF_ARDUCOPTER {
            return Answer::denied("mode refused: is 6 Offboard or Return?");
        }
        let [_, second, third] = parameters;
        self.choose(FlightMode::of_numbers(second, third))
    }

    /// Changes to a mode, if a peer may choose it.
    pub(super) fn choose(&mut self, mode: Option<FlightMode>) -> Answer {
        let Some(mode) = mode else {
            return Answer::denied("mode refused: unknown, see AVAILABLE_MODES");
        };
        match mode {
            FlightMode::Policy => self.fly_by(Flyer::Policy).into(),
            FlightMode::Cascade => self.fly_by(Flyer::Cascade).into(),
            FlightMode::Hold => self.hold().into(),
            FlightMode::Offboard => self.order(Command::Offboard).into(),
            FlightMode::TakeOff => self.take_off(f32::NAN).into(),
            FlightMode::Land => self.order(Command::Land).into(),
            FlightMode::Return => self.order(Command::Return).into(),
            FlightMode::Mission => self.start_mission().into(),
        }
    }

    /// Hands over, and holds if it does anything else.
    fn fly_by(&mut self, flyer: Flyer) -> Result<(), Refusal> {
        self.order(Command::Fly(flyer))?;
        self.hold()
    }

    /// Holds in flight; on the ground that is what it does.
    fn hold(&mut self) -> Result<(), Refusal> {
        if self.autopilot.mode().flies() { self.order(Command::Pause) } else { Ok(()) }
    }

    /// `MAV_CMD_DO_FENCE_ENABLE`: switches the zones that were uploaded on or off.
    fn enable_fence(&mut self, first: f32) -> Answer {
        match first {
            0.0 => self.autopilot.enclose(Zones::default()),
            1.0 => self.autopilot.enclose(self.plans.zones().clone()),
            _ => return Answer::denied("command refused: unknown parameter 1"),
        }
        Answer::ACCEPTED
    }

    /// `MAV_CMD_SET_MESSAGE_INTERVAL`; the interval is in µs.
    fn set_interval(&mut self, message_id: f32, interval_us: f32) -> Answer {
        let Some(stream) = identifier(message_id).and_then(Stream::of_message) else {
            return Answer::denied("this message is not streamed");
        };
        self.schedule.set_interval(stream, interval_us * 1e-6);
        Answer::ACCEPTED
    }

    /// `MAV_CMD_REQUEST_MESSAGE`; the second parameter chooses among several.
    fn send_once(&mut self, message_id: f32, index: f32) -> Answer {
        match identifier(message_id).unwrap_or(u32::MAX) {
            148 => self.answer(identity::autopilot_version(self.profile.policy.hash)),
            435 => self.send_modes(index),
            437 => self.answer(identity::available_modes_monitor()),
            message_id => match Stream::of_message(message_id) {
                Some(stream) if self.requested.contains(&stream) => {}
                // There is room for each of them once.
                Some(stream) => self.requested.push(stream).unwrap_or(()),
                None => return Answer::denied("this message cannot be requested"),
            },
        }
        Answer::ACCEPTED
    }

    /// One of the modes by its index from 1, or all of them.
    fn send_modes(&mut self, index: f32) {
        for mode in FlightMode::ALL {
            if index == 0.0 || index == f32::from(mode as u8 + 1) {
                self.answer(identity::available_mode(mode, &self.profile.policy.name));
            }
        }
    }
}

/// A message's identifier in the parameter of a command.
fn identifier(parameter: f32) -> Option<u32> {
    let whole = (0.0..16_777_216.0).contains(&parameter) && parameter == libm::truncf(parameter);
    whole.then_some(parameter as u32)
}
