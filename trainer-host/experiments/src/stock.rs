//! Bitcraze's controllers as baselines of tasks with a moving goal, at the rate of their firmware.

use std::collections::VecDeque;

use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_core::airframe::{Airframe, GRAVITY};
use kestrel_core::crazyflie::{MOTOR_THRUST_LIMIT_N, STABILISER_SECS, StockController, StockPilot};
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_sim::latency::Latency;
use kestrel_sim::scenario::{Goals, Scenario};
use nalgebra::Vector3;

/// One of the controllers, and how late it knows its state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stock {
    /// Which.
    pub controller: StockController,
    /// Age of the state that it sees \[s\], body rates included.
    pub state_late_secs: f32,
}

impl Stock {
    /// Both, in every episode as late as the drones of a task may be, within a control period; none where no goal moves
    /// or the firmware's motors could not carry the drone.
    pub(crate) fn of(scenario: &Scenario) -> Vec<Self> {
        let Goals::Trajectory(_) = scenario.goals else { return Vec::new() };
        if scenario.airframe.mass * GRAVITY > 4.0 * MOTOR_THRUST_LIMIT_N {
            return Vec::new();
        }
        let [_, state_late_secs] = scenario.latency.state_secs;
        StockController::ALL.map(|controller| Self { controller, state_late_secs }).into()
    }

    /// The same task with rotor speeds as actions, as often as the firmware gives them. Delays are drawn as before, so
    /// that the starts are the same, but last a control period at most: that of the state is added to
    /// [`Self::state_late_secs`], that of the motors is shorter than a policy's.
    pub(crate) fn task(scenario: &Scenario) -> Scenario {
        let longest = STABILISER_SECS as f32;
        let within = |bounds: [f32; 2]| bounds.map(|secs| secs.min(longest));
        let jitter = |secs: f32, bounds: [f32; 2]| secs.min(longest - within(bounds)[1]);
        let late = &scenario.latency;
        let mut task = scenario.clone();
        task.action = ActionSpace::RotorSpeeds(RotorSpeeds::new(&scenario.airframe, 1.0));
        task.physics.control_rate_hz = 1.0 / STABILISER_SECS;
        task.physics.substeps = 1;
        task.latency = Latency {
            state_secs: within(late.state_secs),
            motor_secs: within(late.motor_secs),
            state_jitter_secs: jitter(late.state_jitter_secs, late.state_secs),
            motor_jitter_secs: jitter(late.motor_jitter_secs, late.motor_secs),
            ..*late
        };
        task
    }
}

/// How fast the set-point turns \[rad/s\]. The firmware gives half of its thrust to a heading that is a third of a turn
/// off, and tumbles.
const TURN_RATE: f32 = 2.0;

/// A drone in the hands of one of the controllers, which know the goal and how it moves, but nothing of the way ahead.
#[derive(Clone, Debug)]
pub(crate) struct StockFlight {
    stock: Stock,
    airframe: Airframe,
    pilot: Option<StockPilot<f32>>,
    /// From the one that is known to the present one.
    states: VecDeque<State<f32>>,
    /// Of the goal, a control period ago \[m/s\].
    velocity: Vector3<f32>,
    /// Heading of the set-point \[rad\], which turns from that of the start to the task's.
    yaw: f32,
}

impl StockFlight {
    pub(crate) fn new(stock: Stock, airframe: &Airframe) -> Self {
        Self {
            stock,
            airframe: *airframe,
            pilot: None,
            states: VecDeque::new(),
            velocity: Vector3::zeros(),
            yaw: 0.0,
        }
    }

    /// Forgets the episode before.
    pub(crate) fn reset(&mut self) {
        self.pilot = None;
    }

    /// The action that follows a goal at a position \[m, world\] with a velocity \[m/s, world\].
    pub(crate) fn act(&mut self, state: State<f32>, goal: Vector3<f32>, velocity: Vector3<f32>) -> [f32; 4] {
        let secs = STABILISER_SECS as f32;
        let mass = self.airframe.mass;
        if self.pilot.is_none() {
            self.states = vec![state; (self.stock.state_late_secs / secs).round() as usize].into();
            self.velocity = velocity;
            let [_, _, yaw] = state.world_from_body.map(f64::from).roll_pitch_yaw();
            self.yaw = yaw as f32;
        }
        self.yaw -= self.yaw.clamp(-TURN_RATE * secs, TURN_RATE * secs);
        self.states.push_back(state);
        let known = self.states.pop_front().unwrap_or(state);
        let begun = || StockPilot::begun(self.stock.controller, mass, &known);
        let setpoint = Setpoint { velocity, yaw: self.yaw, ..Setpoint::at(goal) };
        let acceleration = (velocity - self.velocity) / secs;
        self.velocity = velocity;
        let mix = self.pilot.get_or_insert_with(begun).mix(&known, &setpoint, &acceleration);
        let hover_thrust = (mass * GRAVITY / 4.0) as f32;
        mix.motor_thrusts().map(|thrust| ((thrust / hover_thrust).sqrt() - 1.0).clamp(-1.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use kestrel_sim::seed::{Purpose, Seed};
    use kestrel_sim::simulation::Simulation;

    use crate::evaluation::{Cockpit, Flyer};
    use crate::experiment_config::load;
    use crate::golden::in_repository;

    use super::*;

    const FLIGHTS: usize = 64;

    /// Root mean square of the distance from the goal \[m\] from the third second on, on curves with a greatest speed of
    /// 1.5 m/s.
    fn distance(flyer: Flyer<'_>) -> f32 {
        let fast = ["scenario.goals.trajectory.speed_m_per_s=[1.5, 1.5]".to_owned()];
        let experiment = load(&in_repository("configs/trajectory.yaml"), &fast).unwrap();
        let scenario = &*flyer.task(&experiment.evaluation.scenario);
        let mut simulation = Simulation::<64>::with_purpose(scenario, Seed(1), Purpose::Evaluation, 0, FLIGHTS);
        let mut cockpit = Cockpit::new(&simulation, flyer, Seed(1), 0);
        let (mut square, mut count) = (0.0, 0.0);
        for step in 0..scenario.episode_steps() - 1 {
            simulation.step(cockpit.act(&simulation));
            if step as f32 * scenario.physics.control_secs() > 2.0 {
                for row in 0..FLIGHTS {
                    square += (simulation.state(row).position - simulation.goal(row)).norm_squared();
                    count += 1.0;
                }
            }
        }
        (square / count).sqrt()
    }

    #[test]
    fn mellinger_tracks_where_the_cascade_lags() {
        let stock = |controller| Stock { controller, state_late_secs: 0.015 };
        let [cascade, mellinger] =
            StockController::ALL.map(|controller| distance(Flyer::Stock(stock(controller))));
        println!("cascade {cascade} m, Mellinger {mellinger} m, scripted pilot {} m", distance(Flyer::Scripted));
        assert!(mellinger < 0.2 && cascade < 0.8, "{cascade} m, {mellinger} m");
    }

    #[test]
    fn they_fly_where_a_goal_moves() {
        let baselines = |file: &str| {
            let experiment = load(&in_repository(file), &[]).unwrap();
            Flyer::stock(&experiment.evaluation.scenario).len()
        };
        assert_eq!([baselines("configs/trajectory.yaml"), baselines("configs/hover.yaml")], [2, 0]);
    }
}
