//! What the items of a mission have a vehicle do.

use mavlink::dialects::common::MavMissionResult;

use super::place::{MissionTarget, REACH_M, target};
use super::{MISSION_ITEMS, MissionItem};
use crate::geodesy::Home;

/// Heights of a take-off \[m\]: above ground effect, and within sight.
const TAKEOFF_HEIGHTS_M: core::ops::RangeInclusive<f32> = 0.2..=20.0;

/// Commands to cameras, gimbals and what they look at. There are none on board: they are kept and skipped, so that
/// plans that were made for other vehicles fly.
const SKIPPED: [u16; 28] = [
    80, 195, 196, 197, 198, 201, // regions of interest
    204, 205, 220, 1000, 1001, // gimbals
    200, 202, 203, 206, 214, 530, 531, 532, 534, 2000, 2001, 2003, 2500, 2501, 2502, 2503, 2800, // cameras
];

/// Most turns around a point, the greatest radius, and that of a circle that leaves it open \[m\].
const TURNS_LIMIT: f32 = 1000.0;
const CIRCLE_LIMIT_M: f32 = 100.0;
const CIRCLE_M: f32 = 1.0;

/// One thing to do; places are in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MissionStep {
    /// Climb, then go to a place.
    TakeOff(MissionTarget),
    /// Go to a point.
    GoTo {
        /// The point.
        target: MissionTarget,
        /// Time to stay there \[s\].
        hold_secs: f32,
        /// Distance at which it counts as reached \[m\], if the sender cares.
        radius_m: Option<f32>,
    },
    /// Go to a point and stay there.
    Loiter {
        /// The point.
        target: MissionTarget,
        /// For how long.
        time: LoiterTime,
    },
    /// Fly around a point.
    Circle(MissionCircle),
    /// Land at a place.
    Land(MissionTarget),
    /// Fly home and land.
    Return,
    /// From now on go to points at another speed.
    ChangeSpeed(MissionSpeed),
    /// Stay here for some time \[s\].
    Delay {
        /// How long.
        secs: f32,
    },
    /// Turn the nose.
    Turn(MissionTurn),
    /// Go on with another item, so many times.
    Jump {
        /// Its number.
        to: u16,
        /// How often; none for ever.
        times: Option<u16>,
    },
    /// Nothing that this vehicle can do.
    Skip,
}

/// Turns around a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissionCircle {
    /// The point; its height is that of the circle.
    pub center: MissionTarget,
    /// Of the circle \[m\].
    pub radius_m: f32,
    /// Which way.
    pub sense: TurningSense,
    /// How often, above zero.
    pub turns: f32,
}

/// A way around, seen from above.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TurningSense {
    /// As the clock's hands.
    Clockwise,
    /// The other way.
    CounterClockwise,
}

/// For how long to stay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LoiterTime {
    /// Some time \[s\].
    Secs(f32),
    /// Until a peer has the mission go on.
    UntilContinued,
}

/// How fast to go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MissionSpeed {
    /// As fast as the vehicle goes by itself.
    Default,
    /// At a speed \[m/s\], above zero.
    Of(f32),
}

/// Where the nose shall point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MissionTurn {
    /// A heading, counter-clockwise from the world's x axis \[rad\].
    To(f32),
    /// So far to the left of where it points \[rad\].
    By(f32),
}

/// What follows a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AfterStep {
    /// The next one.
    Proceed,
    /// A pause, until a peer has the mission go on.
    Pause,
}

/// A step and what follows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissionLeg {
    /// What to do.
    pub step: MissionStep,
    /// Where the nose shall point meanwhile, counter-clockwise from the world's x axis \[rad\], if the sender cares.
    pub heading: Option<f32>,
    /// And then.
    pub after: AfterStep,
}

/// The legs of a mission.
///
/// # Errors
/// What is wrong with the first wrong item.
pub fn legs(
    items: &[MissionItem],
    home: &Home,
) -> Result<heapless::Vec<MissionLeg, MISSION_ITEMS>, MavMissionResult> {
    let mut legs = heapless::Vec::new();
    for item in items {
        let leg = leg(item, home)?;
        if matches!(leg.step, MissionStep::Jump { to, .. } if usize::from(to) >= items.len()) {
            return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
        }
        legs.push(leg).map_err(|_| MavMissionResult::MAV_MISSION_NO_SPACE)?;
    }
    Ok(legs)
}

