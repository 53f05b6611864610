//! What a body is apart from its shape.

use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::world::{BOX_CONTACT_GAP, Pose, Role, Shape, Solid};

/// What a body is apart from its outline.
#[derive(Clone, Copy, Debug)]
pub(super) struct Surface {
    pub(super) role: Role,
    pub(super) friction: f64,
    pub(super) contact_gap: f64,
    pub(super) colour: [f32; 3],
}

/// Keys that change a [`Surface`]; what is left out stays.
#[derive(Clone, Copy, Debug)]
pub(super) struct SurfaceKeys {
    pub(super) role: Option<Role>,
    pub(super) friction: Option<f64>,
    pub(super) contact_gap_m: Option<f64>,
    pub(super) colour: Option<[f64; 3]>,
}

impl Default for Surface {
    fn default() -> Self {
        Self { role: Role::Obstacle, friction: 0.5, contact_gap: BOX_CONTACT_GAP, colour: [0.6; 3] }
    }
}

impl Surface {
    /// With the keys that are written at `field`.
    pub(super) fn with(self, keys: SurfaceKeys, field: &Field<'_>) -> Result<Self, ConfigError> {
        let number = |key: &str, value: Option<f64>, default: f64, limits: Limits| {
            value.map_or(Ok(default), |value| field.at(key).real(value, &limits))
        };
        let colour = keys.colour.map(|colour| field.at("colour").numbers(colour, &Limits::from(0.0, 1.0, "")));
        Ok(Self {
            role: keys.role.unwrap_or(self.role),
            friction: number("friction", keys.friction, self.friction, Limits::from(0.0, 10.0, ""))?,
            contact_gap: number(
                "contact_gap_m",
                keys.contact_gap_m,
                self.contact_gap,
                Limits::from(0.0, 0.05, "m"),
            )?,
            colour: colour.transpose()?.unwrap_or(self.colour),
        })
    }

    /// A body with this surface, which looks as it is.
    pub(super) fn around(self, name: &str, shape: Shape, pose: Pose) -> Solid {
        let Self { role, friction, contact_gap, colour } = self;
        Solid { name: name.to_owned(), shape, pose, role, friction, contact_gap, colour, visual: None }
    }
}
