//! A pilot written by hand: the baseline that a trained policy has to beat.

use kestrel_core::action::{ACTION_LIMIT, ActionSpace, ReferenceActionKind, ReferenceActions, ThrustBodyRates};
use kestrel_core::airframe::{Airframe, GRAVITY};
use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::termination::Termination;
use nalgebra::Vector3;

/// Gains of the position loop \[1/s², 1/s\]: the best of five sets on the hover task; faster loops meet the rotors' lag and
/// oscillate.
const POSITION_GAIN: f32 = 6.0;
const VELOCITY_GAIN: f32 = 4.5;
/// How fast it learns by how much the drone accelerates otherwise than it asks for \[1/s\], in wind, with a wrong mass, with
/// rotors that differ, and how much of that it makes up for \[m/s²\].
const OBSERVER_GAIN: f32 = 3.0;
const OBSERVER_LIMIT: f32 = 8.0;
/// What it asks for has come about after this time \[s\], and it learns nothing while thrust leads elsewhere: cosine between.
const LAG_SECS: f32 = 0.25;
const ALIGNED: f32 = 0.9;
/// Published drones are as they are known, but can hardly do what they are asked for: there the error of the position is
/// integrated \[1/s³\], up to a limit \[m/s²\] and this close to the goal \[m\], so that a long way does not wind it up.
const INTEGRAL_GAIN: f32 = 3.0;
const INTEGRAL_LIMIT: f32 = 3.0;
const INTEGRAL_RANGE_M: f32 = 0.3;
/// Farther goals pull no harder than this \[m\], which limits the speed to 1.1 m/s.
const LEASH_M: f32 = 0.8;
/// A point of a route counts as passed this close to it \[m\]: by then the drone is slow enough to turn on the spot.
const PASSING_M: f32 = 0.15;
/// Where a task says how hard its goal may be touched, the share of that speed which the pilot asks for, and from how far
/// before the goal on \[m\]: the table of a room begins 0.4 m before it, and slowing down takes as much.
const TOUCH_SHARE: f32 = 0.8;
const TOUCH_RANGE_M: f32 = 0.8;
/// Body rate per attitude error \[1/s\].
const ATTITUDE_GAIN: f32 = 6.0;
/// Angular acceleration per body-rate error \[1/s\], as in the example experiments.
const RATE_GAINS: [f32; 3] = [16.0, 16.0, 6.0];
/// Greatest acceleration that the position loop asks for \[m/s²\].
const ACCELERATION_LIMIT: f32 = 5.0;

/// Share of the hover speed that a full action of the reference's changes.
const PUBLISHED_AUTHORITY: f32 = 0.05;
/// Of the thrust that this authority allows (10 %), what is left for climbing once turning has its part.
const PUBLISHED_THRUST_SHARE: f32 = 0.04;
/// Distance to the next position that a full action of the reference's asks for \[m\].
const PUBLISHED_OFFSET_M: f32 = 0.1;
/// Speed per distance from the goal \[1/s\], and the greatest that a velocity action asks for, as a share of the drone's
/// nominal speed.
const APPROACH_GAIN: f32 = 1.0;
const PUBLISHED_SPEED_SHARE: f32 = 0.03;

/// Geometric tracking control (after Lee, Leok and McClamroch 2010) through the rate controller of the core.
#[derive(Clone, Debug)]
pub struct ScriptedPilot {
    action: ActionSpace,
    rates: ThrustBodyRates,
    control_secs: f32,
    /// Acceleration \[m/s², world\] that it asks for beside what leads to the goal, as it has found to be lacking.
    upkeep: Vector3<f32>,
    /// What should have come about by now of what it was asked for \[m/s², world\], and its velocity a period ago \[m/s, world\];
    /// nobody knows before the first action.
    expected: Option<Vector3<f32>>,
    before: Option<Vector3<f32>>,
    /// Points to fly through \[m, world\].
    route: Vec<Vector3<f32>>,
    /// How many of them it has passed.
    passed: usize,
    /// Where the present leg began \[m, world\]; nowhere before the first action.
    departure: Option<Vector3<f32>>,
    /// How far a goal that must be touched softly pulls at most, from [`TOUCH_RANGE_M`] on \[m\].
    touch_leash: f32,
}