/// The leg of an item.
///
/// # Errors
/// What is wrong with it.
pub fn leg(item: &MissionItem, home: &Home) -> Result<MissionLeg, MavMissionResult> {
    let step = if SKIPPED.contains(&item.command) { MissionStep::Skip } else { flown(item, home)? };
    let after = if item.autocontinue == 0 { AfterStep::Pause } else { AfterStep::Proceed };
    let [_, _, _, yaw_deg] = item.parameters;
    let heading = (YAWING.contains(&item.command) && !yaw_deg.is_nan()).then(|| heading_of(yaw_deg));
    Ok(MissionLeg { step, heading, after })
}

/// Of a yaw \[°\], clockwise from north.
fn heading_of(yaw_deg: f32) -> f32 {
    core::f32::consts::FRAC_PI_2 - yaw_deg.to_radians()
}

/// A way-point, loitering and a take-off, whose fourth parameter is a yaw.
const YAWING: [u16; 3] = [16, 17, 22];

fn flown(item: &MissionItem, home: &Home) -> Result<MissionStep, MavMissionResult> {
    match item.command {
        16..=22 | 93 | 112 | 115 | 177 | 178 => check_finite(&item.parameters)?,
        _ => return Err(MavMissionResult::MAV_MISSION_UNSUPPORTED),
    }
    match item.command {
        16 => waypoint(item, home),
        17 => Ok(MissionStep::Loiter { target: target(item, home, REACH_M)?, time: LoiterTime::UntilContinued }),
        18 => circle(item, home),
        19 => loiter_time(item, home),
        20 => Ok(MissionStep::Return),
        // The floor says where a landing ends.
        21 => Ok(MissionStep::Land(target(&MissionItem { height: f32::NAN, ..*item }, home, REACH_M)?)),
        22 => take_off(item, home),
        115 => turn(item),
        177 => jump(item),
        178 => speed(item),
        _ => delay(item),
    }
}

/// Parameters may be left open, but not infinite.
fn check_finite(parameters: &[f32; 4]) -> Result<(), MavMissionResult> {
    let refusals = [
        MavMissionResult::MAV_MISSION_INVALID_PARAM1,
        MavMissionResult::MAV_MISSION_INVALID_PARAM2,
        MavMissionResult::MAV_MISSION_INVALID_PARAM3,
        MavMissionResult::MAV_MISSION_INVALID_PARAM4,
    ];
    let infinite = parameters.iter().position(|parameter| parameter.is_infinite());
    infinite.map_or(Ok(()), |index| Err(refusals[index]))
}

/// `MAV_CMD_NAV_WAYPOINT`. The radius of passing by is not looked at.
fn waypoint(item: &MissionItem, home: &Home) -> Result<MissionStep, MavMissionResult> {
    let [hold_secs, radius_m, _, _] = item.parameters;
    if hold_secs < 0.0 {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
    }
    if radius_m < 0.0 {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM2);
    }
    Ok(MissionStep::GoTo {
        target: target(item, home, REACH_M)?,
        hold_secs: if hold_secs.is_nan() { 0.0 } else { hold_secs },
        radius_m: Some(radius_m).filter(|radius_m| *radius_m > 0.0),
    })
}

/// `MAV_CMD_NAV_LOITER_TIME`.
fn loiter_time(item: &MissionItem, home: &Home) -> Result<MissionStep, MavMissionResult> {
    let secs = item.parameters[0];
    if secs < 0.0 {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
    }
    let time = LoiterTime::Secs(if secs.is_nan() { 0.0 } else { secs });
    Ok(MissionStep::Loiter { target: target(item, home, REACH_M)?, time })
}

