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

/// `MAV_FRAME_LOCAL_NED`, and the same from where the drone is.
const LOCAL_NED: u8 = 1;
const LOCAL_OFFSET_NED: u8 = 7;

/// `MAV_FRAME_BODY_NED`, `..._OFFSET_NED` and `MAV_FRAME_BODY_FRD`: forward, right and down from where the drone is, in the
/// plane of the floor whatever its tilt. Yaw counts from where the nose points.
const BODY: [u8; 3] = [8, 9, 12];

/// `MAV_FRAME_GLOBAL`, `..._INT`, `..._RELATIVE_ALT` and `..._RELATIVE_ALT_INT`.
const GLOBAL: [u8; 2] = [0, 5];
const GLOBAL_RELATIVE: [u8; 2] = [3, 6];

/// Type mask, whose first bits are for x, y, z of the position, then of the velocity, then of the acceleration: to be ignored.
const YAW_IGNORED: u16 = 0b0100_0000_0000;
const YAW_RATE_IGNORED: u16 = 0b1000_0000_0000;

/// Attitude type mask: the rates of roll, pitch and yaw, the thrust and the attitude are to be ignored.
const RATES_IGNORED: u8 = 0b0000_0111;
const THRUST_IGNORED: u8 = 0b0100_0000;
const ATTITUDE_IGNORED: u8 = 0b1000_0000;

/// In which a place that is asked for beside a velocity along other axes is reached \[s\]: streams come twice a second at least.
const CATCH_UP_SECS: f32 = 0.5;

/// No faster than this, along each axis \[m/s\].
const CATCH_UP_SPEED: f32 = 1.0;

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
    /// North, east, down, or forward, right, down \[m/s\].
    pub velocity: [f32; 3],
    /// Clockwise from north, or from the nose \[rad\], and its rate \[rad/s\].
    pub yaw: [f32; 2],
}

/// Where a drone is, as some frames count from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Whereabouts {
    /// \[m, world\].
    pub position: Vector3<f32>,
    /// Where the nose points, counter-clockwise from the world's x axis \[rad\].
    pub heading: f32,
    /// Where it is led now \[m, world\].
    pub goal: Vector3<f32>,
}

/// A position, as sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TargetPosition {
    /// North, east, down, or forward, right, down \[m\].
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
    /// It asks for nothing but an acceleration, or for nothing.
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
        velocity: core::array::from_fn(|i| f32_at(fields, 16 + 4 * i)),
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
        velocity: core::array::from_fn(|i| f32_at(fields, 16 + 4 * i)),
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
    /// What is to be followed in a world whose origin is at `origin`: the position if there is one, else the velocity; along
    /// the floor the one and in height the other, too. Accelerations beside them are hints, which are not needed.
    ///
    /// # Errors
    /// What keeps the vehicle from following it.
    pub fn set_point(&self, origin: &Home, here: &Whereabouts) -> Result<SetPoint, SetPointError> {
        let given = |bits: u16, shift: u16| match self.type_mask >> shift & bits {
            0 => Some(true),
            ignored if ignored == bits => Some(false),
            _ => None,
        };
        let across = [given(0b11, 0), given(0b11, 3)];
        let upward = [given(1, 2), given(1, 5)];
        match (across, upward) {
            ([Some(true), _], [Some(true), _]) => self.point(origin, here).map(SetPoint::Position),
            ([Some(false), Some(true)], [Some(false), Some(true)]) => self.velocity(here).map(SetPoint::Velocity),
            ([Some(false), Some(true)], [Some(true), _]) => self.mixed(here, [false, false, true]),
            ([Some(true), _], [Some(false), Some(true)]) => self.mixed(here, [true, true, false]),
            ([Some(false), Some(false)], [Some(false), Some(false)]) => Err(SetPointError::Motion),
            (_, _) => Err(SetPointError::Partial),
        }
    }

    /// Where the nose shall point meanwhile: the yaw if there is one, else the yaw rate. NaN is none, as for PX4.
    pub fn facing(&self, here: &Whereabouts) -> Facing {
        let [yaw, yaw_rate] = self.yaw;
        if self.type_mask & YAW_IGNORED == 0 && !yaw.is_nan() {
            let from = if BODY.contains(&self.frame) { here.heading } else { core::f32::consts::FRAC_PI_2 };
            Facing::Toward(from - yaw)
        } else if self.type_mask & YAW_RATE_IGNORED == 0 && !yaw_rate.is_nan() {
            Facing::Turning(-yaw_rate)
        } else {
            Facing::Kept
        }
    }

    /// The velocity that leads to the position along some axes, and is that of the set-point along the others.
    fn mixed(&self, here: &Whereabouts, by_position: [bool; 3]) -> Result<SetPoint, SetPointError> {
        let TargetPosition::Local(_) = self.position else { return Err(SetPointError::Partial) };
        let (velocity, place) = (self.axes(self.velocity, here)?, self.local_place(here)?);
        let way = (place - here.goal) / CATCH_UP_SECS;
        let along = |axis: usize| {
            if by_position[axis] { way[axis].clamp(-CATCH_UP_SPEED, CATCH_UP_SPEED) } else { velocity[axis] }
        };
        finite(Vector3::new(along(0), along(1), along(2))).map(SetPoint::Velocity)
    }

    fn point(&self, origin: &Home, here: &Whereabouts) -> Result<Vector3<f32>, SetPointError> {
        let point = finite(self.place(origin, here)?)?;
        let inside = point.iter().all(|coordinate| coordinate.abs() <= COORDINATE_LIMIT_M) && point.z >= 0.0;
        if inside { Ok(point) } else { Err(SetPointError::Outside) }
    }

    fn place(&self, origin: &Home, here: &Whereabouts) -> Result<Vector3<f32>, SetPointError> {
        match self.position {
            TargetPosition::Local(_) => self.local_place(here),
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
        }
    }

    fn local_place(&self, here: &Whereabouts) -> Result<Vector3<f32>, SetPointError> {
        let TargetPosition::Local(position) = self.position else { return Err(SetPointError::Frame) };
        let from = if self.frame == LOCAL_NED { Vector3::zeros() } else { here.position };
        Ok(from + self.axes(position, here)?)
    }

    fn velocity(&self, here: &Whereabouts) -> Result<Vector3<f32>, SetPointError> {
        match self.position {
            TargetPosition::Local(_) => finite(self.axes(self.velocity, here)?),
            TargetPosition::Global(..) => finite(enu_from_ned(self.velocity)),
        }
    }

    /// A vector in the axes of a local frame as one in the world's.
    fn axes(&self, vector: [f32; 3], here: &Whereabouts) -> Result<Vector3<f32>, SetPointError> {
        if [LOCAL_NED, LOCAL_OFFSET_NED].contains(&self.frame) {
            return Ok(enu_from_ned(vector));
        }
        if !BODY.contains(&self.frame) {
            return Err(SetPointError::Frame);
        }
        let [forward, right, down] = vector;
        let (sine, cosine) = libm::sincosf(here.heading);
        Ok(Vector3::new(cosine * forward + sine * right, sine * forward - cosine * right, -down))
    }
}

fn finite(vector: Vector3<f32>) -> Result<Vector3<f32>, SetPointError> {
    if vector.iter().all(|coordinate| coordinate.is_finite()) { Ok(vector) } else { Err(SetPointError::NotFinite) }
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
            Self::Motion => "set-point refused: neither place nor velocity",
            Self::Partial => "set-point refused: a part of it is missing",
            Self::NotFinite => "set-point refused: not a finite number",
            Self::Outside => "set-point refused: under the floor or over 1 km",
        }
    }
}
