//! The reference system's actions: what its learning environments offer, exactly.

use serde::{Deserialize, Serialize};

use crate::airframe::{Airframe, Downwash, DragCoefficients, Layout};
use crate::limits::ACTION_LIMIT;
use crate::persistence::Persistence;
use crate::policy_error::{PolicyError, finite, positive};
use crate::real::Real;
use crate::reference::controller::command::{self, Hover, Precision};
use crate::reference::controller::{Allocation, DslPid, DslPidMemory, SimplePid, SimplePidMemory};
use crate::setpoint::Setpoint;
use crate::vehicle::State;

/// Numbers of what the reference's controllers remember, in a row.
pub const CONTROL_MEMORY_LEN: usize = 21;

/// The reference's action types, of the thesis's fork and of upstream; its names are in brackets.
///
/// The core limits none of them, neither actions nor rotor speeds, because the reference does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ReferenceActionKind {
    /// Four rotor speeds, within 5 % of hover (RPM).
    Rpm,
    /// Thrust from nothing to twice the weight, and three torques (DYN, fork).
    Dyn,
    /// A position relative to the drone's, up to 0.1 m away along each axis, for a PID controller (PID, fork).
    Pid,
    /// Direction of flight and share of the greatest speed, for a PID controller (VEL).
    Vel,
    /// Changes of the six gains of a PID controller that follows the task's moving target (TUN, fork).
    Tun,
    /// One speed for all rotors, within 5 % of hover (`ONE_D_RPM`).
    OneDRpm,
    /// Thrust within 5 % of the weight, no torques (`ONE_D_DYN`, fork).
    OneDDyn,
    /// A position above or below the drone, up to 0.1 m away, for a PID controller (`ONE_D_PID`).
    OneDPid,
    /// A position in the world \[m\], approached in strides of a metre by a PID controller (PID, upstream).
    Waypoint,
}

/// Which of the reference's controllers turns set points into rotor speeds, and what it takes the drone for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ReferenceController {
    /// `DSLPIDControl`. The reference's learning environments have it for `cf2x`, whichever Crazyflie flies.
    Dsl(Airframe),
    /// `SimplePIDControl`, of the Hummingbird.
    Simple(Airframe),
}

/// An action type of the reference for one airframe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceActions {
    /// What the numbers mean.
    pub kind: ReferenceActionKind,
    /// Where they are computed in single precision.
    pub precision: Precision,
    /// The drone that flies.
    pub airframe: Airframe,
    /// What flies it towards positions and velocities.
    pub controller: ReferenceController,
    /// Whether the controller remembers earlier episodes.
    pub persistence: Persistence,
}

/// [`ReferenceActions`] ready for arithmetic.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceControls<R> {
    kind: ReferenceActionKind,
    precision: Precision,
    airframe: Airframe,
    hover: Hover<R>,
    allocation: Allocation<R>,
    controller: Controller<R>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Controller<R> {
    Dsl(DslPid<R>),
    Simple(SimplePid<R>),
}

/// What the controller behind an action space remembers from call to call; of one without a controller, nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ControlMemory<R> {
    /// Of [`ReferenceController::Dsl`].
    pub dsl: DslPidMemory<R>,
    /// Of [`ReferenceController::Simple`].
    pub simple: SimplePidMemory<R>,
    /// Of [`IntegralVelocities`](crate::action::IntegralVelocities) \[m/s², world\].
    pub velocity_integral: nalgebra::Vector3<R>,
}

impl ReferenceActionKind {
    /// Every kind.
    pub const ALL: [Self; 9] = [
        Self::Rpm,
        Self::Dyn,
        Self::Pid,
        Self::Vel,
        Self::Tun,
        Self::OneDRpm,
        Self::OneDDyn,
        Self::OneDPid,
        Self::Waypoint,
    ];

    /// Values in an action.
    #[expect(clippy::len_without_is_empty, reason = "no action is empty")]
    pub const fn len(self) -> usize {
        match self {
            Self::Rpm | Self::Dyn | Self::Vel => 4,
            Self::Pid | Self::Waypoint => 3,
            Self::Tun => 6,
            Self::OneDRpm | Self::OneDDyn | Self::OneDPid => 1,
        }
    }

