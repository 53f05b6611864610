//! What the high-level commander is asked for: take off, go there, land. Spirals and trajectories are refused.

use nalgebra::Vector3;

use super::packet::{Fields, Packet};
use super::plan::PlanProfile;
use super::status;

/// Longest time that a maneuver may take \[s\].
const DURATION_LIMIT_SECS: f32 = 3600.0;

/// From where a coordinate counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// The world.
    World,
    /// Where the drone is to be now.
    Here,
}

/// Where a maneuver ends to look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum YawGoal {
    /// Where it looks.
    Keep,
    /// At this yaw \[rad\].
    To(f32),
    /// So far to the left \[rad\].
    By(f32),
}

/// How fast a maneuver is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ManeuverTiming {
    /// It takes so long \[s\], above zero.
    Duration(f32),
    /// So fast on average \[m/s\], above zero.
    Speed(f32),
    /// As the parameters say.
    Usual,
}

/// One maneuver; all numbers are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Maneuver {
    /// Belong to these groups of the swarm.
    JoinGroups(u8),
    /// Straight up to a height \[m\].
    TakeOff {
        /// Of the goal.
        height_m: f32,
        /// From where it counts, upward.
        origin: Origin,
        /// How fast.
        timing: ManeuverTiming,
        /// Where it looks.
        yaw_goal: YawGoal,
    },
    /// Straight down to a height \[m\], and on until the floor carries the drone.
    Land {
        /// Of the end of the plan.
        height_m: f32,
        /// From where it counts: upward in the world, downward from here.
        origin: Origin,
        /// How fast.
        timing: ManeuverTiming,
        /// Where it looks.
        yaw_goal: YawGoal,
    },
    /// Motors stop, and what flies falls.
    Stop,
    /// To a point \[m\].
    GoTo {
        /// Of the goal.
        point: Vector3<f32>,
        /// From where it counts.
        origin: Origin,
        /// How long it takes \[s\], above zero.
        duration_secs: f32,
        /// How it runs through this time.
        profile: PlanProfile,
        /// Where it looks.
        yaw_goal: YawGoal,
    },
}

impl Maneuver {
    /// The maneuver in a packet, and the groups that are to fly it; 0 is everybody.
    ///
    /// # Errors
    /// The [`status`] to answer with.
    pub fn of(packet: &Packet) -> Result<(u8, Self), u8> {
        let mut fields = packet.fields();
        let command = fields.byte().ok_or(status::INVALID)?;
        let groups = fields.byte().ok_or(status::INVALID)?;
        match command {
            0 => Ok((0, Self::JoinGroups(groups))),
            1 | 2 | 4 | 7..=10 | 12 => {
                let maneuver = Self::motion(command, fields).ok_or(status::INVALID)?;
                Ok((groups, maneuver))
            }
            3 => Ok((groups, Self::Stop)),
            // Trajectories (5, 6, 13) and spirals (11) among them.
            _ => Err(status::UNKNOWN_COMMAND),
        }
    }

    fn motion(command: u8, mut fields: Fields) -> Option<Self> {
        match command {
            1 => Some(Self::up(Vertical::timed(&mut fields)?)),
            2 => Some(Self::down(Vertical::timed(&mut fields)?)),
            7 => Some(Self::up(Vertical::turned(&mut fields)?)),
            8 => Some(Self::down(Vertical::turned(&mut fields)?)),
            9 => Some(Self::up(Vertical::fast(&mut fields)?)),
            10 => Some(Self::down(Vertical::fast(&mut fields)?)),
            _ => {
                let origin = origin(fields.byte()?);
                let linear = command == 12 && fields.byte()? != 0;
                let (point, yaw, duration_secs) = (fields.vector()?, fields.float()?, seconds(&mut fields)?);
                let profile = if linear { PlanProfile::Linear } else { PlanProfile::Smooth };
                let yaw_goal = match origin {
                    Origin::World => YawGoal::To(yaw),
                    Origin::Here => YawGoal::By(yaw),
                };
                Some(Self::GoTo { point, origin, duration_secs, profile, yaw_goal })
            }
        }
    }

    fn up(Vertical { height_m, origin, timing, yaw_goal }: Vertical) -> Self {
        Self::TakeOff { height_m, origin, timing, yaw_goal }
    }

    fn down(Vertical { height_m, origin, timing, yaw_goal }: Vertical) -> Self {
        Self::Land { height_m, origin, timing, yaw_goal }
    }
}

/// What take-offs and landings have in common, in the three forms of their packets.
struct Vertical {
    height_m: f32,
    origin: Origin,
    timing: ManeuverTiming,
    yaw_goal: YawGoal,
}

impl Vertical {
    fn timed(fields: &mut Fields) -> Option<Self> {
        let (height_m, timing) = (fields.float()?, ManeuverTiming::Duration(seconds(fields)?));
        Some(Self { height_m, origin: Origin::World, timing, yaw_goal: YawGoal::To(0.0) })
    }

