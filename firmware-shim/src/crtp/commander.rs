//! Flies what clients ask for: set-points while they are fresh, and plans to their end.
//!
//! Both move the autopilot's goal at a velocity that is computed anew in every control period, no faster than
//! [`SPEED_LIMIT`]. Whoever refuses such a velocity (a landing, a failsafe) is in charge from then on.

use core::f64::consts::TAU;

use nalgebra::Vector3;

use super::bridge::Bridge;
use super::maneuver::{Haste, Maneuver, Origin, Turn};
use super::parameter::Parameters;
use super::plan::{Ending, Pace, Plan};
use super::set_point::{SetPoint, inside};
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
    /// Nobody's here.
    Nobody,
    /// The client's, that of a time \[s\].
    Stream { set_point: SetPoint, secs: f64, claim: Claim },
    /// The high-level commander's.
    Plan(Plan),
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
        Self { source: Source::Nobody, heading: 0.0, steered_secs: 0.0 }
    }
}

impl Commander {
    /// What the high-level commander is doing, in a mode of the autopilot.
    pub fn high_level(&self, mode: Mode) -> HighLevel {
        match self.source {
            Source::Plan(_) => HighLevel::Flying,
            Source::Arrived => HighLevel::Finished,
            Source::Nobody if !mode.flies() => HighLevel::Stopped,
            Source::Nobody | Source::Stream { .. } => HighLevel::Disabled,
        }
    }

    /// Flies a set-point from now on, and takes off if it is above a drone on the floor.
    ///
    /// # Errors
    /// Why the drone does not take off.
    pub fn follow(&mut self, set_point: SetPoint, bridge: &mut Bridge) -> Result<(), Refusal> {
        if set_point == SetPoint::Stop {
            return self.stop(bridge);
        }
        if !bridge.mode.flies() && !lifts(&set_point, bridge.state.position.z) {
            return Ok(());
        }
        self.take_control(bridge)?;
        if let SetPoint::Position { yaw, .. } = set_point {
            self.heading = yaw.into();
        }
        self.source = Source::Stream { set_point, secs: bridge.secs, claim: Claim::Mine };
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
    pub fn stop(&mut self, bridge: &mut Bridge) -> Result<(), Refusal> {
        self.source = Source::Nobody;
        if bridge.mode.flies() { bridge.order(Command::StopMotors) } else { Ok(()) }
    }

    /// Begins a maneuver.
    ///
    /// # Errors
    /// The [`status`] to answer with, and why the autopilot refuses if it does.
    pub fn begin(
        &mut self,
        maneuver: Maneuver,
        parameters: &Parameters,
        bridge: &mut Bridge,
    ) -> Result<(), (u8, Option<Refusal>)> {
        if maneuver == Maneuver::Stop {
            return self.stop(bridge).map_err(|refusal| (status::BUSY, Some(refusal)));
        }
        if matches!(self.source, Source::Stream { claim: Claim::Mine, .. }) {
            return Err((status::BUSY, None));
        }
        let plan = self.plan(maneuver, parameters, bridge).map_err(|status| (status, None))?;
        self.take_control(bridge).map_err(|refusal| (status::BUSY, Some(refusal)))?;
        self.turn(maneuver.turn());
        self.source = Source::Plan(plan);
        Ok(())
    }

    /// Makes the autopilot ready to be guided. Whoever begins to fly sees the drone as it stands.
    fn take_control(&mut self, bridge: &mut Bridge) -> Result<(), Refusal> {
        guide(bridge)?;
        if self.source == Source::Nobody {
            let [_, _, yaw] = bridge.state.world_from_body.map(f64::from).roll_pitch_yaw();
            self.heading = yaw;
        }
        Ok(())
    }

    fn turn(&mut self, turn: Turn) {
        self.heading = match turn {
            Turn::Keep => self.heading,
            Turn::To(yaw) => yaw.into(),
            Turn::By(angle_rad) => self.heading + f64::from(angle_rad),
        };
    }

    fn plan(&self, maneuver: Maneuver, parameters: &Parameters, bridge: &Bridge) -> Result<Plan, u8> {
        let (start, start_velocity) = self.now(bridge);
        let (end, haste) = match maneuver {
            Maneuver::TakeOff { .. } if bridge.mode.flies() => return Err(status::NOT_PERMITTED),
            Maneuver::Land { .. } if !bridge.mode.flies() => return Err(status::NOT_PERMITTED),
            Maneuver::TakeOff { height_m, origin, haste, .. } => {
                (start.xy().push(base(origin, start.z) + height_m), haste.or_usual(parameters.take_off_speed()))
            }
            Maneuver::Land { height_m, origin: Origin::World, haste, .. } => {
                (start.xy().push(height_m), haste.or_usual(parameters.landing_speed()))
            }
            Maneuver::Land { height_m, origin: Origin::Here, haste, .. } => {
                (start.xy().push(start.z - height_m), haste.or_usual(parameters.landing_speed()))
            }
            Maneuver::GoTo { point, origin, duration_secs, .. } => {
                (start.map(|here| base(origin, here)) + point, Haste::Duration(duration_secs))
            }
            Maneuver::JoinGroups(_) | Maneuver::Stop => return Err(status::UNKNOWN_COMMAND),
        };
        let end = inside(end).map_err(|_| status::INVALID)?;
        let duration_secs = haste.duration_secs((end - start).norm());
        let (pace, ending) = (maneuver.pace(), maneuver.ending());
        Ok(Plan { start, start_velocity, end, start_secs: bridge.secs, duration_secs, pace, ending })
    }

    /// Where the drone is to be now \[m\], and its velocity there \[m/s\].
    fn now(&self, bridge: &Bridge) -> (Vector3<f32>, Vector3<f32>) {
        match self.source {
            Source::Plan(plan) => plan.at(bridge.secs),
            Source::Nobody | Source::Stream { .. } | Source::Arrived if bridge.mode.flies() => {
                (bridge.goal.position(), Vector3::zeros())
            }
            Source::Nobody | Source::Stream { .. } | Source::Arrived => (bridge.state.position, Vector3::zeros()),
        }
    }

    /// Moves the goal for one control period, if it is to move.
    pub fn steer(&mut self, bridge: &mut Bridge) {
        if !bridge.mode.flies() {
            self.source = Source::Nobody;
        }
        let command = match self.source {
            Source::Nobody | Source::Arrived => None,
            Source::Stream { set_point, secs, .. } => self.stream(&set_point, bridge.secs - secs, bridge),
            Source::Plan(plan) => Some(self.advance(&plan, bridge)),
        };
        if command.is_some_and(|command| bridge.order(command).is_err()) {
            self.source = Source::Nobody;
        }
        self.steered_secs = bridge.secs;
    }

    /// What a set-point of this age wants; at a certain age hover, later land.
    fn stream(&mut self, set_point: &SetPoint, age_secs: f64, bridge: &Bridge) -> Option<Command> {
        if age_secs > LAND_SECS {
            self.source = Source::Nobody;
            return Some(Command::Land);
        }
        if age_secs > HOVER_SECS {
            return (bridge.mode == Mode::Guided).then_some(Command::Pause);
        }
        let elapsed_secs = bridge.secs - self.steered_secs;
        self.heading = (self.heading + f64::from(yaw_rate(set_point)) * elapsed_secs) % TAU;
        velocity(set_point, self.heading, bridge).map(|velocity| Command::Velocity(limited(velocity)))
    }

    fn advance(&mut self, plan: &Plan, bridge: &Bridge) -> Command {
        if plan.is_over(bridge.secs) {
            self.source = Source::Arrived;
            return match plan.ending {
                Ending::Hover => Command::GoTo(plan.end),
                Ending::Land => Command::Land,
            };
        }
        let (position, velocity) = plan.at(bridge.secs);
        Command::Velocity(limited(velocity + catch_up(position, bridge)))
    }
}

impl Haste {
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
    fn pace(&self) -> Pace {
        match self {
            Self::GoTo { pace, .. } => *pace,
            Self::JoinGroups(_) | Self::TakeOff { .. } | Self::Land { .. } | Self::Stop => Pace::Smooth,
        }
    }

