//! A place in a configuration from which checks are made: it knows its path and its line.

use std::fmt;
use std::ops::RangeInclusive;

use nalgebra::Vector3;

use crate::error::ConfigError;
use crate::node::Node;

/// Farthest coordinate from the origin \[m\]: f32 still resolves 0.1 mm there.
const COORDINATE_LIMIT: f64 = 1000.0;

/// A key of a configuration, written or left to its default.
#[derive(Clone, Debug)]
pub struct Field<'a> {
    /// The value, or the nearest one around it that was written.
    node: &'a Node,
    written: bool,
    path: String,
}

/// Allowed values of a number and what they mean.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    low: f64,
    high: f64,
    bounds: Bounds,
    unit: &'static str,
}

#[derive(Clone, Copy, Debug)]
enum Bounds {
    /// Both ends allowed.
    Closed,
    /// The low end is not allowed.
    Above,
    /// Neither end is allowed.
    Open,
}

impl Limits {
    /// From `low` to `high`, both allowed; `unit` is empty for pure numbers.
    pub const fn from(low: f64, high: f64, unit: &'static str) -> Self {
        Self { low, high, bounds: Bounds::Closed, unit }
    }

    /// More than `low`, at most `high`.
    pub const fn above(low: f64, high: f64, unit: &'static str) -> Self {
        Self { low, high, bounds: Bounds::Above, unit }
    }

    /// More than `low`, less than `high`.
    pub const fn between(low: f64, high: f64, unit: &'static str) -> Self {
        Self { low, high, bounds: Bounds::Open, unit }
    }

    /// NaN is never allowed.
    fn allow(&self, value: f64) -> bool {
        match self.bounds {
            Bounds::Closed => self.low <= value && value <= self.high,
            Bounds::Above => self.low < value && value <= self.high,
            Bounds::Open => self.low < value && value < self.high,
        }
    }
}

impl fmt::Display for Limits {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { low, high, bounds, unit } = self;
        match bounds {
            Bounds::Closed => write!(formatter, "a number from {low} to {high}")?,
            Bounds::Above => write!(formatter, "a number above {low}, at most {high}")?,
            Bounds::Open => write!(formatter, "a number between {low} and {high}")?,
        }
        if unit.is_empty() { Ok(()) } else { write!(formatter, " {unit}") }
    }
}

impl<'a> Field<'a> {
    pub(crate) fn root(node: &'a Node) -> Self {
        Self { node, written: true, path: String::new() }
    }

    /// The field below this one at `step`: a key, or an index counted from zero.
    #[must_use]
    pub fn at(&self, step: impl fmt::Display) -> Self {
        let step = step.to_string();
        let path = if self.path.is_empty() { step.clone() } else { format!("{}.{step}", self.path) };
        let child = self.node.child(&step).filter(|_| self.written);
        Self { node: child.unwrap_or(self.node), written: child.is_some(), path }
    }

    /// The message that this field is `value`, shown as it was written, instead of `expected`.
    pub fn refuse(&self, value: impl fmt::Display, expected: impl fmt::Display) -> ConfigError {
        let found = if self.written { self.node.value.to_string() } else { format!("{value} (the default)") };
        ConfigError::at(&self.node.place, &self.path, found, expected)
    }

    /// The message that `found`, said in words, is here instead of `expected`.
    pub fn reject(&self, found: impl fmt::Display, expected: impl fmt::Display) -> ConfigError {
        ConfigError::at(&self.node.place, &self.path, found, expected)
    }

    /// `value` if it is within `limits`.
    ///
    /// # Errors
    /// When it is outside, or not a number.
    pub fn number(&self, value: f64, limits: &Limits) -> Result<f32, ConfigError> {
        if limits.allow(value) { Ok(value as f32) } else { Err(self.refuse(value, limits)) }
    }

    /// As [`Self::number`], in double precision.
    ///
    /// # Errors
    /// When it is outside, or not a number.
    pub fn real(&self, value: f64, limits: &Limits) -> Result<f64, ConfigError> {
        self.number(value, limits).map(|_| value)
    }

    /// `value` if it is within `limits`.
    ///
    /// # Errors
    /// When it is outside.
    pub fn whole(&self, value: u64, limits: RangeInclusive<u64>) -> Result<u64, ConfigError> {
        if limits.contains(&value) {
            return Ok(value);
        }
        Err(self.refuse(value, format!("a whole number from {} to {}", limits.start(), limits.end())))
    }

    /// Three numbers within `limits`.
    ///
    /// # Errors
    /// The first that is outside.
    pub fn numbers(&self, values: [f64; 3], limits: &Limits) -> Result<[f32; 3], ConfigError> {
        let [x, y, z] = values;
        Ok([self.at(0).number(x, limits)?, self.at(1).number(y, limits)?, self.at(2).number(z, limits)?])
    }

    /// As [`Self::numbers`], in double precision.
    ///
    /// # Errors
    /// As there.
    pub fn reals(&self, values: [f64; 3], limits: &Limits) -> Result<Vector3<f64>, ConfigError> {
        self.numbers(values, limits).map(|_| values.into())
    }

    /// A point \[m, world\].
    ///
    /// # Errors
    /// When a coordinate is not finite or farther than 1 km from the origin.
    pub fn point(&self, values: [f64; 3]) -> Result<Vector3<f32>, ConfigError> {
        self.numbers(values, &Limits::from(-COORDINATE_LIMIT, COORDINATE_LIMIT, "m")).map(Vector3::from)
    }

    /// As [`Self::point`], in double precision.
    ///
    /// # Errors
    /// As there.
    pub fn place(&self, values: [f64; 3]) -> Result<Vector3<f64>, ConfigError> {
        self.point(values).map(|_| Vector3::from(values))
    }
}
