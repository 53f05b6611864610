//! The autopilot: when motors may turn, and where the policy is to fly.
//!
//! ```text
//!            arm            take off             top reached          set-point
//!  Disarmed ──────► Armed ────────────► TakingOff ──────────► Holding ──────────► Guided
//!     ▲  ▲            │                    │  ▲    or pause      │  ◄──────────     │
//!     │  └────────────┘                    │  │                  │     pause        │
//!     │    10 s idle                       └──┼──────── land ────┴──────────────────┘
//!     │                                       │           ▼
//!     │                              take off │        Landing
//!     │  2 s                                  │           │ at rest
//!     └───────────────────────────────────────┴──────── Landed
//! ```
//!
//! Besides, disarming works in every mode without flight, stopping the motors in every mode, and a state that is
//! not finite, or a processor that does not answer, for [`BLIND_SECS`] ends in Disarmed. Motors turn in the four modes
//! of flight only.

use kestrel_core::observation::{ObservationLayout, PilotForLayout, PilotMeasuredLayout};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use crate::goal::MovingGoal;
use crate::processor::Processor;

/// Rotor targets \[rad/s\] of a drone that does not fly.
pub const STOPPED: [f32; 4] = [0.0; 4];

/// Height of a take-off whose altitude is left open \[m\].
pub const DEFAULT_ALTITUDE_M: f32 = 1.0;

/// Heights that a take-off may climb \[m\]: above ground effect, and within sight.
pub const ALTITUDES_M: core::ops::RangeInclusive<f32> = 0.2..=20.0;

/// Speed of the goal on the way to a set-point \[m/s\]: half of what hover policies start their episodes with.
const TRAVEL_SPEED: f32 = 0.5;

/// Greatest speed that can be commanded \[m/s\]: what hover policies start their episodes with.
pub const SPEED_LIMIT: f32 = 1.0;

/// Speed of the goal while taking off \[m/s\].
const CLIMB_SPEED: f32 = 0.5;

/// Speed of the goal while landing \[m/s\]: a touch-down from a fall of 5 mm.
const DESCENT_SPEED: f32 = 0.3;

/// Greatest distance of the goal from the drone \[m\]: where hover policies are trained.
const LEASH_M: f32 = 0.5;

/// A landing goal sinks this far, so that the floor stops the drone and not the goal \[m\].
const LANDING_DEPTH_M: f32 = 1e4;

/// A take-off is complete when the drone is this close to its top \[m\].
const TOP_RADIUS_M: f32 = 0.2;

/// Slower than this the drone may rest \[m/s\].
const REST_SPEED: f32 = 0.1;

/// Time for which a drone must rest above a sunken goal to count as landed \[s\].
const REST_SECS: f32 = 0.5;

/// Share of the leash that the goal must have sunk below a landed drone; a flying one would follow it.
const SUNKEN: f32 = 0.8;

/// An armed drone that does not take off is disarmed after this \[s\] (PX4's `COM_DISARM_PRFLT`).
const IDLE_SECS: f32 = 10.0;

/// A landed drone is disarmed after this \[s\] (PX4's `COM_DISARM_LAND`).
const LANDED_SECS: f32 = 2.0;

/// Time for which the last rotor targets are held when the state is not finite, or the processor silent \[s\]; then the
/// motors stop.
pub const BLIND_SECS: f32 = 0.1;

/// Arming wants the drone within 25° of level: beyond, a take-off would tip it over.
const LEVEL_COSINE: f32 = 0.906;

/// Arming wants the drone slower than this \[m/s\].
const ARMING_SPEED: f32 = 0.2;

/// What the autopilot is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// Motors cannot turn.
    Disarmed,
    /// On the ground, ready to take off.
    Armed,
    /// Climbing to the height of the take-off.
    TakingOff,
    /// At a point that the autopilot chose: the top of a take-off, or where it was paused.
    Holding,
    /// At, or on the way to, the last set-point, or on and on at the last velocity.
    Guided,
    /// Sinking until the floor stops it.
    Landing,
    /// At rest after a landing, motors stopped, still armed.
    Landed,
}

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
    /// Stay here.
    Pause,
    /// Land below the present goal.
    Land,
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
}

/// Flies a policy: state in, rotor targets out, once per control period.
pub struct Autopilot<P> {
    processor: P,
    control_secs: f32,
    leash_m: f32,
    mode: Mode,
    ticks_in_mode: u32,
    ticks_at_rest: u32,
    ticks_blind: u32,
    known_state: Option<State<f32>>,
    goal: MovingGoal,
    rotor_targets: [f32; 4],
}

