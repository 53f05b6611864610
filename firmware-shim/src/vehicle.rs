//! The vehicle in software in the loop: a [`FlightController`] with parameters, missions and telemetry. Datagrams and states
//! in, rotor targets and frames out; no socket and no clock.

mod camera;
mod channel;
mod command;
mod declined;
mod events;
mod loss;
mod mission;
mod operator;
mod sticks;
mod task;
mod telemetry;

use core::time::Duration;

use kestrel_core::airframe::Airframe;
use kestrel_core::vehicle::State;
use kestrel_onboard::acknowledgement::CommandAnswer;
use kestrel_onboard::endpoint::Counts;
use kestrel_onboard::flight_controller::{FlightController, VehicleIdentity};
use kestrel_onboard::repetition::Sender;
use kestrel_onboard::signature::{SignatureTime, Signer};
use kestrel_onboard::signature_guard::SignatureGuard;
use mavlink::dialects::common::MavSeverity;
use nalgebra::Vector3;

use crate::autopilot::{Autopilot, Command, Mode, Refusal, SetPoint};
use crate::battery::Battery;
use crate::controller::Controller;
use crate::failsafe::FailsafeEvent;
use crate::files::packet::PACKET_LEN;
use crate::files::{FileServer, metadata};
use crate::flight_mode::FlightMode;
use crate::frame::{Frame, Frames, Payload};
use crate::geodesy::Home;
use crate::goal::MovingGoal;
use crate::link::Peer;
use crate::message::sent;
use crate::message::sent::identity::PolicyIdentity;
use crate::mission as mission_protocol;
use crate::mission::runner::Directive;
use crate::mission::{MissionProtocol, MissionRunner};
use crate::parameter::protocol::ParameterProtocol;
use crate::parameter::received::{self as parameter_received, ParameterKey, ParameterRequest};
use crate::parameter::{Parameters, table::Parameter};
use crate::personality::Personality;
use crate::plant::Ranges;
use crate::policy_backend::PolicyBackend;
use crate::request::{self, CommandRequest, Request, SetPointError};
use crate::telemetry::TelemetryStream;

use self::mission::Reached;
use camera::Camera;
use channel::{Channel, Channels};
use events::EventLog;
use loss::Losses;
pub use operator::Operator;
use operator::{Control, Purpose};
pub use task::PolicyRole;
use task::TaskPhase;

/// Answers that wait at once; what is asked beyond it goes unanswered.
const ANSWERS: usize = 32;

/// The same refusal is not worded again within this time \[s\]: set-points come in streams.
const TEXT_SECS: f64 = 1.0;

/// Who a vehicle is, and where.
#[derive(Clone, Debug, PartialEq)]
pub struct VehicleProfile {
    /// MAVLink system, 1 to 250 by custom.
    pub system: u8,
    /// Which autopilot it says it is.
    pub personality: Personality,
    /// Where the world's origin lies on Earth.
    pub origin: Home,
    /// What flies.
    pub policy: PolicyIdentity,
}

/// How a flight kept its pace of late.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Punctuality {
    /// Simulated seconds in one.
    pub real_time_factor: f32,
    /// How late control periods began, on average \[s\].
    pub late_secs: f32,
    /// Control periods since the start whose work was not done in their time.
    pub overruns: u64,
}