    fn turned(fields: &mut Fields) -> Option<Self> {
        let (height_m, yaw_goal) = (fields.float()?, yaw_goal(fields)?);
        Some(Self {
            height_m,
            origin: Origin::World,
            timing: ManeuverTiming::Duration(seconds(fields)?),
            yaw_goal,
        })
    }

    fn fast(fields: &mut Fields) -> Option<Self> {
        let (height_m, origin) = (fields.float()?, origin(fields.byte()?));
        let (yaw_goal, speed) = (yaw_goal(fields)?, fields.float()?);
        let timing = if speed > 0.0 { ManeuverTiming::Speed(speed) } else { ManeuverTiming::Usual };
        Some(Self { height_m, origin, timing, yaw_goal })
    }
}

/// A yaw, and whether to keep the present one instead.
fn yaw_goal(fields: &mut Fields) -> Option<YawGoal> {
    let (yaw, keeps) = (fields.float()?, fields.byte()?);
    Some(if keeps == 0 { YawGoal::To(yaw) } else { YawGoal::Keep })
}

fn origin(relative: u8) -> Origin {
    if relative == 0 { Origin::World } else { Origin::Here }
}

fn seconds(fields: &mut Fields) -> Option<f32> {
    fields.float().filter(|secs| *secs > 0.0 && *secs <= DURATION_LIMIT_SECS)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crtp::packet::Port;

    fn read(head: &[u8], tail: &[f32]) -> Result<(u8, Maneuver), u8> {
        let tail: Vec<u8> = tail.iter().flat_map(|number| number.to_le_bytes()).collect();
        Maneuver::of(&Packet::new(Port::HighLevelCommander, 0).with(head).with(&tail))
    }

    /// Height, yaw, whether the yaw is kept, and a last number.
    fn turned(command: u8, height_m: f32, last: f32) -> Result<(u8, Maneuver), u8> {
        let mut head = vec![command, 5];
        head.extend(height_m.to_le_bytes());
        head.extend([0; 5]);
        read(&head, &[last])
    }

    #[test]
    fn take_offs_and_landings_are_read_in_all_forms() {
        let (height_m, origin, timing, yaw_goal) =
            (0.75, Origin::World, ManeuverTiming::Duration(2.0), YawGoal::To(0.0));
        let up = Maneuver::TakeOff { height_m, origin, timing, yaw_goal };
        let down = Maneuver::Land { height_m, origin, timing, yaw_goal };
        for (old, new, expected) in [(1, 7, up), (2, 8, down)] {
            assert_eq!(read(&[old, 5], &[0.75, 2.0]), Ok((5, expected)));
            assert_eq!(turned(new, 0.75, 2.0), Ok((5, expected)));
        }
        let mut head = vec![9, 0];
        head.extend(0.75_f32.to_le_bytes());
        head.extend([1, 0, 0, 0, 0, 1]);
        let up = |timing| {
            Ok((0, Maneuver::TakeOff { height_m, origin: Origin::Here, timing, yaw_goal: YawGoal::Keep }))
        };
        assert_eq!(read(&head, &[0.3]), up(ManeuverTiming::Speed(0.3)));
        assert_eq!(read(&head, &[0.0]), up(ManeuverTiming::Usual));
        head[0] = 10;
        assert!(matches!(read(&head, &[0.3]), Ok((0, Maneuver::Land { origin: Origin::Here, .. }))));
    }

    #[test]
    fn flights_to_points_are_read_in_both_forms() {
        let numbers = [1.0, -2.0, 0.5, 3.0, 4.0];
        let go_to = |origin, profile, yaw_goal| {
            let point = Vector3::new(1.0, -2.0, 0.5);
            Ok((2, Maneuver::GoTo { point, origin, duration_secs: 4.0, profile, yaw_goal }))
        };
        assert_eq!(read(&[4, 2, 1], &numbers), go_to(Origin::Here, PlanProfile::Smooth, YawGoal::By(3.0)));
        assert_eq!(read(&[12, 2, 0, 1], &numbers), go_to(Origin::World, PlanProfile::Linear, YawGoal::To(3.0)));
    }

    #[test]
    fn groups_and_stops_are_read() {
        assert_eq!(read(&[0, 6], &[]), Ok((0, Maneuver::JoinGroups(6))));
        assert_eq!(read(&[3, 1], &[]), Ok((1, Maneuver::Stop)));
    }

    #[test]
    fn what_cannot_be_flown_is_refused() {
        for command in [5, 6, 11, 13, 14, 255] {
            assert_eq!(read(&[command, 0], &[1.0; 6]), Err(status::UNKNOWN_COMMAND), "{command}");
        }
        for wrong in [&[0.5, 0.0][..], &[0.5, -1.0], &[0.5, 1e5], &[f32::NAN, 1.0], &[0.5, f32::INFINITY], &[0.5]]
        {
            assert_eq!(read(&[1, 0], wrong), Err(status::INVALID), "{wrong:?}");
        }
        for short in [&[][..], &[1], &[4, 0], &[12, 0, 0], &[7, 0, 0]] {
            assert_eq!(read(short, &[]), Err(status::INVALID), "{short:?}");
        }
    }
}