impl Mode {
    /// Whether motors turn.
    pub const fn flies(self) -> bool {
        match self {
            Self::TakingOff | Self::Holding | Self::Guided | Self::Landing => true,
            Self::Disarmed | Self::Armed | Self::Landed => false,
        }
    }

    /// Whether motors may turn.
    pub const fn armed(self) -> bool {
        !matches!(self, Self::Disarmed)
    }

    /// Name in logs and messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Disarmed => "disarmed",
            Self::Armed => "armed",
            Self::TakingOff => "taking off",
            Self::Holding => "holding",
            Self::Guided => "guided",
            Self::Landing => "landing",
            Self::Landed => "landed",
        }
    }
}

/// How far a goal may run ahead \[m\]: a layout that cuts far goals short must still see all of the way.
fn leash_m(layout: &ObservationLayout) -> f32 {
    match layout {
        ObservationLayout::Pilot(scales)
        | ObservationLayout::PilotFor(PilotForLayout { scales, .. })
        | ObservationLayout::PilotMeasured(PilotMeasuredLayout { scales, .. }) => {
            LEASH_M.min(scales.position_scale_m)
        }
        ObservationLayout::Paper(_) | ObservationLayout::Kinematic(_) | ObservationLayout::Measured(_) => LEASH_M,
    }
}

impl<P: Processor> Autopilot<P> {
    /// A disarmed autopilot whose policy this processor computes.
    pub fn new(processor: P) -> Self {
        Self {
            control_secs: processor.control_secs(),
            leash_m: leash_m(processor.observation()),
            processor,
            mode: Mode::Disarmed,
            ticks_in_mode: 0,
            ticks_at_rest: 0,
            ticks_blind: 0,
            known_state: None,
            goal: MovingGoal::at(Vector3::zeros()),
            rotor_targets: STOPPED,
        }
    }

    /// What it is doing.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Where it is going.
    pub fn goal(&self) -> &MovingGoal {
        &self.goal
    }

    /// Time between two ticks \[s\].
    pub fn control_secs(&self) -> f32 {
        self.control_secs
    }

    /// Whether the policy reproduces its golden vectors.
    pub fn healthy(&mut self) -> bool {
        self.processor.healthy()
    }

    /// Rotor targets \[rad/s\] for the next control period, finite whatever the state.
    pub fn tick(&mut self, state: &State<f32>) -> [f32; 4] {
        self.ticks_in_mode = self.ticks_in_mode.saturating_add(1);
        let finite = is_finite(state);
        self.known_state = finite.then_some(*state);
        if finite {
            self.count_rest(state);
            self.change_mode(state);
        }
        let targets = if finite { self.fly(state) } else { None };
        match targets {
            Some(targets) => {
                self.ticks_blind = 0;
                self.rotor_targets = targets;
            }
            None => self.fly_blind(),
        }
        self.rotor_targets
    }

    /// The changes of mode that nobody commands.
    fn change_mode(&mut self, state: &State<f32>) {
        match self.mode {
            Mode::Armed if self.secs_in_mode() >= IDLE_SECS => self.enter(Mode::Disarmed),
            Mode::TakingOff if self.on_top(state) => self.enter(Mode::Holding),
            Mode::Landing if self.secs(self.ticks_at_rest) >= REST_SECS => self.enter(Mode::Landed),
            Mode::Landed if self.secs_in_mode() >= LANDED_SECS => self.enter(Mode::Disarmed),
            Mode::Disarmed
            | Mode::Armed
            | Mode::TakingOff
            | Mode::Holding
            | Mode::Guided
            | Mode::Landing
            | Mode::Landed => {}
        }
    }

    /// Rotor targets, unless the processor does not answer.
    fn fly(&mut self, state: &State<f32>) -> Option<[f32; 4]> {
        if !self.mode.flies() {
            return Some(STOPPED);
        }
        self.goal.advance(&state.position, self.leash_m, self.control_secs);
        self.processor.tick(state, &self.goal.position())
    }

    /// One bad reading, or one answer that is missing, must not drop the drone, and a lasting one must not let it fly on.
    fn fly_blind(&mut self) {
        self.ticks_blind = self.ticks_blind.saturating_add(1);
        if self.mode.armed() && self.secs(self.ticks_blind) > BLIND_SECS {
            self.enter(Mode::Disarmed);
        }
        if !self.mode.flies() {
            self.rotor_targets = STOPPED;
        }
    }

    fn on_top(&self, state: &State<f32>) -> bool {
        self.goal.arrived() && (state.position - self.goal.target()).norm() < TOP_RADIUS_M
    }

