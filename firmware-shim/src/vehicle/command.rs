//! What the vehicle does on command: what its autopilot understands ([`Order`]), and what a vehicle with plans and telemetry
//! does besides.

use kestrel_onboard::acknowledgement::CommandResult;
use kestrel_onboard::fence::Zones;
use kestrel_onboard::order::{Order, Rejection};

use super::MavlinkVehicle;
use crate::autopilot::Refusal;
use crate::flight_mode::FlightMode;
use crate::message::sent::identity::{self, Personality};
use crate::policy_backend::PolicyBackend;
use crate::request::CommandRequest;
use crate::telemetry::TelemetryStream;

/// How pymavlink and `MAVProxy` have a vehicle that is not PX4 return (`mode RTL`), which they take for `ArduCopter`; with PX4's
/// numbers it is the offboard mode, of all modes the one to leave so. Clients of PX4 that ask for that one in flight set the
/// armed bit in the first parameter, or send a whole `custom_mode`.
const RETURN_OF_ARDUCOPTER: [f32; 3] = [1.0, 6.0, 0.0];

/// Result of a request, and the words for it if it is refused.
pub(super) struct Answer {
    pub(super) result: CommandResult,
    pub(super) text: Option<&'static str>,
}

impl Answer {
    pub(super) const ACCEPTED: Self = Self { result: CommandResult::Accepted, text: None };

    const fn denied(text: &'static str) -> Self {
        Self { result: CommandResult::Denied, text: Some(text) }
    }
}

impl From<Rejection> for Answer {
    fn from(Rejection { result, text }: Rejection) -> Self {
        Self { result, text: Some(text) }
    }
}

impl From<Refusal> for Answer {
    fn from(refusal: Refusal) -> Self {
        Self { result: refusal.into(), text: Some(refusal.text()) }
    }
}

impl From<Result<(), Refusal>> for Answer {
    fn from(outcome: Result<(), Refusal>) -> Self {
        outcome.map_or_else(Self::from, |()| Self::ACCEPTED)
    }
}

impl<P: PolicyBackend> MavlinkVehicle<P> {
    pub(super) fn execute(&mut self, request: &CommandRequest) -> Answer {
        let [first, second, third, _] = request.parameters;
        match request.command {
            176 if self.is_ambiguous([first, second, third]) => {
                Answer::denied("mode refused: is 6 Offboard or Return?")
            }
            207 => self.enable_fence(first),
            410 => self.send_once(242.0, 0.0),
            511 => self.set_interval(first, second),
            512 => self.send_once(first, second),
            520 => self.send_once(148.0, 0.0),
            _ => self.carry_out(Order::of(request, &self.autopilot, &self.profile.origin)),
        }
    }

    /// Changes to a mode, if a peer may choose it.
    pub(super) fn choose(&mut self, mode: Option<FlightMode>) -> Answer {
        self.carry_out(Order::to_mode(mode, &self.autopilot, &self.profile.origin))
    }

    fn carry_out(&mut self, order: Result<Order, Rejection>) -> Answer {
        let order = match order {
            Ok(Order::Mission) => return self.start_mission().into(),
            Ok(order) => order,
            Err(rejection) => return rejection.into(),
        };
        for command in order.commands(self.autopilot.mode()) {
            if let Err(refusal) = self.order(command) {
                return refusal.into();
            }
        }
        Answer::ACCEPTED
    }

    /// Whether the parameters of `MAV_CMD_DO_SET_MODE` may mean one of two modes.
    fn is_ambiguous(&self, parameters: [f32; 3]) -> bool {
        let possible = self.profile.personality == Personality::Generic && self.autopilot.mode().flies();
        possible && parameters == RETURN_OF_ARDUCOPTER
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
        let Some(stream) = identifier(message_id).and_then(TelemetryStream::of_message) else {
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
            message_id => match TelemetryStream::of_message(message_id) {
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
