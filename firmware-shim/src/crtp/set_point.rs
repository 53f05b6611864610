//! Set-points that clients stream: what of them a policy can follow, and the reasons why not.
//!
//! A policy flies to a point and chooses its attitude and heading itself. So positions, heights and velocities are
//! followed, and set-points of attitudes and thrust are refused. Yaw is counted without being flown: what is ahead of a
//! client is ahead of a drone that would have turned as it was told.

use nalgebra::Vector3;

use super::packet::{Fields, Packet, Port};

/// Farthest a set-point may be from the origin of the world, along each axis \[m\]: beyond, a client means something
/// else.
pub const COORDINATE_LIMIT_M: f32 = 1000.0;

/// Channel of the generic commander for set-points.
const SET_POINT_CHANNEL: u8 = 0;

/// Channel of the generic commander on which it is told that no more come.
const META_CHANNEL: u8 = 1;

/// What a client streams.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CrtpSetPoint {
    /// Motors stop, and what flies falls.
    Stop,
    /// A velocity.
    Velocity {
        /// \[m/s, world\].
        velocity: Vector3<f32>,
        /// \[rad/s\], to the left.
        yaw_rate: f32,
    },
    /// A velocity \[m/s\] at a height \[m, world\].
    Hover {
        /// Along the heading.
        ahead: f32,
        /// Across it.
        left: f32,
        /// Not below zero.
        height_m: f32,
        /// \[rad/s\], to the left.
        yaw_rate: f32,
    },
    /// A point.
    Position {
        /// \[m, world\].
        position: Vector3<f32>,
        /// \[rad\].
        yaw: f32,
    },
    /// A point that moves.
    Moving {
        /// \[m, world\].
        position: Vector3<f32>,
        /// \[m/s, world\].
        velocity: Vector3<f32>,
    },
}

/// What a packet of a commander means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CommanderPacket {
    /// Fly this.
    Follow(CrtpSetPoint),
    /// No more set-points come: the high-level commander may fly.
    Release,
}

/// Why a packet of a commander is not obeyed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CrtpSetPointError {
    /// It is too short, not finite, or of a kind that does not exist.
    #[error("expected a finite set-point of kind 0, 1, 2, 5 to 10, found another packet")]
    Malformed,
    /// It is under the floor or beyond [`COORDINATE_LIMIT_M`].
    #[error("expected a set-point above the floor and within 1 km, found it outside")]
    Outside,
    /// It is an attitude, which a policy chooses itself.
    #[error("expected positions, heights or velocities, found an attitude: a policy chooses its own")]
    Attitude,
}

impl CommanderPacket {
    /// What a packet of a commander asks for; `positions` if the old commander sets positions (`flightmode.posSet`).
    ///
    /// # Errors
    /// If there is none that a policy can follow.
    pub fn of(packet: &Packet, old_commander: OldCommander) -> Result<Self, CrtpSetPointError> {
        let mut fields = packet.fields();
        match packet.port {
            Port::Commander => old_commander.read(fields).map(Self::Follow),
            Port::GenericCommander if packet.channel == SET_POINT_CHANNEL => generic(fields).map(Self::Follow),
            Port::GenericCommander if packet.channel == META_CHANNEL && fields.byte() == Some(0) => {
                Ok(Self::Release)
            }
            Port::GenericCommander
            | Port::Console
            | Port::Parameter
            | Port::Memory
            | Port::Log
            | Port::Localization
            | Port::HighLevelCommander
            | Port::Supervisor
            | Port::Platform
            | Port::Link => Err(CrtpSetPointError::Malformed),
        }
    }
}

/// What the roll, pitch, yaw and thrust of the old commander mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OldCommander {
    /// What their names say.
    Attitude,
    /// y, -x, yaw, and z in mm.
    Position,
}

impl OldCommander {
    /// Without thrust motors stop, whatever the rest means.
    fn read(self, mut fields: Fields) -> Result<CrtpSetPoint, CrtpSetPointError> {
        let mut next = || fields.float().ok_or(CrtpSetPointError::Malformed);
        let (roll, pitch, yaw_deg) = (next()?, next()?, next()?);
        let thrust = fields.short().ok_or(CrtpSetPointError::Malformed)?;
        match self {
            Self::Attitude | Self::Position if thrust == 0 => Ok(CrtpSetPoint::Stop),
            Self::Attitude => Err(CrtpSetPointError::Attitude),
            Self::Position => {
                let position = inside(Vector3::new(-pitch, roll, f32::from(thrust) / 1e3))?;
                Ok(CrtpSetPoint::Position { position, yaw: yaw_deg.to_radians() })
            }
        }
    }
}

