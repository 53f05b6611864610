//! The vehicle on a microcontroller: bytes of a line and states in, rotor targets and answers out.
//!
//! It has the autopilot and obeys what commands it: commands, modes, set-points, and the heartbeats of a ground station,
//! whose absence is a failsafe. Every command is acknowledged, one that is repeated is executed again. It has no parameters,
//! missions, telemetry or files: those are the business of whoever has an operating system, and go unanswered.

use kestrel_core::airframe::Airframe;
use kestrel_core::vehicle::State;

use crate::acknowledgement::{CommandResult, command_ack};
use crate::autopilot::{Autopilot, Refusal, Surroundings};
use crate::endpoint::Endpoint;
use crate::flight_mode::FlightMode;
use crate::frame::{FRAME_LIMIT, Frame, Payload, Receiver};
use crate::geodesy::Home;
use crate::order::Order;
use crate::policy_backend::PolicyBackend;
use crate::request::{self, Address, CommandRequest, Request};
use crate::signature::{SignatureTime, Signer};
use crate::signature_guard::SignatureGuard;

/// `MAV_COMP_ID_AUTOPILOT1`.
const COMPONENT: u8 = 1;

/// Answers that wait to be sent; what a flood asks beyond it goes unanswered.
const ANSWERS: usize = 4;

/// Who a vehicle is, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleIdentity {
    /// MAVLink system, 1 to 250 by custom.
    pub system: u8,
    /// Where the world's origin lies on Earth.
    pub origin: Home,
}

/// What became of the bytes so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Frames with a right checksum.
    pub frames: u32,
    /// Frames with a wrong one, and runs of bytes that are no frame.
    pub garbage: u32,
    /// Good frames that were not signed as they must be.
    pub refused: u32,
    /// Answers that a flood of requests left no room for.
    pub unanswered: u32,
}

/// An [`Autopilot`] at the end of a line.
pub struct FlightController<P> {
    autopilot: Autopilot<P>,
    identity: VehicleIdentity,
    receiver: Receiver,
    endpoint: Endpoint,
    answers: heapless::Deque<Payload, ANSWERS>,
    /// Since the last word of a ground station, if there was any.
    silent_ticks: Option<u32>,
    counts: Counts,
}

/// A request and the system and component that sent it.
#[derive(Clone, Copy)]
struct Heard {
    sender: [u8; 2],
    address: Address,
    request: Request,
}

impl Heard {
    fn of(frame: &Frame) -> Option<Self> {
        let (address, request) = request::request(frame)?;
        Some(Self { sender: [frame.system, frame.component], address, request })
    }
}

impl<P: PolicyBackend> FlightController<P> {
    /// A disarmed vehicle of an airframe, whose policy `backend` computes; it obeys frames without a signature.
    pub fn new(backend: P, airframe: &Airframe, identity: VehicleIdentity) -> Self {
        Self {
            autopilot: Autopilot::new(backend, airframe),
            endpoint: Endpoint::new(identity.system, COMPONENT),
            identity,
            receiver: Receiver::new(),
            answers: heapless::Deque::new(),
            silent_ticks: None,
            counts: Counts::default(),
        }
    }

    /// From now on obeys only what `guard` admits, and signs its answers.
    pub fn secure(&mut self, guard: SignatureGuard, signer: Signer) {
        self.endpoint.secure(guard, signer);
    }

    /// Lets the clock have reached a time, for signatures.
    pub fn advance_clock(&mut self, now: SignatureTime) {
        self.endpoint.advance_clock(now);
    }

    /// Latest times of accepted and of sent frames, if they are signed: what must be kept over a restart.
    pub fn signature_times(&self) -> Option<[SignatureTime; 2]> {
        self.endpoint.signature_times()
    }

    /// Who flies it, and how.
    pub fn autopilot(&self) -> &Autopilot<P> {
        &self.autopilot
    }

    /// The same, to adjust its settings and its fence.
    pub fn autopilot_mut(&mut self) -> &mut Autopilot<P> {
        &mut self.autopilot
    }

    /// What became of the bytes so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Obeys what the next byte of the line completes, if it completes anything.
    pub fn receive(&mut self, byte: u8) {
        let heard = match self.receiver.push(byte) {
            None => return,
            Some(Err(_)) => {
                self.counts.garbage = self.counts.garbage.wrapping_add(1);
                return;
            }
            Some(Ok(frame)) if self.endpoint.admit(&frame).is_err() => {
                self.counts.refused = self.counts.refused.wrapping_add(1);
                return;
            }
            Some(Ok(frame)) => Heard::of(&frame),
        };
        self.counts.frames = self.counts.frames.wrapping_add(1);
        if let Some(heard) = heard
            && heard.address.reaches(self.identity.system, COMPONENT)
        {
            self.handle(&heard);
        }
    }

    /// Rotor targets \[rad/s\] for the next control period, finite whatever the state; `battery` is the share that is
    /// left of it. One that is no number keeps the vehicle from arming, and is no event in flight.
    pub fn tick(&mut self, state: &State<f32>, battery: f32) -> [f32; 4] {
        let secs = |ticks: u32| ticks as f32 * self.autopilot.control_secs();
        let surroundings = Surroundings { link_age_secs: self.silent_ticks.map(secs), battery };
        self.silent_ticks = self.silent_ticks.map(|ticks| ticks.saturating_add(1));
        self.autopilot.tick(state, &surroundings)
    }

    /// The next frame to be sent, if any waits.
    pub fn answer(&mut self) -> Option<heapless::Vec<u8, FRAME_LIMIT>> {
        let payload = self.answers.pop_front()?;
        Some(self.endpoint.encode(&payload))
    }

    fn handle(&mut self, heard: &Heard) {
        match &heard.request {
            Request::GroundStation => self.silent_ticks = Some(0),
            Request::Command(command) => self.handle_command(command, heard.sender),
            Request::SetMode(custom_mode) => {
                let mode = FlightMode::of_custom_mode(*custom_mode);
                if let Ok(order) = Order::to_mode(mode, &self.autopilot, &self.identity.origin) {
                    // This message has no answer.
                    let _ = self.execute(order);
                }
            }
            // Nor have these, and a set-point that is refused leaves everything as it is.
            Request::PositionTarget(target) => {
                let set_point = target.set_point(&self.identity.origin);
                let _ = set_point.map(|set_point| self.autopilot.set_point(set_point));
            }
            Request::AttitudeTarget(target) => {
                let _ = target.set_point().map(|set_point| self.autopilot.set_point(set_point));
            }
            Request::Ping { .. } | Request::TimeSync(_) | Request::Files(_) => {}
        }
    }

    fn handle_command(&mut self, request: &CommandRequest, sender: [u8; 2]) {
        let result = match Order::of(request, &self.autopilot, &self.identity.origin) {
            Ok(order) => self.execute(order).map_or_else(CommandResult::from, |()| CommandResult::Accepted),
            Err(rejection) => rejection.result,
        };
        if self.answers.push_back(command_ack(request.command, result, sender)).is_err() {
            self.counts.unanswered = self.counts.unanswered.wrapping_add(1);
        }
    }

    fn execute(&mut self, order: Order) -> Result<(), Refusal> {
        if order == Order::Mission {
            return Err(Refusal::NoMission);
        }
        for command in order.commands(self.autopilot.mode()) {
            self.autopilot.command(command)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
