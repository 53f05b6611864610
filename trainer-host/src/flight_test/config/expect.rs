//! What is to come of a flight, as users write it.

use kestrel_shim::autopilot::Mode;
use kestrel_shim::controller::Controller;
use kestrel_sim::config::{BoxConfig, ConfigError, Field, Limits};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::script::{heading, point};
use super::time;
use crate::flight_test::expectation::{Condition, Expectation, Extent};

/// What is to come of a flight. Windows begin with `from_secs` (0) and end with `until_secs` or `by_secs` (the flight's end).
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum ExpectationConfig {
    /// The drone is never lower.
    StaysAbove {
        /// z, world.
        height_m: f64,
        /// From then on.
        #[serde(default)]
        from_secs: f64,
        /// Until then.
        #[serde(default)]
        until_secs: Option<f64>,
    },
    /// It never leaves a box.
    StaysInside {
        /// Corner of the least coordinates, world.
        low_m: [f64; 3],
        /// Corner of the greatest.
        high_m: [f64; 3],
        /// From then on.
        #[serde(default)]
        from_secs: f64,
        /// Until then.
        #[serde(default)]
        until_secs: Option<f64>,
    },
    /// It never leaves a place.
    StaysNear {
        /// x and y, world.
        at_m: [f64; 2],
        /// z, world; left out: the flight's height.
        #[serde(default)]
        height_m: Option<f64>,
        /// No farther.
        radius_m: f64,
        /// From then on.
        #[serde(default)]
        from_secs: f64,
        /// Until then.
        #[serde(default)]
        until_secs: Option<f64>,
    },
    /// It comes to a place.
    Arrives {
        /// x and y, world.
        at_m: [f64; 2],
        /// z, world; left out: the flight's height.
        #[serde(default)]
        height_m: Option<f64>,
        /// So near.
        radius_m: f64,
        /// After then.
        #[serde(default)]
        from_secs: f64,
        /// By then.
        #[serde(default)]
        by_secs: Option<f64>,
    },
    /// Its nose always points there.
    HoldsHeading {
        /// Counter-clockwise from the world's x axis.
        heading_deg: f64,
        /// No further off.
        within_deg: f64,
        /// From then on.
        #[serde(default)]
        from_secs: f64,
        /// Until then.
        #[serde(default)]
        until_secs: Option<f64>,
    },
    /// It is never tilted further.
    TiltsLess {
        /// Angle to the vertical.
        degrees: f64,
        /// From then on.
        #[serde(default)]
        from_secs: f64,
        /// Until then.
        #[serde(default)]
        until_secs: Option<f64>,
    },
    /// It is never faster.
    Slower {
        /// Of the drone.
        m_per_s: f64,
        /// From then on.
        #[serde(default)]
        from_secs: f64,
        /// Until then.
        #[serde(default)]
        until_secs: Option<f64>,
    },
    /// The autopilot comes into a mode.
    ModeBecomes {
        /// Which one.
        mode: ModeConfig,
        /// After then.
        #[serde(default)]
        from_secs: f64,
        /// By then.
        #[serde(default)]
        by_secs: Option<f64>,
    },
    /// The autopilot is in a mode all the time.
    ModeStays {
        /// Which one.
        mode: ModeConfig,
        /// From then on.
        #[serde(default)]
        from_secs: f64,
        /// Until then.
        #[serde(default)]
        until_secs: Option<f64>,
    },
    /// A controller flies all the time.
    FlownBy {
        /// Which one.
        controller: ControllerConfig,
        /// From then on.
        #[serde(default)]
        from_secs: f64,
        /// Until then.
        #[serde(default)]
        until_secs: Option<f64>,
    },
    /// It never touches a wall, furniture or a movable body.
    TouchesNothing {
        /// From then on.
        #[serde(default)]
        from_secs: f64,
        /// Until then.
        #[serde(default)]
        until_secs: Option<f64>,
    },
    /// At the end it is landed or disarmed, upright, at rest, with stopped rotors.
    EndsLanded,
    /// The vehicle says something, and the ground station hears it.
    Says {
        /// What occurs in it.
        text: String,
        /// After then.
        #[serde(default)]
        from_secs: f64,
        /// By then.
        #[serde(default)]
        by_secs: Option<f64>,
    },
}

/// What an autopilot is doing.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum ModeConfig {
    /// Motors cannot turn.
    Disarmed,
    /// On the ground, ready to take off.
    Armed,
    /// Climbing.
    TakingOff,
    /// At a point that the autopilot chose.
    Holding,
    /// At, or on the way to, a point.
    Guided,
    /// Following a stream of set-points.
    Offboard,
    /// On the way home.
    Returning,
    /// Sinking until the floor stops it.
    Landing,
    /// At rest after a landing, still armed.
    Landed,
}

/// Who flies.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum ControllerConfig {
    /// The policy.
    Policy,
    /// The cascade of controllers.
    Cascade,
}

/// A key of an expectation, its extent and its condition, and the window as it is written.
struct Claim {
    name: &'static str,
    extent: Extent,
    condition: Condition,
    from_secs: f64,
    until_secs: Option<f64>,
}

impl ExpectationConfig {
    /// The expectation of a flight of `secs` at a height of `height_m` where it leaves its own open.
    pub(super) fn check(&self, secs: f64, height_m: f32, field: &Field<'_>) -> Result<Expectation, ConfigError> {
        let Claim { name, extent, condition, from_secs, until_secs } = self.claim(height_m, field)?;
        let field = field.at(name);
        let from_secs = time(from_secs, secs, &field.at("from_secs"))?;
        let end = match extent {
            Extent::Throughout | Extent::AtTheEnd => "until_secs",
            Extent::Once => "by_secs",
        };
        let until_secs = until_secs.map_or(Ok(secs), |until| time(until, secs, &field.at(end)))?;
        if from_secs > until_secs {
            return Err(field.at(end).refuse(until_secs, format!("a time after {from_secs} s, where it begins")));
        }
        Ok(Expectation { name, window_secs: [from_secs, until_secs], extent, condition })
    }

