//! A teacher for policies that hardly find the way by chance: the scripted pilot, led along the shortest free way.
//!
//! The learner adds an imitation loss towards its actions ([`TeacherSettings`](kestrel_learn::ppo::TeacherSettings)). The teacher knows the true state and the map, as those of Chen et al. 2020 and Loquercio et al. 2021 do; the policy that
//! has learned needs neither.

use std::sync::Arc;

use kestrel_core::action::ACTION_LIMIT;
use kestrel_core::vehicle::State;
use kestrel_sim::reward::RewardTerm;
use kestrel_sim::rooms::Ways;
use kestrel_sim::scenario::Scenario;
use nalgebra::Vector3;

use crate::scripted::ScriptedPilot;

/// The teacher heads for the point of the way that is so far ahead \[m\]: nearer ones make it wobble, farther ones cut corners.
const LOOKAHEAD_M: f32 = 0.3;

/// As if the goal were so far away \[m\], it flies at full speed.
const APPARENT_DISTANCE_M: f32 = 0.8;

/// The teacher of one task. It remembers nothing from one state to the next.
#[derive(Clone, Debug)]
pub(crate) struct Teacher {
    pilot: ScriptedPilot,
    ways: Ways,
}

impl Teacher {
    /// That of a task whose worlds are drawn, or whose reward says which way leads to its goal; no other has one.
    pub(crate) fn of(scenario: &Scenario) -> Option<Self> {
        let ways = match &scenario.drawn {
            Some(rooms) => Ways::Drawn(Arc::clone(rooms)),
            None => scenario.rewards.iter().find_map(RewardTerm::ways)?.clone(),
        };
        Some(Self { pilot: ScriptedPilot::of(scenario), ways })
    }

    /// What it would do in a room, each value within \[-1, 1\], zeros behind the last.
    pub(crate) fn act(&mut self, state: &State<f32>, room: u32) -> [f32; ACTION_LIMIT] {
        self.pilot.reset();
        let distance = self.distance(&state.position, room);
        self.pilot.lead(state, &self.target(&state.position, room), distance)
    }

    /// To the goal \[m\]. Near obstacles a metre of the way counts more, so that a table that stands among furniture would
    /// seem farther away than it is: in drawn rooms a straight line that is shorter counts.
    fn distance(&self, position: &Vector3<f32>, room: u32) -> f32 {
        let along = self.ways.of(room).length((*position).into());
        match &self.ways {
            Ways::Drawn(rooms) => along.min((rooms.room(room).aviary.goal - position).norm()),
            Ways::Same(_) => along,
        }
    }

    fn target(&self, position: &Vector3<f32>, room: u32) -> Vector3<f32> {
        let ahead = self.ways.of(room).ahead((*position).into(), LOOKAHEAD_M);
        let leg = ahead - position;
        position + leg * (APPARENT_DISTANCE_M / leg.norm().max(LOOKAHEAD_M / 2.0))
    }
}

#[cfg(test)]
mod tests {
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
        let mut teacher = Teacher::of(scenario).expect("its reward has a map");
        let mut successes = [None; FLIGHTS];
        while successes.contains(&None) {
            let mut actions = vec![0.0; scenario.action.len() * FLIGHTS];
            for row in 0..FLIGHTS {
                let action = teacher.act(&simulation.state(row), simulation.room(row));
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
    fn it_arrives_in_furnished_rooms_and_past_pillars() {
        // One that is told no more than the way touches the table of room-2 too hard, at times.
        for (room, least) in [("room-0", 0.9), ("room-1", 0.9), ("room-2", 0.75), ("harder-cross-16", 0.9)] {
            let arrivals = arrivals(room) as f64;
            assert!(arrivals > least * FLIGHTS as f64, "{room}: {arrivals} of {FLIGHTS}");
        }
    }
}
