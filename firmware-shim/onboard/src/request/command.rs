//! Commands, in either of their two messages.

use nalgebra::Vector3;

use super::{Address, Request};
use crate::axes::enu_from_ned;
use crate::fields::{f32_at, i32_at, u16_at};
use crate::geodesy::{Geodetic, Home};

/// Frames of a `COMMAND_INT` (`MAV_FRAME`), with heights above sea level and above home.
const GLOBAL: [u8; 2] = [0, 5];
const GLOBAL_RELATIVE: [u8; 2] = [3, 6];
const LOCAL_NED: u8 = 1;

/// Steps of a metre in the integers of local frames.
const STEPS_PER_METRE: f64 = 1e4;

/// A command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandRequest {
    /// `MAV_CMD`.
    pub command: u16,
    /// How often the sender repeated it so far.
    pub confirmation: u8,
    /// Parameters 1 to 4; NaN where the sender leaves the choice to the vehicle.
    pub parameters: [f32; 4],
    /// Parameters 5 to 7.
    pub place: CommandLocation,
}

/// Where a command is to be carried out, as sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommandLocation {
    /// `COMMAND_LONG`: parameters 5, 6 and 7, which often are a latitude and a longitude \[°\] and a height \[m\].
    Floats([f32; 3]),
    /// `COMMAND_INT`.
    Integers {
        /// `MAV_FRAME`.
        frame: u8,
        /// Parameters 5 and 6.
        integers: [i32; 2],
        /// Parameter 7.
        height: f32,
    },
}

pub(super) fn of_floats(fields: &[u8; 33]) -> (Address, Request) {
    let parameters: [f32; 7] = core::array::from_fn(|i| f32_at(fields, 4 * i));
    let [first, second, third, fourth, place @ ..] = parameters;
    let command = CommandRequest {
        command: u16_at(fields, 28),
        confirmation: fields[32],
        parameters: [first, second, third, fourth],
        place: CommandLocation::Floats(place),
    };
    (Address { system: fields[30], component: fields[31] }, Request::Command(command))
}

/// It cannot say that it is a repetition: every one counts as a new command.
pub(super) fn of_integers(fields: &[u8; 35]) -> (Address, Request) {
    let command = CommandRequest {
        command: u16_at(fields, 28),
        confirmation: 0,
        parameters: core::array::from_fn(|i| f32_at(fields, 4 * i)),
        place: CommandLocation::Integers {
            frame: fields[32],
            integers: [i32_at(fields, 16), i32_at(fields, 20)],
            height: f32_at(fields, 24),
        },
    };
    (Address { system: fields[30], component: fields[31] }, Request::Command(command))
}

impl CommandLocation {
    /// Whether it is left open where; clients write NaN, the greatest integer or zero then.
    pub fn is_here(&self) -> bool {
        match self {
            Self::Floats([x, y, _]) => [x, y].iter().all(|value| value.is_nan() || **value == 0.0),
            Self::Integers { integers, .. } => integers.iter().all(|value| [0, i32::MAX].contains(value)),
        }
    }

    /// Parameter 7 \[m\].
    pub const fn height(&self) -> f32 {
        match self {
            Self::Floats([_, _, height]) | Self::Integers { height, .. } => *height,
        }
    }

    /// The point in a world whose origin is at `origin` \[m\]; none if it is none on Earth, or in a frame that is not
    /// understood. Of a height that is left open the point has none (NaN).
    pub fn point(&self, origin: &Home) -> Option<Vector3<f32>> {
        match *self {
            Self::Floats([latitude, longitude, height]) => {
                let [latitude_deg, longitude_deg] = [latitude, longitude].map(f64::from);
                let exists = latitude_deg.abs() <= 90.0 && longitude_deg.abs() <= 180.0;
                let altitude_m = f64::from(height);
                exists.then(|| point(origin, Geodetic { latitude_deg, longitude_deg, altitude_m }))
            }
            Self::Integers { frame: LOCAL_NED, integers, height } => {
                let [north, east] = integers.map(|value| (f64::from(value) / STEPS_PER_METRE) as f32);
                Some(enu_from_ned([north, east, height]))
            }
            Self::Integers { frame, integers, height } => {
                let base = if GLOBAL.contains(&frame) { 0.0 } else { origin.altitude_m };
                let known = GLOBAL.contains(&frame) || GLOBAL_RELATIVE.contains(&frame);
                let place = Geodetic::from_integers(integers, 0.0).filter(|_| known)?;
                Some(point(origin, Geodetic { altitude_m: base + f64::from(height), ..place }))
            }
        }
    }
}

/// A point whose height may be open.
fn point(origin: &Home, place: Geodetic) -> Vector3<f32> {
    if place.altitude_m.is_finite() {
        return origin.point_at(&place);
    }
    let mut point = origin.point_at(&Geodetic { altitude_m: origin.altitude_m, ..place });
    point.z = f32::NAN;
    point
}
