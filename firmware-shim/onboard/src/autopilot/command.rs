//! What an autopilot can be told, and when it refuses.

use nalgebra::Vector3;

use super::{Authority, Autopilot, FENCE_MARGIN_M, Mode};
use crate::controller::Controller;
use crate::goal::{Facing, MovingGoal};
use crate::policy_backend::PolicyBackend;
use crate::steering::{AttitudeSetPoint, yaw};

/// Heights that a take-off may climb \[m\]: above ground effect, and within sight.
pub const ALTITUDES_M: core::ops::RangeInclusive<f32> = 0.2..=20.0;

/// Greatest speed that can be commanded \[m/s\]: what hover policies start their episodes with.
pub const SPEED_LIMIT: f32 = 1.0;

/// Fastest turn that is followed \[rad/s\]: what policies and the cascade are trained and built for.
const TURNING_LIMIT: f32 = 3.0;

/// Least speed on the way to a point \[m/s\]: slower ones never arrive.
pub const SPEED_MINIMUM: f32 = 0.05;

/// What an autopilot can be told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Allow flight, if all checks pass.
    Arm,
    /// Forbid flight; refused in flight.
    Disarm,
    /// Disarm even in flight: the drone falls.
    StopMotors,
    /// Climb by a height above the ground \[m\].
    TakeOff {
        /// Within [`ALTITUDES_M`].
        altitude_m: f32,
    },
    /// Go to a point \[m, world\], finite.
    GoTo(Vector3<f32>),
    /// Move on at a velocity \[m/s, world\] until another command, no faster than [`SPEED_LIMIT`].
    Velocity(Vector3<f32>),
    /// Follow the stream of set-points, which must have begun.
    Offboard,
    /// Stay here.
    Pause,
    /// Fly home and land there.
    Return,
    /// Land below the present goal.
    Land,
    /// Have the policy or the cascade fly from now on.
    SelectController(Controller),
    /// Go at this speed \[m/s\] from now on, no faster than [`SPEED_LIMIT`].
    Speed(f32),
}

/// One of a stream of set-points; it is followed until the next, or until it is stale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SetPoint {
    /// A point \[m, world\], finite.
    Position(Vector3<f32>),
    /// A velocity \[m/s, world\], finite.
    Velocity(Vector3<f32>),
    /// An attitude or body rates.
    Attitude(AttitudeSetPoint),
}

/// Why a command is not executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The policy does not reproduce its golden vectors.
    SelfTest,
    /// No finite state is known.
    StateUnknown,
    /// The drone is too tilted to take off.
    NotLevel,
    /// The drone is not at rest.
    Moving,
    /// The battery is critical.
    Battery,
    /// It needs an armed drone on the ground.
    NotArmed,
    /// It needs a drone on the ground.
    InFlight,
    /// It needs a drone in the air that neither takes off nor lands.
    NotCruising,
    /// It needs a flying drone.
    NotFlying,
    /// The take-off height is outside [`ALTITUDES_M`].
    Altitude,
    /// The velocity is no number, or beyond [`SPEED_LIMIT`].
    Speed,
    /// It leads out of the fence.
    Fence,
    /// No set-points arrive.
    NoSetPoints,
    /// It needs the offboard mode.
    NotOffboard,
    /// There is no mission to fly.
    NoMission,
    /// A mission is flown.
    OnMission,
    /// A failsafe has acted since the last command.
    Failsafe,
    /// Another client has stopped the drone since the last command.
    Intervention,
    /// Another client has the control.
    OtherOperator,
    /// It needs the mode that is flown by sticks.
    NoSticks,
}

impl Command {
    /// Whether it says where to fly.
    const fn steers(self) -> bool {
        match self {
            Self::TakeOff { .. }
            | Self::GoTo(_)
            | Self::Velocity(_)
            | Self::Offboard
            | Self::Pause
            | Self::Return
            | Self::Land => true,
            Self::Arm | Self::Disarm | Self::StopMotors | Self::SelectController(_) | Self::Speed(_) => false,
        }
    }
}