/// What to fly towards \[m, world\].
pub(crate) struct Aim {
    target: Vector3<f32>,
    /// From the drone to where it should be by now.
    drift: Vector3<f32>,
}

impl Aim {
    /// At a point, without a line that leads to it.
    pub(crate) fn at(target: Vector3<f32>, position: &Vector3<f32>) -> Self {
        Self { target, drift: target - position }
    }
}

impl ScriptedPilot {
    /// A pilot for `airframe` that acts through `action` every `control_secs`.
    pub fn new(airframe: &Airframe, action: &ActionSpace, control_secs: f32) -> Self {
        let reserve = airframe.thrust_limit() / (airframe.mass * GRAVITY) - 1.0;
        let rates = ThrustBodyRates::new(airframe, reserve as f32, [6.0, 6.0, 3.0], RATE_GAINS);
        Self {
            action: *action,
            rates,
            control_secs,
            upkeep: Vector3::zeros(),
            expected: None,
            before: None,
            route: Vec::new(),
            passed: 0,
            departure: None,
            touch_leash: LEASH_M,
        }
    }

    /// The pilot of a scenario, who touches its goal as softly as its rules ask.
    pub fn of(scenario: &Scenario) -> Self {
        let limits = scenario.terminations.iter().filter_map(|rule| {
            if let Termination::Impact(impact) = rule { Some(impact.speed_limit_m_per_s as f32) } else { None }
        });
        let leash = |limit: f32| TOUCH_SHARE * limit * VELOCITY_GAIN / POSITION_GAIN;
        let touch_leash = limits.map(leash).fold(LEASH_M, f32::min);
        let pilot = Self::new(&scenario.airframe, &scenario.action, scenario.physics.control_secs());
        Self { touch_leash, ..pilot }
    }

    /// The same pilot, who touches its goal at this share of his speed.
    #[must_use]
    pub(crate) fn softer(mut self, share: f32) -> Self {
        if self.touch_leash < LEASH_M {
            self.touch_leash *= share;
        }
        self
    }

    /// The same pilot, who flies through these points \[m, world\] before he flies to a goal.
    #[must_use]
    pub fn along(mut self, route: &[Vector3<f32>]) -> Self {
        self.follow(route);
        self
    }

    /// Flies through other points from now on, as on another course.
    pub fn follow(&mut self, route: &[Vector3<f32>]) {
        self.route.clear();
        self.route.extend_from_slice(route);
    }

    /// Forgets what pushed it and the way already flown, as at the start of an episode.
    pub fn reset(&mut self) {
        self.upkeep = Vector3::zeros();
        self.expected = None;
        self.before = None;
        self.passed = 0;
        self.departure = None;
    }

    /// The action that flies `state` along the route and towards `goal` \[m, world\], each value within \[-1, 1\], zeros
    /// behind the last; only as far as the action space lets it: up and down in those of one dimension, nowhere in `tun`, whose
    /// controller follows the task by itself.
    pub fn act(&mut self, state: &State<f32>, goal: &Vector3<f32>) -> [f32; ACTION_LIMIT] {
        let aim = self.aim(&state.position, goal);
        self.lead(state, &aim, (goal - state.position).norm())
    }

    /// The action that flies `state` on a way whose end is `distance` metres away.
    pub(crate) fn lead(&mut self, state: &State<f32>, aim: &Aim, distance: f32) -> [f32; ACTION_LIMIT] {
        let error = self.heeded(state, &aim.target, distance);
        let wish = match &self.action {
            ActionSpace::Velocities(space) => {
                let wish = pull(&error, LEASH_M) * POSITION_GAIN + self.upkeep;
                Some((wish / VELOCITY_GAIN - state.velocity) * space.velocity_gain)
            }
            ActionSpace::RotorSpeeds(_)
            | ActionSpace::RotorThrusts(_)
            | ActionSpace::ThrustTorques(_)
            | ActionSpace::ThrustBodyRates(_)
            | ActionSpace::RateLoop(_)
            | ActionSpace::IntegralVelocities(_) => Some(wish(state, &error) + self.upkeep),
            ActionSpace::Reference(_) => None,
        };
        match wish {
            Some(asked) => self.observe(state, asked),
            None => self.integrate(&aim.drift),
        }
        self.fly(state, &aim.target, &error, &self.upkeep)
    }

