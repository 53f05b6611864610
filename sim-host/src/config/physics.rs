//! How time advances.

use kestrel_core::dynamics::Integrator;
use kestrel_core::reference::bullet::{
    AttitudeUpdate, BulletMode, DownwashAxis, DragFrame, DragRotors, DynAttitude, DynLevers, DynReport,
    GroundQuery, LinkAttitude, Quirks, RotorPrecision,
};
use kestrel_core::vehicle::Ground;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::ConfigError;
use super::field::{Field, Limits};
use crate::physics::{Contacts, Downwash, Physics, Preset};
use crate::termination::Termination;

/// Fewest physics steps per second: rotors with a time constant of 0.07 s need them.
const STEPS_PER_SECOND_LEAST: f64 = 50.0;

/// How time advances.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PhysicsConfig {
    /// Integrator of each substep, of Kestrel's own physics.
    pub integrator: IntegratorConfig,
    /// Physics steps in one control period.
    pub substeps: u64,
    /// Actions per second.
    pub control_rate_hz: f64,
    /// Whether the ground at z = 0 cushions the rotors, in Kestrel's own physics.
    pub ground_effect: bool,
    /// Height of a ceiling that pulls the rotors up, in Kestrel's own physics; without it no ceiling does, whatever the room.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ceiling_effect_m: Option<f64>,
    /// Whether drones feel the air that those above push down, in Kestrel's own physics.
    pub downwash: bool,
    /// What contacts do; by default they are only reported where touching anything ends the episode, and else solved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contacts: Option<Contacts>,
    /// The reference system's physics instead of Kestrel's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bullet: Option<BulletConfig>,
}

/// The integrators.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum IntegratorConfig {
    /// First order, one evaluation per substep: fast.
    #[default]
    SemiImplicitEuler,
    /// Fourth order, four evaluations per substep: exact to rounding at 1 kHz.
    #[serde(rename = "runge_kutta_4")]
    RungeKutta4,
}

/// The reference system's physics.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BulletConfig {
    /// What acts, by the reference's name.
    #[serde(default)]
    pub mode: ModeConfig,
    /// Whose quirks.
    #[serde(default)]
    pub version: VersionConfig,
    /// Quirks that differ from the version's, one by one.
    #[serde(default)]
    pub quirks: QuirksConfig,
}

/// What acts on a drone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModeConfig {
    /// Rotors only.
    #[default]
    Pyb,
    /// Rotors and ground effect.
    PybGnd,
    /// Rotors and drag.
    PybDrag,
    /// Rotors and the downwash of other drones.
    PybDw,
    /// Rotors, ground effect, drag and downwash.
    PybGndDragDw,
    /// Rotors, by the reference's own explicit model: no damping, no contacts.
    Dyn,
}

/// Published versions of the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum VersionConfig {
    /// The thesis's fork, 2022.
    #[default]
    Fork,
    /// gym-pybullet-drones 2.1.0, 2026.
    Upstream,
    /// None of the quirks.
    Sound,
}

/// Quirks of the reference; each key that is left out is as the version has it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct QuirksConfig {
    /// Coefficient k of the damping −v (k + k |v|), of velocities and body rates; Bullet's is 0.04.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub damping: Option<f64>,
    /// Whether thrusts are computed in single precision from speeds in RPM, as for actions of the kind RPM in the fork.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub single_precision_rotors: Option<bool>,
    /// Whether link-frame forces use the attitude of one physics step earlier.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attitude_lag: Option<bool>,
    /// Whether the ground effect's query of the rotors' heights ends that lag for drag and downwash.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground_query_refreshes_links: Option<bool>,
    /// In which frame drag coefficients meet the velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drag_frame: Option<DragFrameConfig>,
    /// Whether drag is computed from the rotor speeds of the physics step before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub late_drag_rotors: Option<bool>,
    /// Whether downwash pushes along the body's z axis rather than the world's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub downwash_along_body: Option<bool>,
    /// Height difference below which downwash grows no further; the reference has none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub downwash_nearest_m: Option<f64>,
    /// Horizontal distance from which there is no downwash.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub downwash_reach_m: Option<f64>,
    /// Greatest rotation in one physics step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rotation_cap_deg: Option<f64>,
    /// Greatest world component of velocity (m/s) and angular velocity (rad/s).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity_cap: Option<f64>,
    /// Whether attitudes advance by the exponential map rather than to first order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exponential_map: Option<bool>,
    /// Whether DYN integrates Euler angles with body rates.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dyn_euler_angles: Option<bool>,
    /// Whether DYN's levers are the nominal arm rather than the rotors' places.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dyn_nominal_arm: Option<bool>,
    /// What DYN reports as angular velocity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dyn_report: Option<DynReportConfig>,
}