impl Refusal {
    /// All of them.
    pub const ALL: [Self; 20] = [
        Self::SelfTest,
        Self::StateUnknown,
        Self::NotLevel,
        Self::Moving,
        Self::Battery,
        Self::NotArmed,
        Self::InFlight,
        Self::NotCruising,
        Self::NotFlying,
        Self::Altitude,
        Self::Speed,
        Self::Fence,
        Self::NoSetPoints,
        Self::NotOffboard,
        Self::NoMission,
        Self::OnMission,
        Self::Failsafe,
        Self::Intervention,
        Self::OtherOperator,
        Self::NoSticks,
    ];

    /// At most the 50 bytes of a `STATUSTEXT`.
    pub const fn text(self) -> &'static str {
        match self {
            Self::SelfTest => "refused: policy self-test failed",
            Self::StateUnknown => "refused: state unknown",
            Self::NotLevel => "arming refused: tilted more than 25 degrees",
            Self::Moving => "arming refused: moving",
            Self::Battery => "arming refused: battery critical",
            Self::NotArmed => "refused: not armed",
            Self::InFlight => "refused: in flight",
            Self::NotCruising => "refused: not flying, or taking off or landing",
            Self::NotFlying => "refused: not flying",
            Self::Altitude => "take-off refused: altitude must be 0.2 m to 20 m",
            Self::Speed => "velocity refused: not up to 1 m/s",
            Self::Fence => "refused: outside the fence",
            Self::NoSetPoints => "offboard refused: no set-points arrive",
            Self::NotOffboard => "set-point waits for the offboard mode",
            Self::NoMission => "mission refused: there is none",
            Self::OnMission => "set-point refused: a mission is flown",
            Self::Failsafe => "set-point refused: a failsafe has the say",
            Self::Intervention => "set-point refused: another client intervened",
            Self::OtherOperator => "refused: another client has the control",
            Self::NoSticks => "sticks wait for the Position mode",
        }
    }
}

impl<P: PolicyBackend> Autopilot<P> {
    /// Executes a command, or says why not.
    ///
    /// # Errors
    /// The first condition that is not met; nothing has changed then.
    pub fn command(&mut self, command: Command) -> Result<(), Refusal> {
        self.execute(command)?;
        if command.steers() {
            self.authority = Authority::Peers;
        }
        Ok(())
    }

    fn execute(&mut self, command: Command) -> Result<(), Refusal> {
        match command {
            Command::Arm => self.arm(),
            Command::Disarm => self.disarm(),
            Command::StopMotors => {
                self.enter(Mode::Disarmed);
                Ok(())
            }
            Command::TakeOff { altitude_m } => self.take_off(altitude_m),
            Command::GoTo(point) => self.go_to(point),
            Command::Velocity(velocity) => self.drift(velocity),
            Command::Offboard => self.be_offboard(),
            Command::Pause => self.pause(),
            Command::Return => self.return_home(),
            Command::Land => self.land(),
            Command::SelectController(controller) => self.hand_over(controller),
            Command::Speed(speed) => self.change_speed(speed),
        }
    }