/// A set-point of the generic commander. The kinds 1, 2 and 5 are 8, 9 and 10 with a yaw rate to the right.
fn generic(mut fields: Fields) -> Result<CrtpSetPoint, CrtpSetPointError> {
    match fields.byte() {
        Some(0) => Ok(CrtpSetPoint::Stop),
        Some(3 | 4 | 11) => Err(CrtpSetPointError::Attitude),
        Some(kind) => motion(kind, fields).ok_or(CrtpSetPointError::Malformed)?.checked(),
        None => Err(CrtpSetPointError::Malformed),
    }
}

fn motion(kind: u8, mut fields: Fields) -> Option<CrtpSetPoint> {
    let to_the_left = |rate_deg: f32| if kind < 8 { -rate_deg.to_radians() } else { rate_deg.to_radians() };
    match kind {
        1 | 8 => {
            Some(CrtpSetPoint::Velocity { velocity: fields.vector()?, yaw_rate: to_the_left(fields.float()?) })
        }
        2 | 5 | 9 | 10 => {
            let (first, second, yaw_rate) = (fields.float()?, fields.float()?, to_the_left(fields.float()?));
            let height_m = fields.float()?;
            // The tilt of a height set-point is not followed: it hovers.
            let [ahead, left] = if matches!(kind, 2 | 9) { [0.0; 2] } else { [first, second] };
            Some(CrtpSetPoint::Hover { ahead, left, height_m, yaw_rate })
        }
        6 => Some(CrtpSetPoint::Moving { position: fields.thousandths()?, velocity: fields.thousandths()? }),
        7 => Some(CrtpSetPoint::Position { position: fields.vector()?, yaw: fields.float()?.to_radians() }),
        _ => None,
    }
}

impl CrtpSetPoint {
    fn checked(self) -> Result<Self, CrtpSetPointError> {
        Ok(match self {
            Self::Stop | Self::Velocity { .. } => self,
            Self::Hover { ahead, left, height_m, yaw_rate } => {
                let height_m = inside(Vector3::new(0.0, 0.0, height_m))?.z;
                Self::Hover { ahead, left, height_m, yaw_rate }
            }
            Self::Position { position, yaw } => Self::Position { position: inside(position)?, yaw },
            Self::Moving { position, velocity } => Self::Moving { position: inside(position)?, velocity },
        })
    }
}

/// Depth to which a set-point may lie under the floor \[m\]: clients that count time instead of measuring end there.
const SLACK_M: f32 = 0.1;