/// A [`FlightController`], and what wants an operating system.
pub struct Vehicle<P> {
    controller: FlightController<P, ANSWERS>,
    profile: VehicleProfile,
    parameters: ParameterProtocol,
    parameters_changed: bool,
    files: FileServer,
    plans: MissionProtocol,
    runner: MissionRunner,
    /// What the mission wanted last.
    directive: Option<Directive>,
    reached: Option<Reached>,
    channels: Channels,
    losses: Losses,
    camera: Option<Camera>,
    /// Of a camera that comes later.
    signer: Option<Signer>,
    /// The task of its plant, if that has one.
    task: Option<(TaskPhase, PolicyRole)>,
    control: Control,
    /// Whether it is flown by sticks, if some come.
    by_sticks: bool,
    events: EventLog,
    /// What everybody is told with the next tick.
    notices: Vec<Payload>,
    last_text: Option<(&'static str, f64)>,
    battery: Battery,
    latency_secs: f32,
    /// How it keeps its pace, where it has one.
    punctuality: Option<Punctuality>,
    /// How far the clock of the vehicle is ahead of its peers' \[s\]: the next control period is not due yet.
    ahead_secs: f64,
    /// What rangers measured last, until it is told.
    ranges: Option<Ranges>,
    /// Of the last control period \[m/s²\], in the world's axes.
    acceleration: Vector3<f32>,
    last_velocity: Option<Vector3<f32>>,
    /// Seconds of flight in one of the peers' clocks.
    pace: f32,
    rotor_targets: [f32; 4],
    rotor_speed_limit: f32,
}

impl<P: PolicyBackend> Vehicle<P> {
    /// A disarmed vehicle of an airframe, whose policy `backend` computes.
    pub fn new(backend: P, airframe: &Airframe, profile: VehicleProfile) -> Self {
        let identity = VehicleIdentity { system: profile.system, origin: profile.origin };
        let controller = FlightController::new(backend, airframe, identity);
        Self {
            channels: Channels::new(controller.autopilot().control_secs()),
            controller,
            parameters: ParameterProtocol::new(Parameters::new(profile.system)),
            parameters_changed: false,
            files: FileServer::new(metadata::files()),
            plans: MissionProtocol::new(profile.origin),
            runner: MissionRunner::default(),
            directive: None,
            reached: None,
            profile,
            losses: Losses::default(),
            camera: None,
            signer: None,
            task: None,
            control: Control::default(),
            by_sticks: false,
            events: EventLog::default(),
            notices: Vec::new(),
            last_text: None,
            battery: Battery::full(),
            latency_secs: 0.0,
            punctuality: None,
            ahead_secs: 0.0,
            ranges: None,
            acceleration: Vector3::zeros(),
            last_velocity: None,
            pace: 1.0,
            rotor_targets: [0.0; 4],
            rotor_speed_limit: airframe.rotor_speed_limit as f32,
        }
    }

    fn autopilot(&self) -> &Autopilot<P> {
        self.controller.autopilot()
    }

    /// What the autopilot is doing.
    pub fn mode(&self) -> Mode {
        self.autopilot().mode()
    }

    /// Where it is going.
    pub fn goal(&self) -> &MovingGoal {
        self.autopilot().goal()
    }

    /// What became of the datagrams so far.
    pub fn counts(&self) -> Counts {
        self.controller.counts()
    }

    /// The values of its parameters.
    pub fn parameters(&self) -> &Parameters {
        self.parameters.parameters()
    }

    /// Flies by these parameters from now on.
    pub fn adjust(&mut self, parameters: Parameters) {
        self.parameters = ParameterProtocol::new(parameters);
        self.apply_settings();
    }

    /// From now on admits only what `guard` does, and signs what it sends.
    pub fn secure(&mut self, guard: SignatureGuard, signer: Signer) {
        self.signer = Some(signer.clone());
        self.controller.secure(guard, signer);
    }

    /// Lets the clock have reached a time, for signatures.
    pub fn advance_clock(&mut self, now: SignatureTime) {
        self.controller.advance_clock(now);
        if let Some(camera) = &mut self.camera {
            camera.advance_clock(now);
        }
    }

    /// Latest times of accepted and of sent frames, if they are signed.
    pub fn signature_times(&self) -> Option<[SignatureTime; 2]> {
        self.controller.signature_times()
    }

    /// Whether a peer has set a parameter since the last call.
    pub fn take_changes(&mut self) -> bool {
        core::mem::take(&mut self.parameters_changed)
    }

    /// Takes note of how long the last tick took on this machine \[s\], to tell peers.
    pub fn note_latency(&mut self, secs: f32) {
        self.latency_secs = secs;
    }

    /// Takes note of how the flight keeps its pace, to tell peers.
    pub fn note_punctuality(&mut self, punctuality: Option<Punctuality>) {
        self.punctuality = punctuality;
    }

    /// Takes note of how far off the next control period is \[s, simulated\]: peers that ask for the time are told that of
    /// now.
    pub fn note_ahead(&mut self, secs: f64) {
        self.ahead_secs = secs;
    }

    /// Whether what rangers measure is to be told, or looked at, with the next tick.
    pub fn wants_ranges(&self) -> bool {
        let streams = [TelemetryStream::DistanceSensor, TelemetryStream::ObstacleDistance];
        let watched = self.autopilot().settings().clearance_secs.is_some();
        watched || streams.iter().any(|stream| self.channels.are_due(*stream, self.controller.ticks()))
    }

    /// Takes note of what rangers measure.
    pub fn note_ranges(&mut self, ranges: Option<Ranges>) {
        self.ranges = ranges;
    }

    /// Lets peers live at another pace: so many seconds of flight go by in one of theirs. Their silence counts by their
    /// clocks.
    pub fn set_pace(&mut self, pace: f32) {
        self.pace = pace;
        self.apply_settings();
    }

    fn apply_settings(&mut self) {
        let settings = self.parameters.settings().at_pace(self.pace);
        self.controller.autopilot_mut().adjust(settings);
    }

