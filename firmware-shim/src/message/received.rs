//! What peers ask for.
//!
//! The messages that carry requests are read here field by field, not through the `mavlink` crate's enums: those
//! reject a frame with an unknown command number, which must be answered "unsupported".

use nalgebra::Vector3;

use crate::frame::Frame;
use crate::message::enu_from_ned;

/// `MAV_FRAME_LOCAL_NED`, the one frame of set-points that is followed.
const LOCAL_NED: u8 = 1;

/// Type mask: the position fields are to be ignored.
const POSITION_IGNORED: u16 = 0b0000_0000_0111;

/// Type mask: the velocity and acceleration fields are to be ignored.
const MOTION_IGNORED: u16 = 0b0001_1111_1000;

/// Set-points farther than this from the origin along an axis are refused \[m\]: beyond it f32 positions get coarse
/// (0.06 mm at 1 km), and no aviary is as large.
const COORDINATE_LIMIT_M: f32 = 1000.0;

/// A request to this or another system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Request {
    /// `COMMAND_LONG`.
    Command(CommandLong),
    /// `COMMAND_INT`, by its command number: none of the commands needs it.
    CommandInt(u16),
    /// `SET_POSITION_TARGET_LOCAL_NED`.
    PositionTarget(PositionTarget),
}

/// To whom a request is addressed; zero means everybody.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address {
    /// System, 0 for all.
    pub system: u8,
    /// Component, 0 for all.
    pub component: u8,
}

/// A command with seven parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandLong {
    /// `MAV_CMD`.
    pub command: u16,
    /// How often the sender repeated it so far.
    pub confirmation: u8,
    /// Parameters 1 to 7; NaN where the sender leaves the choice to the vehicle.
    pub parameters: [f32; 7],
}

/// A set-point, as sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PositionTarget {
    /// `MAV_FRAME`.
    pub frame: u8,
    /// `POSITION_TARGET_TYPEMASK`: what is to be ignored.
    pub type_mask: u16,
    /// North, east, down \[m\].
    pub position_ned: [f32; 3],
}

/// Why a set-point is not followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetPointError {
    /// Relative to the body or to something else than the local origin.
    Frame,
    /// It asks for a velocity or an acceleration.
    Motion,
    /// It leaves out a part of the position.
    Position,
    /// NaN or infinite.
    NotFinite,
    /// Beyond a kilometre from the origin, or below its height.
    Outside,
}

impl Address {
    /// Whether `system` and `component` shall listen.
    pub fn reaches(self, system: u8, component: u8) -> bool {
        [0, system].contains(&self.system) && [0, component].contains(&self.component)
    }
}

/// The request in a frame and its addressee; none if the message is no request that is known here.
pub fn request(frame: &Frame) -> Option<(Address, Request)> {
    match frame.message_id {
        75 => Some(command_int(&frame.fields())),
        76 => Some(command_long(&frame.fields())),
        84 => Some(position_target(&frame.fields())),
        _ => None,
    }
}

fn command_long(fields: &[u8; 33]) -> (Address, Request) {
    let command = CommandLong {
        command: short_at(fields, 28),
        confirmation: fields[32],
        parameters: core::array::from_fn(|i| float_at(fields, 4 * i)),
    };
    (Address { system: fields[30], component: fields[31] }, Request::Command(command))
}

fn command_int(fields: &[u8; 35]) -> (Address, Request) {
    (Address { system: fields[30], component: fields[31] }, Request::CommandInt(short_at(fields, 28)))
}

fn position_target(fields: &[u8; 53]) -> (Address, Request) {
    let target = PositionTarget {
        frame: fields[52],
        type_mask: short_at(fields, 48),
        position_ned: core::array::from_fn(|i| float_at(fields, 4 + 4 * i)),
    };
    (Address { system: fields[50], component: fields[51] }, Request::PositionTarget(target))
}

fn float_at(fields: &[u8], at: usize) -> f32 {
    f32::from_le_bytes([fields[at], fields[at + 1], fields[at + 2], fields[at + 3]])
}

fn short_at(fields: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([fields[at], fields[at + 1]])
}

impl PositionTarget {
    /// The point to go to \[m, world\]. Yaw and yaw rate are not looked at: the policies hold any heading.
    ///
    /// # Errors
    /// What keeps the vehicle from following it.
    pub fn set_point(&self) -> Result<Vector3<f32>, SetPointError> {
        if self.frame != LOCAL_NED {
            return Err(SetPointError::Frame);
        }
        if self.type_mask & MOTION_IGNORED != MOTION_IGNORED {
            return Err(SetPointError::Motion);
        }
        if self.type_mask & POSITION_IGNORED != 0 {
            return Err(SetPointError::Position);
        }
        let point = enu_from_ned(self.position_ned);
        if !point.iter().all(|coordinate| coordinate.is_finite()) {
            return Err(SetPointError::NotFinite);
        }
        let inside = point.iter().all(|coordinate| coordinate.abs() <= COORDINATE_LIMIT_M) && point.z >= 0.0;
        if inside { Ok(point) } else { Err(SetPointError::Outside) }
    }
}

