//! What a policy commands: action spaces that turn a few numbers in \[-1, 1\] into rotor targets.

#[cfg(feature = "px4")]
mod rotor_thrusts;
mod thrust_torques;
mod velocity;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

#[cfg(feature = "px4")]
pub use rotor_thrusts::RotorThrusts;
pub use thrust_torques::ThrustTorques;
pub use velocity::{IntegralVelocities, Velocities};

use crate::airframe::{Airframe, Layout};
use crate::real::Real;
#[cfg(feature = "reference")]
pub use crate::reference::action::{
    CONTROL_MEMORY_LEN, ControlMemory, ReferenceActionKind, ReferenceActions, ReferenceController,
    ReferenceControls,
};
use crate::vehicle::State;
#[cfg(not(feature = "px4"))]
pub use crate::without_px4::RotorThrusts;
#[cfg(not(feature = "reference"))]
pub use crate::without_reference::{ControlMemory, ReferenceActions, ReferenceControls};

pub use crate::limits::{ACTION_LEN, ACTION_LIMIT};
pub use crate::persistence::Persistence;
pub use crate::setpoint::Setpoint;

/// The action spaces; the identifier and its numbers travel in the policy file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[allow(
    clippy::large_enum_variant,
    reason = "with few features one is; there is one per scenario or policy, and no allocator to box it with"
)]
pub enum ActionSpace {
    /// [`RotorSpeeds`].
    RotorSpeeds(RotorSpeeds),
    /// [`ThrustBodyRates`] (CTBR).
    ThrustBodyRates(ThrustBodyRates),
    /// [`ReferenceActions`] of the reference system.
    Reference(ReferenceActions),
    /// [`Velocities`].
    Velocities(Velocities),
    /// [`RotorThrusts`].
    RotorThrusts(RotorThrusts),
    /// [`ThrustBodyRates`] whose rate controller runs at every sample of the gyroscope, between two actions too
    /// ([`RateLoop`](crate::rate_loop::RateLoop)).
    RateLoop(ThrustBodyRates),
    /// [`IntegralVelocities`].
    IntegralVelocities(IntegralVelocities),
    /// [`ThrustTorques`].
    ThrustTorques(ThrustTorques),
}

/// An action space ready for arithmetic; built once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Controls<R> {
    /// [`RotorSpeeds`].
    RotorSpeeds(RotorSpeeds),
    /// [`ThrustBodyRates`].
    ThrustBodyRates(ThrustBodyRates),
    /// [`ReferenceActions`].
    Reference(ReferenceControls<R>),
    /// [`IntegralVelocities`], of [`Velocities`] with a gain of zero: one copy of the code in a firmware.
    Velocities(IntegralVelocities),
    /// [`RotorThrusts`].
    RotorThrusts(RotorThrusts),
    /// [`ThrustTorques`].
    ThrustTorques(ThrustTorques),
}

/// One action per rotor: `hover_rotor_speed · (1 + fraction · action)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RotorSpeeds {
    /// Speed at which the nominal drone hovers \[rad/s\].
    pub hover_rotor_speed: f32,
    /// Greatest rotor speed \[rad/s\].
    pub rotor_speed_limit: f32,
    /// Authority around hover, in (0, 1]; the reference system has 0.05.
    pub fraction: f32,
}

/// Collective thrust and body rates, tracked by a proportional rate controller with the nominal mixer.
///
/// Thrust is `hover thrust · (1 + thrust_fraction · action[0])`; the wanted body rates are `action[1..4]` times
/// their limits.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ThrustBodyRates {
    /// Squared rotor speed at which the nominal drone hovers \[rad²/s²\].
    pub hover_speed_squared: f32,
    /// Squared greatest rotor speed \[rad²/s²\].
    pub speed_squared_limit: f32,
    /// Thrust authority around hover, in (0, 1.25] for the Crazyflie.
    pub thrust_fraction: f32,
    /// Body rates that a full action asks for \[rad/s\].
    pub body_rates_limit: [f32; 3],
    /// Angular acceleration per body-rate error \[1/s\].
    pub rate_gains: [f32; 3],
    /// Squared rotor speed per angular acceleration about x, y, z, for each rotor \[rad\].
    pub mixer: [[f32; 3]; 4],
}