    /// Flies with another battery from now on.
    pub fn change_battery(&mut self, battery: Battery) {
        self.battery = battery;
    }

    /// Which controller flies, or is going to.
    pub fn active_controller(&self) -> Controller {
        self.autopilot().active_controller()
    }

    /// Simulated time since the first tick \[s\].
    pub fn elapsed_secs(&self) -> f64 {
        self.controller.elapsed_secs()
    }

    /// Time between two ticks.
    pub fn control_period(&self) -> Duration {
        Duration::from_secs_f32(self.autopilot().control_secs())
    }

    /// Has the autopilot execute a command; one that moves the drone ends a mission.
    ///
    /// # Errors
    /// As [`Autopilot::command`].
    pub fn order(&mut self, command: Command) -> Result<(), Refusal> {
        self.controller.autopilot_mut().command(command)?;
        match command {
            Command::Arm | Command::SelectController(_) | Command::Speed(_) => {}
            Command::Disarm
            | Command::StopMotors
            | Command::TakeOff { .. }
            | Command::GoTo(_)
            | Command::Velocity(_)
            | Command::Offboard
            | Command::Pause
            | Command::Return
            | Command::Land => {
                self.pause_mission();
                self.stop_task();
                self.by_sticks = false;
            }
        }
        Ok(())
    }

    /// Has the autopilot execute a command of an operator, if it may command.
    ///
    /// # Errors
    /// As [`Vehicle::order`], and [`Refusal::OtherOperator`].
    pub fn order_as(&mut self, operator: Operator, command: Command) -> Result<(), Refusal> {
        self.note_heard(operator);
        // A Crazyflie's clients stop the motors by a set-point; in an emergency they have another way.
        let purpose = if command == Command::StopMotors { Purpose::Fly } else { Purpose::of(command) };
        self.permit(operator, purpose)?;
        self.order(command)?;
        self.note_done(operator, purpose);
        Ok(())
    }

    /// Takes one of a stream of set-points of an operator, unless a mission is flown.
    fn set_point(&mut self, set_point: SetPoint, operator: Operator) -> Result<(), Refusal> {
        self.permit(operator, Purpose::Fly)?;
        if self.on_mission() {
            return Err(Refusal::OnMission);
        }
        let mut outcome = self.controller.autopilot_mut().set_point(set_point);
        if outcome == Err(Refusal::NotOffboard) && self.is_guided() {
            self.order(Command::Offboard)?;
            outcome = self.controller.autopilot_mut().set_point(set_point);
        }
        if outcome.is_ok() {
            self.by_sticks = false;
            self.note_done(operator, Purpose::Fly);
        }
        outcome
    }

    /// Whether set-points of every kind are followed at once, as `ArduPilot` follows them in its mode GUIDED.
    fn is_guided(&self) -> bool {
        self.profile.personality == Personality::Ardupilot
            && [Mode::Holding, Mode::Guided].contains(&self.mode())
            && self.autopilot().trusts_streams()
    }

    /// Does what a datagram of a peer asks for; `answer` gets the frames for that peer. Whether any frame in it was good: if
    /// not, its sender is no peer.
    pub fn receive(&mut self, peer: Peer, datagram: &[u8], answer: &mut dyn FnMut(&[u8])) -> bool {
        let mut good = false;
        for frame in Frames::new(datagram) {
            if let Some(frame) = self.controller.admit(frame) {
                good = true;
                self.channels.open(peer);
                if self.handle(&frame, peer) == Audience::Peer {
                    self.answer(peer, answer);
                }
            }
        }
        good
    }

    /// Sends a peer what waits.
    fn answer(&mut self, peer: Peer, send: &mut dyn FnMut(&[u8])) {
        let channel = self.channels.open(peer);
        while let Some(payload) = self.controller.next_payload() {
            send(&self.controller.encode_numbered(&payload, &mut channel.sequence));
        }
        if let Some(camera) = &mut self.camera {
            camera.answer(channel, send);
        }
    }