/// `MAV_CMD_NAV_LOITER_TURNS`: a negative radius turns counter-clockwise, and one that is left open is of a metre.
fn circle(item: &MissionItem, home: &Home) -> Result<MissionStep, MavMissionResult> {
    let [turns, _, radius_m, _] = item.parameters;
    if !(turns > 0.0 && turns <= TURNS_LIMIT) {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
    }
    if radius_m.abs() > CIRCLE_LIMIT_M {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM3);
    }
    let is_open = radius_m.is_nan() || radius_m == 0.0;
    Ok(MissionStep::Circle(MissionCircle {
        center: target(item, home, REACH_M)?,
        radius_m: if is_open { CIRCLE_M } else { radius_m.abs() },
        sense: if radius_m < 0.0 { TurningSense::CounterClockwise } else { TurningSense::Clockwise },
        turns,
    }))
}

/// `MAV_CMD_NAV_TAKEOFF`.
fn take_off(item: &MissionItem, home: &Home) -> Result<MissionStep, MavMissionResult> {
    let target = target(item, home, REACH_M)?;
    if target.height_m.is_some_and(|height| !TAKEOFF_HEIGHTS_M.contains(&height)) {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM7);
    }
    Ok(MissionStep::TakeOff(target))
}

/// `MAV_CMD_DO_CHANGE_SPEED`, of the air or the ground; -1 and NaN change nothing, -2 is the default.
fn speed(item: &MissionItem) -> Result<MissionStep, MavMissionResult> {
    let [kind, speed, _, _] = item.parameters;
    if !kind.is_nan() && kind != 0.0 && kind != 1.0 {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
    }
    match speed {
        speed if speed.is_nan() || speed == -1.0 => Ok(MissionStep::Skip),
        -2.0 => Ok(MissionStep::ChangeSpeed(MissionSpeed::Default)),
        speed if speed > 0.0 => Ok(MissionStep::ChangeSpeed(MissionSpeed::Of(speed))),
        _ => Err(MavMissionResult::MAV_MISSION_INVALID_PARAM2),
    }
}

/// `MAV_CMD_CONDITION_YAW`: to an angle the shorter way, or by one to the right or (third parameter -1) to the left.
fn turn(item: &MissionItem) -> Result<MissionStep, MavMissionResult> {
    let [yaw_deg, _, direction, relative] = item.parameters;
    if yaw_deg.is_nan() {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
    }
    let turn = if relative == 1.0 {
        MissionTurn::By(yaw_deg.to_radians() * if direction < 0.0 { 1.0 } else { -1.0 })
    } else {
        MissionTurn::To(heading_of(yaw_deg))
    };
    Ok(MissionStep::Turn(turn))
}

/// `MAV_CMD_DO_JUMP`; -1 times is for ever.
fn jump(item: &MissionItem) -> Result<MissionStep, MavMissionResult> {
    let [to, times, _, _] = item.parameters;
    let whole = |number: f32| (0.0..65536.0).contains(&number) && number == libm::truncf(number);
    if !whole(to) {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1);
    }
    if times != -1.0 && !whole(times) {
        return Err(MavMissionResult::MAV_MISSION_INVALID_PARAM2);
    }
    Ok(MissionStep::Jump { to: to as u16, times: (times >= 0.0).then_some(times as u16) })
}

/// `MAV_CMD_NAV_DELAY` and `MAV_CMD_CONDITION_DELAY`; there is no time of day here.
fn delay(item: &MissionItem) -> Result<MissionStep, MavMissionResult> {
    let secs = item.parameters[0];
    if secs >= 0.0 { Ok(MissionStep::Delay { secs }) } else { Err(MavMissionResult::MAV_MISSION_INVALID_PARAM1) }
}

#[cfg(test)]
mod tests {
    use MavMissionResult::{
        MAV_MISSION_INVALID_PARAM1, MAV_MISSION_INVALID_PARAM2, MAV_MISSION_INVALID_PARAM3,
        MAV_MISSION_INVALID_PARAM4, MAV_MISSION_INVALID_PARAM7, MAV_MISSION_UNSUPPORTED,
        MAV_MISSION_UNSUPPORTED_FRAME,
    };

    use super::super::OPEN;
    use super::*;

    const NAN: f32 = f32::NAN;