#[cfg(test)]
mod tests {
    use mavlink::dialects::common::{
        COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavFrame, PositionTargetTypemask,
        SET_POSITION_TARGET_LOCAL_NED_DATA,
    };

    use super::*;
    use crate::frame::{Encoder, Frames, Payload};

    fn read<D: mavlink::MessageData>(message: &D) -> (Address, Request) {
        let bytes = Encoder::new(255, 190).encode(&Payload::of(message));
        request(&Frames::new(&bytes).next().unwrap().unwrap()).unwrap()
    }

    #[test]
    fn a_command_is_read_as_the_mavlink_crate_writes_it() {
        let sent = COMMAND_LONG_DATA {
            param1: 1.0,
            param2: 2.0,
            param3: 3.0,
            param4: 4.0,
            param5: 5.0,
            param6: 6.0,
            param7: 7.0,
            command: MavCmd::MAV_CMD_NAV_TAKEOFF,
            target_system: 8,
            target_component: 9,
            confirmation: 10,
        };
        let expected =
            CommandLong { command: 22, confirmation: 10, parameters: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0] };
        assert_eq!(read(&sent), (Address { system: 8, component: 9 }, Request::Command(expected)));
    }

    #[test]
    fn a_command_int_is_known_by_its_number() {
        let sent = COMMAND_INT_DATA {
            command: MavCmd::MAV_CMD_DO_REPOSITION,
            target_system: 8,
            target_component: 9,
            ..COMMAND_INT_DATA::default()
        };
        assert_eq!(read(&sent), (Address { system: 8, component: 9 }, Request::CommandInt(192)));
    }

    #[test]
    fn a_set_point_is_read_as_the_mavlink_crate_writes_it() {
        let sent = SET_POSITION_TARGET_LOCAL_NED_DATA {
            x: 1.0,
            y: 2.0,
            z: -3.0,
            type_mask: PositionTargetTypemask::from_bits_truncate(0b1101_1111_1000),
            target_system: 8,
            target_component: 9,
            coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
            ..SET_POSITION_TARGET_LOCAL_NED_DATA::default()
        };
        let (address, request) = read(&sent);
        assert_eq!(address, Address { system: 8, component: 9 });
        let expected = PositionTarget { frame: 1, type_mask: 0b1101_1111_1000, position_ned: [1.0, 2.0, -3.0] };
        assert_eq!(request, Request::PositionTarget(expected));
        assert_eq!(expected.set_point(), Ok(Vector3::new(2.0, 1.0, 3.0)));
    }

    #[test]
    fn only_whole_finite_reachable_positions_are_followed() {
        let good = PositionTarget { frame: 1, type_mask: 0b1101_1111_1000, position_ned: [0.0, 0.0, -1.0] };
        let at = |position_ned| PositionTarget { position_ned, ..good }.set_point();
        let masked = |type_mask| PositionTarget { type_mask, ..good }.set_point();
        assert!(good.set_point().is_ok());
        assert!(masked(2552).is_ok(), "MAVSDK's position and yaw");
        assert_eq!(PositionTarget { frame: 8, ..good }.set_point(), Err(SetPointError::Frame));
        assert_eq!(masked(2503), Err(SetPointError::Motion), "MAVSDK's velocity and yaw");
        assert_eq!(masked(0b1101_1111_1100), Err(SetPointError::Position));
        assert_eq!(masked(0), Err(SetPointError::Motion));
        assert_eq!(at([f32::NAN, 0.0, -1.0]), Err(SetPointError::NotFinite));
        assert_eq!(at([0.0, f32::INFINITY, -1.0]), Err(SetPointError::NotFinite));
        assert_eq!(at([0.0, 0.0, 1.0]), Err(SetPointError::Outside));
        assert_eq!(at([1e6, 0.0, -1.0]), Err(SetPointError::Outside));
    }

    #[test]
    fn zero_addresses_everybody() {
        let reaches = |system, component| Address { system, component }.reaches(1, 1);
        assert!(reaches(0, 0) && reaches(1, 0) && reaches(0, 1) && reaches(1, 1));
        assert!(!reaches(2, 0) && !reaches(2, 1) && !reaches(1, 2));
    }
}