    /// Rotor targets \[rad/s\] for the next control period; `send` gets the frames that are due to each of those who
    /// listen, one by one.
    pub fn tick(&mut self, state: &State<f32>, listeners: &[Peer], send: &mut dyn FnMut(Peer, &[u8])) -> [f32; 4] {
        let before = self.mode();
        self.feel(state);
        self.controller.note_collision(self.ranges.and_then(|ranges| ranges.collision_secs(state)));
        self.rotor_targets = self.controller.fly(state, self.battery.remaining());
        if self.autopilot().events().contains(&FailsafeEvent::CollisionCourse) {
            self.stop_task();
        }
        if self.mode().flies() {
            self.battery.drain(self.controller.autopilot().control_secs(), self.controller.autopilot().settings());
        }
        self.announce(before);
        self.tend_sticks();
        self.tend_control();
        self.fly_mission(state);
        self.repeat_reached();
        self.channels.are_of(listeners);
        for notice in core::mem::take(&mut self.notices) {
            tell(&mut self.controller, &mut self.channels, &notice, send);
        }
        while let Some(payload) = self.controller.next_payload() {
            tell(&mut self.controller, &mut self.channels, &payload, send);
        }
        self.publish_lists(send);
        for stream in TelemetryStream::ALL {
            let is_told = stream != TelemetryStream::ControlStatus || self.tells_control();
            if is_told && self.channels.are_due(stream, self.controller.ticks()) {
                self.publish(stream, state, send);
            }
        }
        self.publish_camera(send);
        self.ranges = None;
        self.channels.end_period();
        self.controller.end_period();
        self.rotor_targets
    }

    /// The acceleration of the control period that has just ended.
    fn feel(&mut self, state: &State<f32>) {
        let before = self.last_velocity.replace(state.velocity).unwrap_or(state.velocity);
        self.acceleration = (state.velocity - before) / self.autopilot().control_secs();
    }

    /// What is due of the parameters' list, and of an upload.
    fn publish_lists(&mut self, send: &mut dyn FnMut(Peer, &[u8])) {
        let now_secs = self.elapsed_secs();
        let Self { controller, channels, parameters, plans, .. } = self;
        let mut send = |payload: Payload| tell(controller, channels, &payload, send);
        parameters.tick(&mut send);
        plans.tick(now_secs, &mut send);
    }

    fn flight_mode(&self) -> FlightMode {
        if self.on_mission() {
            return FlightMode::Mission;
        }
        if self.by_sticks && [Mode::Holding, Mode::Offboard].contains(&self.mode()) {
            return FlightMode::Position;
        }
        FlightMode::of(self.autopilot().mode(), self.autopilot().active_controller())
    }

    /// Status texts for what has gone wrong, and for changes of mode that no client commanded.
    fn announce(&mut self, before: Mode) {
        for event in self.autopilot().events().clone() {
            self.controller.answer(sent::status_text(MavSeverity::MAV_SEVERITY_CRITICAL, event.text()));
        }
        let stopped = self
            .autopilot()
            .events()
            .iter()
            .any(|event| matches!(event, FailsafeEvent::Tilted | FailsafeEvent::Spinning));
        let after = self.mode();
        if after == before {
            return;
        }
        let (severity, text) = match after {
            Mode::Disarmed if !before.flies() => (MavSeverity::MAV_SEVERITY_INFO, "disarmed"),
            Mode::Disarmed if stopped => (MavSeverity::MAV_SEVERITY_CRITICAL, "motors stopped"),
            Mode::Disarmed => (MavSeverity::MAV_SEVERITY_CRITICAL, "state is not finite: motors stopped"),
            Mode::Holding if before == Mode::TakingOff => (MavSeverity::MAV_SEVERITY_INFO, "take-off complete"),
            Mode::Landed => (MavSeverity::MAV_SEVERITY_INFO, "landed"),
            Mode::Armed
            | Mode::TakingOff
            | Mode::Holding
            | Mode::Guided
            | Mode::Offboard
            | Mode::Returning
            | Mode::Landing => return,
        };
        self.controller.answer(sent::status_text(severity, text));
    }

    /// Does what a frame asks for; who is to hear of it.
    fn handle(&mut self, frame: &Frame, peer: Peer) -> Audience {
        let sender = Sender::of(frame);
        self.losses.note(sender, self.elapsed_secs());
        self.note_heard(Operator::System(frame.system));
        if let Some((address, request)) = request::request(frame) {
            if self.controller.is_meant(address) {
                self.handle_request(&request, frame, peer);
            }
            let time_boot_ms = self.time_boot_ms();
            if let Some(camera) = &mut self.camera {
                camera.handle(address, &request, sender.address, time_boot_ms);
            }
        } else if let Some((address, request)) = parameter_received::request(frame)
            && self.controller.is_meant(address)
        {
            return self.handle_parameter(request, sender.address);
        } else if let Some((address, request)) = mission_protocol::request(frame)
            && self.controller.is_meant(address)
        {
            self.handle_mission(&request, sender.address);
        } else if !self.handle_sticks(frame) && !self.handle_event_request(frame) {
            self.decline(frame);
        }
        Audience::Peer
    }