/// In which frame drag coefficients meet the velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DragFrameConfig {
    /// The world's, and the product is turned into the body (upstream).
    ScaledInWorld,
    /// The world's, and the product is turned out of the body twice (fork).
    TurnedTwice,
    /// The body's.
    Body,
}

/// What DYN reports as angular velocity.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DynReportConfig {
    /// Body rates turned by the attitude before the step (upstream).
    PreviousAttitude,
    /// Minus one about each axis (fork).
    MinusOne,
    /// Body rates turned by the attitude after the step.
    Current,
}

impl Default for PhysicsConfig {
    fn default() -> Self {
        Self {
            integrator: IntegratorConfig::SemiImplicitEuler,
            substeps: 2,
            control_rate_hz: 100.0,
            ground_effect: false,
            ceiling_effect_m: None,
            downwash: false,
            contacts: None,
            bullet: None,
        }
    }
}

impl PhysicsConfig {
    /// The physics; with no choice about contacts the `terminations` decide.
    ///
    /// # Errors
    /// When a number is out of range, the physics steps are too long to be stable, or two keys contradict each other.
    pub fn check(&self, field: &Field<'_>) -> Result<Physics, ConfigError> {
        let substeps = field.at("substeps").whole(self.substeps, 1..=1000)?;
        field.at("control_rate_hz").number(self.control_rate_hz, &Limits::from(1.0, 1000.0, "Hz"))?;
        let least = (STEPS_PER_SECOND_LEAST / self.control_rate_hz).ceil();
        if (substeps as f64) < least {
            let expected = format!(
                "at least {least} at {} Hz, which makes 50 physics steps per second",
                self.control_rate_hz
            );
            return Err(field.at("substeps").refuse(substeps, expected));
        }
        Ok(Physics {
            preset: self.preset(field)?,
            substeps: substeps as u32,
            control_rate_hz: self.control_rate_hz,
            contacts: self.contacts.unwrap_or(Contacts::Solved),
        })
    }

    /// Leaves contacts unsolved where touching anything ends the episode, unless the file says otherwise.
    pub(crate) fn settle_contacts(&self, physics: &mut Physics, terminations: &[Termination]) {
        let asks = |contacts| terminations.iter().any(|rule| rule.contacts() == Some(contacts));
        if matches!(physics.preset, Preset::Bullet { mode: BulletMode::Dyn, .. }) {
            physics.contacts = Contacts::Absent;
        } else if self.contacts.is_none() && asks(Contacts::Reported) && !asks(Contacts::Solved) {
            physics.contacts = Contacts::Reported;
        }
    }

    fn preset(&self, field: &Field<'_>) -> Result<Preset, ConfigError> {
        let Some(bullet) = &self.bullet else {
            return Ok(Preset::Clean {
                integrator: match self.integrator {
                    IntegratorConfig::SemiImplicitEuler => Integrator::SemiImplicitEuler,
                    IntegratorConfig::RungeKutta4 => Integrator::RungeKutta4,
                },
                ground: if self.ground_effect { Ground::Near } else { Ground::Distant },
                ceiling: self.ceiling(field)?,
                downwash: if self.downwash { Downwash::Felt } else { Downwash::Absent },
            });
        };
        let own = [
            ("integrator", self.integrator != IntegratorConfig::SemiImplicitEuler),
            ("ground_effect", self.ground_effect),
            ("ceiling_effect_m", self.ceiling_effect_m.is_some()),
            ("downwash", self.downwash),
        ];
        if let Some((key, _)) = own.into_iter().find(|(_, chosen)| *chosen) {
            let expected = format!("no `{key}` beside `bullet`, whose mode says what acts");
            return Err(field.at(key).refuse("", expected));
        }
        bullet.check(&field.at("bullet"))
    }

    fn ceiling(&self, field: &Field<'_>) -> Result<Option<f64>, ConfigError> {
        let limits = Limits::from(0.1, 1000.0, "m");
        self.ceiling_effect_m.map(|height| field.at("ceiling_effect_m").real(height, &limits)).transpose()
    }
}

