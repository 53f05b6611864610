//! A teacher for policies that hardly find the way by chance: the scripted pilot, led along the shortest free way.
//!
//! The learner adds an imitation loss towards its actions ([`TeacherSettings`](kestrel_learn::ppo::TeacherSettings)). The teacher knows the true state and the map, as those of Chen et al. 2020 and Loquercio et al. 2021 do; the policy that
//! has learned needs neither.

use kestrel_core::action::{ACTION_LIMIT, ActionSpace};
use kestrel_core::vehicle::State;
use kestrel_sim::scenario::Scenario;
use nalgebra::Vector3;

use crate::known_way::{KnownWay, drawn_out};
use crate::scripted::ScriptedPilot;

/// Drones that find their ways learn to touch at this share of the scripted pilot's speed, a twelfth of whose touches of tables
/// in furnished rooms are too hard on a drone that is late.
const TOUCH_SHARE: f32 = 0.7;

/// Who sees ahead alone looks where it flies: yaw rate per angle between the two \[1/s\], and the share of its speed that is left
/// where it looks aside.
const TURN_GAIN: f32 = 3.0;
const BLIND_SHARE: f32 = 0.15;

/// A way that leads so little to the side has no heading \[m\].
const UPRIGHT_M: f32 = 0.05;

/// The teacher of one task. It remembers nothing from one state to the next.
#[derive(Clone, Debug)]
pub(crate) struct Teacher {
    pilot: ScriptedPilot,
    way: KnownWay,
    /// Greatest yaw rate of an action, where it looks where it flies \[rad/s\].
    turning: Option<f32>,
}

impl Teacher {
    /// That of a task whose worlds are drawn, whose reward says which way leads to its goal, or whose goals are gates; no other
    /// has one.
    pub(crate) fn of(scenario: &Scenario) -> Option<Self> {
        let way = KnownWay::of(scenario)?;
        let pilot = ScriptedPilot::of(scenario);
        let looks = scenario.camera.is_some() && scenario.drawn.is_some();
        let finds_its_way = looks || scenario.sensors.finds_way();
        let sees_ahead_alone = looks || scenario.sensors.tof().is_some();
        let turning = match (&scenario.action, sees_ahead_alone) {
            (ActionSpace::Velocities(space), true) => Some(space.rates.body_rates_limit[2]),
            (ActionSpace::IntegralVelocities(space), true) => Some(space.velocities.rates.body_rates_limit[2]),
            (
                ActionSpace::Velocities(_)
                | ActionSpace::IntegralVelocities(_)
                | ActionSpace::RotorSpeeds(_)
                | ActionSpace::RotorThrusts(_)
                | ActionSpace::ThrustTorques(_)
                | ActionSpace::ThrustBodyRates(_)
                | ActionSpace::RateLoop(_)
                | ActionSpace::Reference(_),
                true | false,
            ) => None,
        };
        let pilot = if finds_its_way { pilot.softer(TOUCH_SHARE) } else { pilot };
        Some(Self { pilot, way, turning })
    }

    /// What it would do on the way to a goal \[m, world\] of a room, each value within \[-1, 1\], zeros behind the last. Where
    /// the drone has found a way by itself, and says the point ahead on it, it is led along that one: who is to follow what it
    /// sees must not be shown another way.
    pub(crate) fn act(
        &self,
        state: &State<f32>,
        goal: &Vector3<f32>,
        room: u32,
        found: Option<Vector3<f32>>,
    ) -> [f32; ACTION_LIMIT] {
        let position = &state.position;
        let (ahead, distance) = self.way.ahead(position, goal, room);
        let leg = found.unwrap_or(ahead) - position;
        let mut action = self.pilot.lead_at_once(state, &(position + drawn_out(&leg)), distance);
        if let Some(limit) = self.turning.filter(|_| leg.xy().norm() > UPRIGHT_M) {
            turn(&mut action, state, &leg, limit);
        }
        action
    }
}

/// Turns the nose where a leg leads, and flies the slower the more it looks aside.
fn turn(action: &mut [f32; ACTION_LIMIT], state: &State<f32>, leg: &Vector3<f32>, limit: f32) {
    let nose = state.world_from_body.rotate(Vector3::x());
    let (along, aside) = (nose.x * leg.x + nose.y * leg.y, nose.x * leg.y - nose.y * leg.x);
    let angle = libm::atan2f(aside, along);
    let share = libm::cosf(angle).max(BLIND_SHARE);
    let [x, y, z, yaw, ..] = action;
    for velocity in [x, y, z] {
        *velocity *= share;
    }
    *yaw = (TURN_GAIN * angle / limit).clamp(-1.0, 1.0);
}

#[cfg(test)]
mod tests {
    use kestrel_core::attitude::Attitude;
    use kestrel_sim::seed::Seed;
    use kestrel_sim::simulation::Simulation;

    use super::*;
    use crate::experiment_config::load;
    use crate::golden::in_repository;

    const FLIGHTS: usize = 64;

