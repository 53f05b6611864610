//! The task of a plant: begun by a peer, flown by its policy, told when it ends.
//!
//! `MAV_CMD_USER_1` (31010) asks for it; its first parameter is the number of the start, NaN the one after the last. Whoever
//! asks on the ground has the drone armed and in flight first. Any command that says where to fly ends it.

use kestrel_onboard::acknowledgement::CommandAnswer;
use kestrel_onboard::plant::{Plant, TaskEnding};
use mavlink::dialects::common::MavSeverity;

use super::Vehicle;
use crate::autopilot::{Command, Refusal};
use crate::battery::Battery;
use crate::controller::Controller;
use crate::message::sent;
use crate::message::sent::events::EventContent;
use crate::policy_backend::PolicyBackend;

/// Largest number of a start: floats count so far.
const STARTS: f32 = 16_777_216.0;

/// Height of the take-off that no one sees \[m\]: the plant takes the drone to its start at once.
const ALTITUDE_M: f32 = 1.0;

/// What the policy of a vehicle with a task flies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PolicyRole {
    /// The task alone: on the way to set-points the cascade flies.
    TaskAlone,
    /// What peers command, too.
    SetPointsToo,
}

/// Where the task stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TaskPhase {
    /// Nothing is flown; the start that comes next.
    Idle(u32),
    /// From this start, as soon as the drone flies.
    Asked(u32),
    /// The drone has been put to where it is launched.
    Launching(u32),
    /// From this start.
    Flying(u32),
    /// A command has ended it; the start that comes next.
    Stopped(u32),
}

impl<P: PolicyBackend> Vehicle<P> {
    /// Lets peers ask for the task of the plant.
    pub fn offer_task(&mut self, role: PolicyRole) {
        self.task = Some((TaskPhase::Idle(0), role));
    }

    /// Answers `MAV_CMD_USER_1`.
    pub(super) fn ask_for_task(&mut self, start: f32) -> CommandAnswer {
        let Some((phase, _)) = self.task else {
            return CommandAnswer::denied("refused: this vehicle has no task");
        };
        let next = match phase {
            TaskPhase::Idle(next) | TaskPhase::Stopped(next) => next,
            TaskPhase::Asked(_) | TaskPhase::Launching(_) | TaskPhase::Flying(_) => {
                return CommandAnswer::denied("refused: the task is being flown");
            }
        };
        let start = if start.is_nan() { next as f32 } else { start };
        if !(0.0..STARTS).contains(&start) || start != libm::truncf(start) {
            return CommandAnswer::denied("refused: no number of a start");
        }
        self.enter_phase(TaskPhase::Asked(start as u32));
        CommandAnswer::ACCEPTED
    }

    /// A peer wants something else.
    pub(super) fn stop_task(&mut self) {
        match self.task {
            Some((TaskPhase::Flying(start), _)) => self.enter_phase(TaskPhase::Stopped(start + 1)),
            // The command came before the task had begun.
            Some((TaskPhase::Asked(start), _)) => self.enter_phase(TaskPhase::Stopped(start)),
            Some((TaskPhase::Idle(_) | TaskPhase::Launching(_) | TaskPhase::Stopped(_), _)) | None => {}
        }
    }

    fn enter_phase(&mut self, next: TaskPhase) {
        if let Some((phase, _)) = &mut self.task {
            *phase = next;
        }
    }

    /// What is due before a tick: begins or ends the task of `plant`.
    pub fn tend_task(&mut self, plant: &mut dyn Plant) {
        let Some((phase, role)) = self.task else { return };
        if role == PolicyRole::TaskAlone && !self.mode().flies() {
            // Before the first state is known, and no one has asked for anything, it is refused.
            let _chosen = self.order(Command::SelectController(Controller::Cascade));
        }
        match phase {
            TaskPhase::Idle(_) => {}
            TaskPhase::Asked(start) if self.mode().flies() => self.begin_task(start, plant),
            TaskPhase::Asked(start) => {
                plant.reset();
                self.battery = Battery::full();
                self.enter_phase(TaskPhase::Launching(start));
            }
            TaskPhase::Launching(start) => match self.launch() {
                Ok(()) => self.begin_task(start, plant),
                Err(refusal) => {
                    self.enter_phase(TaskPhase::Idle(start));
                    self.send_status_text(Some(refusal.text()));
                }
            },
            TaskPhase::Flying(start) => {
                if let Some(ending) = plant.take_ending() {
                    self.enter_phase(TaskPhase::Idle(start + 1));
                    self.hold_after(start, &ending);
                }
            }
            TaskPhase::Stopped(next) => {
                plant.end_task();
                self.enter_phase(TaskPhase::Idle(next));
                self.controller.answer(sent::status_text(MavSeverity::MAV_SEVERITY_INFO, "task stopped"));
                self.tell_event(EventContent::TaskStopped);
            }
        }
    }

    fn launch(&mut self) -> Result<(), Refusal> {
        self.order(Command::Arm)?;
        self.order(Command::TakeOff { altitude_m: ALTITUDE_M })
    }

    fn begin_task(&mut self, start: u32, plant: &mut dyn Plant) {
        plant.begin_task(start);
        self.battery = Battery::full();
        self.enter_phase(TaskPhase::Flying(start));
        let text = format!("task begun from start {start}");
        self.controller.answer(sent::status_text(MavSeverity::MAV_SEVERITY_INFO, &text));
        self.tell_event(EventContent::TaskBegun { start });
    }

    /// Says how it ended, and holds where the drone is, if it still flies.
    fn hold_after(&mut self, start: u32, ending: &TaskEnding) {
        let TaskEnding { success, cause, secs } = *ending;
        let verdict = if success { "success" } else { "failure" };
        let text = format!("task {start}: {verdict}, {cause}, {secs:.2} s");
        self.controller.answer(sent::status_text(MavSeverity::MAV_SEVERITY_NOTICE, &text));
        self.tell_event(EventContent::TaskEnded { start, success, secs });
        self.controller.autopilot_mut().take_over();
    }
}