impl RotorSpeeds {
    /// Authority of `fraction` around the hover speed of `airframe`.
    pub fn new(airframe: &Airframe, fraction: f32) -> Self {
        Self {
            hover_rotor_speed: airframe.hover_rotor_speed() as f32,
            rotor_speed_limit: airframe.rotor_speed_limit as f32,
            fraction,
        }
    }

    /// Rotor targets \[rad/s\], within zero and the greatest rotor speed, whatever the action (limited to
    /// \[-1, 1\], NaN to -1).
    #[inline(always)]
    pub fn rotor_targets<R: Real>(&self, action: &[R; ACTION_LEN]) -> [R; 4] {
        action.map(|value| {
            let value = value.limited(-R::one(), R::one());
            let hover = R::from_f32(self.hover_rotor_speed);
            let target = hover + hover * R::from_f32(self.fraction) * value;
            target.limited(R::zero(), R::from_f32(self.rotor_speed_limit))
        })
    }
}

impl ThrustBodyRates {
    /// A controller for `airframe`; the rotor shares of the three torques are orthogonal in every [`Layout`].
    pub fn new(
        airframe: &Airframe,
        thrust_fraction: f32,
        body_rates_limit: [f32; 3],
        rate_gains: [f32; 3],
    ) -> Self {
        let positions = airframe.rotor_positions();
        let yaw_arm = airframe.torque_coefficient / airframe.thrust_coefficient;
        let arms = [
            positions.map(|[_, y]| y),
            positions.map(|[x, _]| -x),
            Layout::TORQUE_SIGNS.map(|sign| sign * yaw_arm),
        ];
        let hover = airframe.hover_rotor_speed();
        Self {
            hover_speed_squared: (hover * hover) as f32,
            speed_squared_limit: (airframe.rotor_speed_limit * airframe.rotor_speed_limit) as f32,
            thrust_fraction,
            body_rates_limit,
            rate_gains,
            mixer: core::array::from_fn(|rotor| {
                core::array::from_fn(|axis| {
                    let lever: f64 = arms[axis].iter().map(|arm| arm * arm).sum();
                    let per_torque = arms[axis][rotor] / (lever * airframe.thrust_coefficient);
                    (airframe.inertia[axis] * per_torque) as f32
                })
            }),
        }
    }

    /// Rotor targets \[rad/s\], within zero and the greatest rotor speed, whatever the action (limited to
    /// \[-1, 1\], NaN to -1) and the body rates \[rad/s\].
    #[inline(always)]
    pub fn rotor_targets<R: Real>(&self, action: &[R; ACTION_LEN], body_rates: &Vector3<R>) -> [R; 4] {
        let real = R::from_f32;
        let [thrust, roll, pitch, yaw] = action.map(|value| value.limited(-R::one(), R::one()));
        let hover = real(self.hover_speed_squared);
        let collective = hover + hover * real(self.thrust_fraction) * thrust;
        let wanted = |axis: usize, action: R, rate: R| {
            (real(self.body_rates_limit[axis]) * action - rate) * real(self.rate_gains[axis])
        };
        let acceleration =
            [wanted(0, roll, body_rates.x), wanted(1, pitch, body_rates.y), wanted(2, yaw, body_rates.z)];
        self.mixer.map(|[x, y, z]| {
            let turning = (real(x) * acceleration[0] + real(y) * acceleration[1]) + real(z) * acceleration[2];
            (collective + turning).limited(R::zero(), real(self.speed_squared_limit)).sqrt()
        })
    }
}

impl ActionSpace {
    /// Values in an action.
    #[expect(clippy::len_without_is_empty, reason = "no action is empty")]
    pub const fn len(&self) -> usize {
        match self {
            Self::RotorSpeeds(_)
            | Self::ThrustBodyRates(_)
            | Self::RateLoop(_)
            | Self::Velocities(_)
            | Self::IntegralVelocities(_)
            | Self::RotorThrusts(_)
            | Self::ThrustTorques(_) => ACTION_LEN,
            Self::Reference(space) => space.len(),
        }
    }

