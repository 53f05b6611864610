//! The autopilot: when motors may turn, where to fly, and who flies.
//!
//! ```text
//!            arm            take off             top reached          set-point
//!  Disarmed ──────► Armed ────────────► TakingOff ──────────► Holding ──────────► Guided
//!     ▲  ▲            │                    │  ▲    or pause    │ ▲  ◄──────────     │
//!     │  └────────────┘                    │  │                │ │      pause       │
//!     │    10 s idle                       │  │      offboard  ▼ │ pause            │ return
//!     │                                    │  │             Offboard                ▼
//!     │                                    └──┼──────── land ────┴────────────── Returning
//!     │                                       │           ▼                          │
//!     │                              take off │        Landing ◄─────────────────────┘
//!     │  2 s                                  │           │ at rest            above home
//!     └───────────────────────────────────────┴──────── Landed
//! ```
//!
//! Besides, disarming works in every mode without flight and stopping the motors in every mode; the offboard mode can be
//! entered from the ground too. An event of the [`Failsafe`] does as a command would: hold, return, land or stop; only a
//! command of a peer ends that, and no stream of set-points. A state that is not finite for [`BLIND_SECS`] ends in
//! Disarmed. Motors turn in the modes of flight only, and there none ever stops.
//!
//! Who flies is another matter ([`Controller`]): the policy or the cascade of controllers, in every mode alike. What a peer steers by
//! attitude or body rates is flown by the cascade's inner half.

use kestrel_core::airframe::Airframe;
use kestrel_core::observation::{BodyLayout, ObservationLayout, PilotForLayout, PilotMeasuredLayout};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use crate::controller::{Controller, Controllers};
use crate::failsafe::{Failsafe, FailsafeEvent, FailsafeInput};
use crate::fence::{Fence, Zones};
use crate::goal::{Facing, MovingGoal};
use crate::policy_backend::PolicyBackend;
use crate::request::Whereabouts;
use crate::settings::{AutopilotSettings, FailsafeAction, FailsafeReaction, Fallback};
use crate::steering::{AttitudeSetPoint, yaw};

mod arming;
mod command;

pub use command::{ALTITUDES_M, Command, Refusal, SPEED_LIMIT, SPEED_MINIMUM, SetPoint};

/// Rotor targets \[rad/s\] of a drone that does not fly.
pub const STOPPED: [f32; 4] = [0.0; 4];

/// Greatest distance of the goal from the drone \[m\]: where hover policies are trained.
const LEASH_M: f32 = 0.5;

/// A landing goal sinks this far, so that the floor stops the drone and not the goal \[m\].
const LANDING_DEPTH_M: f32 = 1e4;

/// Height above home up to which a landing is slow \[m\]: furniture is lower.
const SLOW_LANDING_M: f32 = 2.0;

/// A take-off is complete, or home reached, when the drone is this close \[m\].
const ARRIVAL_RADIUS_M: f32 = 0.2;

/// Slower than this the drone may rest \[m/s\].
const REST_SPEED: f32 = 0.1;

/// Time for which a drone must rest above a sunken goal to count as landed \[s\].
const REST_SECS: f32 = 0.5;

/// Share of the leash that the goal must have sunk below a landed drone; a flying one would follow it.
const SUNKEN: f32 = 0.8;

/// Time for which the last rotor targets are held when the state is not finite \[s\]; then the motors stop.
pub const BLIND_SECS: f32 = 0.1;

/// Goals stay this far within the fence \[m\]: more than a drone overshoots one.
const FENCE_MARGIN_M: f32 = 0.3;

/// Events of one control period.
pub type FailsafeEvents = heapless::Vec<FailsafeEvent, { FailsafeEvent::ALL.len() }>;

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
    /// At, or on the way to, the last point, or on and on at the last velocity.
    Guided,
    /// Following a stream of set-points.
    Offboard,
    /// On the way home.
    Returning,
    /// Sinking until the floor stops it.
    Landing,
    /// At rest after a landing, motors stopped, still armed.
    Landed,
}

/// Who decides where to fly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Authority {
    /// Peers, by commands and by set-points.
    Peers,
    /// A failsafe, until a peer commands something.
    Failsafe,
    /// A peer that has stopped what another one streams, until one commands something.
    Intervention,
}

