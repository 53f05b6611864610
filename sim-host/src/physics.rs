//! How time advances: whose physics, in which steps, and what contacts do.

use kestrel_core::dynamics::Integrator;
use kestrel_core::reference::bullet::{BulletMode, Quirks};
use kestrel_core::vehicle::Ground;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How time advances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Physics {
    /// Whose physics.
    pub preset: Preset,
    /// Substeps in one control period.
    pub substeps: u32,
    /// Actions per second \[Hz\].
    pub control_rate_hz: f64,
    /// What contacts do.
    pub contacts: Contacts,
}

/// Whose physics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Preset {
    /// The vehicle of the core: quaternion integration, first-order rotors, drag in the body frame.
    Clean {
        /// Integrator of each substep.
        integrator: Integrator,
        /// Whether rotors feel the floor.
        ground: Ground,
        /// Height of a ceiling that pulls the rotors up \[m\].
        ceiling: Option<f64>,
        /// Whether drones feel those above them.
        downwash: Downwash,
    },
    /// The reference system's, quirk by quirk.
    Bullet {
        /// What acts.
        mode: BulletMode,
        /// What is odd about it.
        quirks: Quirks,
    },
}

/// Whether drones feel the air that those above them push down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Downwash {
    /// They do.
    Felt,
    /// They do not.
    Absent,
}

/// What contacts do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Contacts {
    /// Nothing: drones pass through everything unseen.
    Absent,
    /// Rewards and terminations see them; drones pass through.
    Reported,
    /// Bodies push each other: resting, sliding, landing.
    Solved,
}

impl Physics {
    /// Kestrel's own physics without ground effect, ceiling and downwash; contacts are reported.
    pub fn clean(integrator: Integrator, substeps: u32, control_rate_hz: f64) -> Self {
        let preset =
            Preset::Clean { integrator, ground: Ground::Distant, ceiling: None, downwash: Downwash::Absent };
        Self { preset, substeps, control_rate_hz, contacts: Contacts::Reported }
    }

    /// Time between two actions \[s\].
    pub fn control_secs(&self) -> f32 {
        (1.0 / self.control_rate_hz) as f32
    }

    /// Time of one substep \[s\].
    pub fn substep_secs(&self) -> f64 {
        1.0 / (self.control_rate_hz * f64::from(self.substeps))
    }

    /// Whether drones of one environment push each other through the air.
    pub fn has_downwash(&self) -> bool {
        match self.preset {
            Preset::Clean { downwash, .. } => downwash == Downwash::Felt,
            Preset::Bullet { mode, .. } => mode.has_downwash(),
        }
    }
}
