//! Areas and boxes.

use kestrel_config::{ConfigError, Field, Limits};
use kestrel_core::real::Real;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::swarm::Swarm;
use crate::world::Cuboid;

const AXES: [char; 3] = ['x', 'y', 'z'];

/// An upright rectangle, its border excluded, at any height.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AreaConfig {
    /// Least and greatest x.
    pub x_m: [f64; 2],
    /// Least and greatest y.
    pub y_m: [f64; 2],
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BoxConfig {
    /// Corner with the smallest coordinates: `[x, y, z]`.
    pub low_m: [f64; 3],
    /// Corner with the greatest coordinates: `[x, y, z]`.
    pub high_m: [f64; 3],
}

impl AreaConfig {
    /// Refuses a coordinate that is out of range, and a least one that is not below the greatest.
    ///
    /// # Errors
    /// The first that is wrong.
    pub fn check(&self, field: &Field<'_>) -> Result<(), ConfigError> {
        check_range(self.x_m, &field.at("x_m"))?;
        check_range(self.y_m, &field.at("y_m"))
    }

    /// Whether the drone in a lane is inside.
    #[inline(always)]
    pub(crate) fn contains<const LANES: usize, R: Real>(&self, swarm: &Swarm<LANES, R>, lane: usize) -> bool {
        let (x, y) = (swarm.position[0][lane], swarm.position[1][lane]);
        let within = |[low, high]: [f64; 2], value: R| {
            (R::from_f32(low as f32) < value) & (value < R::from_f32(high as f32))
        };
        within(self.x_m, x) & within(self.y_m, y)
    }
}

fn check_range([low, high]: [f64; 2], field: &Field<'_>) -> Result<(), ConfigError> {
    let coordinate = Limits::from(-1000.0, 1000.0, "m");
    field.at(0).number(low, &coordinate)?;
    field.at(1).number(high, &coordinate)?;
    if high <= low {
        return Err(field.at(1).refuse(high, format!("more than {low}, the least")));
    }
    Ok(())
}

impl BoxConfig {
    /// The box.
    ///
    /// # Errors
    /// When a coordinate is out of range or `low_m` is not below `high_m`.
    pub fn check(&self, field: &Field<'_>) -> Result<Cuboid, ConfigError> {
        let (low, high) = self.corners(field)?;
        Ok(Cuboid { low: low.cast(), high: high.cast() })
    }

    /// The box, not checked.
    #[inline(always)]
    pub(crate) fn cuboid(&self) -> Cuboid {
        Cuboid {
            low: self.low_m.map(|metres| metres as f32).into(),
            high: self.high_m.map(|metres| metres as f32).into(),
        }
    }

    /// The lowest and the highest corner \[m\].
    pub(crate) fn corners(&self, field: &Field<'_>) -> Result<(Vector3<f64>, Vector3<f64>), ConfigError> {
        let low = field.at("low_m").place(self.low_m)?;
        let high = field.at("high_m").place(self.high_m)?;
        // As f32, which contacts are: two corners that differ by less are none.
        match (0..3).find(|axis| low[*axis] as f32 >= high[*axis] as f32) {
            None => Ok((low, high)),
            Some(axis) => {
                let expected = format!("more than {}, the {} of `low_m`", self.low_m[axis], AXES[axis]);
                Err(field.at("high_m").at(axis).refuse(self.high_m[axis], expected))
            }
        }
    }
}