    /// As written in configurations.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::RotorSpeeds(_) => "rotor_speeds",
            Self::ThrustBodyRates(_) | Self::RateLoop(_) => "thrust_body_rates",
            Self::Reference(space) => space.name(),
            Self::Velocities(_) | Self::IntegralVelocities(_) => "velocity",
            Self::RotorThrusts(_) => "rotor_thrusts",
            Self::ThrustTorques(_) => "thrust_torques",
        }
    }

    /// The same actions on another drone: those that any drone understands ([`ThrustTorques`]) turn its rotors; others stay
    /// those of the drone that they were made for.
    #[must_use]
    pub fn on(&self, airframe: &Airframe) -> Self {
        match self {
            Self::ThrustTorques(space) => Self::ThrustTorques(space.on(airframe)),
            Self::RotorSpeeds(_)
            | Self::ThrustBodyRates(_)
            | Self::RateLoop(_)
            | Self::Reference(_)
            | Self::Velocities(_)
            | Self::IntegralVelocities(_)
            | Self::RotorThrusts(_) => *self,
        }
    }

    /// Greatest rotor speed \[rad/s\].
    pub fn rotor_speed_limit(&self) -> f32 {
        match self {
            Self::RotorSpeeds(space) => space.rotor_speed_limit,
            Self::ThrustBodyRates(space)
            | Self::RateLoop(space)
            | Self::Velocities(Velocities { rates: space, .. })
            | Self::IntegralVelocities(IntegralVelocities {
                velocities: Velocities { rates: space, .. }, ..
            }) => space.speed_squared_limit.sqrt(),
            Self::Reference(space) => space.rotor_speed_limit(),
            Self::RotorThrusts(space) => space.rotor_speed_limit(),
            Self::ThrustTorques(space) => space.speed_squared_limit.sqrt(),
        }
    }

    /// Squared rotor speed at which the nominal drone hovers \[rad²/s²\].
    pub fn hover_speed_squared(&self) -> f32 {
        match self {
            Self::RotorSpeeds(space) => space.hover_rotor_speed * space.hover_rotor_speed,
            Self::ThrustBodyRates(space) | Self::RateLoop(space) => space.hover_speed_squared,
            Self::Reference(space) => space.hover_speed_squared(),
            Self::Velocities(space) => space.rates.hover_speed_squared,
            Self::IntegralVelocities(space) => space.velocities.rates.hover_speed_squared,
            Self::RotorThrusts(space) => space.hover_speed_squared(),
            Self::ThrustTorques(space) => space.hover_speed_squared,
        }
    }

    /// How long the controller behind the space remembers; a space without one does not.
    pub const fn persistence(&self) -> Persistence {
        match self {
            Self::RotorSpeeds(_)
            | Self::ThrustBodyRates(_)
            | Self::RateLoop(_)
            | Self::Velocities(_)
            | Self::IntegralVelocities(_)
            | Self::RotorThrusts(_)
            | Self::ThrustTorques(_) => Persistence::ResetEachEpisode,
            Self::Reference(space) => space.persistence(),
        }
    }
}

impl<R: Real> Controls<R> {
    /// The controls of an action space.
    pub fn new(space: &ActionSpace) -> Self {
        match space {
            ActionSpace::RotorSpeeds(space) => Self::RotorSpeeds(*space),
            ActionSpace::ThrustBodyRates(space) | ActionSpace::RateLoop(space) => Self::ThrustBodyRates(*space),
            ActionSpace::Reference(space) => Self::Reference(ReferenceControls::new(space)),
            ActionSpace::Velocities(space) => {
                Self::Velocities(IntegralVelocities { velocities: *space, integral_gain: 0.0 })
            }
            ActionSpace::IntegralVelocities(space) => Self::Velocities(*space),
            ActionSpace::RotorThrusts(space) => Self::RotorThrusts(*space),
            ActionSpace::ThrustTorques(space) => Self::ThrustTorques(*space),
        }
    }