    /// Learns from a period of flight how far the drone's acceleration is from what it asked for, unless it is still turning to
    /// where it is to accelerate; counts on what it asks for now to come about in a while.
    fn observe(&mut self, state: &State<f32>, asked: Vector3<f32>) {
        let before = self.before.replace(state.velocity);
        if let (Some(before), Some(expected)) = (before, self.expected) {
            let push = expected + Vector3::new(0.0, 0.0, GRAVITY as f32);
            if state.world_from_body.body_z().dot(&push.normalize()) >= ALIGNED {
                let seen = (state.velocity - before) / self.control_secs;
                self.upkeep += (expected - seen - self.upkeep) * (OBSERVER_GAIN * self.control_secs);
                self.upkeep *= OBSERVER_LIMIT / self.upkeep.norm().max(OBSERVER_LIMIT);
            }
        }
        let expected = self.expected.get_or_insert_with(Vector3::zeros);
        *expected += (asked - *expected) * (self.control_secs / LAG_SECS);
    }

    fn integrate(&mut self, drift: &Vector3<f32>) {
        if drift.norm() < INTEGRAL_RANGE_M {
            self.upkeep += drift * (INTEGRAL_GAIN * self.control_secs);
            self.upkeep *= INTEGRAL_LIMIT / self.upkeep.norm().max(INTEGRAL_LIMIT);
        }
    }

    /// As [`Self::lead`], by who has forgotten all that was before.
    pub(crate) fn lead_at_once(
        &self,
        state: &State<f32>,
        target: &Vector3<f32>,
        distance: f32,
    ) -> [f32; ACTION_LIMIT] {
        self.fly(state, target, &self.heeded(state, target, distance), &Vector3::zeros())
    }

    /// The way to a point, as short as it must be near what is to be touched softly \[m, world\].
    fn heeded(&self, state: &State<f32>, target: &Vector3<f32>, distance: f32) -> Vector3<f32> {
        let error = target - state.position;
        let softly = self.touch_leash < LEASH_M && distance < TOUCH_RANGE_M;
        if softly { pull(&error, self.touch_leash) } else { error }
    }

    /// The action that flies a way \[m, world\], and makes up for what it is known to need beside that \[m/s², world\].
    fn fly(
        &self,
        state: &State<f32>,
        target: &Vector3<f32>,
        error: &Vector3<f32>,
        upkeep: &Vector3<f32>,
    ) -> [f32; ACTION_LIMIT] {
        let (thrust_share, rates) = track(state, error, upkeep);
        match &self.action {
            ActionSpace::RotorSpeeds(space) => {
                let targets = self.rotor_targets(state, thrust_share, &rates);
                action(targets.map(|target| (target / space.hover_rotor_speed - 1.0) / space.fraction))
            }
            ActionSpace::RotorThrusts(space) => {
                let targets = self.rotor_targets(state, thrust_share, &rates);
                action(targets.map(|target| space.action_of(target)))
            }
            ActionSpace::ThrustTorques(space) => {
                let targets = self.rotor_targets(state, thrust_share, &rates);
                action(space.action_of(targets))
            }
            ActionSpace::ThrustBodyRates(space) | ActionSpace::RateLoop(space) => {
                action(normalised(space, thrust_share, &rates))
            }
            ActionSpace::Velocities(space) => {
                let wish = pull(error, LEASH_M) * POSITION_GAIN + upkeep;
                action((wish / (VELOCITY_GAIN * space.speed_limit)).into())
            }
            // Its controller has an integral of its own.
            ActionSpace::IntegralVelocities(space) => {
                let wish = pull(error, LEASH_M) * POSITION_GAIN;
                action((wish / (VELOCITY_GAIN * space.velocities.speed_limit)).into())
            }
            ActionSpace::Reference(space) => self.published(space, state, target, upkeep),
        }
    }

