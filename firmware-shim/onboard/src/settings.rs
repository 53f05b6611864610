//! What a vehicle may be told to do differently: speeds, heights, and what it does when something fails.

/// What is done when something fails, from mild to hard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FailsafeAction {
    /// Nothing, not even a word.
    Nothing,
    /// Say so.
    Warn,
    /// Stay here; inside the fence, if it was left.
    Hold,
    /// Fly home and land there.
    Return,
    /// Land here.
    Land,
    /// Stop the motors: the drone falls.
    StopMotors,
}

/// What is done, and whether the policy flies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FailsafeReaction {
    /// Where to.
    pub action: FailsafeAction,
    /// Who flies there.
    pub fallback: Fallback,
}

/// Who flies after a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fallback {
    /// The controller that flew before.
    Keep,
    /// The cascade of controllers.
    Cascade,
}

/// All of it. The defaults suit a Crazyflie in a room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AutopilotSettings {
    /// Height of a take-off that leaves it open \[m\].
    pub takeoff_altitude_m: f32,
    /// Speed on the way to a point \[m/s\].
    pub cruise_speed: f32,
    /// Speed of climbing \[m/s\].
    pub climb_speed: f32,
    /// Speed of sinking where it is too high to land \[m/s\].
    pub descent_speed: f32,
    /// Speed of landing \[m/s\].
    pub landing_speed: f32,
    /// Least height on the way home \[m\].
    pub return_altitude_m: f32,
    /// A landed drone is disarmed after this \[s\].
    pub landed_secs: f32,
    /// An armed drone that does not take off is disarmed after this \[s\].
    pub idle_secs: f32,
    /// A set-point in the offboard mode that is older holds the drone where it is \[s\].
    pub set_point_stale_secs: f32,
    /// After this without set-points the offboard mode is left \[s\].
    pub offboard_loss_secs: f32,
    /// Then.
    pub offboard_loss_action: FailsafeAction,
    /// After this without a word of a ground station that spoke before, the link is lost \[s\].
    pub link_loss_secs: f32,
    /// Then.
    pub link_loss_action: FailsafeAction,
    /// When the fence is left.
    pub fence_action: FailsafeAction,
    /// Radius of the fence around home, if there is one \[m\].
    pub fence_radius_m: Option<f32>,
    /// Height of the fence above home, if there is one \[m\].
    pub fence_height_m: Option<f32>,
    /// Shares of the battery that are low, critical, and nearly nothing.
    pub battery_levels: [f32; 3],
    /// At each of them.
    pub battery_actions: [FailsafeAction; 3],
    /// Time of flight that empties the simulated battery, if it empties at all \[s\].
    pub battery_drain_secs: Option<f32>,
    /// Share of the battery at which it stops emptying.
    pub battery_least: f32,
    /// Greatest tilt \[rad\].
    pub tilt_limit_rad: f32,
    /// For how long it may be exceeded \[s\].
    pub tilt_secs: f32,
    /// Greatest body rate about any axis \[rad/s\].
    pub rate_limit: f32,
    /// For how long it may be exceeded \[s\].
    pub rate_secs: f32,
    /// When either is.
    pub upset_reaction: FailsafeReaction,
    /// For how long a policy may give no answer, or none that is finite \[s\].
    pub silence_secs: f32,
    /// For how long it may keep a rotor at its limits \[s\].
    pub saturation_secs: f32,
    /// When it exceeds either.
    pub policy_reaction: FailsafeReaction,
    /// With less time than this until the drone is at what its rangers see, the cascade holds it where it is, if it may
    /// \[s\].
    pub clearance_secs: Option<f32>,
    /// Whether it learns in flight what share of its thrust each rotor makes, and drives weak ones harder; if not, it forgets
    /// them.
    pub compensates_rotors: bool,
}

impl FailsafeReaction {
    /// The cascade takes over.
    pub const fn with_cascade(action: FailsafeAction) -> Self {
        Self { action, fallback: Fallback::Cascade }
    }

    /// The active controller goes on.
    pub const fn only(action: FailsafeAction) -> Self {
        Self { action, fallback: Fallback::Keep }
    }
}

impl AutopilotSettings {
    /// For peers that live in another time than the vehicle, of which `pace` seconds go by in one of theirs: they may be
    /// silent for as long as before by their own clocks.
    #[must_use]
    pub fn at_pace(self, pace: f32) -> Self {
        Self {
            set_point_stale_secs: self.set_point_stale_secs * pace,
            offboard_loss_secs: self.offboard_loss_secs * pace,
            link_loss_secs: self.link_loss_secs * pace,
            ..self
        }
    }
}

impl Default for AutopilotSettings {
    fn default() -> Self {
        Self {
            takeoff_altitude_m: 1.0,
            // Half of what hover policies start their episodes with.
            cruise_speed: 0.5,
            climb_speed: 0.5,
            descent_speed: 1.0,
            // A touch-down from a fall of 5 mm.
            landing_speed: 0.3,
            return_altitude_m: 1.5,
            landed_secs: 2.0,
            idle_secs: 10.0,
            // PX4 wants two set-points a second at least.
            set_point_stale_secs: 0.6,
            offboard_loss_secs: 1.0,
            offboard_loss_action: FailsafeAction::Hold,
            link_loss_secs: 10.0,
            link_loss_action: FailsafeAction::Land,
            fence_action: FailsafeAction::Hold,
            fence_radius_m: None,
            fence_height_m: None,
            battery_levels: [0.15, 0.07, 0.05],
            battery_actions: [FailsafeAction::Warn, FailsafeAction::Return, FailsafeAction::Land],
            battery_drain_secs: None,
            battery_least: 0.5,
            tilt_limit_rad: 60_f32.to_radians(),
            tilt_secs: 0.3,
            rate_limit: 15.0,
            rate_secs: 0.3,
            upset_reaction: FailsafeReaction::with_cascade(FailsafeAction::Land),
            silence_secs: 0.02,
            saturation_secs: 0.5,
            policy_reaction: FailsafeReaction::with_cascade(FailsafeAction::Hold),
            clearance_secs: None,
            compensates_rotors: false,
        }
    }
}