impl BulletConfig {
    fn check(&self, field: &Field<'_>) -> Result<Preset, ConfigError> {
        let version = match self.version {
            VersionConfig::Fork => Quirks::fork(),
            VersionConfig::Upstream => Quirks::upstream(),
            VersionConfig::Sound => Quirks::none(),
        };
        let quirks = self.quirks.check(version, &field.at("quirks"))?;
        Ok(Preset::Bullet { mode: self.mode.check(), quirks })
    }
}

impl ModeConfig {
    fn check(self) -> BulletMode {
        match self {
            Self::Pyb => BulletMode::Pyb,
            Self::PybGnd => BulletMode::PybGnd,
            Self::PybDrag => BulletMode::PybDrag,
            Self::PybDw => BulletMode::PybDw,
            Self::PybGndDragDw => BulletMode::PybGndDragDw,
            Self::Dyn => BulletMode::Dyn,
        }
    }
}

impl QuirksConfig {
    fn check(&self, version: Quirks, field: &Field<'_>) -> Result<Quirks, ConfigError> {
        let number = |key: &str, value: Option<f64>, default: f64, limits: Limits| {
            value.map_or(Ok(default), |value| field.at(key).real(value, &limits))
        };
        let length = |low| Limits::from(low, 1000.0, "m");
        let cap = version.rotation_cap.to_degrees();
        let degrees =
            number("rotation_cap_deg", self.rotation_cap_deg, cap, Limits::above(0.0, 180.0, "degrees"))?;
        let rotation_cap = self.rotation_cap_deg.map_or(version.rotation_cap, |_| degrees.to_radians());
        let cap = Limits::above(0.0, 1e6, "");
        Ok(Quirks {
            damping: number("damping", self.damping, version.damping, Limits::from(0.0, 10.0, ""))?,
            downwash_nearest: number(
                "downwash_nearest_m",
                self.downwash_nearest_m,
                version.downwash_nearest,
                length(0.0),
            )?,
            downwash_reach: number(
                "downwash_reach_m",
                self.downwash_reach_m,
                version.downwash_reach,
                length(0.0),
            )?,
            rotation_cap,
            velocity_cap: number("velocity_cap", self.velocity_cap, version.velocity_cap, cap)?,
            ..self.choices(version)
        })
    }

    /// The quirks that are choices rather than numbers.
    fn choices(&self, version: Quirks) -> Quirks {
        Quirks {
            rotor_precision: choose(
                self.single_precision_rotors,
                [RotorPrecision::Single, RotorPrecision::Full],
                version.rotor_precision,
            ),
            link_attitude: choose(
                self.attitude_lag,
                [LinkAttitude::Previous, LinkAttitude::Current],
                version.link_attitude,
            ),
            ground_query: choose(
                self.ground_query_refreshes_links,
                [GroundQuery::RefreshesLinks, GroundQuery::LeavesLinks],
                version.ground_query,
            ),
            drag_frame: self.drag_frame.map_or(version.drag_frame, |frame| match frame {
                DragFrameConfig::ScaledInWorld => DragFrame::ScaledInWorld,
                DragFrameConfig::TurnedTwice => DragFrame::TurnedTwice,
                DragFrameConfig::Body => DragFrame::Body,
            }),
            drag_rotors: choose(
                self.late_drag_rotors,
                [DragRotors::Previous, DragRotors::Current],
                version.drag_rotors,
            ),
            downwash_axis: choose(
                self.downwash_along_body,
                [DownwashAxis::Body, DownwashAxis::World],
                version.downwash_axis,
            ),
            attitude_update: choose(
                self.exponential_map,
                [AttitudeUpdate::ExponentialMap, AttitudeUpdate::FirstOrder],
                version.attitude_update,
            ),
            dyn_attitude: choose(
                self.dyn_euler_angles,
                [DynAttitude::EulerAngles, DynAttitude::Quaternion],
                version.dyn_attitude,
            ),
            dyn_levers: choose(
                self.dyn_nominal_arm,
                [DynLevers::NominalArm, DynLevers::RotorPositions],
                version.dyn_levers,
            ),
            dyn_report: self.dyn_report.map_or(version.dyn_report, |report| match report {
                DynReportConfig::PreviousAttitude => DynReport::PreviousAttitude,
                DynReportConfig::MinusOne => DynReport::MinusOne,
                DynReportConfig::Current => DynReport::Current,
            }),
            ..version
        }
    }
}

/// The first of two for yes, the second for no, the default for neither.
fn choose<T: Copy>(answer: Option<bool>, [yes, no]: [T; 2], default: T) -> T {
    answer.map_or(default, |answer| if answer { yes } else { no })
}
