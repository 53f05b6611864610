//! What the vehicle does on command: what its autopilot understands ([`Order`]), and what a vehicle with plans and telemetry
//! does besides.

use kestrel_onboard::acknowledgement::CommandAnswer;
use kestrel_onboard::fence::Zones;
use kestrel_onboard::order::Order;
use kestrel_onboard::repetition::Sender;

use super::operator::{Operator, Purpose, REQUEST_CONTROL};
use super::{Vehicle, VehicleProfile};
use crate::files::metadata;
use crate::flight_mode::FlightMode;
use crate::frame::Payload;
use crate::link::Peer;
use crate::message::sent::identity;
use crate::message::sent::status;
use crate::policy_backend::PolicyBackend;
use crate::request::CommandRequest;
use crate::telemetry::TelemetryStream;

impl<P: PolicyBackend> Vehicle<P> {
    /// What is only asked is answered to everybody, what is to be done is done for who has the control.
    pub(super) fn execute(&mut self, request: &CommandRequest, sender: Sender, peer: Peer) -> CommandAnswer {
        let [first, second, ..] = request.parameters;
        match request.command {
            410 => self.send_once(242.0, 0.0, peer),
            510 => self.send_interval(first, peer),
            511 => self.set_interval(first, second, peer),
            512 => self.send_once(first, second, peer),
            519 => self.send_once(300.0, 0.0, peer),
            520 => self.send_once(148.0, 0.0, peer),
            REQUEST_CONTROL => self.ask_for_control(request, sender),
            _ => self.obey(request, Operator::System(sender.address[0])),
        }
    }

    fn obey(&mut self, request: &CommandRequest, operator: Operator) -> CommandAnswer {
        let [first, second, third, _] = request.parameters;
        match request.command {
            176 => self.choose(self.profile.personality.of_numbers(second, third), operator),
            207 => self.execute_as(operator, Purpose::Change, |vehicle| vehicle.enable_fence(first)),
            224 => self.execute_as(operator, Purpose::Change, |vehicle| vehicle.choose_item(first)),
            262 => self.choose(identity::mode_of_standard(first), operator),
            31010 => self.execute_as(operator, Purpose::Fly, |vehicle| vehicle.ask_for_task(first)),
            _ => self.carry_out(self.controller.order(request), operator),
        }
    }

    /// Changes to a mode, if this operator may choose it.
    pub(super) fn choose(&mut self, mode: Option<FlightMode>, operator: Operator) -> CommandAnswer {
        let by_sticks = mode == Some(FlightMode::Position);
        // Holding is anybody's, flying by sticks is not.
        if by_sticks && let Err(refusal) = self.permit(operator, Purpose::Fly) {
            return Err(refusal).into();
        }
        let answer = self.carry_out(self.controller.order_to_mode(mode), operator);
        if answer == CommandAnswer::ACCEPTED {
            self.by_sticks = by_sticks;
        }
        answer
    }

    fn carry_out(&mut self, order: Result<Order, CommandAnswer>, operator: Operator) -> CommandAnswer {
        let order = match order {
            Ok(order) => order,
            Err(answer) => return answer,
        };
        self.execute_as(operator, Purpose::of_order(&order), |vehicle| {
            let mode = vehicle.mode();
            match order {
                Order::Mission => vehicle.start_mission(),
                Order::Execute(_) | Order::SelectController(_) | Order::Hold => {
                    order.execute(mode, &mut |command| vehicle.order(command))
                }
            }
            .into()
        })
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

    /// `MAV_CMD_DO_SET_MISSION_CURRENT`.
    fn choose_item(&mut self, sequence: f32) -> CommandAnswer {
        match identifier(sequence).filter(|sequence| (*sequence as usize) < self.plans.legs().len()) {
            Some(sequence) => {
                self.jump(sequence as u16);
                CommandAnswer::ACCEPTED
            }
            None => CommandAnswer::denied("command refused: no such item in the mission"),
        }
    }

    /// `MAV_CMD_SET_MESSAGE_INTERVAL` of the peer that asks; the interval is in µs.
    fn set_interval(&mut self, message_id: f32, interval_us: f32, peer: Peer) -> CommandAnswer {
        let Some(stream) = identifier(message_id).and_then(TelemetryStream::of_message) else {
            return CommandAnswer::denied("this message is not streamed");
        };
        self.channels.open(peer).set_interval(stream, interval_us * 1e-6);
        CommandAnswer::ACCEPTED
    }

    /// `MAV_CMD_GET_MESSAGE_INTERVAL`: zero for a message that is never sent, -1 for one that is switched off.
    fn send_interval(&mut self, message_id: f32, peer: Peer) -> CommandAnswer {
        let Some(message_id) = identifier(message_id) else {
            return CommandAnswer::denied("command refused: unknown parameter 1");
        };
        let stream = TelemetryStream::of_message(message_id);
        let secs = stream.map(|stream| self.channels.open(peer).interval_secs(stream).unwrap_or(-1e-6));
        let interval_us = secs.map_or(0, |secs| (secs * 1e6).round() as i32);
        self.controller.answer(status::message_interval(message_id as u16, interval_us));
        CommandAnswer::ACCEPTED
    }

    /// `MAV_CMD_REQUEST_MESSAGE`; the second parameter chooses among several.
    fn send_once(&mut self, message_id: f32, index: f32, peer: Peer) -> CommandAnswer {
        match identifier(message_id).unwrap_or(u32::MAX) {
            148 => self.controller.answer(identity::autopilot_version(self.profile.policy.hash)),
            300 => self.controller.answer(identity::protocol_version()),
            395 => self.send_metadata(identity::component_information),
            397 => self.send_metadata(identity::component_metadata),
            435 => self.send_modes(index),
            512 => self.controller.answer(self.control_status()),
            437 => self.controller.answer(identity::available_modes_monitor()),
            message_id => match TelemetryStream::of_message(message_id) {
                Some(stream) => self.channels.open(peer).request(stream),
                None => return CommandAnswer::denied("this message cannot be requested"),
            },
        }
        CommandAnswer::ACCEPTED
    }

    /// Where all metadata are, in the message that is made of the file's CRC-32 and the time since boot \[ms\].
    fn send_metadata(&mut self, message: fn(u32, u32) -> Payload) {
        let file_crc = self.files.checksum(metadata::GENERAL).unwrap_or_default();
        self.controller.answer(message(file_crc, self.time_boot_ms()));
    }

    /// One of the modes by its index from 1, or all of them.
    fn send_modes(&mut self, index: f32) {
        let VehicleProfile { personality, ref policy, .. } = self.profile;
        for place in 0..personality.listed().len() {
            let asked = index == 0.0 || index == (place + 1) as f32;
            if let Some(mode) = identity::available_mode(personality, place, &policy.name).filter(|_| asked) {
                self.controller.answer(mode);
            }
        }
    }
}

/// A message's identifier in the parameter of a command.
fn identifier(parameter: f32) -> Option<u32> {
    let whole = (0.0..16_777_216.0).contains(&parameter) && parameter == libm::truncf(parameter);
    whole.then_some(parameter as u32)
}