    /// At 1 m north and 2 m east, 3 m high.
    fn item(command: u16, parameters: [f32; 4]) -> MissionItem {
        MissionItem { frame: 1, command, autocontinue: 1, parameters, place: [10_000, 20_000], height: -3.0 }
    }

    fn step(command: u16, parameters: [f32; 4]) -> Result<MissionStep, MavMissionResult> {
        leg(&item(command, parameters), &Home::default()).map(|leg| leg.step)
    }

    const THERE: MissionTarget = MissionTarget { horizontal_m: Some([2.0, 1.0]), height_m: Some(3.0) };
    const ON_FLOOR: MissionTarget = MissionTarget { horizontal_m: Some([2.0, 1.0]), height_m: None };

    #[test]
    fn items_become_steps() {
        let go_to = |hold_secs, radius_m| Ok(MissionStep::GoTo { target: THERE, hold_secs, radius_m });
        assert_eq!(step(16, [NAN; 4]), go_to(0.0, None));
        assert_eq!(step(16, [5.0, 0.5, 1.0, 90.0]), go_to(5.0, Some(0.5)));
        assert_eq!(step(16, [0.0; 4]), go_to(0.0, None));
        assert_eq!(
            step(17, [NAN; 4]),
            Ok(MissionStep::Loiter { target: THERE, time: LoiterTime::UntilContinued })
        );
        assert_eq!(
            step(19, [4.0, 0.0, 0.0, NAN]),
            Ok(MissionStep::Loiter { target: THERE, time: LoiterTime::Secs(4.0) })
        );
        assert_eq!(step(20, [0.0; 4]), Ok(MissionStep::Return));
        assert_eq!(step(21, [0.0, 0.0, 0.0, NAN]), Ok(MissionStep::Land(ON_FLOOR)));
        assert_eq!(step(22, [NAN; 4]), Ok(MissionStep::TakeOff(THERE)));
        assert_eq!(step(93, [2.0, -1.0, -1.0, -1.0]), Ok(MissionStep::Delay { secs: 2.0 }));
        assert_eq!(step(112, [2.0, 0.0, 0.0, 0.0]), Ok(MissionStep::Delay { secs: 2.0 }));
        assert_eq!(step(178, [1.0, 0.3, -1.0, 0.0]), Ok(MissionStep::ChangeSpeed(MissionSpeed::Of(0.3))));
        assert_eq!(step(178, [1.0, -2.0, -1.0, 0.0]), Ok(MissionStep::ChangeSpeed(MissionSpeed::Default)));
        assert_eq!(step(178, [1.0, -1.0, -1.0, 0.0]), Ok(MissionStep::Skip));
        let north = core::f32::consts::FRAC_PI_2;
        assert_eq!(step(115, [0.0, 0.0, 0.0, 0.0]), Ok(MissionStep::Turn(MissionTurn::To(north))));
        assert_eq!(step(115, [90.0, 0.0, 1.0, 1.0]), Ok(MissionStep::Turn(MissionTurn::By(-north))));
        assert_eq!(step(115, [90.0, 0.0, -1.0, 1.0]), Ok(MissionStep::Turn(MissionTurn::By(north))));
        assert_eq!(step(177, [3.0, 2.0, 0.0, 0.0]), Ok(MissionStep::Jump { to: 3, times: Some(2) }));
        assert_eq!(step(177, [3.0, -1.0, 0.0, 0.0]), Ok(MissionStep::Jump { to: 3, times: None }));
    }

    #[test]
    fn a_yaw_is_where_the_nose_points_and_none_is_none() {
        let heading =
            |command, yaw_deg| leg(&item(command, [0.0, 0.0, 0.0, yaw_deg]), &Home::default()).unwrap().heading;
        // East is the world's x axis.
        assert!(heading(16, 90.0).unwrap().abs() < 1e-6);
        assert_eq!(heading(22, 0.0), Some(core::f32::consts::FRAC_PI_2));
        assert_eq!([heading(16, NAN), heading(19, 90.0), heading(21, 90.0)], [None; 3]);
    }

