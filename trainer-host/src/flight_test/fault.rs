//! What goes wrong in a flight, and when.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Something that goes wrong for a while.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fault {
    /// When it begins \[s\].
    pub(crate) at_secs: f64,
    /// When it ends \[s\]; infinite if it does not.
    pub(crate) until_secs: f64,
    /// What it is.
    pub(crate) kind: FaultKind,
}

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum FaultKind {
    /// No frame passes between the ground station and the vehicle.
    LinkLoss,
    /// What the vehicle knows of its state.
    Estimate(EstimateFault),
    /// A rotor turns no faster than a share of its greatest speed.
    Motor {
        /// Counted from 0, in the order of the airframe.
        rotor: usize,
        /// Of the greatest speed.
        share: f32,
    },
    /// A rotor makes a share of its thrust, or all of them do.
    Thrust {
        /// Counted from 0, in the order of the airframe; all where there is none.
        rotor: Option<usize>,
        /// Of its thrust.
        share: f32,
    },
    /// So much more is carried \[kg\].
    Load(f64),
    /// So much is left of the battery, of one.
    Battery(f32),
    /// Wind beside that of the flight \[m/s, world\].
    Gust(Vector3<f64>),
    /// What the policy does.
    Policy(PolicyFault),
}

/// What the vehicle knows of its state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum EstimateFault {
    /// What it knew when the fault began, again and again.
    Frozen,
    /// Nothing: no number is finite.
    Lost,
}

/// What a policy does that fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PolicyFault {
    /// It gives no answer.
    Silent,
    /// Its answers are no numbers.
    Nan,
    /// It wants every rotor at its greatest speed.
    Saturated,
    /// Its file is damaged: it fails its self-test, and gives no answer.
    Damaged,
}

impl Fault {
    /// Whether it acts at a time \[s\]; times are sums of rounded periods, of which half a one, `grace_secs`, is forgiven.
    pub(crate) fn acts_at(&self, secs: f64, grace_secs: f64) -> bool {
        (self.at_secs..self.until_secs).contains(&(secs + grace_secs))
    }
}
