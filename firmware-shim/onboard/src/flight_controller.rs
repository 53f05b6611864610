//! The vehicle: frames and states in, rotor targets and answers out.
//!
//! On a microcontroller it is all there is: it executes commands, changes modes, follows set-points and watches for the
//! heartbeats of a ground station, whose absence is a failsafe. Every command is acknowledged, and one that is repeated is
//! executed once. What wants an operating system (parameters, missions, telemetry, files) is built around it in software in
//! the loop, from the parts that are public here.

use kestrel_core::airframe::Airframe;
use kestrel_core::vehicle::State;

use crate::acknowledgement::{CommandAnswer, CommandResult, command_ack};
use crate::autopilot::{Autopilot, Surroundings};
use crate::endpoint::{Counts, Endpoint};
use crate::flight_mode::FlightMode;
use crate::frame::{FRAME_LIMIT, Frame, FrameError, Payload, Receiver};
use crate::geodesy::Home;
use crate::order::Order;
use crate::policy_backend::PolicyBackend;
use crate::repetition::{Repetitions, Sender};
use crate::request::{self, Address, CommandRequest, Request};
use crate::signature::{SignatureTime, Signer};
use crate::signature_guard::SignatureGuard;

/// `MAV_COMP_ID_AUTOPILOT1`.
const COMPONENT: u8 = 1;

/// Who a vehicle is, and where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleIdentity {
    /// MAVLink system, 1 to 250 by custom.
    pub system: u8,
    /// Where the world's origin lies on Earth.
    pub origin: Home,
}

/// An [`Autopilot`] at the end of a line; at most `ANSWERS` wait to be sent, and what a flood asks beyond that goes unanswered.
pub struct FlightController<P, const ANSWERS: usize = 4> {
    autopilot: Autopilot<P>,
    identity: VehicleIdentity,
    receiver: Receiver,
    endpoint: Endpoint<ANSWERS>,
    repetitions: Repetitions,
    /// Tick of the last heartbeat of a ground station.
    ground_station_tick: Option<u64>,
    /// Of the control period that comes \[s\].
    collision_secs: Option<f32>,
    ticks: u64,
}

impl<P: PolicyBackend, const ANSWERS: usize> FlightController<P, ANSWERS> {
    /// A disarmed vehicle of an airframe, whose policy `backend` computes; it accepts frames without a signature.
    pub fn new(backend: P, airframe: &Airframe, identity: VehicleIdentity) -> Self {
        Self {
            autopilot: Autopilot::new(backend, airframe),
            endpoint: Endpoint::new(identity.system, COMPONENT),
            identity,
            receiver: Receiver::new(),
            repetitions: Repetitions::default(),
            ground_station_tick: None,
            collision_secs: None,
            ticks: 0,
        }
    }