    /// As written in configurations.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rpm => "rpm",
            Self::Dyn => "dyn",
            Self::Pid => "pid",
            Self::Vel => "vel",
            Self::Tun => "tun",
            Self::OneDRpm => "one_d_rpm",
            Self::OneDDyn => "one_d_dyn",
            Self::OneDPid => "one_d_pid",
            Self::Waypoint => "waypoint",
        }
    }
}

impl ReferenceActions {
    /// Values in an action.
    pub(crate) const fn len(&self) -> usize {
        self.kind.len()
    }

    /// As written in configurations.
    pub(crate) const fn name(&self) -> &'static str {
        self.kind.name()
    }

    /// Greatest rotor speed \[rad/s\].
    pub(crate) const fn rotor_speed_limit(&self) -> f32 {
        self.airframe.rotor_speed_limit as f32
    }

    pub(crate) fn hover_speed_squared(&self) -> f32 {
        (self.airframe.weight() / (4.0 * self.airframe.thrust_coefficient)) as f32
    }

    pub(crate) const fn persistence(&self) -> Persistence {
        self.persistence
    }

    /// Refuses numbers with which a flight would compute nonsense.
    pub(crate) fn check(&self) -> Result<(), PolicyError> {
        check_airframe(&self.airframe)?;
        check_airframe(self.controller.airframe())
    }
}

impl ReferenceController {
    /// What it takes the drone for.
    pub const fn airframe(&self) -> &Airframe {
        match self {
            Self::Dsl(airframe) | Self::Simple(airframe) => airframe,
        }
    }
}

impl<R: Real> ReferenceControls<R> {
    /// The controls of an action space.
    pub fn new(space: &ReferenceActions) -> Self {
        Self {
            kind: space.kind,
            precision: space.precision,
            airframe: space.airframe,
            hover: Hover::new(&space.airframe),
            allocation: Allocation::new(&space.airframe),
            controller: match &space.controller {
                ReferenceController::Dsl(airframe) => Controller::Dsl(DslPid::new(airframe)),
                ReferenceController::Simple(airframe) => Controller::Simple(SimplePid::new(airframe)),
            },
        }
    }

    /// Around which speed the values of an action of [`ReferenceActionKind::Rpm`] lie, which needs neither state nor memory;
    /// `None` of any other kind.
    pub fn rpm(&self) -> Option<(Hover<R>, Precision)> {
        (self.kind == ReferenceActionKind::Rpm).then_some((self.hover, self.precision))
    }

    /// As [`Controls::rotor_targets`](crate::action::Controls::rotor_targets).
    #[inline]
    pub fn rotor_targets(
        &self,
        action: &[R; ACTION_LIMIT],
        state: &State<R>,
        setpoint: &Setpoint<R>,
        memory: &mut ControlMemory<R>,
        secs: R,
    ) -> [R; 4] {
        let [a, b, c, d, _, _] = *action;
        let around_hover = |value| self.hover.rotor_speed(self.precision, value);
        let setpoint = match self.kind {
            ReferenceActionKind::Rpm => return [a, b, c, d].map(around_hover),
            ReferenceActionKind::OneDRpm => return [around_hover(a); 4],
            ReferenceActionKind::Dyn => {
                return self.allocation.rotor_speeds(&command::wrench(&self.airframe, &[a, b, c, d]));
            }
            ReferenceActionKind::OneDDyn => {
                return self.allocation.rotor_speeds(&command::thrust(&self.airframe, a));
            }
            ReferenceActionKind::Tun => {
                return self.controller.tuned(action).rotor_speeds(memory, state, setpoint, secs);
            }
            ReferenceActionKind::Pid => match self.precision {
                Precision::Exact => command::offset(state, &[a, b, c]),
                Precision::Single | Precision::AllSingle => command::offset_in_single(state, &[a, b, c]),
            },
            ReferenceActionKind::Vel => match self.precision {
                Precision::Exact => command::velocity(&self.airframe, state, &[a, b, c, d]),
                Precision::Single | Precision::AllSingle => {
                    command::velocity_in_single(&self.airframe, state, &[a, b, c, d])
                }
            },
            ReferenceActionKind::OneDPid => command::vertical_offset(state, a),
            ReferenceActionKind::Waypoint => command::waypoint(state, [a, b, c].into()),
        };
        self.controller.rotor_speeds(memory, state, &setpoint, secs)
    }
}

