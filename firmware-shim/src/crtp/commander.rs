//! Flies what clients ask for: set-points while they are fresh, and plans to their end.
//!
//! Both move the autopilot's goal at a velocity that is computed anew in every control period, no faster than
//! [`SPEED_LIMIT`]. If the autopilot refuses such a velocity (while it lands, after a failsafe), it has the authority from then on.

use core::f64::consts::TAU;

use nalgebra::Vector3;

use super::access::VehicleAccess;
use super::maneuver::{Maneuver, ManeuverTiming, Origin, YawGoal};
use super::parameter::CrtpParameters;
use super::plan::{Ending, PlanProfile, TrajectoryPlan};
use super::set_point::{CrtpSetPoint, inside};
use super::status;
use crate::autopilot::{Command, Mode, Refusal, SPEED_LIMIT};

/// Without a new set-point for this long the drone hovers \[s\] (the firmware's `COMMANDER_WDT_TIMEOUT_STABILIZE`).
pub const HOVER_SECS: f64 = 0.5;

/// Without a new set-point for this long it lands \[s\] (`COMMANDER_WDT_TIMEOUT_SHUTDOWN`; there it falls).
pub const LAND_SECS: f64 = 2.0;

/// Time in which the goal makes up for its distance from where it is to be \[s\]: that between two set-points of
/// common clients.
const CATCH_UP_SECS: f32 = 0.2;

/// Height of a take-off that a set-point begins \[m\]; the next one flies on from there.
const TAKEOFF_ALTITUDE_M: f32 = 1.0;

/// A set-point so high above a drone on the floor takes off \[m\].
const LIFT_M: f32 = 0.02;

/// Shortest and longest plan \[s\]; a shorter one would be flown at the speed limit alone.
const PLAN_SECS: [f32; 2] = [0.1, 3600.0];

/// Whose set-points are flown.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    /// None.
    None,
    /// The client's, that of a time \[s\].
    Stream { set_point: CrtpSetPoint, secs: f64, claim: Claim },
    /// The high-level commander's.
    TrajectoryPlan(TrajectoryPlan),
    /// None any more: the high-level commander is at its point.
    Arrived,
}

/// Whether others may fly while set-points are fresh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Claim {
    Mine,
    Released,
}

/// What the high-level commander is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HighLevel {
    /// Nothing; the motors rest.
    Stopped,
    /// It flies a plan.
    Flying,
    /// It has flown one, and hovers or lands.
    Finished,
    /// Others fly.
    Disabled,
}

/// What is flown on behalf of the clients.
#[derive(Clone, Debug)]
pub struct Commander {
    source: Source,
    /// Yaw of a drone that had turned as it was told \[rad\].
    heading: f64,
    steered_secs: f64,
}

impl Default for Commander {
    fn default() -> Self {
        Self { source: Source::None, heading: 0.0, steered_secs: 0.0 }
    }
}

impl Commander {
    /// What the high-level commander is doing, in a mode of the autopilot.
    pub fn high_level(&self, mode: Mode) -> HighLevel {
        match self.source {
            Source::TrajectoryPlan(_) => HighLevel::Flying,
            Source::Arrived => HighLevel::Finished,
            Source::None if !mode.flies() => HighLevel::Stopped,
            Source::None | Source::Stream { .. } => HighLevel::Disabled,
        }
    }

    /// Flies a set-point from now on, and takes off if it is above a drone on the floor.
    ///
    /// # Errors
    /// Why the drone does not take off.
    pub fn follow(&mut self, set_point: CrtpSetPoint, access: &mut VehicleAccess) -> Result<(), Refusal> {
        if set_point == CrtpSetPoint::Stop {
            return self.stop(access);
        }
        if !access.mode.flies() && !lifts(&set_point, access.state.position.z) {
            return Ok(());
        }
        self.take_control(access)?;
        if let CrtpSetPoint::Position { yaw, .. } = set_point {
            self.heading = yaw.into();
        }
        self.source = Source::Stream { set_point, secs: access.secs, claim: Claim::Mine };
        Ok(())
    }

    /// Lets others fly although set-points are fresh.
    pub fn release(&mut self) {
        if let Source::Stream { claim, .. } = &mut self.source {
            *claim = Claim::Released;
        }
    }

    /// Stops the motors.
    ///
    /// # Errors
    /// As the autopilot.
    pub fn stop(&mut self, access: &mut VehicleAccess) -> Result<(), Refusal> {
        self.source = Source::None;
        if access.mode.flies() { access.order(Command::StopMotors) } else { Ok(()) }
    }

    /// Begins a maneuver.
    ///
    /// # Errors
    /// The [`status`] to answer with, and why the autopilot refuses if it does.
    pub fn begin(
        &mut self,
        maneuver: Maneuver,
        parameters: &CrtpParameters,
        access: &mut VehicleAccess,
    ) -> Result<(), (u8, Option<Refusal>)> {
        if maneuver == Maneuver::Stop {
            return self.stop(access).map_err(|refusal| (status::BUSY, Some(refusal)));
        }
        if matches!(self.source, Source::Stream { claim: Claim::Mine, .. }) {
            return Err((status::BUSY, None));
        }
        let plan = self.plan(maneuver, parameters, access).map_err(|status| (status, None))?;
        self.take_control(access).map_err(|refusal| (status::BUSY, Some(refusal)))?;
        self.turn(maneuver.yaw_goal());
        self.source = Source::TrajectoryPlan(plan);
        Ok(())
    }