/// What the autopilot cannot know by itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surroundings {
    /// Since the last word of a ground station, if there was any \[s\].
    pub link_age_secs: Option<f32>,
    /// What is left of the battery, of one.
    pub battery: f32,
    /// Time until the drone is at what its rangers see, if that is known and nears \[s\].
    pub collision_secs: Option<f32>,
}

/// Flies a policy: state in, rotor targets out, once per control period.
pub struct Autopilot<P> {
    controllers: Controllers<P>,
    settings: AutopilotSettings,
    fence: Fence,
    failsafe: Failsafe,
    events: FailsafeEvents,
    control_secs: f32,
    leash_m: f32,
    mode: Mode,
    authority: Authority,
    ticks_in_mode: u32,
    ticks_at_rest: u32,
    ticks_blind: u32,
    ticks_since_set_point: u32,
    surroundings: Surroundings,
    known_state: Option<State<f32>>,
    goal: MovingGoal,
    attitude_set_point: Option<AttitudeSetPoint>,
    home: Vector3<f32>,
    last_inside: Vector3<f32>,
    rotor_targets: [f32; 4],
}

impl Mode {
    /// All of them.
    pub const ALL: [Self; 9] = [
        Self::Disarmed,
        Self::Armed,
        Self::TakingOff,
        Self::Holding,
        Self::Guided,
        Self::Offboard,
        Self::Returning,
        Self::Landing,
        Self::Landed,
    ];

    /// Whether motors turn.
    pub const fn flies(self) -> bool {
        match self {
            Self::TakingOff | Self::Holding | Self::Guided | Self::Offboard | Self::Returning | Self::Landing => {
                true
            }
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
            Self::Offboard => "offboard",
            Self::Returning => "returning",
            Self::Landing => "landing",
            Self::Landed => "landed",
        }
    }

    /// Which action it already is; a failsafe never does something milder instead.
    const fn action(self) -> FailsafeAction {
        match self {
            Self::Disarmed | Self::Armed | Self::Landed => FailsafeAction::StopMotors,
            Self::TakingOff | Self::Holding | Self::Guided | Self::Offboard => FailsafeAction::Nothing,
            Self::Returning => FailsafeAction::Return,
            Self::Landing => FailsafeAction::Land,
        }
    }
}

impl Default for Surroundings {
    /// No ground station was heard yet, and the battery is full.
    fn default() -> Self {
        Self { link_age_secs: None, battery: 1.0, collision_secs: None }
    }
}

/// How far a goal may run ahead \[m\]: a layout that cuts far goals short must still see all of the way.
pub fn leash_m(layout: &ObservationLayout) -> f32 {
    match layout {
        ObservationLayout::Pilot(scales)
        | ObservationLayout::PilotFor(PilotForLayout { scales, .. })
        | ObservationLayout::PilotMeasured(PilotMeasuredLayout { scales, .. })
        | ObservationLayout::Body(BodyLayout { scales, .. }) => LEASH_M.min(scales.position_scale_m),
        ObservationLayout::Reference(_)
        | ObservationLayout::Kinematic(_)
        | ObservationLayout::Measured(_)
        | ObservationLayout::Px4Neural(_) => LEASH_M,
    }
}

impl<P: PolicyBackend> Autopilot<P> {
    /// A disarmed autopilot of an airframe, whose policy this processor computes.
    pub fn new(backend: P, airframe: &Airframe) -> Self {
        let nowhere = Vector3::zeros();
        Self {
            control_secs: backend.control_secs(),
            leash_m: leash_m(backend.observation()),
            controllers: Controllers::new(backend, airframe),
            settings: AutopilotSettings::default(),
            fence: Fence::default(),
            failsafe: Failsafe::default(),
            events: FailsafeEvents::new(),
            mode: Mode::Disarmed,
            authority: Authority::Peers,
            ticks_in_mode: 0,
            ticks_at_rest: 0,
            ticks_blind: 0,
            ticks_since_set_point: u32::MAX,
            surroundings: Surroundings::default(),
            known_state: None,
            goal: MovingGoal::at(nowhere, 0.0),
            attitude_set_point: None,
            home: nowhere,
            last_inside: nowhere,
            rotor_targets: STOPPED,
        }
    }

    /// What it is doing.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Which controller flies.
    pub fn active_controller(&self) -> Controller {
        self.controllers.active()
    }