/// The point, on the floor if it is barely under it.
///
/// # Errors
/// If it is deeper, or beyond [`COORDINATE_LIMIT_M`].
pub fn inside(point: Vector3<f32>) -> Result<Vector3<f32>, CrtpSetPointError> {
    if point.iter().all(|coordinate| coordinate.abs() <= COORDINATE_LIMIT_M) && point.z >= -SLACK_M {
        return Ok(Vector3::new(point.x, point.y, point.z.max(0.0)));
    }
    Err(CrtpSetPointError::Outside)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn commander_packet(
        port: Port,
        channel: u8,
        kind: Option<u8>,
        numbers: &[f32],
    ) -> Result<CommanderPacket, CrtpSetPointError> {
        let bytes: Vec<u8> =
            kind.into_iter().chain(numbers.iter().flat_map(|number| number.to_le_bytes())).collect();
        CommanderPacket::of(&Packet::new(port, channel).with(&bytes), OldCommander::Attitude)
    }

    fn generic(kind: u8, numbers: &[f32]) -> Result<CrtpSetPoint, CrtpSetPointError> {
        commander_packet(Port::GenericCommander, 0, Some(kind), numbers).map(|commander_packet| {
            match commander_packet {
                CommanderPacket::Follow(set_point) => set_point,
                CommanderPacket::Release => panic!("{kind} released"),
            }
        })
    }

    fn old(thrust: u16, old_commander: OldCommander) -> Result<CommanderPacket, CrtpSetPointError> {
        let packet = [1.5_f32, -0.5, 90.0]
            .iter()
            .fold(Packet::new(Port::Commander, 0), |packet, number| packet.with(&number.to_le_bytes()));
        CommanderPacket::of(&packet.with(&thrust.to_le_bytes()), old_commander)
    }

    #[test]
    fn every_kind_that_a_policy_can_follow_is_read() {
        let yaw_rate = core::f32::consts::FRAC_PI_2;
        let velocity = CrtpSetPoint::Velocity { velocity: Vector3::new(0.1, 0.2, 0.3), yaw_rate };
        let hover = CrtpSetPoint::Hover { ahead: 0.1, left: 0.2, height_m: 0.4, yaw_rate };
        let still = CrtpSetPoint::Hover { ahead: 0.0, left: 0.0, height_m: 0.4, yaw_rate };
        assert_eq!(generic(0, &[]), Ok(CrtpSetPoint::Stop));
        assert_eq!(generic(1, &[0.1, 0.2, 0.3, -90.0]), Ok(velocity));
        assert_eq!(generic(8, &[0.1, 0.2, 0.3, 90.0]), Ok(velocity));
        for (old, new, expected) in [(2, 9, still), (5, 10, hover)] {
            assert_eq!(generic(old, &[0.1, 0.2, -90.0, 0.4]), Ok(expected));
            assert_eq!(generic(new, &[0.1, 0.2, 90.0, 0.4]), Ok(expected));
        }
        let position = CrtpSetPoint::Position { position: Vector3::new(1.0, 2.0, 3.0), yaw: yaw_rate };
        assert_eq!(generic(7, &[1.0, 2.0, 3.0, 90.0]), Ok(position));
    }

    #[test]
    fn a_full_state_is_in_thousandths() {
        let numbers: [i16; 9] = [1000, -2000, 1500, 100, 200, -300, 0, 0, 0];
        let mut packet = Packet::new(Port::GenericCommander, 0).with(&[6]);
        for number in numbers {
            packet = packet.with(&number.to_le_bytes());
        }
        let Ok(CommanderPacket::Follow(CrtpSetPoint::Moving { position, velocity })) =
            CommanderPacket::of(&packet, OldCommander::Attitude)
        else {
            panic!("not a moving point");
        };
        assert!((position - Vector3::new(1.0, -2.0, 1.5)).norm() < 1e-6);
        assert!((velocity - Vector3::new(0.1, 0.2, -0.3)).norm() < 1e-6);
    }

    #[test]
    fn the_end_of_set_points_is_heard() {
        assert_eq!(commander_packet(Port::GenericCommander, 1, Some(0), &[0.0]), Ok(CommanderPacket::Release));
        assert_eq!(commander_packet(Port::GenericCommander, 1, Some(1), &[]), Err(CrtpSetPointError::Malformed));
        assert_eq!(commander_packet(Port::GenericCommander, 1, None, &[]), Err(CrtpSetPointError::Malformed));
    }

    #[test]
    fn attitudes_are_refused() {
        for kind in [3, 4, 11] {
            assert_eq!(generic(kind, &[0.0; 4]), Err(CrtpSetPointError::Attitude));
        }
        assert_eq!(old(30_000, OldCommander::Attitude), Err(CrtpSetPointError::Attitude));
    }

    #[test]
    fn the_old_commander_stops_without_thrust_and_can_set_positions() {
        for old_commander in [OldCommander::Attitude, OldCommander::Position] {
            assert_eq!(old(0, old_commander), Ok(CommanderPacket::Follow(CrtpSetPoint::Stop)));
        }
        let yaw = core::f32::consts::FRAC_PI_2;
        let position = CrtpSetPoint::Position { position: Vector3::new(0.5, 1.5, 0.75), yaw };
        assert_eq!(old(750, OldCommander::Position), Ok(CommanderPacket::Follow(position)));
    }

    #[test]
    fn numbers_that_are_not_finite_and_short_packets_are_refused() {
        for kind in [1, 2, 5, 7, 8, 9, 10] {
            for wrong in [&[0.0, f32::NAN, 0.0, 0.0][..], &[f32::INFINITY; 4], &[0.0; 2]] {
                assert_eq!(generic(kind, wrong), Err(CrtpSetPointError::Malformed), "{kind}: {wrong:?}");
            }
        }
        assert_eq!(generic(6, &[0.0; 2]), Err(CrtpSetPointError::Malformed));
        assert_eq!(generic(12, &[0.0; 4]), Err(CrtpSetPointError::Malformed));
        assert_eq!(commander_packet(Port::Commander, 0, None, &[0.0; 3]), Err(CrtpSetPointError::Malformed));
        assert_eq!(commander_packet(Port::GenericCommander, 2, Some(0), &[]), Err(CrtpSetPointError::Malformed));
    }

    #[test]
    fn points_outside_are_refused_and_those_barely_under_the_floor_are_on_it() {
        assert_eq!(generic(7, &[0.0, 0.0, -0.5, 0.0]), Err(CrtpSetPointError::Outside));
        assert_eq!(generic(7, &[0.0, -1001.0, 1.0, 0.0]), Err(CrtpSetPointError::Outside));
        assert_eq!(generic(10, &[0.0, 0.0, 0.0, 2000.0]), Err(CrtpSetPointError::Outside));
        assert_eq!(
            generic(7, &[0.0, 0.0, -0.05, 0.0]),
            Ok(CrtpSetPoint::Position { position: Vector3::zeros(), yaw: 0.0 })
        );
    }
}
