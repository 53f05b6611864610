//! Drones and physics by the names that recordings give them.

use std::collections::BTreeMap;

use kestrel_core::airframe::{Airframe, CF2P, CF2X, HUMMINGBIRD, RACER, RotorOrder};
use kestrel_core::reference::bullet::BulletMode;
use serde::Deserialize;

use super::error::RecordingError;
use super::index::Part;

/// The physics of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Physics {
    /// Bullet.
    Pyb,
    /// Bullet with ground effect.
    PybGnd,
    /// Bullet with drag.
    PybDrag,
    /// Bullet with downwash.
    PybDw,
    /// Bullet with all three.
    PybGndDragDw,
    /// The explicit model.
    Dyn,
}

impl Physics {
    /// Its mode in the core.
    pub fn mode(self) -> BulletMode {
        match self {
            Self::Pyb => BulletMode::Pyb,
            Self::PybGnd => BulletMode::PybGnd,
            Self::PybDrag => BulletMode::PybDrag,
            Self::PybDw => BulletMode::PybDw,
            Self::PybGndDragDw => BulletMode::PybGndDragDw,
            Self::Dyn => BulletMode::Dyn,
        }
    }

    /// As recordings write it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pyb => "pyb",
            Self::PybGnd => "pyb_gnd",
            Self::PybDrag => "pyb_drag",
            Self::PybDw => "pyb_dw",
            Self::PybGndDragDw => "pyb_gnd_drag_dw",
            Self::Dyn => "dyn",
        }
    }

    /// All, the longer of two names with the same end first.
    pub(super) const ALL: [Self; 6] =
        [Self::PybGndDragDw, Self::PybGnd, Self::PybDrag, Self::PybDw, Self::Pyb, Self::Dyn];
}

/// Who numbered the rotors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Publisher {
    /// gym-pybullet-drones since August 2025.
    Upstream,
    /// The thesis's fork, and gym-pybullet-drones before.
    Fork,
}

/// The drones that recordings may name.
#[derive(Clone, Debug, Default)]
pub struct Models(BTreeMap<String, Airframe>);

impl Models {
    /// One more drone, or another one under a known name; its rotors keep their order.
    pub fn insert(&mut self, name: String, airframe: Airframe) {
        self.0.insert(name, airframe);
    }

    /// The drone of that name with its rotors in the publisher's order.
    pub(super) fn find(&self, name: &str, publisher: Publisher) -> Option<Airframe> {
        let reversed = |airframe: Airframe| airframe.numbered(RotorOrder::CounterClockwise);
        let known = match (name, publisher) {
            ("cf2x", Publisher::Upstream) => Some(CF2X),
            ("cf2x", Publisher::Fork) => Some(reversed(CF2X)),
            ("cf2p", _) => Some(reversed(CF2P)),
            ("hb", _) => Some(HUMMINGBIRD),
            ("racer", _) => Some(RACER),
            _ => None,
        };
        self.0.get(name).copied().or(known)
    }

    /// Upstream's drone of a case.
    ///
    /// # Errors
    /// When nothing is known by that name.
    pub(super) fn of_case(&self, name: &str, part: &Part<'_>) -> Result<Airframe, RecordingError> {
        self.find(name, Publisher::Upstream).ok_or_else(|| {
            part.refuse(
                format_args!("the model {name:?}"),
                "cf2x, cf2p, hb, racer or one given as --airframe NAME=FILE",
            )
        })
    }
}