    /// Of the first flights through `room` from the far end, those that succeed.
    fn arrivals(room: &str) -> usize {
        let experiment = load(&in_repository(&format!("configs/aviaries/{room}.yaml")), &[]).unwrap();
        let scenario = &experiment.evaluation.scenario;
        let mut simulation = Simulation::<64>::new(scenario, Seed(5), 0, FLIGHTS);
        let teacher = Teacher::of(scenario).expect("its reward has a map");
        let mut successes = [None; FLIGHTS];
        while successes.contains(&None) {
            let mut actions = vec![0.0; scenario.action.len() * FLIGHTS];
            for row in 0..FLIGHTS {
                let action =
                    teacher.act(&simulation.state(row), &simulation.goal(row), simulation.room(row), None);
                for (column, value) in actions.chunks_exact_mut(FLIGHTS).zip(action) {
                    column[row] = value;
                }
            }
            simulation.step(&actions);
            for flight in simulation.take_episodes() {
                successes[flight.environment as usize].get_or_insert(flight.success);
            }
        }
        successes.iter().filter(|success| **success == Some(true)).count()
    }

    #[test]
    fn who_has_found_a_way_is_led_along_that_one() {
        let experiment = load(&in_repository("configs/aviaries/room-0.yaml"), &[]).unwrap();
        let scenario = &experiment.evaluation.scenario;
        let simulation = Simulation::<1>::new(scenario, Seed(5), 0, 1);
        let teacher = Teacher::of(scenario).expect("its reward has a map");
        let (state, goal) = (simulation.state(0), simulation.goal(0));
        let sideways = |y: f32| {
            let found = state.position + Vector3::new(0.0, y, 0.0);
            teacher.act(&state, &goal, 0, Some(found))[1]
        };
        let [left, right] = [sideways(0.3), sideways(-0.3)];
        assert!(left > 0.1 && right < -0.1, "{left}, {right}");
    }

    #[test]
    fn who_finds_a_way_by_itself_is_shown_softer_touches() {
        let experiment = load(&in_repository("configs/aviaries/unseen-rooms.yaml"), &[]).unwrap();
        let scenario = &experiment.evaluation.scenario;
        let told = Scenario { sensors: scenario.sensors.clone().with_told(None), ..scenario.clone() };
        let simulation = Simulation::<1>::new(scenario, Seed(5), 0, 1);
        let goal = simulation.goal(0);
        let state = State { position: goal + Vector3::new(0.0, 0.0, 0.4), ..simulation.state(0) };
        let [softly, firmly] = [scenario, &told].map(|scenario| {
            let teacher = Teacher::of(scenario).expect("its rooms have ways");
            teacher.act(&state, &goal, simulation.room(0), Some(goal))[2]
        });
        assert!(firmly < -0.1 && (softly / firmly - TOUCH_SHARE).abs() < 0.01, "{softly}, {firmly}");
    }

    #[test]
    fn who_sees_ahead_alone_is_turned_to_where_it_flies() {
        let sensors = "scenario.sensors=[{tof: {}}, {way: {map: {low_m: [-1, -1.5, 0], high_m: [7, 1.5, 1.5]}}}]";
        let path = in_repository("configs/aviaries/unseen-rooms.yaml");
        let led = |overrides: &[String], yaw: f32| {
            let scenario = load(&path, overrides).unwrap().evaluation.scenario;
            let simulation = Simulation::<1>::new(&scenario, Seed(5), 0, 1);
            let turned = Attitude { w: (0.5 * yaw).cos(), x: 0.0, y: 0.0, z: (0.5 * yaw).sin() };
            let state = State { world_from_body: turned, ..simulation.state(0) };
            let found = state.position + Vector3::new(0.3, 0.0, 0.0);
            let teacher = Teacher::of(&scenario).expect("its rooms have ways");
            teacher.act(&state, &simulation.goal(0), simulation.room(0), Some(found))
        };
        let ranger = [sensors.to_owned()];
        let [ahead, aside, behind] = [0.0, 0.5, -2.5].map(|yaw| led(&ranger, yaw));
        assert!(ahead[3].abs() < 1e-3 && aside[3] < -0.3 && behind[3] > 0.9, "{ahead:?} {aside:?} {behind:?}");
        assert!(aside[0] < ahead[0] && behind[0] < 0.3 * ahead[0] && behind[0] > 0.0);
        assert_eq!(led(&[], 0.5)[3], 0.0, "beams see all around");
    }

    #[test]
    fn it_arrives_in_furnished_rooms_and_past_pillars() {
        // One that is told no more than the way touches the table of room-2 too hard, at times.
        for (room, least) in
            [("room-0", 0.9), ("room-1", 0.9), ("room-2", 0.75), ("harder-cross-16", 0.9), ("race", 0.9)]
        {
            let arrivals = arrivals(room) as f64;
            assert!(arrivals > least * FLIGHTS as f64, "{room}: {arrivals} of {FLIGHTS}");
        }
    }
}
