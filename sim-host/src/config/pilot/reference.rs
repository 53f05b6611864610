//! The actions of the reference system as users write them.

use kestrel_core::action::{Persistence, ReferenceActionKind, ReferenceActions, ReferenceController};
use kestrel_core::airframe::{Airframe, CF2X, HUMMINGBIRD, Layout, RotorOrder};
use kestrel_core::reference::controller::command::Precision;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// An action type of gym-pybullet-drones. Its numbers are limited to -1 to 1 like all actions; nothing else is.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ReferenceActionConfig {
    /// Which of them.
    pub kind: ReferenceActionKindConfig,
    /// Where the reference computes in single precision; it matters in comparisons with recordings only.
    pub precision: ReferencePrecisionConfig,
    /// Who flies towards positions and velocities. Left out: `simple` for the Hummingbird, `cf2x` for all others, as in
    /// the reference.
    pub controller: Option<ReferenceControllerConfig>,
    /// Whether controllers remember what they have integrated when an episode ends, as they do in the reference.
    pub controllers_persist: bool,
}

/// The action types of gym-pybullet-drones, with its names in brackets.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReferenceActionKindConfig {
    /// Four rotor speeds within 5 % of hover (RPM).
    #[default]
    Rpm,
    /// Thrust and torques (DYN, before 2023).
    Dyn,
    /// A position up to 0.1 m away (PID, before 2023).
    Pid,
    /// Direction of flight and share of the greatest speed (VEL).
    Vel,
    /// Six gains of a controller that follows the task's moving target (TUN, before 2023).
    Tun,
    /// One speed for all rotors (`ONE_D_RPM`).
    OneDRpm,
    /// Thrust alone (`ONE_D_DYN`, before 2023).
    OneDDyn,
    /// A height up to 0.1 m above or below (`ONE_D_PID`).
    OneDPid,
    /// A position in the world, a metre around the origin (PID, since 2023).
    Waypoint,
}

/// Where actions are computed in single precision.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReferencePrecisionConfig {
    /// Nowhere.
    #[default]
    Exact,
    /// As upstream does.
    Single,
    /// As the thesis's fork does.
    AllSingle,
}

/// The reference's controllers.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReferenceControllerConfig {
    /// `DSLPIDControl` for `cf2x`, whatever flies: its rotors in the order of the drone's if that is a cross too, else
    /// clockwise.
    Cf2x,
    /// `DSLPIDControl` for the `cf2x` of the thesis's fork, whose rotors are numbered counter-clockwise, whatever flies.
    ForkCf2x,
    /// `DSLPIDControl` for the drone that flies.
    Own,
    /// `SimplePIDControl` for the drone that flies.
    Simple,
}

impl ReferenceActionConfig {
    /// The action space of `airframe`.
    pub(super) fn check(&self, airframe: &Airframe) -> ReferenceActions {
        ReferenceActions {
            kind: self.kind.check(),
            precision: match self.precision {
                ReferencePrecisionConfig::Exact => Precision::Exact,
                ReferencePrecisionConfig::Single => Precision::Single,
                ReferencePrecisionConfig::AllSingle => Precision::AllSingle,
            },
            airframe: *airframe,
            controller: self.controller.unwrap_or_else(|| usual_controller(airframe)).check(airframe),
            persistence: if self.controllers_persist {
                Persistence::Persist
            } else {
                Persistence::ResetEachEpisode
            },
        }
    }
}

fn usual_controller(airframe: &Airframe) -> ReferenceControllerConfig {
    if airframe.numbered(HUMMINGBIRD.rotor_order) == HUMMINGBIRD {
        ReferenceControllerConfig::Simple
    } else {
        ReferenceControllerConfig::Cf2x
    }
}

impl ReferenceControllerConfig {
    fn check(self, airframe: &Airframe) -> ReferenceController {
        let order = match airframe.layout {
            Layout::Cross { .. } => airframe.rotor_order,
            Layout::Plus { .. } => CF2X.rotor_order,
        };
        match self {
            Self::Cf2x => ReferenceController::Dsl(CF2X.numbered(order)),
            Self::ForkCf2x => ReferenceController::Dsl(CF2X.numbered(RotorOrder::CounterClockwise)),
            Self::Own => ReferenceController::Dsl(*airframe),
            Self::Simple => ReferenceController::Simple(*airframe),
        }
    }
}

impl ReferenceActionKindConfig {
    const fn check(self) -> ReferenceActionKind {
        match self {
            Self::Rpm => ReferenceActionKind::Rpm,
            Self::Dyn => ReferenceActionKind::Dyn,
            Self::Pid => ReferenceActionKind::Pid,
            Self::Vel => ReferenceActionKind::Vel,
            Self::Tun => ReferenceActionKind::Tun,
            Self::OneDRpm => ReferenceActionKind::OneDRpm,
            Self::OneDDyn => ReferenceActionKind::OneDDyn,
            Self::OneDPid => ReferenceActionKind::OneDPid,
            Self::Waypoint => ReferenceActionKind::Waypoint,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kestrel_core::airframe::CF2P;

    fn space(text: &str, airframe: &Airframe) -> ReferenceActions {
        let config: ReferenceActionConfig = serde_yaml::from_str(text).unwrap();
        config.check(airframe)
    }

    #[test]
    fn the_keys_are_the_cores_names() {
        for kind in ReferenceActionKind::ALL {
            assert_eq!(space(&format!("kind: {}", kind.name()), &CF2X).kind, kind);
        }
    }

    #[test]
    fn controllers_are_the_references_unless_chosen() {
        assert_eq!(space("kind: pid", &CF2X).controller, ReferenceController::Dsl(CF2X));
        assert_eq!(space("kind: pid", &CF2P).controller, ReferenceController::Dsl(CF2X));
        assert_eq!(space("kind: pid", &HUMMINGBIRD).controller, ReferenceController::Simple(HUMMINGBIRD));
        let mirrored = CF2X.numbered(RotorOrder::CounterClockwise);
        assert_eq!(space("kind: pid", &mirrored).controller, ReferenceController::Dsl(mirrored));
        assert_eq!(space("controller: fork_cf2x", &CF2P).controller, ReferenceController::Dsl(mirrored));
        assert_eq!(space("controller: own", &CF2P).controller, ReferenceController::Dsl(CF2P));
        assert_eq!(space("controllers_persist: true", &CF2P).persistence, Persistence::Persist);
    }
}