    /// Where it is going.
    pub fn goal(&self) -> &MovingGoal {
        &self.goal
    }

    /// The attitude or the body rates that it follows, if it does.
    pub fn attitude_set_point(&self) -> Option<&AttitudeSetPoint> {
        self.attitude_set_point.as_ref().filter(|_| self.mode == Mode::Offboard)
    }

    /// Where it is, as set-points may count from there; where it is led while its state is unknown.
    pub fn whereabouts(&self) -> Whereabouts {
        let goal = self.goal.position();
        self.known_state.map_or(Whereabouts { position: goal, heading: self.goal.heading(), goal }, |state| {
            Whereabouts { position: state.position, heading: yaw(&state.world_from_body), goal }
        })
    }

    /// Where it was armed, and returns to \[m, world\].
    pub fn home(&self) -> &Vector3<f32> {
        &self.home
    }

    /// What it may be told to do differently.
    pub fn settings(&self) -> &AutopilotSettings {
        &self.settings
    }

    /// Does it this way from now on.
    pub fn adjust(&mut self, settings: AutopilotSettings) {
        self.settings = settings;
        if !settings.compensates_rotors {
            self.controllers.effectiveness_mut().reset();
        }
        self.fence.cylinder.radius_m = settings.fence_radius_m;
        self.fence.cylinder.height_m = settings.fence_height_m;
    }

    /// Flies within these zones from now on, besides the cylinder of the settings.
    pub fn enclose(&mut self, zones: Zones) {
        self.fence.zones = zones;
    }

    /// Time between two ticks \[s\].
    pub fn control_secs(&self) -> f32 {
        self.control_secs
    }

    /// Whether the policy reproduces its golden vectors.
    pub fn healthy(&mut self) -> bool {
        self.controllers.backend().healthy()
    }

    /// How old the policy's last answer is, if it flies \[s\].
    pub fn silent_secs(&self) -> f32 {
        self.controllers.silent_secs()
    }

    /// What share of its thrust each rotor makes, as far as it has learned that; ones where it is told not to.
    pub fn rotor_shares(&self) -> [f32; 4] {
        self.controllers.effectiveness().shares()
    }

    /// What has gone wrong in the last control period.
    pub fn events(&self) -> &FailsafeEvents {
        &self.events
    }

    /// Rotor targets \[rad/s\] for the next control period, finite whatever the state.
    pub fn tick(&mut self, state: &State<f32>, surroundings: &Surroundings) -> [f32; 4] {
        self.ticks_in_mode = self.ticks_in_mode.saturating_add(1);
        self.ticks_since_set_point = self.ticks_since_set_point.saturating_add(1);
        self.surroundings = *surroundings;
        self.events.clear();
        self.known_state = is_finite(state).then_some(*state);
        match self.known_state {
            Some(state) => self.tick_with(&state),
            None => self.fly_blind(),
        }
        self.rotor_targets
    }

    fn tick_with(&mut self, state: &State<f32>) {
        self.ticks_blind = 0;
        if self.mode == Mode::Disarmed {
            self.home = state.position;
            self.fence.cylinder.center = self.home;
        }
        self.count_rest(state);
        self.change_mode(state);
        self.watch(state);
        self.fly(state);
    }

    /// The changes of mode that are not commanded.
    fn change_mode(&mut self, state: &State<f32>) {
        match self.mode {
            Mode::Armed if self.secs_in_mode() >= self.settings.idle_secs => self.enter(Mode::Disarmed),
            Mode::TakingOff if self.has_arrived(state) => self.enter(Mode::Holding),
            Mode::Returning if self.has_arrived(state) => self.go_on_home(state),
            Mode::Landing if self.secs(self.ticks_at_rest) >= REST_SECS => self.enter(Mode::Landed),
            Mode::Landed if self.secs_in_mode() >= self.settings.landed_secs => self.enter(Mode::Disarmed),
            Mode::Disarmed
            | Mode::Armed
            | Mode::TakingOff
            | Mode::Holding
            | Mode::Guided
            | Mode::Offboard
            | Mode::Returning
            | Mode::Landing
            | Mode::Landed => {}
        }
    }