    fn turn(&self) -> Turn {
        match self {
            Self::TakeOff { turn, .. } | Self::Land { turn, .. } | Self::GoTo { turn, .. } => *turn,
            Self::JoinGroups(_) | Self::Stop => Turn::Keep,
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
fn lifts(set_point: &SetPoint, floor_m: f32) -> bool {
    match set_point {
        SetPoint::Stop => false,
        SetPoint::Velocity { velocity, .. } => velocity.z > 0.0,
        SetPoint::Hover { height_m, .. } => *height_m > floor_m + LIFT_M,
        SetPoint::Position { position, .. } | SetPoint::Moving { position, .. } => position.z > floor_m + LIFT_M,
    }
}

/// Has the autopilot take off if it must. As on a Crazyflie with brushed motors nobody needs to arm it.
fn guide(bridge: &mut Bridge) -> Result<(), Refusal> {
    match bridge.mode {
        Mode::Disarmed | Mode::Armed | Mode::Landed => {
            bridge.order(Command::Arm)?;
            bridge.order(Command::TakeOff { altitude_m: TAKEOFF_ALTITUDE_M })?;
            bridge.order(Command::Pause)
        }
        Mode::TakingOff => bridge.order(Command::Pause),
        Mode::Holding | Mode::Guided | Mode::Offboard | Mode::Returning => Ok(()),
        Mode::Landing => Err(Refusal::NotCruising),
    }
}

/// How fast a set-point turns to the left \[rad/s\].
fn yaw_rate(set_point: &SetPoint) -> f32 {
    match set_point {
        SetPoint::Velocity { yaw_rate, .. } | SetPoint::Hover { yaw_rate, .. } => *yaw_rate,
        SetPoint::Stop | SetPoint::Position { .. } | SetPoint::Moving { .. } => 0.0,
    }
}

/// Velocity of the goal \[m/s, world\] that a set-point wants of a drone with a heading \[rad\].
fn velocity(set_point: &SetPoint, heading: f64, bridge: &Bridge) -> Option<Vector3<f32>> {
    match *set_point {
        SetPoint::Stop => None,
        SetPoint::Velocity { velocity, .. } => Some(velocity),
        SetPoint::Hover { ahead, left, height_m, .. } => {
            let (sine, cosine) = (libm::sin(heading) as f32, libm::cos(heading) as f32);
            let climb = (height_m - bridge.goal.position().z) / CATCH_UP_SECS;
            Some(Vector3::new(cosine * ahead - sine * left, sine * ahead + cosine * left, climb))
        }
        SetPoint::Position { position, .. } => Some(catch_up(position, bridge)),
        SetPoint::Moving { position, velocity } => Some(velocity + catch_up(position, bridge)),
    }
}

/// Velocity that brings the goal to a point \[m/s\].
fn catch_up(point: Vector3<f32>, bridge: &Bridge) -> Vector3<f32> {
    (point - bridge.goal.position()) / CATCH_UP_SECS
}

/// The velocity, slowed down to [`SPEED_LIMIT`]. Rounding must not lead beyond.
fn limited(velocity: Vector3<f32>) -> Vector3<f32> {
    let speed = velocity.norm();
    if speed <= SPEED_LIMIT { velocity } else { velocity * (0.999_999 * SPEED_LIMIT / speed) }
}
