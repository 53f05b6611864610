//! What a vehicle flies in: a simulation that advances one control period at a time.

use kestrel_core::action::ActionSpace;
use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use kestrel_core::dynamics::Integrator;
use kestrel_core::rate_loop::RateLoop;
use kestrel_core::vehicle::{Air, Ground, State, Vehicle};
use nalgebra::Vector3;

use crate::steering::heading;

/// Longest integration step \[s\]; rotors and body rates of a Crazyflie settle in tens of milliseconds.
const SUBSTEP_LIMIT_SECS: f32 = 0.0025;

/// Rangers see so far \[m\].
const RANGE_LIMIT_M: f32 = 4.0;

/// Slower than this a drone nears nothing \[m/s\]: it hovers.
const CREEP: f32 = 0.05;

/// One drone and its surroundings, in lockstep with the vehicle that steers it.
pub trait Plant {
    /// The true state.
    fn state(&self) -> &State<f32>;

    /// The state that the drone knows; the true one where nothing is late.
    fn known_state(&self) -> &State<f32> {
        self.state()
    }

    /// What rangers on the drone measure, where the plant knows what is around it.
    fn ranges(&self) -> Option<Ranges> {
        None
    }

    /// What is left of a battery that the plant empties, of one; none where the vehicle simulates its own.
    fn battery(&self) -> Option<f32> {
        None
    }

    /// Advances one control period with rotor targets \[rad/s\] held.
    fn step(&mut self, rotor_targets: &[f32; 4]);

    /// Once every drone that shares the place has been stepped: they move together.
    fn settle(&mut self) {}

    /// Puts the drone back to where it was launched; of no effect where there is no task.
    fn reset(&mut self) {}

    /// Puts the drone to a start of its task, whose policy then flies it, whatever the rotor targets, until the episode ends;
    /// of no effect where there is no task.
    fn begin_task(&mut self, _start: u32) {}

    /// Ends the task where the drone is.
    fn end_task(&mut self) {}

    /// How the task has ended, once after it has.
    fn take_ending(&mut self) -> Option<TaskEnding> {
        None
    }
}

/// Distances along the drone's axes \[m\]; none where nothing is near.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranges {
    /// Forward.
    pub front: Option<f32>,
    /// Backward.
    pub back: Option<f32>,
    /// To the left.
    pub left: Option<f32>,
    /// To the right.
    pub right: Option<f32>,
    /// Up.
    pub up: Option<f32>,
    /// Down.
    pub down: Option<f32>,
}

impl Ranges {
    /// Time until the drone, at the velocity of now, is at what a ranger sees \[s\]; none if it nears nothing. The floor
    /// does not count: drones land.
    pub fn collision_secs(&self, state: &State<f32>) -> Option<f32> {
        let velocity = state.world_from_body.rotate_inverse(state.velocity);
        let Self { front, back, left, right, up, down: _ } = *self;
        let ways =
            [(front, velocity.x), (back, -velocity.x), (left, velocity.y), (right, -velocity.y), (up, velocity.z)];
        let times = ways
            .into_iter()
            .filter_map(|(distance, speed)| Some(distance?.max(0.0) / speed).filter(|_| speed > CREEP));
        times.reduce(f32::min)
    }
}

/// How an episode of a task has ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TaskEnding {
    /// Whether by success, in the true state.
    pub success: bool,
    /// What ended it, such as `time limit` or `collision`.
    pub cause: &'static str,
    /// Its length \[s\].
    pub secs: f32,
}

/// The core's dynamics above an endless floor at z = 0, without wind.
///
/// The floor holds what touches it: on it a drone stands level and still, keeping its heading, until its rotors
/// lift it. It neither bounces, slides nor tips over.
#[derive(Clone, Debug)]
pub struct FlatFloor {
    vehicle: Vehicle<f32>,
    rest_height: f32,
    substeps: u32,
    substep_secs: f32,
    rate_loop: Option<RateLoop<f32>>,
    state: State<f32>,
}

impl FlatFloor {
    /// A nominal drone at rest at the origin of the floor, for control periods of `control_secs`.
    pub fn new(airframe: &Airframe, control_secs: f32) -> Self {
        let rest_height = (airframe.collision_height / 2.0) as f32;
        let substeps = libm::ceilf(control_secs / SUBSTEP_LIMIT_SECS).max(1.0) as u32;
        Self {
            vehicle: Vehicle::new(airframe),
            rest_height,
            substeps,
            substep_secs: control_secs / substeps as f32,
            rate_loop: None,
            state: State {
                position: Vector3::new(0.0, 0.0, rest_height),
                world_from_body: Attitude::level(),
                velocity: Vector3::zeros(),
                body_rates: Vector3::zeros(),
                rotor_speeds: [0.0; 4],
            },
        }
    }

    /// The same at another place of the floor \[m, world x and y\].
    #[must_use]
    pub fn at(mut self, [x_m, y_m]: [f32; 2]) -> Self {
        (self.state.position.x, self.state.position.y) = (x_m, y_m);
        self
    }

    /// The same with the rate loop of an action space, which follows the true body rates at every substep; without one in any
    /// other space.
    #[must_use]
    pub fn with_rate_loop(mut self, action: &ActionSpace) -> Self {
        self.rate_loop = RateLoop::of(action);
        self
    }

    /// Goes on from another state.
    pub fn put(&mut self, state: State<f32>) {
        self.state = state;
    }

    /// Stands still on the floor.
    fn rest(&mut self) {
        self.state.position.z = self.rest_height;
        self.state.velocity = Vector3::zeros();
        self.state.body_rates = Vector3::zeros();
        self.state.world_from_body = heading(&self.state.world_from_body);
    }
}