    /// High enough: on above home. Above home: down.
    fn go_on_home(&mut self, state: &State<f32>) {
        let above_home = Vector3::new(self.home.x, self.home.y, self.goal.position().z);
        if (state.position - above_home).norm() < ARRIVAL_RADIUS_M {
            self.sink();
        } else {
            self.goal.head_for(above_home, self.settings.cruise_speed);
        }
    }

    /// Looks for what has gone wrong, and does what is to be done about it.
    fn watch(&mut self, state: &State<f32>) {
        if !self.mode.flies() {
            return;
        }
        let margin_m = self.margin_m(&state.position);
        if margin_m >= FENCE_MARGIN_M {
            self.last_inside = state.position;
        }
        if self.mode == Mode::Offboard && self.set_point_age_secs() > self.settings.set_point_stale_secs {
            self.stay();
        }
        let situation = FailsafeInput {
            state,
            set_point_age_secs: (self.mode == Mode::Offboard).then_some(self.set_point_age_secs()),
            link_age_secs: self.surroundings.link_age_secs,
            fence_margin_m: margin_m,
            battery: self.surroundings.battery,
            silent_secs: self.controllers.silent_secs(),
            saturated_secs: self.controllers.saturated_secs(),
            collision_secs: self.surroundings.collision_secs,
        };
        let events = self.failsafe.watch(&situation, &self.settings, self.control_secs);
        for event in &events {
            self.react(*event, state);
        }
        self.events = events;
    }

    fn react(&mut self, event: FailsafeEvent, state: &State<f32>) {
        let FailsafeReaction { action, fallback } = event.reaction(&self.settings);
        if fallback == Fallback::Cascade
            && action > FailsafeAction::Warn
            && self.active_controller() == Controller::Policy
        {
            self.engage(Controller::Cascade, state);
        }
        if action <= self.mode.action() {
            return;
        }
        if event == FailsafeEvent::CollisionCourse {
            // Its goal may lie behind the wall.
            self.goal = MovingGoal::at(state.position, yaw(&state.world_from_body));
        }
        // A stream that comes back is followed again.
        if action > FailsafeAction::Warn && event != FailsafeEvent::OffboardLost {
            self.authority = Authority::Failsafe;
        }
        match action {
            FailsafeAction::Nothing | FailsafeAction::Warn => {}
            FailsafeAction::Hold => self.hold_inside(state),
            FailsafeAction::Return => self.head_home(state),
            FailsafeAction::Land => self.sink(),
            FailsafeAction::StopMotors => self.enter(Mode::Disarmed),
        }
    }

    /// Begins with a controller, which holds the heading of now: a policy may have turned the drone from what was wanted.
    fn engage(&mut self, controller: Controller, state: &State<f32>) {
        self.goal.face(Facing::Toward(yaw(&state.world_from_body)));
        self.controllers.begin(controller);
    }

    /// Rotor targets of this period; the last ones are held while the policy gives none.
    fn fly(&mut self, state: &State<f32>) {
        if !self.mode.flies() {
            self.controllers.effectiveness_mut().pause();
            self.rotor_targets = STOPPED;
            return;
        }
        self.move_goal(state);
        let targets = match self.attitude_set_point().copied() {
            Some(attitude) => Some(self.controllers.follow(state, &attitude)),
            None => self.controllers.toward(state, &self.goal, self.control_secs),
        };
        self.rotor_targets = targets.map_or(self.rotor_targets, |targets| self.compensated(state, targets));
    }

    /// What makes up for weak rotors, if it is told to.
    fn compensated(&mut self, state: &State<f32>, targets: [f32; 4]) -> [f32; 4] {
        if !self.settings.compensates_rotors {
            return targets;
        }
        // The floor may carry the drone.
        let is_free = !matches!(self.mode, Mode::TakingOff | Mode::Landing);
        self.controllers.compensated(state, &targets, self.control_secs, is_free)
    }

    /// On its way, but not out of the fence.
    fn move_goal(&mut self, state: &State<f32>) {
        let before = self.goal;
        let mut held = state.position;
        if self.mode == Mode::Landing {
            // It sinks under the floor beside a drone that touched down aside, too.
            (held.x, held.y) = (before.position().x, before.position().y);
            self.goal.head_for(before.target(), self.sinking_speed());
        }
        self.goal.advance(&held, self.leash_m, self.control_secs);
        if self.mode == Mode::Landing || self.goal.position() == before.position() {
            return;
        }
        // A polygon's margin is most of a tick where doubles are computed in software.
        let margin_m = self.margin_m(&self.goal.position());
        if margin_m < FENCE_MARGIN_M && margin_m < self.margin_m(&before.position()) {
            self.goal = before;
        }
    }