    /// The goal itself without a route; otherwise a point ahead on the straight line to the next point, so that the
    /// drone passes between obstacles where the route does.
    fn aim(&mut self, position: &Vector3<f32>, goal: &Vector3<f32>) -> Aim {
        if self.route.is_empty() {
            return Aim::at(*goal, position);
        }
        let mut departure = *self.departure.get_or_insert(*position);
        while let Some(point) = self.route.get(self.passed).filter(|point| (*point - position).norm() < PASSING_M)
        {
            departure = *point;
            self.departure = Some(departure);
            self.passed += 1;
        }
        let end = self.route.get(self.passed).unwrap_or(goal);
        let length = (end - departure).norm();
        let direction = (end - departure) / length.max(1e-6);
        let along = (position - departure).dot(&direction);
        let line = |along: f32| departure + direction * along.clamp(0.0, length);
        let foot = if (end - position).norm() < INTEGRAL_RANGE_M { *end } else { line(along) };
        Aim { target: line(along + LEASH_M), drift: foot - position }
    }

    fn published(
        &self,
        space: &ReferenceActions,
        state: &State<f32>,
        goal: &Vector3<f32>,
        upkeep: &Vector3<f32>,
    ) -> [f32; ACTION_LIMIT] {
        let error = goal - state.position;
        let (thrust_share, rates) = track(state, &error, upkeep);
        let level = State { world_from_body: Attitude::level(), ..*state };
        let vertical = |value: f32| Vector3::new(0.0, 0.0, value);
        let (climb_share, _) = track(&level, &vertical(error.z), &vertical(upkeep.z));
        match space.kind {
            ReferenceActionKind::Rpm => {
                let margin = PUBLISHED_THRUST_SHARE;
                let gentle = thrust_share.clamp(1.0 - margin, 1.0 + margin);
                let per_hover = 1.0 / space.airframe.hover_rotor_speed() as f32;
                let targets = self.rotor_targets(state, gentle, &rates);
                action(targets.map(|target| (target * per_hover - 1.0) / PUBLISHED_AUTHORITY))
            }
            ReferenceActionKind::Dyn => {
                let [x, y, z] = self.torque_shares(&space.airframe, state, &rates);
                action([thrust_share - 1.0, x, y, z])
            }
            ReferenceActionKind::Pid => action((error / PUBLISHED_OFFSET_M).into()),
            ReferenceActionKind::Vel => {
                let limit = PUBLISHED_SPEED_SHARE * space.airframe.nominal_speed as f32;
                let [x, y, z] = (error / error.norm().max(1e-6)).into();
                action([x, y, z, error.norm() * APPROACH_GAIN / limit])
            }
            ReferenceActionKind::Tun => action([]),
            ReferenceActionKind::OneDRpm => action([(climb_share.sqrt() - 1.0) / PUBLISHED_AUTHORITY]),
            ReferenceActionKind::OneDDyn => action([(climb_share - 1.0) / PUBLISHED_AUTHORITY]),
            ReferenceActionKind::OneDPid => action([error.z / PUBLISHED_OFFSET_M]),
            ReferenceActionKind::Waypoint => action((*goal).into()),
        }
    }

    /// Rotor targets \[rad/s\] for a thrust relative to hover and body rates \[rad/s\].
    fn rotor_targets(&self, state: &State<f32>, thrust_share: f32, rates: &Vector3<f32>) -> [f32; 4] {
        self.rates.rotor_targets(&normalised(&self.rates, thrust_share, rates), &state.body_rates)
    }

    /// Torques as shares of what a full action of the reference's asks for.
    fn torque_shares(&self, airframe: &Airframe, state: &State<f32>, rates: &Vector3<f32>) -> [f32; 3] {
        let limits =
            [airframe.tilting_torque_limit(), airframe.tilting_torque_limit(), airframe.turning_torque_limit()];
        core::array::from_fn(|axis| {
            let acceleration = self.rates.rate_gains[axis] * (rates[axis] - state.body_rates[axis]);
            acceleration * airframe.inertia[axis] as f32 / (PUBLISHED_AUTHORITY * limits[axis] as f32)
        })
    }
}

/// An action of these values, limited to \[-1, 1\].
fn action<const N: usize>(values: [f32; N]) -> [f32; ACTION_LIMIT] {
    let mut action = [0.0; ACTION_LIMIT];
    for (slot, value) in action.iter_mut().zip(values) {
        *slot = value.clamp(-1.0, 1.0);
    }
    action
}