    /// Takes one of a stream of set-points: followed in the offboard mode, and what that mode waits for. A position is
    /// flown to in other modes, too, as [`Command::GoTo`], unless a failsafe has acted: no stream that goes on undoes that.
    ///
    /// # Errors
    /// Why it is not followed, or not yet.
    pub fn set_point(&mut self, set_point: SetPoint) -> Result<(), Refusal> {
        self.check_set_point(&set_point)?;
        self.ticks_since_set_point = 0;
        match (self.mode, set_point) {
            (Mode::Offboard, SetPoint::Position(point)) => {
                self.attitude_set_point = None;
                self.goal.head_for(point, self.settings.cruise_speed);
            }
            (Mode::Offboard, SetPoint::Velocity(velocity)) => {
                self.attitude_set_point = None;
                self.goal.drift(velocity);
            }
            (Mode::Offboard, SetPoint::Attitude(attitude)) => {
                // Where to hold when the stream ends.
                self.goal = self
                    .known_state
                    .map_or(self.goal, |state| MovingGoal::at(state.position, yaw(&state.world_from_body)));
                self.attitude_set_point = Some(attitude);
            }
            (_, SetPoint::Position(_)) if self.authority == Authority::Failsafe => return Err(Refusal::Failsafe),
            (_, SetPoint::Position(_)) if self.authority == Authority::Intervention => {
                return Err(Refusal::Intervention);
            }
            (_, SetPoint::Position(point)) => return self.go_to(point),
            (_, SetPoint::Velocity(_) | SetPoint::Attitude(_)) => return Err(Refusal::NotOffboard),
        }
        Ok(())
    }

    /// Points the nose somewhere, in flight; policies that see no heading do not.
    ///
    /// # Errors
    /// When it is no number.
    pub fn face(&mut self, facing: Facing) -> Result<(), Refusal> {
        let finite = match facing {
            Facing::Kept => true,
            Facing::Toward(heading) => heading.is_finite(),
            Facing::Turning(rate) => rate.is_finite() && rate.abs() <= TURNING_LIMIT,
        };
        if !finite {
            return Err(Refusal::Speed);
        }
        self.goal.face(facing);
        Ok(())
    }

    fn check_set_point(&self, set_point: &SetPoint) -> Result<(), Refusal> {
        match set_point {
            SetPoint::Position(point) => self.check_inside(point),
            SetPoint::Velocity(velocity) => check_speed(velocity),
            SetPoint::Attitude(attitude) if attitude.is_valid() => Ok(()),
            SetPoint::Attitude(_) => Err(Refusal::Speed),
        }
    }

    /// Whether the fence lets a goal there.
    fn check_inside(&self, point: &Vector3<f32>) -> Result<(), Refusal> {
        if self.margin_m(point) >= FENCE_MARGIN_M { Ok(()) } else { Err(Refusal::Fence) }
    }

    fn disarm(&mut self) -> Result<(), Refusal> {
        if self.mode.flies() {
            return Err(Refusal::InFlight);
        }
        self.enter(Mode::Disarmed);
        Ok(())
    }

    fn take_off(&mut self, altitude_m: f32) -> Result<(), Refusal> {
        if !ALTITUDES_M.contains(&altitude_m) {
            return Err(Refusal::Altitude);
        }
        self.check_grounded()?;
        let state = self.known_state.ok_or(Refusal::StateUnknown)?;
        let top = state.position + Vector3::z() * altitude_m;
        self.check_inside(&top)?;
        self.lift_off()?;
        self.goal.head_for(top, self.settings.climb_speed);
        self.enter(Mode::TakingOff);
        Ok(())
    }

    fn check_grounded(&self) -> Result<(), Refusal> {
        match self.mode {
            Mode::Armed | Mode::Landed => Ok(()),
            Mode::Disarmed => Err(Refusal::NotArmed),
            Mode::TakingOff | Mode::Holding | Mode::Guided | Mode::Offboard | Mode::Returning | Mode::Landing => {
                Err(Refusal::InFlight)
            }
        }
    }

    /// Begins a flight: nothing has gone wrong yet.
    fn lift_off(&mut self) -> Result<(), Refusal> {
        let state = self.known_state.ok_or(Refusal::StateUnknown)?;
        self.last_inside = state.position;
        self.goal = MovingGoal::at(state.position, 0.0);
        self.failsafe.reset();
        self.engage(self.active_controller(), &state);
        self.rotor_targets = self.controllers.idle();
        Ok(())
    }