impl Plant for FlatFloor {
    fn state(&self) -> &State<f32> {
        &self.state
    }

    fn ranges(&self) -> Option<Ranges> {
        let State { position, world_from_body, .. } = &self.state;
        let along = |x: f32, y: f32, z: f32| {
            let sinking = -world_from_body.rotate(Vector3::new(x, y, z)).z;
            let distance = position.z / sinking;
            (sinking > 0.0 && distance <= RANGE_LIMIT_M).then_some(distance)
        };
        Some(Ranges {
            front: along(1.0, 0.0, 0.0),
            back: along(-1.0, 0.0, 0.0),
            left: along(0.0, 1.0, 0.0),
            right: along(0.0, -1.0, 0.0),
            up: along(0.0, 0.0, 1.0),
            down: along(0.0, 0.0, -1.0),
        })
    }

    fn step(&mut self, rotor_targets: &[f32; 4]) {
        let air = Air { ground: Ground::Near, ..Air::still() };
        let looped =
            self.rate_loop.map(|rate_loop| (rate_loop, rate_loop.held(rotor_targets, &self.state.body_rates)));
        for _ in 0..self.substeps {
            let integrator = Integrator::SemiImplicitEuler;
            let targets = looped.map_or(*rotor_targets, |(rate_loop, held)| {
                rate_loop.rotor_targets(&held, &self.state.body_rates)
            });
            let next = integrator.advance(&self.vehicle, &self.state, &targets, &air, self.substep_secs);
            self.state = next.tumbling_within_limit();
            if self.state.position.z <= self.rest_height && self.state.velocity.z <= 0.0 {
                self.rest();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::action::ThrustBodyRates;
    use kestrel_core::airframe::CF2X;

    use super::*;

    #[test]
    fn its_rangers_see_the_floor() {
        let mut plant = FlatFloor::new(&CF2X, 0.01);
        plant.state.position.z = 2.0;
        let level = plant.ranges().unwrap();
        assert_eq!(level.down, Some(2.0));
        let others = [level.front, level.back, level.left, level.right, level.up];
        assert_eq!(others, [None; 5]);
        // A third of a turn, nose down: the front ranger sees the floor at 2 m / sin 60°.
        plant.state.world_from_body =
            Attitude::from_axis_angle(Vector3::y(), 60_f64.to_radians()).map(|value| value as f32);
        let tilted = plant.ranges().unwrap();
        assert!((tilted.front.unwrap() - 2.309).abs() < 1e-3 && tilted.back.is_none(), "{tilted:?}");
        plant.state.position.z = 10.0;
        assert_eq!(plant.ranges().unwrap().down, None, "too far");
    }

    #[test]
    fn it_stands_still_until_the_rotors_carry_it() {
        let mut plant = FlatFloor::new(&CF2X, 0.01);
        let start = *plant.state();
        for _ in 0..100 {
            plant.step(&[0.0; 4]);
        }
        assert_eq!(*plant.state(), start);
        for _ in 0..100 {
            plant.step(&[1.1 * CF2X.hover_rotor_speed() as f32; 4]);
        }
        assert!(plant.state().position.z > 0.3);
    }

    #[test]
    fn a_rate_loop_stops_a_turn_within_a_control_period() {
        let rates = ThrustBodyRates::new(&CF2X, 1.0, [8.0, 8.0, 3.0], [10.0, 10.0, 4.0]);
        let after = |action: &ActionSpace| {
            let mut plant = FlatFloor::new(&CF2X, 0.3).with_rate_loop(action);
            (plant.state.position.z, plant.state.rotor_speeds) = (5.0, [CF2X.hover_rotor_speed() as f32; 4]);
            plant.step(&[CF2X.hover_rotor_speed() as f32; 4]);
            plant.state.body_rates.x = 3.0;
            let targets = rates.rotor_targets(&[0.0; 4], &plant.state.body_rates);
            plant.step(&targets);
            plant.state.body_rates.x
        };
        // What is held for so long turns the drone the other way.
        let [held, followed] =
            [ActionSpace::ThrustBodyRates(rates), ActionSpace::RateLoop(rates)].map(|a| after(&a));
        assert!(held < -2.0 && followed.abs() < 1.5, "{held} {followed}");
    }

    #[test]
    fn what_falls_comes_to_rest_level_with_its_heading() {
        let mut plant = FlatFloor::new(&CF2X, 0.01);
        plant.state.position.z = 1.0;
        plant.state.world_from_body = Attitude { w: 0.8, x: 0.2, y: 0.2, z: 0.5 }.normalized();
        for _ in 0..100 {
            plant.step(&[0.0; 4]);
        }
        let state = plant.state();
        assert_eq!(state.velocity, Vector3::zeros());
        assert_eq!(state.position.z, 0.0125);
        assert_eq!(state.world_from_body.up_cosine(), 1.0);
        assert!((state.world_from_body.z / state.world_from_body.w - 0.625).abs() < 1e-3);
    }

    #[test]
    fn a_drone_that_tumbles_for_minutes_stays_a_drone() {
        let mut plant = FlatFloor::new(&CF2X, 0.002);
        plant.state.position.z = 5_000.0;
        let limit = CF2X.rotor_speed_limit as f32;
        for _ in 0..30_000 {
            plant.step(&[limit, limit, 0.0, 0.0]);
            let State { position, velocity, body_rates, .. } = plant.state;
            assert!(
                position.z.is_finite() && velocity.norm() < 100.0 && body_rates.norm() < 101.0,
                "{:?}",
                plant.state
            );
        }
    }

    #[test]
    fn an_upside_down_drone_ends_upright() {
        let overturned = Attitude { w: 0.0, x: 1.0, y: 0.0, z: 0.0 };
        assert_eq!(heading(&overturned), Attitude::level());
    }
}
