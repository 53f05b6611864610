//! Set-points.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use super::{Address, Request};
use crate::autopilot::SetPoint;
use crate::axes::{enu_from_flu, enu_from_ned, flu_from_frd};
use crate::fields::{f32_at, i32_at, u16_at};
use crate::geodesy::{Geodetic, Home};
use crate::goal::Facing;
use crate::steering::AttitudeSetPoint;

/// `MAV_FRAME_LOCAL_NED`.
const LOCAL_NED: u8 = 1;

/// `MAV_FRAME_GLOBAL`, `..._INT`, `..._RELATIVE_ALT` and `..._RELATIVE_ALT_INT`.
const GLOBAL: [u8; 2] = [0, 5];
const GLOBAL_RELATIVE: [u8; 2] = [3, 6];

/// Type mask: the position, velocity and acceleration fields are to be ignored.
const POSITION_IGNORED: u16 = 0b0000_0000_0111;
const VELOCITY_IGNORED: u16 = 0b0000_0011_1000;
const ACCELERATION_IGNORED: u16 = 0b0001_1100_0000;
const YAW_IGNORED: u16 = 0b0100_0000_0000;
const YAW_RATE_IGNORED: u16 = 0b1000_0000_0000;

/// Attitude type mask: the rates of roll, pitch and yaw, the thrust and the attitude are to be ignored.
const RATES_IGNORED: u8 = 0b0000_0111;
const THRUST_IGNORED: u8 = 0b0100_0000;
const ATTITUDE_IGNORED: u8 = 0b1000_0000;

/// Set-points farther than this from the origin along an axis are refused \[m\]: beyond it f32 positions get coarse
/// (0.06 mm at 1 km), and no aviary is as large.
const COORDINATE_LIMIT_M: f32 = 1000.0;

/// A set-point of a position or a velocity, as sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionTarget {
    /// `MAV_FRAME`.
    pub frame: u8,
    /// `POSITION_TARGET_TYPEMASK`: what is to be ignored.
    pub type_mask: u16,
    /// Where.
    pub position: TargetPosition,
    /// North, east, down \[m/s\].
    pub velocity_ned: [f32; 3],
    /// Clockwise from north \[rad\], and its rate \[rad/s\].
    pub yaw: [f32; 2],
}

/// A position, as sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TargetPosition {
    /// North, east, down \[m\].
    Local([f32; 3]),
    /// Latitude and longitude \[1e-7 °\], and a height \[m\].
    Global([i32; 2], f32),
}

/// A set-point of an attitude or body rates, as sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AttitudeTarget {
    /// `ATTITUDE_TARGET_TYPEMASK`: what is to be ignored.
    pub type_mask: u8,
    /// Of the FRD body in the NED world: w, x, y, z.
    pub quaternion: [f32; 4],
    /// Forward, right, down \[rad/s\].
    pub body_rates_frd: [f32; 3],
    /// Share of the greatest thrust.
    pub thrust: f32,
}

/// Why a set-point is not followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetPointError {
    /// In a frame that is not understood.
    Frame,
    /// It asks for an acceleration, or for nothing.
    Motion,
    /// It leaves out a part of what it asks for.
    Partial,
    /// NaN or infinite.
    NotFinite,
    /// Beyond a kilometre from the origin, or below its height.
    Outside,
}

pub(super) fn local_target(fields: &[u8; 53]) -> (Address, Request) {
    let target = PositionTarget {
        frame: fields[52],
        type_mask: u16_at(fields, 48),
        position: TargetPosition::Local(core::array::from_fn(|i| f32_at(fields, 4 + 4 * i))),
        velocity_ned: core::array::from_fn(|i| f32_at(fields, 16 + 4 * i)),
        yaw: core::array::from_fn(|i| f32_at(fields, 40 + 4 * i)),
    };
    (Address { system: fields[50], component: fields[51] }, Request::PositionTarget(target))
}

/// The same layout, but for two integers.
pub(super) fn global_target(fields: &[u8; 53]) -> (Address, Request) {
    let target = PositionTarget {
        frame: fields[52],
        type_mask: u16_at(fields, 48),
        position: TargetPosition::Global([i32_at(fields, 4), i32_at(fields, 8)], f32_at(fields, 12)),
        velocity_ned: core::array::from_fn(|i| f32_at(fields, 16 + 4 * i)),
        yaw: core::array::from_fn(|i| f32_at(fields, 40 + 4 * i)),
    };
    (Address { system: fields[50], component: fields[51] }, Request::PositionTarget(target))
}

pub(super) fn attitude_target(fields: &[u8; 39]) -> (Address, Request) {
    let target = AttitudeTarget {
        type_mask: fields[38],
        quaternion: core::array::from_fn(|i| f32_at(fields, 4 + 4 * i)),
        body_rates_frd: core::array::from_fn(|i| f32_at(fields, 20 + 4 * i)),
        thrust: f32_at(fields, 32),
    };
    (Address { system: fields[36], component: fields[37] }, Request::AttitudeTarget(target))
}