    /// Makes the autopilot ready to be guided, from where the drone is.
    fn take_control(&mut self, access: &mut VehicleAccess) -> Result<(), Refusal> {
        guide(access)?;
        if self.source == Source::None {
            let [_, _, yaw] = access.state.world_from_body.map(f64::from).roll_pitch_yaw();
            self.heading = yaw;
        }
        Ok(())
    }

    fn turn(&mut self, yaw_goal: YawGoal) {
        self.heading = match yaw_goal {
            YawGoal::Keep => self.heading,
            YawGoal::To(yaw) => yaw.into(),
            YawGoal::By(angle_rad) => self.heading + f64::from(angle_rad),
        };
    }

    fn plan(
        &self,
        maneuver: Maneuver,
        parameters: &CrtpParameters,
        access: &VehicleAccess,
    ) -> Result<TrajectoryPlan, u8> {
        let (start, start_velocity) = self.now(access);
        let (end, timing) = match maneuver {
            Maneuver::TakeOff { .. } if access.mode.flies() => return Err(status::NOT_PERMITTED),
            Maneuver::Land { .. } if !access.mode.flies() => return Err(status::NOT_PERMITTED),
            Maneuver::TakeOff { height_m, origin, timing, .. } => {
                (start.xy().push(base(origin, start.z) + height_m), timing.or_usual(parameters.take_off_speed()))
            }
            Maneuver::Land { height_m, origin: Origin::World, timing, .. } => {
                (start.xy().push(height_m), timing.or_usual(parameters.landing_speed()))
            }
            Maneuver::Land { height_m, origin: Origin::Here, timing, .. } => {
                (start.xy().push(start.z - height_m), timing.or_usual(parameters.landing_speed()))
            }
            Maneuver::GoTo { point, origin, duration_secs, .. } => {
                (start.map(|here| base(origin, here)) + point, ManeuverTiming::Duration(duration_secs))
            }
            Maneuver::JoinGroups(_) | Maneuver::Stop => return Err(status::UNKNOWN_COMMAND),
        };
        let end = inside(end).map_err(|_| status::INVALID)?;
        let duration_secs = timing.duration_secs((end - start).norm());
        let (profile, ending) = (maneuver.profile(), maneuver.ending());
        Ok(TrajectoryPlan { start, start_velocity, end, start_secs: access.secs, duration_secs, profile, ending })
    }

    /// Where the drone is to be now \[m\], and its velocity there \[m/s\].
    fn now(&self, access: &VehicleAccess) -> (Vector3<f32>, Vector3<f32>) {
        match self.source {
            Source::TrajectoryPlan(plan) => plan.at(access.secs),
            Source::None | Source::Stream { .. } | Source::Arrived if access.mode.flies() => {
                (access.goal.position(), Vector3::zeros())
            }
            Source::None | Source::Stream { .. } | Source::Arrived => (access.state.position, Vector3::zeros()),
        }
    }

    /// Moves the goal for one control period, if it is to move.
    pub fn steer(&mut self, access: &mut VehicleAccess) {
        if !access.mode.flies() {
            self.source = Source::None;
        }
        let command = match self.source {
            Source::None | Source::Arrived => None,
            Source::Stream { set_point, secs, .. } => self.stream(&set_point, access.secs - secs, access),
            Source::TrajectoryPlan(plan) => Some(self.advance(&plan, access)),
        };
        if command.is_some_and(|command| access.order(command).is_err()) {
            self.source = Source::None;
        }
        self.steered_secs = access.secs;
    }

    /// What a set-point of this age wants; at a certain age hover, later land.
    fn stream(&mut self, set_point: &CrtpSetPoint, age_secs: f64, access: &VehicleAccess) -> Option<Command> {
        if age_secs > LAND_SECS {
            self.source = Source::None;
            return Some(Command::Land);
        }
        if age_secs > HOVER_SECS {
            return (access.mode == Mode::Guided).then_some(Command::Pause);
        }
        let elapsed_secs = access.secs - self.steered_secs;
        self.heading = (self.heading + f64::from(yaw_rate(set_point)) * elapsed_secs) % TAU;
        velocity(set_point, self.heading, access).map(|velocity| Command::Velocity(limited(velocity)))
    }

    fn advance(&mut self, plan: &TrajectoryPlan, access: &VehicleAccess) -> Command {
        if plan.is_over(access.secs) {
            self.source = Source::Arrived;
            return match plan.ending {
                Ending::Hover => Command::GoTo(plan.end),
                Ending::Land => Command::Land,
            };
        }
        let (position, velocity) = plan.at(access.secs);
        Command::Velocity(limited(velocity + catch_up(position, access)))
    }
}

