//! Cushions and whatever is rounder than a box and fuller than a ball.

use std::f64::consts::FRAC_PI_4;

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::area::BoxConfig;
use crate::config::error::ConfigError;
use crate::config::field::{Field, Limits};
use crate::world::{Pose, Shape};

/// Steps across each side of the cube whose corners are projected onto the surface.
const STEPS: i32 = 4;

/// Bisections of a ray from the middle to the surface: as many as a number has bits.
const BISECTIONS: u32 = 53;

/// A superellipsoid that fills a box: where `|x|^a + |y|^b + |z|^c ≤ 1`, with x, y and z from -1 to 1 across the box and
/// nought at `middle_m`. It is the hull of 98 points on that surface.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SuperellipsoidConfig {
    /// Corner of its box with the smallest coordinates: `[x, y, z]`.
    pub low_m: [f64; 3],
    /// Corner of its box with the greatest coordinates: `[x, y, z]`.
    pub high_m: [f64; 3],
    /// Where it is widest along each axis, inside of the box; its middle unless it is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub middle_m: Option<[f64; 3]>,
    /// `[a, b, c]`: 2 is an ellipse, more is fuller, 1 is straight to a point.
    pub exponents: [f64; 3],
}

impl SuperellipsoidConfig {
    pub(super) fn outline(&self, field: &Field<'_>) -> Result<(Shape, Pose), ConfigError> {
        let (low, high) = BoxConfig { low_m: self.low_m, high_m: self.high_m }.corners(field)?;
        let centre = (low + high) / 2.0;
        let exponents = field.at("exponents").reals(self.exponents, &Limits::from(1.0, 100.0, ""))?;
        let widest = match self.middle_m {
            None => centre,
            Some(middle) => field.at("middle_m").place(middle)?,
        };
        if let Some(axis) = (0..3).find(|axis| !(low[*axis] < widest[*axis] && widest[*axis] < high[*axis])) {
            let expected = format!("a number between {} and {}, inside of the box", low[axis], high[axis]);
            return Err(field.at("middle_m").at(axis).refuse(widest[axis], expected));
        }
        let place = |direction: Vector3<f64>| {
            let half = (high - widest)
                .zip_zip_map(&(widest - low), &direction, |up, down, along| if along > 0.0 { up } else { down });
            widest - centre + half.component_mul(&(direction * reach(&direction, &exponents)))
        };
        Ok((Shape::Hull(directions().map(place).collect()), Pose::at(centre)))
    }
}

/// Where a ray in a direction leaves the superellipsoid of half extents one.
fn reach(direction: &Vector3<f64>, exponents: &Vector3<f64>) -> f64 {
    let (mut inside, mut outside) = (0.0, 1.0 / direction.amax());
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (inside + outside);
        let terms = direction.zip_map(exponents, |along, exponent| libm::pow(middle * along.abs(), exponent));
        if terms.sum() > 1.0 { outside = middle } else { inside = middle }
    }
    inside
}

/// Towards points on a cube that are evenly apart as seen from its middle.
fn directions() -> impl Iterator<Item = Vector3<f64>> {
    let along = |step: i32| libm::tan(FRAC_PI_4 * (2.0 * f64::from(step) / f64::from(STEPS) - 1.0));
    let is_end = |step: i32| step == 0 || step == STEPS;
    let steps = move || 0..=STEPS;
    steps()
        .flat_map(move |x| steps().flat_map(move |y| steps().map(move |z| [x, y, z])))
        .filter(move |steps| steps.iter().any(|step| is_end(*step)))
        .map(move |steps| Vector3::from(steps.map(along)))
}