    /// Counts how long the drone has not followed a goal that sank: the floor carries it.
    fn count_rest(&mut self, state: &State<f32>) {
        let sunken = state.position.z - self.goal.position().z > SUNKEN * self.leash_m;
        let still = sunken && state.velocity.norm() < REST_SPEED;
        self.ticks_at_rest = if still { self.ticks_at_rest.saturating_add(1) } else { 0 };
    }

    fn enter(&mut self, mode: Mode) {
        self.mode = mode;
        self.ticks_in_mode = 0;
        self.ticks_at_rest = 0;
    }

    fn secs_in_mode(&self) -> f32 {
        self.secs(self.ticks_in_mode)
    }

    fn secs(&self, ticks: u32) -> f32 {
        ticks as f32 * self.control_secs
    }

    /// Executes a command, or says why not.
    ///
    /// # Errors
    /// The first condition that is not met; nothing has changed then.
    pub fn command(&mut self, command: Command) -> Result<(), Refusal> {
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
            Command::Pause => self.pause(),
            Command::Land => self.land(),
        }
    }

    fn arm(&mut self) -> Result<(), Refusal> {
        if self.mode.armed() {
            return Ok(());
        }
        let state = self.known_state.as_ref().ok_or(Refusal::StateUnknown)?;
        if state.world_from_body.up_cosine() < LEVEL_COSINE {
            return Err(Refusal::NotLevel);
        }
        if state.velocity.norm() > ARMING_SPEED {
            return Err(Refusal::Moving);
        }
        if !self.healthy() {
            return Err(Refusal::SelfTest);
        }
        self.enter(Mode::Armed);
        Ok(())
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
        match self.mode {
            Mode::Armed | Mode::Landed => {}
            Mode::Disarmed => return Err(Refusal::NotArmed),
            Mode::TakingOff | Mode::Holding | Mode::Guided | Mode::Landing => return Err(Refusal::InFlight),
        }
        let state = self.known_state.as_ref().ok_or(Refusal::StateUnknown)?;
        self.goal = MovingGoal::at(state.position);
        self.goal.head_for(state.position + Vector3::z() * altitude_m, CLIMB_SPEED);
        self.processor.reset();
        self.enter(Mode::TakingOff);
        Ok(())
    }

    fn go_to(&mut self, point: Vector3<f32>) -> Result<(), Refusal> {
        self.be_guided()?;
        self.goal.head_for(point, TRAVEL_SPEED);
        Ok(())
    }

    fn drift(&mut self, velocity: Vector3<f32>) -> Result<(), Refusal> {
        if velocity.norm() <= SPEED_LIMIT {
            self.be_guided()?;
            self.goal.drift(velocity);
            return Ok(());
        }
        Err(Refusal::Speed)
    }

    fn be_guided(&mut self) -> Result<(), Refusal> {
        match self.mode {
            Mode::Holding => self.enter(Mode::Guided),
            Mode::Guided => {}
            Mode::Disarmed | Mode::Armed | Mode::TakingOff | Mode::Landing | Mode::Landed => {
                return Err(Refusal::NotCruising);
            }
        }
        Ok(())
    }

    fn pause(&mut self) -> Result<(), Refusal> {
        match self.mode {
            Mode::TakingOff | Mode::Holding | Mode::Guided => {
                self.goal.stop();
                self.enter(Mode::Holding);
                Ok(())
            }
            Mode::Disarmed | Mode::Armed | Mode::Landing | Mode::Landed => Err(Refusal::NotCruising),
        }
    }

    fn land(&mut self) -> Result<(), Refusal> {
        match self.mode {
            Mode::Landing | Mode::Landed => Ok(()),
            Mode::Disarmed | Mode::Armed => Err(Refusal::NotFlying),
            Mode::TakingOff | Mode::Holding | Mode::Guided => {
                let below = self.goal.position() - Vector3::z() * LANDING_DEPTH_M;
                self.goal.head_for(below, DESCENT_SPEED);
                self.enter(Mode::Landing);
                Ok(())
            }
        }
    }
}

/// Whether every number of a state is finite.
fn is_finite(state: &State<f32>) -> bool {
    let attitude = &state.world_from_body;
    let vectors = [&state.position, &state.velocity, &state.body_rates];
    vectors.iter().flat_map(|vector| vector.iter()).all(|value| value.is_finite())
        && [attitude.w, attitude.x, attitude.y, attitude.z].iter().all(|value| value.is_finite())
        && state.rotor_speeds.iter().all(|value| value.is_finite())
}

#[cfg(test)]
mod tests;
