//! Between a server and its vehicle: what it sees, what it orders, what it sends.

use kestrel_core::vehicle::State;

use super::packet::Packet;
use crate::autopilot::{Command, Mode, Refusal};
use crate::goal::MovingGoal;
use crate::plant::Ranges;

/// What the autopilot answers, and what it is doing since.
#[derive(Clone, Copy, Debug)]
pub struct CommandOutcome {
    /// Whether it obeys.
    pub result: Result<(), Refusal>,
    /// What it is doing.
    pub mode: Mode,
    /// Where it is going.
    pub goal: MovingGoal,
}

/// What a client's server has the vehicle do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClientOrder {
    /// Execute a command, if the client has the control.
    Command(Command),
    /// Stop the motors, whoever has it.
    EmergencyStop,
}

/// The vehicle and the client of a server, for the time of one call.
pub struct VehicleAccess<'a> {
    /// Simulated time since the start \[s\].
    pub secs: f64,
    /// True state.
    pub state: &'a State<f32>,
    /// What rangers measure, if the drone has some.
    pub ranges: Option<Ranges>,
    /// What the autopilot is doing.
    pub mode: Mode,
    /// Where it is going.
    pub goal: MovingGoal,
    /// Has the vehicle obey.
    pub order: &'a mut dyn FnMut(ClientOrder) -> CommandOutcome,
    /// Sends a packet to the client, if there is one.
    pub send: &'a mut dyn FnMut(&Packet),
}

impl VehicleAccess<'_> {
    /// Has the autopilot execute a command, and sees what it is doing since.
    ///
    /// # Errors
    /// As [`crate::autopilot::Autopilot::command`].
    pub fn order(&mut self, command: Command) -> Result<(), Refusal> {
        self.have(ClientOrder::Command(command))
    }

    /// Stops the motors.
    pub fn stop_in_emergency(&mut self) {
        // It is always obeyed.
        let _stopped = self.have(ClientOrder::EmergencyStop);
    }

    fn have(&mut self, order: ClientOrder) -> Result<(), Refusal> {
        let CommandOutcome { result, mode, goal } = (self.order)(order);
        self.mode = mode;
        self.goal = goal;
        result
    }

    /// Simulated time since the start \[ms\].
    pub fn millis(&self) -> u64 {
        libm::round(self.secs * 1e3) as u64
    }
}
