//! Who has the say where several speak to a vehicle: one of them at a time, unless `RL_ONE_OPERATOR` says otherwise.
//!
//! A ground station may ask for control (`MAV_CMD_REQUEST_OPERATOR_CONTROL`); it has it until it gives it back or falls silent,
//! and meanwhile nobody else is obeyed. Most clients never ask: who flies the drone has the control then, until it is
//! disarmed. Others may still have it hold, return, land or stop, and whoever asks for the control gets it.

use kestrel_onboard::acknowledgement::CommandAnswer;
use kestrel_onboard::order::Order;
use kestrel_onboard::repetition::Sender;

use super::{TaskPhase, Vehicle};
use crate::autopilot::{Command, Refusal};
use crate::frame::Payload;
use crate::message::sent::status::{self, ControlStatus};
use crate::policy_backend::PolicyBackend;
use crate::request::CommandRequest;

/// `MAV_CMD_REQUEST_OPERATOR_CONTROL`.
pub(super) const REQUEST_CONTROL: u16 = 32_100;

/// Somebody who commands a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operator {
    /// A MAVLink system.
    System(u8),
    /// The client of a Crazyflie's protocol.
    CrazyflieClient,
}

/// What is asked of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Purpose {
    /// To fly: whoever does has the control.
    Fly,
    /// To change what is not flown.
    Change,
    /// To be still, where it is or on the ground.
    Stop,
}

/// How the control was come by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Claim {
    /// By flying.
    Flying,
    /// By asking for it; others get it on request, or do not.
    Asked { takeover_allowed: bool },
}

#[derive(Clone, Copy, Debug)]
struct Holder {
    operator: Operator,
    claim: Claim,
    heard_secs: f64,
}

/// Who has it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Control {
    holder: Option<Holder>,
    /// Who spoke first.
    first: Option<Operator>,
    /// Whether others spoke, too, or one asked for the control: then it matters who has it.
    matters: bool,
}

impl Purpose {
    /// Of a command.
    pub(super) const fn of(command: Command) -> Self {
        match command {
            Command::StopMotors | Command::Pause | Command::Return | Command::Land => Self::Stop,
            Command::Disarm | Command::SelectController(_) | Command::Speed(_) => Self::Change,
            Command::Arm
            | Command::TakeOff { .. }
            | Command::GoTo(_)
            | Command::Velocity(_)
            | Command::Offboard => Self::Fly,
        }
    }

    /// Of an order.
    pub(super) const fn of_order(order: &Order) -> Self {
        match order {
            Order::Execute(command) => Self::of(*command),
            Order::SelectController(_) => Self::Change,
            Order::Hold => Self::Stop,
            Order::Mission => Self::Fly,
        }
    }
}

impl Control {
    /// Who has it, and whether others get it on request.
    fn status(&self) -> ControlStatus {
        let system = |operator| match operator {
            Operator::System(system) => system,
            // A system like any other, with a number that none has.
            Operator::CrazyflieClient => 254,
        };
        ControlStatus {
            system_in_control: self.holder.map_or(0, |holder| system(holder.operator)),
            takeover_allowed: self.holder.is_none_or(|holder| holder.claim.yields()),
        }
    }
}

impl Claim {
    /// Whether another one gets the control who asks for it.
    const fn yields(self) -> bool {
        match self {
            Self::Flying => true,
            Self::Asked { takeover_allowed } => takeover_allowed,
        }
    }
}

impl<P: PolicyBackend> Vehicle<P> {
    /// Whether an operator may do something.
    ///
    /// # Errors
    /// If another one has the control.
    pub(super) fn permit(&self, operator: Operator, purpose: Purpose) -> Result<(), Refusal> {
        let Some(holder) = self.control.holder.filter(|_| self.has_one_operator()) else { return Ok(()) };
        let stops = purpose == Purpose::Stop && holder.claim == Claim::Flying;
        if holder.operator == operator || stops { Ok(()) } else { Err(Refusal::OtherOperator) }
    }

    fn has_one_operator(&self) -> bool {
        self.parameters.parameters().has_one_operator()
    }