/// Thrust and body rates as an action.
fn normalised(space: &ThrustBodyRates, thrust_share: f32, rates: &Vector3<f32>) -> [f32; 4] {
    let [x, y, z] = core::array::from_fn(|axis| rates[axis] / space.body_rates_limit[axis]);
    [(thrust_share - 1.0) / space.thrust_fraction, x, y, z].map(|value| value.clamp(-1.0, 1.0))
}

/// The part of a distance that is heeded, up to a leash \[m\].
fn pull(error: &Vector3<f32>, leash: f32) -> Vector3<f32> {
    error * (leash / error.norm().max(leash))
}

/// The acceleration that leads to where it should be \[m/s², world\].
fn wish(state: &State<f32>, error: &Vector3<f32>) -> Vector3<f32> {
    let wish = pull(error, LEASH_M) * POSITION_GAIN - state.velocity * VELOCITY_GAIN;
    wish * (ACCELERATION_LIMIT / wish.norm().max(ACCELERATION_LIMIT))
}

/// Thrust relative to hover and wanted body rates \[rad/s\].
fn track(state: &State<f32>, error: &Vector3<f32>, upkeep: &Vector3<f32>) -> (f32, Vector3<f32>) {
    let gravity = GRAVITY as f32;
    let push = wish(state, error) + upkeep + Vector3::new(0.0, 0.0, gravity);
    let body_z = state.world_from_body.body_z();
    let turn = state.world_from_body.rotate_inverse(body_z.cross(&push.normalize()));
    // Upside down the cross product vanishes: full rate about any axis gets out of there.
    let behind = if body_z.dot(&push) < 0.0 { turn.normalize() } else { turn };
    let share = (push.dot(&body_z) / gravity).max(0.0);
    (share, behind * ATTITUDE_GAIN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kestrel_core::action::Setpoint;
    use kestrel_core::action::{
        ControlMemory, Controls, IntegralVelocities, Persistence, ReferenceController, RotorSpeeds, Velocities,
    };
    use kestrel_core::airframe::{CF2X, HUMMINGBIRD};
    use kestrel_core::reference::bullet::{Bullet, BulletMode, BulletState, Quirks};
    use kestrel_core::reference::controller::command::Precision;
    use kestrel_sim::seed::Purpose;

    use crate::evaluation::{Flyer, Starts, evaluate};
    use crate::experiment_config::load;
    use crate::golden::in_repository;

    /// As in the thesis.
    const CONTROL_SECS: f32 = 1.0 / 48.0;
    const SUBSTEPS: u32 = 5;

    /// Where the pilot is after ten seconds of the reference's physics, from a metre above the origin.
    fn destination(airframe: &Airframe, space: &ActionSpace, goal: Vector3<f32>) -> Vector3<f32> {
        let bullet = Bullet::<f32>::new(airframe, BulletMode::Pyb, Quirks::upstream());
        let (controls, mut memory) = (Controls::new(space), ControlMemory::new());
        let mut pilot = ScriptedPilot::new(airframe, space, CONTROL_SECS);
        let mut drone = BulletState::placed(State {
            position: Vector3::new(0.0, 0.0, 1.0),
            world_from_body: Attitude::level(),
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: [0.0; 4],
        });
        for _ in 0..480 {
            let action = pilot.act(&drone.motion, &goal);
            assert!(action[..space.len()].iter().all(|value| value.abs() <= 1.0), "{action:?}");
            assert_eq!(action[space.len()..], [0.0; ACTION_LIMIT][space.len()..]);
            let setpoint = Setpoint::at(goal);
            let targets = controls.rotor_targets(&action, &drone.motion, &setpoint, &mut memory, CONTROL_SECS);
            drone = (0..SUBSTEPS)
                .fold(drone, |drone, _| bullet.step(&drone, &targets, &[], CONTROL_SECS / SUBSTEPS as f32));
        }
        drone.motion.position
    }

    fn published(kind: ReferenceActionKind, airframe: &Airframe, controller: &ReferenceController) -> ActionSpace {
        ActionSpace::Reference(ReferenceActions {
            kind,
            precision: Precision::Exact,
            airframe: *airframe,
            controller: *controller,
            persistence: Persistence::ResetEachEpisode,
        })
    }

    #[test]
    fn it_arrives_in_every_action_space_that_lets_it() {
        let goal = Vector3::new(0.4, -0.3, 0.9);
        let crazyflie = |kind| (CF2X, published(kind, &CF2X, &ReferenceController::Dsl(CF2X)));
        let hummingbird =
            |kind| (HUMMINGBIRD, published(kind, &HUMMINGBIRD, &ReferenceController::Simple(HUMMINGBIRD)));
        let rates = ThrustBodyRates::new(&CF2X, 1.0, [6.0, 6.0, 3.0], RATE_GAINS);
        let velocities = Velocities { rates, speed_limit: 2.0, velocity_gain: 3.0, attitude_gain: 5.0 };
        let spaces = [
            (CF2X, ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 0.3))),
            (CF2X, ActionSpace::ThrustBodyRates(rates)),
            (CF2X, ActionSpace::Velocities(velocities)),
            (CF2X, ActionSpace::IntegralVelocities(IntegralVelocities { velocities, integral_gain: 3.0 })),
            crazyflie(ReferenceActionKind::Rpm),
            crazyflie(ReferenceActionKind::Dyn),
            crazyflie(ReferenceActionKind::Pid),
            crazyflie(ReferenceActionKind::Vel),
            crazyflie(ReferenceActionKind::Waypoint),
            // Its controller follows the task's target by itself.
            crazyflie(ReferenceActionKind::Tun),
            hummingbird(ReferenceActionKind::Rpm),
            // Not PID: in that action the Hummingbird's controller hears nothing of velocity, kicks off with its first
            // derivative and is never stopped; at 48 Hz it even tumbles.
            hummingbird(ReferenceActionKind::Dyn),
        ];
        for (airframe, space) in spaces {
            let missed = (destination(&airframe, &space, goal) - goal).norm();
            assert!(missed < 0.05, "{}: {missed} m from the goal", space.name());
        }
    }

    #[test]
    fn it_makes_up_for_drones_that_are_not_what_they_should_be() {
        let experiment = load(&in_repository("configs/hover.yaml"), &[]).unwrap();
        let starts = Starts { seed: experiment.evaluation.seed, purpose: Purpose::Evaluation, episodes: 64 };
        let settled = evaluate(&experiment.evaluation.scenario, Flyer::Scripted, starts).success_rate;
        // With the integral of published drones in its place 4 % of 1,024 do.
        assert!(settled > 0.4, "{settled} of the drones settle");
    }

    #[test]
    fn it_stays_on_its_route() {
        let space = published(ReferenceActionKind::Pid, &CF2X, &ReferenceController::Dsl(CF2X));
        let corner = Vector3::new(1.0, 0.0, 1.0);
        let mut pilot = ScriptedPilot::new(&CF2X, &space, CONTROL_SECS).along(&[corner]);
        let goal = Vector3::new(1.0, 1.0, 1.0);
        let mut aim = |x: f32, y: f32| pilot.aim(&Vector3::new(x, y, 1.0), &goal).target;
        assert_eq!(aim(0.0, 0.0), Vector3::new(LEASH_M, 0.0, 1.0));
        // Pushed aside, it returns to the line.
        assert_eq!(aim(0.1, 0.3), Vector3::new(0.1 + LEASH_M, 0.0, 1.0));
        assert_eq!(aim(0.8, 0.0), corner);
        // At the corner it turns, and does not turn back.
        assert_eq!(aim(0.9, 0.0), Vector3::new(1.0, LEASH_M, 1.0));
        assert_eq!(aim(0.7, 0.1), Vector3::new(1.0, 0.1 + LEASH_M, 1.0));
        pilot.reset();
        let again = pilot.aim(&Vector3::new(0.5, 0.0, 1.0), &goal).target;
        assert_eq!(again, corner);
    }

    #[test]
    fn it_finds_the_height_where_it_can_only_climb() {
        for kind in [ReferenceActionKind::OneDRpm, ReferenceActionKind::OneDDyn, ReferenceActionKind::OneDPid] {
            let space = published(kind, &CF2X, &ReferenceController::Dsl(CF2X));
            let position = destination(&CF2X, &space, Vector3::new(0.4, -0.3, 1.3));
            assert!((position - Vector3::new(0.0, 0.0, 1.3)).norm() < 0.02, "{}: {position}", kind.name());
        }
    }
}