impl<R: Real> Controller<R> {
    fn rotor_speeds(
        &self,
        memory: &mut ControlMemory<R>,
        state: &State<R>,
        setpoint: &Setpoint<R>,
        secs: R,
    ) -> [R; 4] {
        match self {
            Self::Dsl(controller) => controller.command(&mut memory.dsl, state, setpoint, secs).rotor_speeds,
            Self::Simple(controller) => controller.command(&mut memory.simple, state, setpoint, secs).rotor_speeds,
        }
    }

    /// The controller with the gains that the action asks for.
    fn tuned(mut self, action: &[R; 6]) -> Self {
        match &mut self {
            Self::Dsl(DslPid { gains, .. }) | Self::Simple(SimplePid { gains, .. }) => {
                *gains = gains.tuned(action);
            }
        }
        self
    }
}

impl<R: Real> ControlMemory<R> {
    /// Nothing, as at the start of an episode.
    pub fn new() -> Self {
        let velocity_integral = crate::reference::vector::zero();
        Self { dsl: DslPidMemory::new(), simple: SimplePidMemory::new(), velocity_integral }
    }

    /// What the reference's controllers remember, in a row.
    pub fn to_array(&self) -> [R; CONTROL_MEMORY_LEN] {
        let DslPidMemory { position_integral, attitude_integral, last_angles } = self.dsl;
        let simple = &self.simple;
        let vectors = [
            position_integral,
            attitude_integral,
            last_angles,
            simple.position_integral,
            simple.last_position_error,
            simple.attitude_integral,
            simple.last_attitude_error,
        ];
        let mut numbers = [R::zero(); CONTROL_MEMORY_LEN];
        for (slots, vector) in numbers.as_chunks_mut::<3>().0.iter_mut().zip(vectors) {
            *slots = vector.into();
        }
        numbers
    }

    /// The memory of the reference's controllers of which [`Self::to_array`] gave these numbers.
    pub fn from_array(numbers: &[R; CONTROL_MEMORY_LEN]) -> Self {
        let mut vectors = numbers.as_chunks::<3>().0.iter().map(|[x, y, z]| nalgebra::Vector3::new(*x, *y, *z));
        let mut next = || vectors.next().unwrap_or_else(crate::reference::vector::zero);
        Self {
            dsl: DslPidMemory { position_integral: next(), attitude_integral: next(), last_angles: next() },
            simple: SimplePidMemory {
                position_integral: next(),
                last_position_error: next(),
                attitude_integral: next(),
                last_attitude_error: next(),
            },
            ..Self::new()
        }
    }
}

impl<R: Real> Default for ControlMemory<R> {
    fn default() -> Self {
        Self::new()
    }
}

