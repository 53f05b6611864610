//! What the vehicle does on command: what its autopilot understands ([`Order`]), and what a vehicle with plans and telemetry
//! does besides.

use kestrel_onboard::acknowledgement::CommandAnswer;
use kestrel_onboard::fence::Zones;
use kestrel_onboard::order::Order;

use super::Vehicle;
use crate::flight_mode::FlightMode;
use crate::message::sent::identity::{self, Personality};
use crate::policy_backend::PolicyBackend;
use crate::request::CommandRequest;
use crate::telemetry::TelemetryStream;

/// How pymavlink and `MAVProxy` have a vehicle that is not PX4 return (`mode RTL`), which they take for `ArduCopter`; with PX4's
/// numbers it is the offboard mode, of all modes the one to leave so. Clients of PX4 that ask for that one in flight set the
/// armed bit in the first parameter, or send a whole `custom_mode`.
const RETURN_OF_ARDUCOPTER: [f32; 3] = [1.0, 6.0, 0.0];

impl<P: PolicyBackend> Vehicle<P> {
    pub(super) fn execute(&mut self, request: &CommandRequest) -> CommandAnswer {
        let [first, second, third, _] = request.parameters;
        match request.command {
            176 if self.is_ambiguous([first, second, third]) => {
                CommandAnswer::denied("mode refused: is 6 Offboard or Return?")
            }
            207 => self.enable_fence(first),
            410 => self.send_once(242.0, 0.0),
            511 => self.set_interval(first, second),
            512 => self.send_once(first, second),
            520 => self.send_once(148.0, 0.0),
            31010 => self.ask_for_task(first),
            _ => self.carry_out(self.controller.order(request)),
        }
    }

    /// Changes to a mode, if a peer may choose it.
    pub(super) fn choose(&mut self, mode: Option<FlightMode>) -> CommandAnswer {
        self.carry_out(self.controller.order_to_mode(mode))
    }

    fn carry_out(&mut self, order: Result<Order, CommandAnswer>) -> CommandAnswer {
        let mode = self.mode();
        match order {
            Ok(Order::Mission) => self.start_mission().into(),
            Ok(order) => order.execute(mode, &mut |command| self.order(command)).into(),
            Err(answer) => answer,
        }
    }

    /// Whether the parameters of `MAV_CMD_DO_SET_MODE` may mean one of two modes.
    fn is_ambiguous(&self, parameters: [f32; 3]) -> bool {
        let possible = self.profile.personality == Personality::Generic && self.mode().flies();
        possible && parameters == RETURN_OF_ARDUCOPTER
    }

    /// `MAV_CMD_DO_FENCE_ENABLE`: switches the zones that were uploaded on or off.
    fn enable_fence(&mut self, first: f32) -> CommandAnswer {
        match first {
            0.0 => self.controller.autopilot_mut().enclose(Zones::default()),
            1.0 => self.controller.autopilot_mut().enclose(self.plans.zones().clone()),
            _ => return CommandAnswer::denied("command refused: unknown parameter 1"),
        }
        CommandAnswer::ACCEPTED
    }

    /// `MAV_CMD_SET_MESSAGE_INTERVAL`; the interval is in µs.
    fn set_interval(&mut self, message_id: f32, interval_us: f32) -> CommandAnswer {
        let Some(stream) = identifier(message_id).and_then(TelemetryStream::of_message) else {
            return CommandAnswer::denied("this message is not streamed");
        };
        self.schedule.set_interval(stream, interval_us * 1e-6);
        CommandAnswer::ACCEPTED
    }

    /// `MAV_CMD_REQUEST_MESSAGE`; the second parameter chooses among several.
    fn send_once(&mut self, message_id: f32, index: f32) -> CommandAnswer {
        match identifier(message_id).unwrap_or(u32::MAX) {
            148 => self.controller.answer(identity::autopilot_version(self.profile.policy.hash)),
            435 => self.send_modes(index),
            437 => self.controller.answer(identity::available_modes_monitor()),
            message_id => match TelemetryStream::of_message(message_id) {
                Some(stream) if self.requested.contains(&stream) => {}
                // There is room for each of them once.
                Some(stream) => self.requested.push(stream).unwrap_or(()),
                None => return CommandAnswer::denied("this message cannot be requested"),
            },
        }
        CommandAnswer::ACCEPTED
    }

    /// One of the modes by its index from 1, or all of them.
    fn send_modes(&mut self, index: f32) {
        for mode in FlightMode::ALL {
            if index == 0.0 || index == f32::from(mode as u8 + 1) {
                self.controller.answer(identity::available_mode(mode, &self.profile.policy.name));
            }
        }
    }
}

/// A message's identifier in the parameter of a command.
fn identifier(parameter: f32) -> Option<u32> {
    let whole = (0.0..16_777_216.0).contains(&parameter) && parameter == libm::truncf(parameter);
    whole.then_some(parameter as u32)
}
