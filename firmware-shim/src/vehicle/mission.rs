//! Missions: what the present item asks for becomes commands to the autopilot.

use kestrel_core::vehicle::State;
use mavlink::dialects::common::{MavMissionResult, MavSeverity};
use nalgebra::Vector3;

use super::Vehicle;
use crate::autopilot::{Command, Mode, Refusal, SPEED_LIMIT, SPEED_MINIMUM};
use crate::frame::Payload;
use crate::goal::Facing;
use crate::message::sent;
use crate::mission::runner::{Directive, DroneMotion, MissionInput, MissionPhase};
use crate::mission::{self, MissionEvent, PlanKind};
use crate::policy_backend::PolicyBackend;
use crate::settings::FailsafeAction;
use crate::steering::yaw;

/// `MISSION_ITEM_REACHED` of the last item is told again after this \[s\], so often: clients count what is reached, and some
/// wait for the last item for ever.
const REPETITION_SECS: f64 = 0.25;
const REPETITIONS: u8 = 3;

/// The last item of a mission that was reached.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reached {
    sequence: u16,
    sent_secs: f64,
    repetitions: u8,
}

impl<P: PolicyBackend> Vehicle<P> {
    /// Whether a mission is flown.
    pub(super) fn on_mission(&self) -> bool {
        self.runner.phase() == MissionPhase::Active
    }

    pub(super) fn handle_mission(&mut self, request: &mission::received::MissionRequest, sender: [u8; 2]) {
        let now_secs = self.elapsed_secs();
        if request.changes_plans() && !self.may_change(sender) {
            if let Some(plan) = request.plan() {
                let denied = MavMissionResult::MAV_MISSION_DENIED;
                self.controller.answer(mission::sent::acknowledge(plan, denied, 0, sender));
            }
            return;
        }
        let controller = &mut self.controller;
        let event = self.plans.handle(request, sender, now_secs, &mut |payload| controller.answer(payload));
        match event {
            None | Some(MissionEvent::Replaced(PlanKind::Rally)) => {}
            Some(MissionEvent::Replaced(PlanKind::Mission)) => self.forget_mission(),
            Some(MissionEvent::Replaced(PlanKind::Fence)) => {
                self.controller.autopilot_mut().enclose(self.plans.zones().clone());
            }
            Some(MissionEvent::Cleared) => {
                self.forget_mission();
                self.controller.autopilot_mut().enclose(self.plans.zones().clone());
            }
            Some(MissionEvent::JumpTo(sequence)) => self.jump(sequence),
        }
    }

    /// Goes on with an item of the mission, and says so.
    pub(super) fn jump(&mut self, sequence: u16) {
        self.runner.jump(sequence, self.plans.legs());
        self.controller.answer(self.mission_current());
    }

    /// Which item of the mission is next.
    pub(super) fn mission_current(&self) -> Payload {
        mission::sent::current(self.plans.legs().len(), self.plans.identifiers(), &self.runner)
    }

    /// There is another mission, or none: holds, if the former one was flown.
    fn forget_mission(&mut self) {
        if self.on_mission() {
            // Refused while landing: then it lands.
            let _ = self.controller.autopilot_mut().command(Command::Pause);
        }
        self.runner.reset();
        self.directive = None;
        self.reached = None;
    }

    /// Starts the mission, or goes on with it.
    ///
    /// # Errors
    /// If there is none, or motors may not turn.
    pub(super) fn start_mission(&mut self) -> Result<(), Refusal> {
        if !self.mode().armed() {
            return Err(Refusal::NotArmed);
        }
        let paused = self.runner.phase() == MissionPhase::Paused;
        if paused {
            self.runner.resume();
        } else if !self.runner.start(self.plans.legs()) {
            return Err(Refusal::NoMission);
        }
        self.directive = None;
        Ok(())
    }

    /// A client's commands have the authority from now on.
    pub(super) fn pause_mission(&mut self) {
        self.runner.pause();
        self.directive = None;
    }

    /// Has the autopilot do what the mission wants, if it wants something new.
    pub(super) fn fly_mission(&mut self, state: &State<f32>) {
        if self
            .autopilot()
            .events()
            .iter()
            .any(|event| event.reaction(self.autopilot().settings()).action > FailsafeAction::Warn)
            || !self.mode().armed()
        {
            self.pause_mission();
        }
        if !self.on_mission() {
            return;
        }
        let situation = MissionInput {
            position: state.position,
            heading: yaw(&state.world_from_body),
            motion: self.motion(),
            secs: self.elapsed_secs(),
        };
        let mut reached = heapless::Vec::<u16, { mission::MISSION_ITEMS }>::new();
        let directive =
            self.runner.advance(self.plans.legs(), &situation, &mut |sequence| reached.extend([sequence]));
        for sequence in reached {
            self.controller.answer(mission::sent::reached(sequence));
            self.reached = Some(Reached { sequence, sent_secs: self.elapsed_secs(), repetitions: REPETITIONS });
        }
        if self.directive == Some(directive) {
            return;
        }
        self.directive = Some(directive);
        if let Err(refusal) = self.direct(directive, state) {
            self.pause_mission();
            self.controller.answer(sent::status_text(MavSeverity::MAV_SEVERITY_WARNING, "mission paused"));
            self.send_status_text(Some(refusal.text()));
        }
    }

    /// Tells again what was reached last.
    pub(super) fn repeat_reached(&mut self) {
        let now_secs = self.elapsed_secs();
        let due = |reached: &Reached| reached.repetitions > 0 && now_secs - reached.sent_secs >= REPETITION_SECS;
        let Some(Reached { sequence, repetitions, .. }) = self.reached.filter(due) else { return };
        self.controller.answer(mission::sent::reached(sequence));
        self.reached = Some(Reached { sequence, sent_secs: now_secs, repetitions: repetitions - 1 });
    }

    fn motion(&self) -> DroneMotion {
        if !self.mode().flies() {
            DroneMotion::OnGround
        } else if self.autopilot().goal().arrived() && self.mode() != Mode::TakingOff {
            DroneMotion::Resting
        } else {
            DroneMotion::Travelling
        }
    }

    fn direct(&mut self, directive: Directive, state: &State<f32>) -> Result<(), Refusal> {
        let command = match directive {
            Directive::TakeOff { altitude_m: None } => {
                Command::TakeOff { altitude_m: self.autopilot().settings().takeoff_altitude_m }
            }
            Directive::TakeOff { altitude_m: Some(height_m) } => {
                Command::TakeOff { altitude_m: height_m - state.position.z }
            }
            Directive::HeadFor { point, speed, heading } => {
                self.head_for(point, speed)?;
                return heading.map_or(Ok(()), |heading| self.face(heading));
            }
            Directive::Face { heading } => return self.face(heading),
            Directive::Return => Command::Return,
            Directive::Land => Command::Land,
            Directive::Done if self.mode().flies() && self.mode() != Mode::Landing => Command::Pause,
            Directive::Wait | Directive::Done => return Ok(()),
        };
        self.controller.autopilot_mut().command(command)
    }
    fn head_for(&mut self, point: Vector3<f32>, speed: Option<f32>) -> Result<(), Refusal> {
        let speed = speed.unwrap_or(self.parameters.settings().cruise_speed).clamp(SPEED_MINIMUM, SPEED_LIMIT);
        let autopilot = self.controller.autopilot_mut();
        autopilot.command(Command::Speed(speed))?;
        autopilot.command(Command::GoTo(point))
    }

    fn face(&mut self, heading: f32) -> Result<(), Refusal> {
        self.controller.autopilot_mut().face(Facing::Toward(heading))
    }
}
