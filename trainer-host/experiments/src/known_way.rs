//! The shortest free way through the places of a task, for who may know the map: the teacher, and the scripted pilot where no
//! route is written down.

use std::sync::Arc;

use kestrel_sim::contact::AXIS_M;
use kestrel_sim::course::Gate;
use kestrel_sim::reward::RewardTerm;
use kestrel_sim::rooms::{Rooms, Ways};
use kestrel_sim::scenario::{Aviary, Goals, Scenario};
use nalgebra::Vector3;

/// Who flies along it heads for the point that is so far ahead \[m\]: nearer ones make it wobble, farther ones cut corners.
const LOOKAHEAD_M: f32 = 0.3;

/// As if the goal were so far away \[m\], it flies at full speed.
const APPARENT_DISTANCE_M: f32 = 0.8;

/// So near to the end of a forest's way \[m\] a drone of a team flies straight to its own goal: no trunk is beside it any more.
const OWN_GOAL_M: f32 = 1.2;

/// This near to the axis of a gate, the way leads along it \[m\]; this near to the end of that, it turns to the next gate.
const ON_AXIS_M: f64 = 0.15;

/// The ways of one task.
#[derive(Clone, Debug)]
pub(crate) struct KnownWay {
    map: Map,
    /// Whether drawn ways lead to where a team parts.
    has_own_goals: bool,
}

/// What it knows of the way.
#[derive(Clone, Debug)]
enum Map {
    /// How far the goal is from everywhere.
    Ways(Ways),
    /// Which gates there are, and what leads from one to the next.
    Course(Box<Course>),
}

/// The course of the one place, or those of the rooms that are drawn.
#[derive(Clone, Debug)]
struct Course {
    aviary: Aviary,
    drawn: Option<Arc<Rooms>>,
}

impl KnownWay {
    /// That of a task whose worlds are drawn, whose reward says which way leads to its goal, or whose goals are gates; no other
    /// has one.
    pub(crate) fn of(scenario: &Scenario) -> Option<Self> {
        let map = match (&scenario.drawn, &scenario.goals) {
            (drawn, Goals::Gates) => {
                Map::Course(Box::new(Course { aviary: scenario.aviary.clone(), drawn: drawn.clone() }))
            }
            (Some(rooms), _) => Map::Ways(Ways::Drawn(Arc::clone(rooms))),
            (None, _) => Map::Ways(scenario.rewards.iter().find_map(RewardTerm::ways)?.clone()),
        };
        let has_own_goals = matches!((&scenario.drawn, &scenario.goals), (Some(_), Goals::PerAgent(_)));
        Some(Self { map, has_own_goals })
    }

    /// The point ahead on the way to a goal of a room, and how far away the goal seems \[m, world\].
    pub(crate) fn ahead(&self, position: &Vector3<f32>, goal: &Vector3<f32>, room: u32) -> (Vector3<f32>, f32) {
        let straight = (goal - position).norm();
        match &self.map {
            // Near obstacles a metre of the way counts more, so that a table that stands among furniture would seem farther
            // away than it is: a straight line that is shorter counts.
            Map::Ways(ways) => {
                let ways = ways.of(room);
                let length = ways.length((*position).into());
                if self.has_own_goals && length < OWN_GOAL_M {
                    (*goal, straight)
                } else {
                    (ways.ahead((*position).into(), LOOKAHEAD_M), length.min(straight))
                }
            }
            Map::Course(course) => (course.ahead(position, goal, room), straight),
        }
    }
}

/// Where a leg of the way leads to, so far away \[m\] that it is flown at full speed.
pub(crate) fn drawn_out(leg: &Vector3<f32>) -> Vector3<f32> {
    leg * (APPARENT_DISTANCE_M / leg.norm().max(LOOKAHEAD_M / 2.0))
}

impl Course {
    /// Where to head for on the way through the gate around a goal \[m, world\].
    fn ahead(&self, position: &Vector3<f32>, goal: &Vector3<f32>, room: u32) -> Vector3<f32> {
        let aviary = self.drawn.as_ref().map_or(&self.aviary, |rooms| &rooms.room(room).aviary);
        let here = position.cast();
        let Some(index) = aviary.gates.iter().position(|gate| gate.center.cast() == *goal) else { return *goal };
        // A route leads on to the end of the axis: whoever turns in the gate cuts a corner that may not be free.
        let leaves = |last: &Gate| {
            let place = last.seen(&here);
            (0.0..AXIS_M - ON_AXIS_M).contains(&place.x) && place.yz().norm() < 2.0 * ON_AXIS_M
        };
        if let Some(last) = index.checked_sub(1).map(|last| &aviary.gates[last]).filter(|last| leaves(last)) {
            return last.on_axis(AXIS_M).cast();
        }
        let gate = &aviary.gates[index];
        let [before, behind] = [-AXIS_M, AXIS_M].map(|way| gate.on_axis(way));
        let place = gate.seen(&here);
        let lined_up = place.yz().norm() < ON_AXIS_M && place.x > -AXIS_M - ON_AXIS_M;
        if lined_up {
            return behind.cast();
        }
        let aside = detour(aviary, index, &before.cast());
        // What leads past an obstacle has been passed once the gate is nearer than it is.
        let heads_aside = |point: &&Vector3<f32>| (before.cast() - **point).dot(&(position - **point)) < 0.0;
        aside.filter(heads_aside).copied().unwrap_or(before.cast())
    }
}

/// The point on the route by which the leg to a gate leads around what stands there, if it does.
fn detour<'a>(aviary: &'a Aviary, gate: usize, before: &Vector3<f32>) -> Option<&'a Vector3<f32>> {
    let route = aviary.route(0);
    let end = route.iter().position(|point| point == before)?;
    let begin = match gate.checked_sub(1) {
        None => 0,
        Some(last) => {
            let behind = aviary.gates[last].on_axis(AXIS_M).cast();
            route.iter().position(|point| *point == behind)? + 1
        }
    };
    route.get(begin..end)?.last()
}