    /// From now on accepts only what `guard` admits, and signs its answers.
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
        self.endpoint.counts()
    }

    /// Control periods since the start.
    pub fn ticks(&self) -> u64 {
        self.ticks
    }

    /// Time of these control periods \[s\].
    pub fn elapsed_secs(&self) -> f64 {
        self.secs(self.ticks)
    }

    fn secs(&self, ticks: u64) -> f64 {
        ticks as f64 * f64::from(self.autopilot.control_secs())
    }

    /// Does what the next byte of the line completes, if it completes anything.
    pub fn receive(&mut self, byte: u8) {
        let admitted = self.receiver.push(byte).and_then(|frame| self.endpoint.admit(frame));
        let Some(frame) = admitted else { return };
        let sender = Sender::of(&frame);
        if let Some((address, request)) = request::request(&frame)
            && self.is_meant(address)
        {
            self.handle(&request, sender);
        }
    }

    /// The frame, if it is one and signed as it must be.
    pub fn admit<'a>(&mut self, frame: Result<Frame<'a>, FrameError>) -> Option<Frame<'a>> {
        self.endpoint.admit(frame)
    }

    /// Whether what is sent to an address is for this vehicle.
    pub fn is_meant(&self, address: Address) -> bool {
        address.reaches(self.identity.system, COMPONENT)
    }

    /// Rotor targets \[rad/s\] for the next control period, finite whatever the state; `battery` is the share that is
    /// left of it. One that is no number keeps the vehicle from arming, and is no event in flight.
    pub fn tick(&mut self, state: &State<f32>, battery: f32) -> [f32; 4] {
        let targets = self.fly(state, battery);
        self.end_period();
        targets
    }

    /// The same within a period that lasts until [`FlightController::end_period`]: its time is that of what is sent in it.
    pub fn fly(&mut self, state: &State<f32>, battery: f32) -> [f32; 4] {
        let age_ticks = self.ground_station_tick.map(|tick| self.ticks.wrapping_sub(tick));
        let link_age_secs = age_ticks.map(|ticks| self.secs(ticks) as f32);
        let collision_secs = self.collision_secs.take();
        self.autopilot.tick(state, &Surroundings { link_age_secs, battery, collision_secs })
    }

    /// Takes note, for the control period that comes, of the time until the drone is at what its rangers see \[s\].
    pub fn note_collision(&mut self, secs: Option<f32>) {
        self.collision_secs = secs;
    }

    /// Ends a control period.
    pub fn end_period(&mut self) {
        self.ticks = self.ticks.wrapping_add(1);
    }

    /// Has a message wait to be sent, if there is room.
    pub fn answer(&mut self, payload: Payload) {
        self.endpoint.answer(payload);
    }

    /// The next message to be sent, if any waits.
    pub fn next_payload(&mut self) -> Option<Payload> {
        self.endpoint.next_payload()
    }

    /// The next frame to be sent, if any waits.
    pub fn next_answer(&mut self) -> Option<heapless::Vec<u8, FRAME_LIMIT>> {
        self.endpoint.next_answer()
    }

    /// The bytes of a frame to be sent at once.
    pub fn encode(&mut self, payload: &Payload) -> heapless::Vec<u8, FRAME_LIMIT> {
        self.endpoint.encode(payload)
    }

    /// The bytes of a frame to somebody whose frames are numbered by `sequence`.
    pub fn encode_numbered(&mut self, payload: &Payload, sequence: &mut u8) -> heapless::Vec<u8, FRAME_LIMIT> {
        self.endpoint.encode_numbered(payload, sequence)
    }

    /// Does what a request asks for, and answers a command. Whatever else it is, it has no answer here, and one that is
    /// refused leaves everything as it is.
    pub fn handle(&mut self, request: &Request, sender: Sender) {
        match request {
            Request::GroundStation => self.ground_station_tick = Some(self.ticks),
            Request::Command(command) => self.handle_command(command, sender),
            Request::SetMode(custom_mode) => {
                let _ = self.execute(self.order_to_mode(FlightMode::of_custom_mode(*custom_mode)));
            }
            Request::PositionTarget(target) => {
                let here = self.autopilot.whereabouts();
                let set_point = target.set_point(&self.identity.origin, &here);
                if set_point.is_ok_and(|set_point| self.autopilot.set_point(set_point).is_ok()) {
                    let _ = self.autopilot.face(target.facing(&here));
                }
            }
            Request::AttitudeTarget(target) => {
                let _ = target.set_point().map(|set_point| self.autopilot.set_point(set_point));
            }
            Request::Ping { .. } | Request::TimeSync(_) | Request::Files => {}
        }
    }

    fn handle_command(&mut self, request: &CommandRequest, sender: Sender) {
        let answer = match self.earlier_result(request, sender) {
            Some(result) => CommandAnswer::silent(result),
            None => self.execute(self.order(request)),
        };
        let times = self.acknowledgements(request, sender);
        self.acknowledge(request, sender, answer.result, times);
    }

    /// What a command orders the autopilot to do.
    ///
    /// # Errors
    /// As [`Order::of`].
    pub fn order(&self, request: &CommandRequest) -> Result<Order, CommandAnswer> {
        Order::of(request, &self.autopilot, &self.identity.origin)
    }

    /// What the change to a mode orders the autopilot to do.
    ///
    /// # Errors
    /// As [`Order::to_mode`].
    pub fn order_to_mode(&self, mode: Option<FlightMode>) -> Result<Order, CommandAnswer> {
        Order::to_mode(mode, &self.autopilot, &self.identity.origin)
    }

    fn execute(&mut self, order: Result<Order, CommandAnswer>) -> CommandAnswer {
        let mode = self.autopilot.mode();
        match order {
            Ok(order) => order.execute(mode, &mut |command| self.autopilot.command(command)).into(),
            Err(answer) => answer,
        }
    }

    /// The result of a command that was executed before, if this is a repetition of it.
    pub fn earlier_result(&self, request: &CommandRequest, sender: Sender) -> Option<CommandResult> {
        self.repetitions.result(request, sender, self.autopilot.mode(), self.elapsed_secs())
    }

    /// How often to acknowledge a command: twice if its sender seems to have missed an acknowledgement, for clients give up.
    pub fn acknowledgements(&self, request: &CommandRequest, sender: Sender) -> usize {
        if self.repetitions.is_sent_again(request, sender, self.elapsed_secs()) { 2 } else { 1 }
    }

    /// Acknowledges a command so many times, and remembers what became of it.
    pub fn acknowledge(&mut self, request: &CommandRequest, sender: Sender, result: CommandResult, times: usize) {
        self.repetitions.remember(request, sender, result, self.elapsed_secs());
        for _ in 0..times {
            self.endpoint.answer(command_ack(request.command, result, sender.address));
        }
    }
}

#[cfg(test)]
mod tests;