    fn handle_request(&mut self, request: &Request, frame: &Frame, peer: Peer) {
        let sender = Sender::of(frame);
        let operator = Operator::System(sender.address[0]);
        match request {
            Request::GroundStation => self.controller.handle(request, sender),
            Request::Ping { time_usec, seq } => {
                self.controller.answer(sent::ping(*time_usec, *seq, sender.address));
            }
            Request::SetMode(custom_mode) => {
                let mode = self.profile.personality.of_custom_mode(*custom_mode);
                let answer = self.choose(mode, operator);
                self.send_status_text(answer.text);
            }
            Request::Command(command) => self.handle_command(command, sender, peer),
            Request::PositionTarget(target) => {
                let here = self.autopilot().whereabouts();
                if self.follow(target.set_point(&self.profile.origin, &here), operator) {
                    let refused = self.controller.autopilot_mut().face(target.facing(&here)).err();
                    self.send_status_text(refused.map(Refusal::text));
                }
            }
            Request::AttitudeTarget(target) => {
                self.follow(target.set_point(), operator);
            }
            Request::TimeSync(theirs_ns) => {
                let ours_ns = ((self.elapsed_secs() - self.ahead_secs) * 1e9) as i64;
                self.controller.answer(sent::timesync(*theirs_ns, ours_ns, sender.address));
            }
            Request::Files => self.serve_files(frame),
        }
    }

    /// Answers a request for files; sessions lie idle by the clocks of peers.
    fn serve_files(&mut self, frame: &Frame) {
        let sender = Sender::of(frame).address;
        let [_, _, _, packet @ ..] = frame.fields::<{ 3 + PACKET_LEN }>();
        let now_secs = self.elapsed_secs() / f64::from(self.pace);
        for answer in self.files.handle(&packet, sender, now_secs) {
            self.controller.answer(sent::file_transfer(answer, sender));
        }
    }

    /// Follows a set-point, or says why not; whether it does.
    fn follow(&mut self, set_point: Result<SetPoint, SetPointError>, operator: Operator) -> bool {
        let outcome = set_point
            .map_err(SetPointError::text)
            .and_then(|set_point| self.set_point(set_point, operator).map_err(Refusal::text));
        self.send_status_text(outcome.err());
        outcome.is_ok()
    }

    /// A change is everybody's matter.
    fn handle_parameter(&mut self, request: ParameterRequest, sender: [u8; 2]) -> Audience {
        let request = match request {
            // Who may not set it is told what it is.
            ParameterRequest::Set { name, .. } if !self.may_change(sender) => {
                ParameterRequest::Read(ParameterKey::Name(name))
            }
            ParameterRequest::List | ParameterRequest::Read(_) | ParameterRequest::Set { .. } => request,
        };
        let controller = &mut self.controller;
        let changed: Option<Parameter> =
            self.parameters.handle(&request, sender, &mut |payload| controller.answer(payload));
        if changed.is_none() {
            return Audience::Peer;
        }
        self.parameters_changed = true;
        self.apply_settings();
        Audience::Listeners
    }

    fn handle_command(&mut self, command: &CommandRequest, sender: Sender, peer: Peer) {
        let answer = match self.controller.earlier_result(command, sender) {
            Some(result) => CommandAnswer::silent(result),
            None => self.execute(command, sender, peer),
        };
        // Where frames are lost acknowledgements are, too, and clients give up after a few times.
        let lossy = self.losses.are_of(sender, self.elapsed_secs());
        let times = if lossy { 2 } else { self.controller.acknowledgements(command, sender) };
        self.controller.acknowledge(command, sender, answer.result, times);
        self.send_status_text(answer.text);
    }

    /// Says why something is refused, but not over and over.
    fn send_status_text(&mut self, text: Option<&'static str>) {
        let Some(text) = text else { return };
        let now = self.elapsed_secs();
        if self.last_text.is_some_and(|(last, secs)| last == text && now - secs < TEXT_SECS) {
            return;
        }
        self.last_text = Some((text, now));
        self.controller.answer(sent::status_text(MavSeverity::MAV_SEVERITY_WARNING, text));
    }
}

/// Sends a message to everybody who listens.
fn tell<P: PolicyBackend>(
    controller: &mut FlightController<P, ANSWERS>,
    channels: &mut Channels,
    payload: &Payload,
    send: &mut dyn FnMut(Peer, &[u8]),
) {
    for Channel { peer, sequence, .. } in channels.listening() {
        send(*peer, &controller.encode_numbered(payload, sequence));
    }
}

/// Who is to hear what a request led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Audience {
    /// Whoever asked.
    Peer,
    /// Everybody who listens.
    Listeners,
}

#[cfg(test)]
mod tests;