impl ManeuverTiming {
    fn or_usual(self, speed: f32) -> Self {
        match self {
            Self::Usual => Self::Speed(speed),
            Self::Duration(_) | Self::Speed(_) => self,
        }
    }

    fn duration_secs(self, distance_m: f32) -> f32 {
        let [shortest, longest] = PLAN_SECS;
        let secs = match self {
            Self::Duration(secs) => secs,
            Self::Speed(speed) if speed > 0.0 => distance_m / speed,
            Self::Speed(_) | Self::Usual => distance_m / SPEED_LIMIT,
        };
        secs.clamp(shortest, longest)
    }
}

impl Maneuver {
    fn profile(&self) -> PlanProfile {
        match self {
            Self::GoTo { profile, .. } => *profile,
            Self::JoinGroups(_) | Self::TakeOff { .. } | Self::Land { .. } | Self::Stop => PlanProfile::Smooth,
        }
    }

    fn yaw_goal(&self) -> YawGoal {
        match self {
            Self::TakeOff { yaw_goal, .. } | Self::Land { yaw_goal, .. } | Self::GoTo { yaw_goal, .. } => {
                *yaw_goal
            }
            Self::JoinGroups(_) | Self::Stop => YawGoal::Keep,
        }
    }

    fn ending(&self) -> Ending {
        match self {
            Self::Land { .. } => Ending::Land,
            Self::JoinGroups(_) | Self::TakeOff { .. } | Self::GoTo { .. } | Self::Stop => Ending::Hover,
        }
    }
}

/// Where a coordinate counts from \[m, world\].
fn base(origin: Origin, here: f32) -> f32 {
    match origin {
        Origin::World => 0.0,
        Origin::Here => here,
    }
}

/// Whether a set-point is above a drone on the floor at `floor_m`.
fn lifts(set_point: &CrtpSetPoint, floor_m: f32) -> bool {
    match set_point {
        CrtpSetPoint::Stop => false,
        CrtpSetPoint::Velocity { velocity, .. } => velocity.z > 0.0,
        CrtpSetPoint::Hover { height_m, .. } => *height_m > floor_m + LIFT_M,
        CrtpSetPoint::Position { position, .. } | CrtpSetPoint::Moving { position, .. } => {
            position.z > floor_m + LIFT_M
        }
    }
}

/// Has the autopilot take off if it must. As a Crazyflie with brushed motors it need not be armed.
fn guide(access: &mut VehicleAccess) -> Result<(), Refusal> {
    match access.mode {
        Mode::Disarmed | Mode::Armed | Mode::Landed => {
            access.order(Command::Arm)?;
            access.order(Command::TakeOff { altitude_m: TAKEOFF_ALTITUDE_M })?;
            access.order(Command::Pause)
        }
        Mode::TakingOff => access.order(Command::Pause),
        Mode::Holding | Mode::Guided | Mode::Offboard | Mode::Returning => Ok(()),
        Mode::Landing => Err(Refusal::NotCruising),
    }
}

/// How fast a set-point turns to the left \[rad/s\].
fn yaw_rate(set_point: &CrtpSetPoint) -> f32 {
    match set_point {
        CrtpSetPoint::Velocity { yaw_rate, .. } | CrtpSetPoint::Hover { yaw_rate, .. } => *yaw_rate,
        CrtpSetPoint::Stop | CrtpSetPoint::Position { .. } | CrtpSetPoint::Moving { .. } => 0.0,
    }
}

/// Velocity of the goal \[m/s, world\] that a set-point wants of a drone with a heading \[rad\].
fn velocity(set_point: &CrtpSetPoint, heading: f64, access: &VehicleAccess) -> Option<Vector3<f32>> {
    match *set_point {
        CrtpSetPoint::Stop => None,
        CrtpSetPoint::Velocity { velocity, .. } => Some(velocity),
        CrtpSetPoint::Hover { ahead, left, height_m, .. } => {
            let (sine, cosine) = (libm::sin(heading) as f32, libm::cos(heading) as f32);
            let climb = (height_m - access.goal.position().z) / CATCH_UP_SECS;
            Some(Vector3::new(cosine * ahead - sine * left, sine * ahead + cosine * left, climb))
        }
        CrtpSetPoint::Position { position, .. } => Some(catch_up(position, access)),
        CrtpSetPoint::Moving { position, velocity } => Some(velocity + catch_up(position, access)),
    }
}

/// Velocity that brings the goal to a point \[m/s\].
fn catch_up(point: Vector3<f32>, access: &VehicleAccess) -> Vector3<f32> {
    (point - access.goal.position()) / CATCH_UP_SECS
}

/// The velocity, slowed down to [`SPEED_LIMIT`]. Rounding must not lead beyond.
fn limited(velocity: Vector3<f32>) -> Vector3<f32> {
    let speed = velocity.norm();
    if speed <= SPEED_LIMIT { velocity } else { velocity * (0.999_999 * SPEED_LIMIT / speed) }
}