    /// An operator has done what it was permitted to.
    pub(super) fn note_done(&mut self, operator: Operator, purpose: Purpose) {
        if !self.has_one_operator() {
            return;
        }
        match (purpose, &self.control.holder) {
            (Purpose::Fly, None) => {
                let heard_secs = self.elapsed_secs();
                self.control.holder = Some(Holder { operator, claim: Claim::Flying, heard_secs });
            }
            // No stream of the one who flies undoes it.
            (Purpose::Stop, Some(holder)) if holder.operator != operator => {
                self.controller.autopilot_mut().distrust_streams();
            }
            (Purpose::Fly | Purpose::Change | Purpose::Stop, _) => {}
        }
    }

    /// Executes a command of an operator, if it may command.
    pub(super) fn execute_as(
        &mut self,
        operator: Operator,
        purpose: Purpose,
        execute: impl FnOnce(&mut Self) -> CommandAnswer,
    ) -> CommandAnswer {
        if let Err(refusal) = self.permit(operator, purpose) {
            return Err(refusal).into();
        }
        let answer = execute(self);
        if answer == CommandAnswer::ACCEPTED {
            self.note_done(operator, purpose);
        }
        answer
    }

    /// Whether a system may change what is not flown; if not, it is told so.
    pub(super) fn may_change(&mut self, [system, _]: [u8; 2]) -> bool {
        let outcome = self.permit(Operator::System(system), Purpose::Change);
        self.send_status_text(outcome.err().map(Refusal::text));
        outcome.is_ok()
    }

    /// Whether all are to be told who has the control. A client that is alone has no use for it, and few know the message.
    pub(super) fn tells_control(&self) -> bool {
        self.control.matters
    }

    /// An operator is there.
    pub(super) fn note_heard(&mut self, operator: Operator) {
        let now_secs = self.elapsed_secs();
        self.control.matters |= *self.control.first.get_or_insert(operator) != operator;
        if let Some(holder) = self.control.holder.as_mut().filter(|holder| holder.operator == operator) {
            holder.heard_secs = now_secs;
        }
    }

    /// Takes the control from who is silent, or has landed.
    pub(super) fn tend_control(&mut self) {
        let Some(Holder { claim, heard_secs, .. }) = self.control.holder else { return };
        let silent_secs = self.elapsed_secs() - heard_secs;
        // A task that was asked for arms the drone itself.
        let launches = matches!(self.task, Some((TaskPhase::Asked(_) | TaskPhase::Launching(_), _)));
        let has_landed = claim == Claim::Flying && !self.mode().armed() && !launches;
        if has_landed || silent_secs > f64::from(self.autopilot().settings().link_loss_secs) {
            self.hand_to(None);
        }
    }

    /// Answers `MAV_CMD_REQUEST_OPERATOR_CONTROL`.
    pub(super) fn ask_for_control(&mut self, request: &CommandRequest, sender: Sender) -> CommandAnswer {
        let [_, action, takeover, _] = request.parameters;
        let [system, _] = sender.address;
        let operator = Operator::System(system);
        self.control.matters = true;
        let held_by_other = self.control.holder.filter(|holder| holder.operator != operator);
        match action {
            0.0 if held_by_other.is_none() => self.hand_to(None),
            1.0 if held_by_other.is_none_or(|holder| holder.claim.yields()) => {
                let claim = Claim::Asked { takeover_allowed: takeover == 1.0 };
                self.hand_to(Some(Holder { operator, claim, heard_secs: self.elapsed_secs() }));
            }
            0.0 => return Err(Refusal::OtherOperator).into(),
            1.0 => {
                if let Some(Holder { operator: Operator::System(holder), .. }) = held_by_other {
                    self.notices.push(status::request_for_control(request.parameters, system, holder));
                }
                return Err(Refusal::OtherOperator).into();
            }
            _ => return CommandAnswer::denied("command refused: unknown parameter 2"),
        }
        CommandAnswer::ACCEPTED
    }

    /// Gives the control away, and tells everybody.
    fn hand_to(&mut self, holder: Option<Holder>) {
        self.control.holder = holder;
        if self.control.matters {
            self.notices.push(self.control_status());
        }
    }

    /// `CONTROL_STATUS`.
    pub(super) fn control_status(&self) -> Payload {
        status::control_status(self.control.status())
    }
}
