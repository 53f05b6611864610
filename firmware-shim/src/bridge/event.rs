//! What happens on a simulator bridge, for its callbacks.

use std::fmt;
use std::net::SocketAddr;

use kestrel_core::vehicle::State;

/// What happens on a bridge.
#[derive(Clone, Copy, Debug)]
pub enum BridgeEvent<'a> {
    /// No autopilot is there yet, or no more; reported again and again.
    Waiting,
    /// An autopilot speaks from this address.
    Connected(SocketAddr),
    /// It commands the motors for the first time: from now on every step waits for it.
    Engaged,
    /// A step was made.
    Stepped(BridgeStep<'a>),
    /// It did not answer in time; the step was made with its last command.
    Unanswered,
    /// It has gone; the simulation stands still.
    Gone,
}

/// One step of the simulation.
#[derive(Clone, Copy, Debug)]
pub struct BridgeStep<'a> {
    /// Simulated time at its end \[s\].
    pub secs: f64,
    /// True state at its end.
    pub state: &'a State<f32>,
    /// What the rotors were told \[rad/s\].
    pub rotor_targets: [f32; 4],
}

/// What became of the steps so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BridgeCounts {
    /// Steps that were made.
    pub steps: u64,
    /// Of those, steps that an autopilot commanded.
    pub answered: u64,
    /// Of those, steps that it left unanswered although it had commanded before.
    pub unanswered: u64,
    /// Frames and datagrams that were none.
    pub garbage: u64,
    /// Connections, of a restarted autopilot for instance.
    pub connections: u64,
}

impl fmt::Display for BridgeCounts {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { steps, answered, unanswered, garbage, connections } = self;
        write!(
            formatter,
            "{steps} steps, {answered} commanded, {unanswered} unanswered; {connections} connections; {garbage} pieces of garbage"
        )
    }
}