    /// Rotor targets \[rad/s\] for the next `secs`, the time since the last call.
    ///
    /// `setpoint` is the task's moving target, which only the reference's `TUN` reads. The targets of the reference's
    /// actions are not limited and are NaN where the state is; those of the other spaces are in range, whatever the
    /// action and the state.
    #[inline(always)]
    pub fn rotor_targets(
        &self,
        action: &[R; ACTION_LIMIT],
        state: &State<R>,
        setpoint: &Setpoint<R>,
        memory: &mut ControlMemory<R>,
        secs: R,
    ) -> [R; 4] {
        let [a, b, c, d, _, _] = *action;
        match self {
            Self::RotorSpeeds(space) => space.rotor_targets(&[a, b, c, d]),
            Self::ThrustBodyRates(space) => space.rotor_targets(&[a, b, c, d], &state.body_rates),
            Self::Reference(controls) => controls.rotor_targets(action, state, setpoint, memory, secs),
            Self::Velocities(space) => {
                space.rotor_targets(&[a, b, c, d], state, &mut memory.velocity_integral, secs)
            }
            Self::RotorThrusts(space) => space.rotor_targets(&[a, b, c, d]),
            Self::ThrustTorques(space) => space.rotor_targets(&[a, b, c, d]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::CF2X;
    use crate::attitude::Attitude;
    use crate::vehicle::{Air, Vehicle};
    use proptest::prelude::*;

    fn turning<R: Real>(body_rates: Vector3<R>) -> State<R> {
        State {
            position: Vector3::from([R::zero(); 3]),
            world_from_body: Attitude::level(),
            velocity: Vector3::from([R::zero(); 3]),
            body_rates,
            rotor_speeds: [R::zero(); 4],
        }
    }

    fn targets<R: Real>(space: &ActionSpace, [a, b, c, d]: [R; 4], body_rates: Vector3<R>) -> [R; 4] {
        let action = [a, b, c, d, R::from_f64(f64::NAN), R::one()];
        let setpoint = Setpoint::at(Vector3::from([R::zero(); 3]));
        let mut memory = ControlMemory::new();
        Controls::new(space).rotor_targets(&action, &turning(body_rates), &setpoint, &mut memory, R::one())
    }

    #[test]
    fn a_zero_action_hovers_in_both_spaces() {
        let spaces = [
            ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 0.05)),
            ActionSpace::ThrustBodyRates(ThrustBodyRates::new(&CF2X, 1.0, [6.0, 6.0, 3.0], [20.0, 20.0, 10.0])),
        ];
        for space in spaces {
            assert_eq!(space.len(), 4);
            for target in targets(&space, [0.0_f64; 4], Vector3::zeros()) {
                assert!((target / CF2X.hover_rotor_speed() - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn the_reference_action_moves_each_rotor_by_a_twentieth() {
        let space = ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 0.05));
        let targets = targets(&space, [1.0_f64, -1.0, 2.0, f64::NAN], Vector3::zeros());
        let shares = targets.map(|target| target / CF2X.hover_rotor_speed());
        for (share, expected) in shares.into_iter().zip([1.05, 0.95, 1.05, 0.95]) {
            assert!((share - expected).abs() < 1e-6);
        }
    }

    #[test]
    fn the_rate_controller_asks_for_the_gain_times_the_error() {
        let space = ThrustBodyRates::new(&CF2X, 1.0, [6.0; 3], [10.0, 10.0, 4.0]);
        let rates = Vector3::new(0.5, -0.2, 0.1);
        let rotor_speeds = space.rotor_targets(&[0.0, 0.1, -0.1, 0.05_f64], &rates);
        let state = State { rotor_speeds, ..turning(rates) };
        let (_, turning) = Vehicle::new(&CF2X).accelerations(&state, &[0.0; 4], &Air::still());
        let gyroscopic = Vehicle::<f64>::new(&CF2X).gyroscopic;
        let expected = [10.0 * (0.6 - 0.5), 10.0 * (-0.6 + 0.2), 4.0 * (0.3 - 0.1)];
        let coupling = [rates.y * rates.z, rates.z * rates.x, rates.x * rates.y];
        for axis in 0..3 {
            assert!((turning[axis] - expected[axis] - gyroscopic[axis] * coupling[axis]).abs() < 1e-4);
        }
    }

    proptest! {
        #[test]
        fn targets_are_always_in_range(bits in any::<[u32; 7]>()) {
            let [a, b, c, d, p, q, r] = bits.map(f32::from_bits);
            let spaces = [
                ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 1.0)),
                ActionSpace::ThrustBodyRates(ThrustBodyRates::new(&CF2X, 1.0, [9.0; 3], [20.0; 3])),
            ];
            for space in spaces {
                for target in targets(&space, [a, b, c, d], Vector3::new(p, q, r)) {
                    prop_assert!((0.0..=CF2X.rotor_speed_limit as f32).contains(&target));
                }
            }
        }
    }
}