    fn go_to(&mut self, point: Vector3<f32>) -> Result<(), Refusal> {
        self.check_cruising()?;
        self.check_inside(&point)?;
        self.be_guided();
        self.goal.head_for(point, self.settings.cruise_speed);
        Ok(())
    }

    fn drift(&mut self, velocity: Vector3<f32>) -> Result<(), Refusal> {
        check_speed(&velocity)?;
        self.check_cruising()?;
        self.be_guided();
        self.goal.drift(velocity);
        Ok(())
    }

    fn check_cruising(&self) -> Result<(), Refusal> {
        match self.mode {
            Mode::Holding | Mode::Guided | Mode::Offboard | Mode::Returning => Ok(()),
            Mode::Disarmed | Mode::Armed | Mode::TakingOff | Mode::Landing | Mode::Landed => {
                Err(Refusal::NotCruising)
            }
        }
    }

    fn be_guided(&mut self) {
        if self.mode != Mode::Guided {
            self.enter(Mode::Guided);
        }
    }

    fn be_offboard(&mut self) -> Result<(), Refusal> {
        if self.set_point_age_secs() > self.settings.offboard_loss_secs {
            return Err(Refusal::NoSetPoints);
        }
        match self.mode {
            Mode::Offboard => return Ok(()),
            Mode::Disarmed => return Err(Refusal::NotArmed),
            Mode::Armed | Mode::Landed => self.lift_off()?,
            Mode::TakingOff | Mode::Holding | Mode::Guided | Mode::Returning | Mode::Landing => self.stay(),
        }
        self.enter(Mode::Offboard);
        Ok(())
    }

    fn pause(&mut self) -> Result<(), Refusal> {
        match self.mode {
            Mode::TakingOff | Mode::Holding | Mode::Guided | Mode::Offboard | Mode::Returning => {
                self.stay();
                self.enter(Mode::Holding);
                Ok(())
            }
            Mode::Disarmed | Mode::Armed | Mode::Landing | Mode::Landed => Err(Refusal::NotCruising),
        }
    }

    fn return_home(&mut self) -> Result<(), Refusal> {
        match self.mode {
            Mode::Returning => Ok(()),
            Mode::TakingOff | Mode::Holding | Mode::Guided | Mode::Offboard | Mode::Landing => {
                let state = self.known_state.ok_or(Refusal::StateUnknown)?;
                self.head_home(&state);
                Ok(())
            }
            Mode::Disarmed | Mode::Armed | Mode::Landed => Err(Refusal::NotFlying),
        }
    }

    fn land(&mut self) -> Result<(), Refusal> {
        match self.mode {
            Mode::Landing | Mode::Landed => Ok(()),
            Mode::Disarmed | Mode::Armed => Err(Refusal::NotFlying),
            Mode::TakingOff | Mode::Holding | Mode::Guided | Mode::Offboard | Mode::Returning => {
                self.sink();
                Ok(())
            }
        }
    }

    fn change_speed(&mut self, speed: f32) -> Result<(), Refusal> {
        if !(SPEED_MINIMUM..=SPEED_LIMIT).contains(&speed) {
            return Err(Refusal::Speed);
        }
        self.settings.cruise_speed = speed;
        if self.mode == Mode::Guided && !self.goal.arrived() && self.goal.target() != self.goal.position() {
            self.goal.head_for(self.goal.target(), speed);
        }
        Ok(())
    }

    fn hand_over(&mut self, controller: Controller) -> Result<(), Refusal> {
        if controller == self.active_controller() {
            return Ok(());
        }
        if controller == Controller::Policy && !self.healthy() {
            return Err(Refusal::SelfTest);
        }
        let state = self.known_state.ok_or(Refusal::StateUnknown)?;
        self.engage(controller, &state);
        Ok(())
    }
}

/// Whether a velocity is a number, and slow enough.
fn check_speed(velocity: &Vector3<f32>) -> Result<(), Refusal> {
    if velocity.norm() <= SPEED_LIMIT { Ok(()) } else { Err(Refusal::Speed) }
}