/// What divides must be positive, the rest finite.
fn check_airframe(airframe: &Airframe) -> Result<(), PolicyError> {
    let single = |number: f64| number as f32;
    positive("mass", single(airframe.mass))?;
    positive("arm", single(airframe.arm))?;
    positive("thrust_coefficient", single(airframe.thrust_coefficient))?;
    positive("torque_coefficient", single(airframe.torque_coefficient.abs()))?;
    positive("rotor_speed_limit", single(airframe.rotor_speed_limit))?;
    let [x, y] = match airframe.layout {
        Layout::Cross { x, y } => [x, y],
        Layout::Plus { arm } => [arm, arm],
    };
    let DragCoefficients { planar, axial } = airframe.drag_coefficients;
    let Downwash { strength, width_slope, width_offset } = airframe.downwash;
    let [jx, jy, jz] = airframe.inertia;
    let (rise, fall) = (airframe.rotor_rise_secs, airframe.rotor_fall_secs);
    let (radius, height) = (airframe.collision_radius, airframe.collision_height);
    let numbers = [
        [x, y, rise, fall, planar, axial],
        [jx, jy, jz, strength, width_slope, width_offset],
        [radius, height, airframe.collision_offset, airframe.nominal_speed, 0.0, 0.0],
        [airframe.propeller_radius, airframe.ground_effect_coefficient, 0.0, 0.0, 0.0, 0.0],
    ];
    numbers.as_flattened().iter().try_for_each(|number| finite("an airframe number", single(*number)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::{CF2P, CF2X, HUMMINGBIRD};
    use crate::attitude::Attitude;
    use nalgebra::Vector3;

    fn space(
        kind: ReferenceActionKind,
        airframe: Airframe,
        controller: &ReferenceController,
    ) -> ReferenceControls<f64> {
        ReferenceControls::new(&ReferenceActions {
            kind,
            precision: Precision::Exact,
            airframe,
            controller: *controller,
            persistence: Persistence::ResetEachEpisode,
        })
    }

    fn hovering() -> State<f64> {
        State {
            position: Vector3::new(0.3, -0.2, 1.0),
            world_from_body: Attitude::level(),
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: [0.0; 4],
        }
    }

    #[test]
    fn staying_where_it_is_hovers_in_every_space() {
        let state = hovering();
        let fleet = [
            (CF2X, ReferenceController::Dsl(CF2X)),
            (CF2P, ReferenceController::Dsl(CF2X)),
            (HUMMINGBIRD, ReferenceController::Simple(HUMMINGBIRD)),
        ];
        for (airframe, controller) in fleet {
            for kind in ReferenceActionKind::ALL {
                let controls = space(kind, airframe, &controller);
                let stay = [0.3, -0.2, 1.0, 0.0, 0.0, 0.0];
                let action = if kind == ReferenceActionKind::Waypoint { stay } else { [0.0; ACTION_LIMIT] };
                let setpoint = Setpoint::at(state.position);
                let mut memory = ControlMemory::new();
                for target in controls.rotor_targets(&action, &state, &setpoint, &mut memory, 1.0 / 48.0) {
                    // The Crazyflie's controller knows the hover speed by way of rounded constants.
                    assert!((target / airframe.hover_rotor_speed() - 1.0).abs() < 1e-9, "{kind:?}");
                }
            }
        }
    }

    #[test]
    fn an_action_of_minus_one_silences_a_tuned_gain() {
        let mut state = hovering();
        state.velocity = Vector3::new(0.0, 0.0, 0.4);
        let controls = space(ReferenceActionKind::Tun, CF2X, &ReferenceController::Dsl(CF2X));
        let targets = |setpoint_height: f64, action| {
            let setpoint = Setpoint::at(Vector3::new(0.3, -0.2, setpoint_height));
            controls.rotor_targets(&action, &state, &setpoint, &mut ControlMemory::new(), 0.01)
        };
        let without_position = [-1.0, -1.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(targets(1.0, without_position), targets(3.0, without_position));
        assert_ne!(targets(1.0, [0.0; 6]), targets(3.0, [0.0; 6]));
        let silent = targets(3.0, [-1.0; 6]);
        assert!(silent.iter().all(|target| (target / CF2X.hover_rotor_speed() - 1.0).abs() < 1e-9));
    }

    #[test]
    fn a_memory_survives_as_an_array() {
        let numbers: [f64; CONTROL_MEMORY_LEN] = core::array::from_fn(|index| index as f64 - 7.5);
        assert_eq!(ControlMemory::from_array(&numbers).to_array(), numbers);
        assert_eq!(ControlMemory::<f32>::new().to_array(), [0.0; CONTROL_MEMORY_LEN]);
    }

    #[test]
    fn only_the_controller_in_charge_remembers() {
        for (controller, used) in
            [(ReferenceController::Dsl(CF2X), 0..9), (ReferenceController::Simple(HUMMINGBIRD), 9..21)]
        {
            let controls = space(ReferenceActionKind::Pid, *controller.airframe(), &controller);
            let mut state = hovering();
            state.world_from_body = Attitude::from_axis_angle(Vector3::new(0.6, 0.0, 0.8), 0.3);
            let mut memory = ControlMemory::new();
            controls.rotor_targets(&[0.5; 6], &state, &Setpoint::at(Vector3::zeros()), &mut memory, 0.02);
            for (index, number) in memory.to_array().into_iter().enumerate() {
                assert!(used.contains(&index) || number == 0.0);
            }
            assert_ne!(memory, ControlMemory::new());
        }
    }
}