    fn claim(&self, height_m: f32, field: &Field<'_>) -> Result<Claim, ConfigError> {
        let (name, extent) = self.kind();
        let (from_secs, until_secs) = self.window();
        let condition = self.condition(height_m, &field.at(name))?;
        Ok(Claim { name, extent, condition, from_secs, until_secs })
    }

    /// Its key, and how much of its window counts.
    const fn kind(&self) -> (&'static str, Extent) {
        match self {
            Self::StaysAbove { .. } => ("stays_above", Extent::Throughout),
            Self::StaysInside { .. } => ("stays_inside", Extent::Throughout),
            Self::StaysNear { .. } => ("stays_near", Extent::Throughout),
            Self::Arrives { .. } => ("arrives", Extent::Once),
            Self::HoldsHeading { .. } => ("holds_heading", Extent::Throughout),
            Self::TiltsLess { .. } => ("tilts_less", Extent::Throughout),
            Self::Slower { .. } => ("slower", Extent::Throughout),
            Self::ModeBecomes { .. } => ("mode_becomes", Extent::Once),
            Self::ModeStays { .. } => ("mode_stays", Extent::Throughout),
            Self::FlownBy { .. } => ("flown_by", Extent::Throughout),
            Self::TouchesNothing { .. } => ("touches_nothing", Extent::Throughout),
            Self::EndsLanded => ("ends_landed", Extent::AtTheEnd),
            Self::Says { .. } => ("says", Extent::Once),
        }
    }

    /// Its begin and end, as they are written \[s\].
    const fn window(&self) -> (f64, Option<f64>) {
        match self {
            Self::StaysAbove { from_secs, until_secs, .. }
            | Self::StaysInside { from_secs, until_secs, .. }
            | Self::StaysNear { from_secs, until_secs, .. }
            | Self::HoldsHeading { from_secs, until_secs, .. }
            | Self::TiltsLess { from_secs, until_secs, .. }
            | Self::Slower { from_secs, until_secs, .. }
            | Self::ModeStays { from_secs, until_secs, .. }
            | Self::FlownBy { from_secs, until_secs, .. }
            | Self::TouchesNothing { from_secs, until_secs }
            | Self::Arrives { from_secs, by_secs: until_secs, .. }
            | Self::ModeBecomes { from_secs, by_secs: until_secs, .. }
            | Self::Says { from_secs, by_secs: until_secs, .. } => (*from_secs, *until_secs),
            Self::EndsLanded => (0.0, None),
        }
    }

    fn condition(&self, flight_m: f32, field: &Field<'_>) -> Result<Condition, ConfigError> {
        let metres = Limits::above(0.0, 1000.0, "m");
        let degrees = Limits::above(0.0, 180.0, "degrees");
        Ok(match self {
            Self::StaysAbove { height_m, .. } => {
                Condition::Above(field.at("height_m").number(*height_m, &Limits::from(-1000.0, 1000.0, "m"))?)
            }
            Self::StaysInside { low_m, high_m, .. } => {
                let cuboid = BoxConfig { low_m: *low_m, high_m: *high_m }.check(field)?;
                Condition::Inside([cuboid.low, cuboid.high])
            }
            Self::StaysNear { at_m, height_m, radius_m, .. } | Self::Arrives { at_m, height_m, radius_m, .. } => {
                let point: Vector3<f32> = point(*at_m, height_m.unwrap_or(flight_m.into()), field)?;
                Condition::Near { point, radius_m: field.at("radius_m").number(*radius_m, &metres)? }
            }
            Self::HoldsHeading { heading_deg, within_deg, .. } => Condition::Heading {
                heading: heading(*heading_deg, &field.at("heading_deg"))?,
                within: field.at("within_deg").number(*within_deg, &degrees)?.to_radians(),
            },
            Self::TiltsLess { degrees: limit, .. } => {
                Condition::Tilt(field.at("degrees").number(*limit, &degrees)?.to_radians())
            }
            Self::Slower { m_per_s, .. } => {
                Condition::Speed(field.at("m_per_s").number(*m_per_s, &Limits::above(0.0, 100.0, "m/s"))?)
            }
            Self::ModeBecomes { mode, .. } | Self::ModeStays { mode, .. } => Condition::Mode((*mode).into()),
            Self::FlownBy { controller, .. } => Condition::Controller(match controller {
                ControllerConfig::Policy => Controller::Policy,
                ControllerConfig::Cascade => Controller::Cascade,
            }),
            Self::TouchesNothing { .. } => Condition::Untouched,
            Self::EndsLanded => Condition::Landed,
            Self::Says { text, .. } if text.is_empty() => return Err(field.at("text").refuse("", "words")),
            Self::Says { text, .. } => Condition::Said(text.clone()),
        })
    }
}

impl From<ModeConfig> for Mode {
    fn from(config: ModeConfig) -> Self {
        match config {
            ModeConfig::Disarmed => Self::Disarmed,
            ModeConfig::Armed => Self::Armed,
            ModeConfig::TakingOff => Self::TakingOff,
            ModeConfig::Holding => Self::Holding,
            ModeConfig::Guided => Self::Guided,
            ModeConfig::Offboard => Self::Offboard,
            ModeConfig::Returning => Self::Returning,
            ModeConfig::Landing => Self::Landing,
            ModeConfig::Landed => Self::Landed,
        }
    }
}
