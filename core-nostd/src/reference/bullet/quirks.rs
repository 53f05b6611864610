//! What the reference system does that a textbook model does not, one field per quirk.
//!
//! Facts 1 to 9 of `tests/golden/README.md` are where each was observed; `Quirks::upstream()` and `Quirks::fork()`
//! are the two published systems, and every field can be turned alone.

/// The departures of the `bullet` preset from rigid-body mechanics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quirks {
    /// Artificial damping `k`: accelerations −v (k + k |v|), angular −ω (k + k |ω|), with v in m/s and ω in rad/s,
    /// not in DYN. Bullet's default is the float literal 0.04; the line of the reference that would clear it is
    /// commented out. Zero turns it off.
    pub damping: f64,
    /// How exactly thrusts and reaction torques follow from rotor speeds.
    pub rotor_precision: RotorPrecision,
    /// Which attitude turns thrust, reaction torque, drag and downwash into the world.
    pub link_attitude: LinkAttitude,
    /// What the ground-effect modes do to the links' stale attitude.
    pub ground_query: GroundQuery,
    /// In which frame the drag coefficients meet the velocity.
    pub drag_frame: DragFrame,
    /// Which rotor speeds drag is computed from.
    pub drag_rotors: DragRotors,
    /// Along which axis downwash pushes.
    pub downwash_axis: DownwashAxis,
    /// Vertical distance below which downwash grows no further \[m\]. The reference has no such floor (zero): its
    /// force diverges as (R / 4 dz)² when one drone comes level with another; [`Self::none`] stops at twice the
    /// height of a Crazyflie.
    pub downwash_nearest: f64,
    /// Horizontal distance from which there is no downwash \[m\].
    pub downwash_reach: f64,
    /// Greatest rotation in one physics step \[rad\], in (0, π]: Bullet caps the angle of its exponential map.
    pub rotation_cap: f64,
    /// Greatest magnitude of each world component of velocity \[m/s\] and angular velocity \[rad/s\], not in DYN.
    pub velocity_cap: f64,
    /// How the multibody modes advance the attitude.
    pub attitude_update: AttitudeUpdate,
    /// How DYN advances the attitude.
    pub dyn_attitude: DynAttitude,
    /// With which levers DYN turns thrust into torque.
    pub dyn_levers: DynLevers,
    /// What DYN reports as world angular velocity.
    pub dyn_report: DynReport,
}

/// Arithmetic from rotor speed to thrust and reaction torque.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RotorPrecision {
    /// The number type's own.
    Full,
    /// Every operation rounded to `float32`, on speeds in RPM: what numpy 1 makes of the fork when an environment
    /// receives `float32` actions of the RPM kind (the controllers' rotor speeds are `float64`). It moves body rates by
    /// some 1e-6 rad/s in a second.
    Single,
}

/// The attitude that turns forces given in a link's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LinkAttitude {
    /// One physics step late: at the start of the previous step (of this step right after a reset), because Bullet
    /// refreshes its links inside a step, before it integrates.
    Previous,
    /// Of this step.
    Current,
}

/// Whether reading the rotors' heights refreshes the links.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundQuery {
    /// Drag and downwash, applied after the query, use the current attitude; thrust, applied before, does not.
    RefreshesLinks,
    /// All forces use the same attitude.
    LeavesLinks,
}

/// How the drag force −(Σ Ω) c ⊙ velocity is formed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DragFrame {
    /// Coefficients scale the world velocity, and the product is turned into the body (upstream since 2024).
    ScaledInWorld,
    /// As before, but turned out of the body a second time (the fork): the world force is R R (c ⊙ v).
    TurnedTwice,
    /// Coefficients scale the body velocity, as in Förster 2015.
    Body,
}

/// The rotor speeds that drag sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DragRotors {
    /// Of the previous physics step: at the first step of a control period still the last period's, zero after a
    /// reset.
    Previous,
    /// Of this step.
    Current,
}

/// The axis of the downwash force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DownwashAxis {
    /// Down the body z axis of the drone that is hit (a link-frame force).
    Body,
    /// Down the world z axis.
    World,
}

/// From angular velocity to attitude in the multibody modes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AttitudeUpdate {
    /// Exponential map of the new angular velocity, as Bullet does.
    ExponentialMap,
    /// First-order quaternion step, normalised, as the `clean` preset does.
    FirstOrder,
}

/// From body rates to attitude in DYN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DynAttitude {
    /// The closed solution for constant body rates (upstream since 2023).
    Quaternion,
    /// Roll, pitch and yaw grow by the body rates as if those were their derivatives (the fork): right only when
    /// level.
    EulerAngles,
}

/// Levers of the rotors in DYN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DynLevers {
    /// The nominal arm, a cross being square.
    NominalArm,
    /// Where the rotors are, as in the other modes.
    RotorPositions,
}

/// World angular velocity that DYN writes back to Bullet, and observations contain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DynReport {
    /// New body rates turned by the attitude before the step (upstream).
    PreviousAttitude,
    /// (−1, −1, −1), whatever the drone does (the fork).
    MinusOne,
    /// New body rates turned by the new attitude.
    Current,
}

impl Quirks {
    /// gym-pybullet-drones 2.1.0 (commit 90b178a) on Bullet 3.2.7.
    pub const fn upstream() -> Self {
        Self {
            damping: 0.04_f32 as f64,
            rotor_precision: RotorPrecision::Full,
            link_attitude: LinkAttitude::Previous,
            ground_query: GroundQuery::RefreshesLinks,
            drag_frame: DragFrame::ScaledInWorld,
            drag_rotors: DragRotors::Previous,
            downwash_axis: DownwashAxis::Body,
            downwash_nearest: 0.0,
            downwash_reach: 10.0,
            rotation_cap: core::f64::consts::FRAC_PI_4,
            velocity_cap: 100.0,
            attitude_update: AttitudeUpdate::ExponentialMap,
            dyn_attitude: DynAttitude::Quaternion,
            dyn_levers: DynLevers::NominalArm,
            dyn_report: DynReport::PreviousAttitude,
        }
    }

    /// None: with rotors at their target speeds, the `clean` physics under semi-implicit Euler (whose ground effect
    /// raises the reaction torques too).
    pub const fn none() -> Self {
        Self {
            damping: 0.0,
            rotor_precision: RotorPrecision::Full,
            link_attitude: LinkAttitude::Current,
            ground_query: GroundQuery::LeavesLinks,
            drag_frame: DragFrame::Body,
            drag_rotors: DragRotors::Current,
            downwash_axis: DownwashAxis::World,
            downwash_nearest: 0.05,
            downwash_reach: f64::INFINITY,
            rotation_cap: core::f64::consts::PI,
            velocity_cap: f64::INFINITY,
            attitude_update: AttitudeUpdate::FirstOrder,
            dyn_attitude: DynAttitude::Quaternion,
            dyn_levers: DynLevers::RotorPositions,
            dyn_report: DynReport::Current,
        }
    }

    /// The thesis's fork (commit 40d017e) on Bullet 3.2.7; its Crazyflie is [numbered] counter-clockwise.
    ///
    /// [numbered]: crate::airframe::Airframe::numbered
    pub const fn fork() -> Self {
        Self {
            drag_frame: DragFrame::TurnedTwice,
            dyn_attitude: DynAttitude::EulerAngles,
            dyn_report: DynReport::MinusOne,
            ..Self::upstream()
        }
    }
}