impl PositionTarget {
    /// What is to be followed in a world whose origin is at `origin`: the position if there is one, else the velocity.
    ///
    /// # Errors
    /// What keeps the vehicle from following it.
    pub fn set_point(&self, origin: &Home) -> Result<SetPoint, SetPointError> {
        let [position, velocity, acceleration] =
            [POSITION_IGNORED, VELOCITY_IGNORED, ACCELERATION_IGNORED].map(|ignored| self.type_mask & ignored);
        if acceleration != ACCELERATION_IGNORED {
            return Err(SetPointError::Motion);
        }
        match (position, velocity) {
            (0, _) => self.point(origin).map(SetPoint::Position),
            (POSITION_IGNORED, 0) => self.velocity().map(SetPoint::Velocity),
            (POSITION_IGNORED, VELOCITY_IGNORED) => Err(SetPointError::Motion),
            (_, _) => Err(SetPointError::Partial),
        }
    }

    /// Where the nose shall point meanwhile: the yaw if there is one, else the yaw rate. NaN is none, as for PX4.
    pub fn facing(&self) -> Facing {
        let [yaw, yaw_rate] = self.yaw;
        if self.type_mask & YAW_IGNORED == 0 && !yaw.is_nan() {
            Facing::Toward(core::f32::consts::FRAC_PI_2 - yaw)
        } else if self.type_mask & YAW_RATE_IGNORED == 0 && !yaw_rate.is_nan() {
            Facing::Turning(-yaw_rate)
        } else {
            Facing::Kept
        }
    }

    fn point(&self, origin: &Home) -> Result<Vector3<f32>, SetPointError> {
        let point = self.place(origin)?;
        if !point.iter().all(|coordinate| coordinate.is_finite()) {
            return Err(SetPointError::NotFinite);
        }
        let inside = point.iter().all(|coordinate| coordinate.abs() <= COORDINATE_LIMIT_M) && point.z >= 0.0;
        if inside { Ok(point) } else { Err(SetPointError::Outside) }
    }

    fn place(&self, origin: &Home) -> Result<Vector3<f32>, SetPointError> {
        match self.position {
            TargetPosition::Local(ned) if self.frame == LOCAL_NED => Ok(enu_from_ned(ned)),
            TargetPosition::Global(integers, height) => {
                let base = if GLOBAL.contains(&self.frame) {
                    0.0
                } else if GLOBAL_RELATIVE.contains(&self.frame) {
                    origin.altitude_m
                } else {
                    return Err(SetPointError::Frame);
                };
                let place = Geodetic::from_integers(integers, height).ok_or(SetPointError::NotFinite)?;
                Ok(origin.point_at(&Geodetic { altitude_m: base + place.altitude_m, ..place }))
            }
            TargetPosition::Local(_) => Err(SetPointError::Frame),
        }
    }

    fn velocity(&self) -> Result<Vector3<f32>, SetPointError> {
        let local = matches!(self.position, TargetPosition::Local(_));
        if local && self.frame != LOCAL_NED {
            return Err(SetPointError::Frame);
        }
        let velocity = enu_from_ned(self.velocity_ned);
        if velocity.iter().all(|speed| speed.is_finite()) { Ok(velocity) } else { Err(SetPointError::NotFinite) }
    }
}

impl AttitudeTarget {
    /// What is to be followed: the attitude if there is one, else the body rates.
    ///
    /// # Errors
    /// What keeps the vehicle from following it.
    pub fn set_point(&self) -> Result<SetPoint, SetPointError> {
        if self.type_mask & THRUST_IGNORED != 0 {
            return Err(SetPointError::Partial);
        }
        let attitude = if self.type_mask & ATTITUDE_IGNORED == 0 {
            let world_from_body: Attitude<f32> = enu_from_flu(self.quaternion);
            AttitudeSetPoint::Attitude { world_from_body, thrust: self.thrust }
        } else if self.type_mask & RATES_IGNORED == 0 {
            AttitudeSetPoint::BodyRates { body_rates: flu_from_frd(self.body_rates_frd), thrust: self.thrust }
        } else {
            return Err(SetPointError::Partial);
        };
        if attitude.is_valid() { Ok(SetPoint::Attitude(attitude)) } else { Err(SetPointError::NotFinite) }
    }
}

impl SetPointError {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Frame, Self::Motion, Self::Partial, Self::NotFinite, Self::Outside];

    /// At most the 50 bytes of a `STATUSTEXT`.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Frame => "set-point refused: frame is not understood",
            Self::Motion => "set-point refused: accelerations are not followed",
            Self::Partial => "set-point refused: a part of it is missing",
            Self::NotFinite => "set-point refused: not a finite number",
            Self::Outside => "set-point refused: under the floor or over 1 km",
        }
    }
}