    /// One bad reading must not drop the drone, and a lasting one must not let it fly on.
    fn fly_blind(&mut self) {
        self.ticks_blind = self.ticks_blind.saturating_add(1);
        if self.mode.armed() && self.secs(self.ticks_blind) > BLIND_SECS {
            self.enter(Mode::Disarmed);
        }
        if !self.mode.flies() {
            self.rotor_targets = STOPPED;
        }
    }

    fn has_arrived(&self, state: &State<f32>) -> bool {
        self.goal.arrived() && (state.position - self.goal.target()).norm() < ARRIVAL_RADIUS_M
    }

    /// Counts how long the drone has not followed a goal that sank: the floor carries it.
    fn count_rest(&mut self, state: &State<f32>) {
        let sunken = state.position.z - self.goal.position().z > SUNKEN * self.leash_m;
        let still = sunken && state.velocity.norm() < REST_SPEED;
        self.ticks_at_rest = if still { self.ticks_at_rest.saturating_add(1) } else { 0 };
    }

    /// How far a point \[m, world\] lies within the fence, negative outside \[m\].
    pub fn margin_m(&self, point: &Vector3<f32>) -> f32 {
        self.fence.margin_m(point)
    }

    /// Holds where the drone is, if it flies: something else has flown it there.
    pub fn take_over(&mut self) {
        let Some(state) = self.known_state.filter(|_| self.mode.flies()) else { return };
        self.goal = MovingGoal::at(state.position, yaw(&state.world_from_body));
        self.attitude_set_point = None;
        self.authority = Authority::Peers;
        self.enter(Mode::Holding);
    }

    /// Follows no stream of positions until a peer commands something: one who does not stream has stopped the drone.
    pub fn distrust_streams(&mut self) {
        self.authority = Authority::Intervention;
    }

    /// Whether a stream of set-points may begin to steer the drone.
    pub fn trusts_streams(&self) -> bool {
        self.authority == Authority::Peers
    }

    /// Stops where the goal is.
    fn stay(&mut self) {
        self.goal.stop();
        self.attitude_set_point = None;
    }

    /// Holds here, or where the drone last was well inside the fence; lands if the fence has left that place, too.
    fn hold_inside(&mut self, state: &State<f32>) {
        self.stay();
        let [here_m, inside_m] = [&state.position, &self.last_inside].map(|point| self.margin_m(point));
        if here_m < FENCE_MARGIN_M && inside_m < FENCE_MARGIN_M {
            self.sink();
            return;
        }
        if here_m < FENCE_MARGIN_M {
            self.goal.head_for(self.last_inside, self.settings.cruise_speed);
        }
        self.enter(Mode::Holding);
    }

    fn head_home(&mut self, state: &State<f32>) {
        self.stay();
        let height_m = state.position.z.max(self.home.z + self.settings.return_altitude_m);
        let here = self.goal.position();
        let above = Vector3::new(here.x, here.y, height_m);
        self.goal.head_for(above, self.settings.climb_speed);
        self.enter(Mode::Returning);
    }

    fn sink(&mut self) {
        self.stay();
        let below = self.goal.position() - Vector3::z() * LANDING_DEPTH_M;
        self.goal.head_for(below, self.sinking_speed());
        self.enter(Mode::Landing);
    }

    /// Slow where something to land on may be.
    fn sinking_speed(&self) -> f32 {
        let is_high = self.goal.position().z > self.home.z + SLOW_LANDING_M;
        if is_high { self.settings.descent_speed } else { self.settings.landing_speed }
    }

    fn enter(&mut self, mode: Mode) {
        self.mode = mode;
        self.ticks_in_mode = 0;
        self.ticks_at_rest = 0;
        if mode != Mode::Offboard {
            self.attitude_set_point = None;
        }
    }

    fn set_point_age_secs(&self) -> f32 {
        self.secs(self.ticks_since_set_point)
    }

    fn secs_in_mode(&self) -> f32 {
        self.secs(self.ticks_in_mode)
    }

    fn secs(&self, ticks: u32) -> f32 {
        ticks as f32 * self.control_secs
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