    #[test]
    fn a_jump_leads_to_an_item_that_there_is() {
        let jump = |to| [item(16, [NAN; 4]), item(177, [to, 1.0, 0.0, 0.0])];
        assert!(legs(&jump(1.0), &Home::default()).is_ok());
        assert_eq!(legs(&jump(2.0), &Home::default()), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(step(177, [0.5, 1.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(step(177, [0.0, -2.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM2));
    }

    #[test]
    fn what_a_camera_would_do_is_skipped_whatever_its_parameters() {
        for command in [205, 1000, 2000, 2001, 530, 2500, 2501, 201, 203] {
            let item = MissionItem { frame: 2, ..item(command, [f32::INFINITY, NAN, -1.0, 1e30]) };
            assert_eq!(
                leg(&item, &Home::default()),
                Ok(MissionLeg { step: MissionStep::Skip, heading: None, after: AfterStep::Proceed })
            );
        }
    }

    #[test]
    fn what_cannot_be_flown_is_refused_with_the_reason() {
        assert_eq!(step(16, [-1.0, 0.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(step(16, [f32::INFINITY, 0.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(step(16, [0.0, -1.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM2));
        assert_eq!(step(16, [0.0, 0.0, f32::INFINITY, 0.0]), Err(MAV_MISSION_INVALID_PARAM3));
        assert_eq!(step(16, [0.0, 0.0, 0.0, f32::NEG_INFINITY]), Err(MAV_MISSION_INVALID_PARAM4));
        assert_eq!(step(19, [-1.0, 0.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(step(93, [-1.0, 12.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(step(93, [NAN; 4]), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(step(178, [3.0, 1.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(step(178, [1.0, 0.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM2));
        assert_eq!(step(178, [1.0, -3.0, 0.0, 0.0]), Err(MAV_MISSION_INVALID_PARAM2));
        for command in [0, 31, 400, 5001, u16::MAX] {
            assert_eq!(step(command, [0.0; 4]), Err(MAV_MISSION_UNSUPPORTED), "{command}");
        }
        let high = MissionItem { height: -20.1, ..item(22, [NAN; 4]) };
        assert_eq!(leg(&high, &Home::default()), Err(MAV_MISSION_INVALID_PARAM7));
        let elsewhere = MissionItem { frame: 8, ..item(16, [NAN; 4]) };
        assert_eq!(leg(&elsewhere, &Home::default()), Err(MAV_MISSION_UNSUPPORTED_FRAME));
    }

    #[test]
    fn a_landing_wants_no_height_and_no_place() {
        let open = MissionItem { place: [OPEN; 2], height: 1e9, ..item(21, [NAN; 4]) };
        let here = MissionTarget { horizontal_m: None, height_m: None };
        assert_eq!(leg(&open, &Home::default()).map(|leg| leg.step), Ok(MissionStep::Land(here)));
    }

    #[test]
    fn circles_have_a_sense_and_a_radius() {
        let circle = |parameters| match step(18, parameters) {
            Ok(MissionStep::Circle(MissionCircle { radius_m, sense, turns, .. })) => Ok((radius_m, sense, turns)),
            Ok(other) => panic!("{other:?}"),
            Err(result) => Err(result),
        };
        assert_eq!(circle([2.0, NAN, 0.5, NAN]), Ok((0.5, TurningSense::Clockwise, 2.0)));
        assert_eq!(circle([0.5, 0.0, -2.0, 0.0]), Ok((2.0, TurningSense::CounterClockwise, 0.5)));
        assert_eq!(circle([1.0, NAN, NAN, NAN]), Ok((1.0, TurningSense::Clockwise, 1.0)));
        assert_eq!(circle([0.0, NAN, 1.0, NAN]), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(circle([NAN; 4]), Err(MAV_MISSION_INVALID_PARAM1));
        assert_eq!(circle([1.0, NAN, 101.0, NAN]), Err(MAV_MISSION_INVALID_PARAM3));
    }

    #[test]
    fn an_item_that_does_not_continue_pauses() {
        let item = MissionItem { autocontinue: 0, ..item(16, [NAN; 4]) };
        assert_eq!(leg(&item, &Home::default()).map(|leg| leg.after), Ok(AfterStep::Pause));
    }
}
