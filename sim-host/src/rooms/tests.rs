//! Drawn rooms are each a world of its own.

use std::sync::Arc;

use super::*;
use crate::config::Document;
use crate::scenario::Scenario;
use crate::simulation::Simulation;

/// Fly to the table of another room in every episode: boxes, pillars and partitions are in the way.
pub(crate) const ROOMS: &str = "
aviary:
  drawn:
    worlds: { seed: 3, count: 5 }
    from:
      furnished_rooms:
        pieces: 8
        table: { name: table, role: landing, parts: [{ low_m: [-0.3, -0.3, 0], high_m: [0.3, 0.3, 0.6] }] }
        furniture:
          - { piece: { name: box, parts: [{ low_m: [-0.2, -0.3, 0], high_m: [0.2, 0.3, 1] }] }, scales: [0.8, 1.2] }
physics: { substeps: 2, control_rate_hz: 50 }
action: { velocity: { speed_limit_m_per_s: 2 } }
sensors: [{ scan: { rings: [{ beams: 7 }, { elevation_deg: -40, beams: 3 }], limit_m: 2 } }]
observation:
  pilot_measured: { position_scale_m: 8, velocity_scale_m_per_s: 2, body_rates_scale_rad_per_s: 10 }
start:
  position: { free_within: { low_m: [-0.8, -1.3, 0.2], high_m: [6.8, 1.3, 1.3], clearance_m: 0.12 } }
  speed_limit_m_per_s: 8
rewards: [{ advance: { weight: 2 } }, { clearance: { weight: 1, reach_m: 0.3 } }]
terminations: [landing, collision, { out_of_bounds: { low_m: [-1, -1.5, 0], high_m: [7, 1.5, 1.5] } }]
episode_secs: 1
success: ending
";

pub(crate) fn checked(yaml: &str) -> Result<Scenario, String> {
    let document = Document::parse("trial.yaml", yaml).unwrap();
    let first_line = |text: String| text.lines().next().unwrap_or_default().to_owned();
    Scenario::of("trial", &document).map_err(|error| first_line(error.to_string()))
}

fn scenario() -> Scenario {
    checked(ROOMS).unwrap()
}

/// Noise for one environment that depends on nothing but it, the step and the value.
fn noise(environment: u32, step: u32, len: usize) -> Vec<f32> {
    let mut stream = Stream::new(Seed(u64::from(step)), environment, Purpose::Actions);
    (0..len).map(|_| stream.between(-1.0, 1.0)).collect()
}

/// Observations and rewards of an environment's first episode, and how it ended.
fn first_episode(scenario: &Scenario, environment: u32) -> (Vec<u32>, String) {
    let mut simulation = Simulation::<1>::new(scenario, Seed(9), environment, 1);
    let mut trace = Vec::new();
    for step in 0.. {
        trace.extend(simulation.observations().iter().map(|value| value.to_bits()));
        simulation.step(&noise(environment, step, 4));
        if let Some(episode) = simulation.take_episodes().pop() {
            return (trace, format!("{:?} {:?}", episode.ending, episode.terms));
        }
        trace.push(simulation.rewards()[0].to_bits());
    }
    unreachable!("an episode ends")
}

#[test]
fn in_its_room_a_drone_flies_as_in_that_world_alone() {
    // The bound of the reward `clearance` is lower in rooms that are drawn.
    let mut scenario = scenario();
    scenario.rewards.truncate(1);
    let mut endings = std::collections::BTreeSet::new();
    for environment in 0..40 {
        let alone = scenario.in_room(environment % 5);
        assert_eq!(alone.drawn, None);
        let flown = first_episode(&scenario, environment);
        assert_eq!(flown, first_episode(&alone, environment), "environment {environment}");
        endings.insert(flown.1.split(' ').next().unwrap_or_default().to_owned());
    }
    assert!(endings.contains("Collision"), "{endings:?}");
}

#[test]
fn neighbouring_lanes_are_in_different_rooms() {
    let scenario = scenario();
    let mut simulation = Simulation::<64>::new(&scenario, Seed(1), 0, 64);
    let rooms: Vec<u32> = (0..64).map(|row| simulation.room(row)).collect();
    assert_eq!(rooms, (0..64).map(|row| row % 5).collect::<Vec<u32>>());
    for row in 0..64 {
        let room = scenario.drawn.as_ref().unwrap().room(rooms[row]);
        assert_eq!(simulation.goal(row), room.aviary.goal);
        let world = &room.aviary.world;
        let arena = Arena::coarse(world, &scenario.airframe, ContactReport::Touch, scenario.sensors.scan());
        let nearness = arena.nearness(simulation.state(row).position.into(), 0);
        let seen: Vec<f32> = (22..32).map(|value| simulation.observations()[value * 64 + row]).collect();
        assert_eq!(seen, nearness[..10], "row {row}");
    }
    // Later episodes draw: after a few, all rooms are still flown, no longer in turn.
    for _ in 0..120 {
        simulation.step(&[0.0; 256]);
    }
    let later: Vec<u32> = (0..64).map(|row| simulation.room(row)).collect();
    assert!(later != rooms && (0..5).all(|room| later.contains(&room)), "{later:?}");
}

#[test]
fn lanes_that_nobody_flies_make_no_rooms() {
    let scenario = scenario();
    let mut simulation = Simulation::<64>::new(&scenario, Seed(1), 2, 1);
    let mut flown = std::collections::BTreeSet::from([2]);
    // The lanes behind it crash and start again, many times.
    for _ in 0..120 {
        let state = simulation.state(0);
        simulation.step(&[0.0; 4]);
        simulation.put(0, state);
        flown.insert(simulation.room(0));
    }
    let made = scenario.drawn.as_ref().unwrap().made.iter().enumerate();
    let made: Vec<u32> = made.filter(|(_, room)| room.get().is_some()).map(|(index, _)| index as u32).collect();
    assert_eq!(made, flown.into_iter().collect::<Vec<u32>>());
    assert!(made.len() < 5, "of five rooms");
}

#[test]
fn every_room_has_a_way_that_is_not_straight() {
    let scenario = scenario();
    let rooms = scenario.drawn.as_ref().unwrap().elsewhere(RoomRange { seed: Seed(5), first: 7, count: 24 });
    for index in 0..24 {
        let Room { aviary, ways, .. } = rooms.room(index);
        assert!(ways.as_ref().unwrap().free_path_from([-0.55, 0.0, 0.5]).is_some(), "room {index}");
        let narrow = DistanceField::new(&aviary.world, &aviary.goal, ROOM, 0.6 * CLEARANCE_M);
        assert!(narrow.free_path_from([-0.55, 0.0, 0.5]).is_some(), "room {index}");
        let goals = Workshop::goals();
        assert!((0..3).all(|axis| (goals.low[axis]..=goals.high[axis]).contains(&aviary.goal[axis])));
    }
    let again = rooms.elsewhere(RoomRange { seed: Seed(5), first: 20, count: 1 });
    assert_eq!(again.room(0).aviary, rooms.room(13).aviary, "a number is a room in every range");
    assert_ne!(rooms.room(12).aviary, rooms.room(13).aviary);
}

#[test]
fn a_crowded_room_has_fewer_pieces_rather_than_no_way() {
    let crowded = checked(&ROOMS.replace("pieces: 8", "pieces: 100")).unwrap();
    let Room { ways, aviary, .. } = crowded.drawn.as_ref().unwrap().room(0);
    assert!(ways.as_ref().unwrap().free_path_from([-0.55, 0.0, 0.5]).is_some());
    assert!(aviary.world.solids.len() > 10);
}

/// Race through gates that are drawn.
const COURSES: &str = "
aviary: { drawn: { worlds: { seed: 3, count: 24 }, from: { race_courses: { gates: [2, 8], posts: 12 } } } }
action: { velocity: { speed_limit_m_per_s: 2 } }
sensors: [ gates: {} ]
observation: { pilot_measured: {} }
start: { position: { within: { low_m: [-0.7, -0.3, 0.4], high_m: [-0.4, 0.3, 0.65] } } }
rewards: [ progress: { weight: 2 } ]
terminations: [ finish, collision ]
success: ending
";

/// Points along a line through these, at most 2 cm apart.
fn along(corners: &[nalgebra::Vector3<f64>]) -> impl Iterator<Item = nalgebra::Vector3<f64>> {
    let legs = corners.windows(2).map(|ends| (ends[0], ends[1] - ends[0]));
    let on_leg = |(from, leg): (nalgebra::Vector3<f64>, nalgebra::Vector3<f64>)| {
        let count = (leg.norm() / 0.02).ceil() as u32 + 1;
        (0..=count).map(move |step| from + leg * f64::from(step) / f64::from(count))
    };
    legs.flat_map(on_leg)
}

#[test]
fn every_course_has_a_line_that_leads_through_its_gates_past_everything() {
    let scenario = checked(COURSES).unwrap();
    let rooms = scenario.drawn.as_ref().unwrap();
    let (mut fewest, mut most, mut posts) = (8, 2, 0);
    for index in 0..24 {
        let Room { aviary, ways, .. } = rooms.room(index);
        assert_eq!(*ways, None);
        assert_eq!(aviary.goal, aviary.gates[0].center.cast());
        let start = nalgebra::Vector3::new(-0.55, 0.0, 0.525);
        let line: Vec<_> = [start].into_iter().chain(aviary.route(0).iter().map(|point| point.cast())).collect();
        let (mut before, mut left) = (start, &aviary.gates[..]);
        for point in along(&line) {
            let (solid, distance) = crate::contact::nearest_obstacle(&aviary.world.solids, &point).unwrap();
            assert!(distance > 0.23, "course {index}: {} is {distance} m from {point:?}", solid.name);
            assert!(point.z > 0.24);
            if left.first().is_some_and(|gate| gate.is_passed(&before, &point)) {
                left = &left[1..];
            }
            before = point;
        }
        assert!(left.is_empty(), "course {index}: {} gates are left", left.len());
        (fewest, most) = (aviary.gates.len().min(fewest), aviary.gates.len().max(most));
        posts = aviary.world.solids.iter().filter(|solid| solid.name == "post").count().max(posts);
    }
    assert!(fewest < 4 && most > 6 && posts > 6, "{fewest} {most} {posts}");
    assert_ne!(rooms.room(0).aviary.gates, rooms.room(1).aviary.gates);
}

#[test]
fn courses_of_impossible_numbers_are_refused() {
    let refused = |from: &str, to: &str| checked(&COURSES.replace(from, to)).unwrap_err();
    let found = refused("gates: [2, 8]", "gates: [5, 4]");
    assert!(found.contains("race_courses.gates.1: found 4, expected a whole number from 5 to 8"), "{found}");
    let found = refused("posts: 12", "opening_m: [0.3, 0.5]");
    assert!(found.contains("race_courses.opening_m.0: found 0.3"), "{found}");
    let found = refused("progress: { weight: 2 }", "advance: { weight: 2 }");
    assert!(found.contains("advance"), "{found}");
}

/// Fly through a forest that is drawn.
const FORESTS: &str = "
aviary: { drawn: { worlds: { seed: 3, count: 24 }, from: { forest: { trunks_per_square_metre: 0.3 } } } }
action: { velocity: { speed_limit_m_per_s: 2 } }
sensors: [ tof: {} ]
observation: { pilot_measured: {} }
start: { position: { within: { low_m: [-0.8, -2.5, 0.4], high_m: [0.5, 2.5, 2] } } }
rewards: [ progress: { weight: 2 } ]
terminations: [ { arrival: { radius_m: 0.3 } }, collision ]
success: ending
";

#[test]
fn every_forest_is_as_dense_as_asked_and_has_a_way_through_it() {
    let scenario = checked(FORESTS).unwrap();
    let rooms = scenario.drawn.as_ref().unwrap();
    let mut straight = 0;
    for index in 0..24 {
        let Room { aviary, ways, .. } = rooms.room(index);
        let trunks: Vec<_> = aviary.world.solids.iter().filter(|solid| solid.name == "trunk").collect();
        assert!((26..=28).contains(&trunks.len()), "0.3 on each of 93 square metres: {}", trunks.len());
        for trunk in &trunks {
            let (low, high) = trunk.extent();
            assert!(low.x >= 1.0 && high.x <= 16.5 && low.y >= -3.0 && high.y <= 3.0, "{low:?} {high:?}");
            let radius = (high.x - low.x) / 2.0;
            assert!((0.08..=0.2001).contains(&radius) && low.z == 0.0 && high.z == 2.5);
        }
        assert!(ways.as_ref().unwrap().free_path_from([-0.3, 0.0, 1.2]).is_some(), "forest {index}");
        let ends = [nalgebra::Vector3::new(-0.3, 0.0, 1.2), aviary.goal.cast()];
        let free = |point| crate::contact::nearest_obstacle(&aviary.world.solids, &point).unwrap().1 > 0.1;
        straight += u32::from(along(&ends).all(free));
    }
    assert!(straight < 8, "a straight line leads through {straight} of 24");
    assert_ne!(rooms.room(0).aviary.world, rooms.room(1).aviary.world);
}

#[test]
fn forests_of_impossible_numbers_are_refused_and_one_without_trunks_is_a_hall() {
    let from = "trunks_per_square_metre: 0.3";
    let refused = |to: &str| checked(&FORESTS.replace(from, to)).unwrap_err();
    let found = refused("radius_m: [0.3, 0.2]");
    assert!(found.contains("forest.radius_m.1: found 0.2"), "{found}");
    let found = refused("trunks_per_square_metre: 3");
    assert!(found.contains("forest.trunks_per_square_metre: found 3"), "{found}");
    let bare = checked(&FORESTS.replace(from, "trunks_per_square_metre: 0")).unwrap();
    assert_eq!(bare.drawn.as_ref().unwrap().room(0).aviary.world.solids.len(), 4);
}

#[test]
fn every_corridor_winds_and_leads_to_its_goal() {
    let corridors = |loops: &str| {
        let to = format!("{{ corridors: {{ loops: {loops} }} }}");
        let text = FORESTS.replace("{ forest: { trunks_per_square_metre: 0.3 } }", &to).replace(
            "low_m: [-0.8, -2.5, 0.4], high_m: [0.5, 2.5, 2]",
            "low_m: [-0.8, -1.8, 0.4], high_m: [-0.3, 1.8, 1.2]",
        );
        checked(&text)
    };
    let mean_way = |loops: &str| {
        let scenario = corridors(loops).unwrap();
        let rooms = scenario.drawn.as_ref().unwrap();
        let lengths = (0..24).map(|index| {
            let Room { aviary, ways, .. } = rooms.room(index);
            let ways = ways.as_ref().unwrap();
            let path = ways.free_path_from([-0.5, 0.0, 0.75]);
            assert!(path.is_some(), "corridors {index}");
            assert!(aviary.goal.x == 10.5 && aviary.goal.y.abs() <= 1.5 && aviary.goal.z == 0.75);
            let length = ways.length([-0.5, 0.0, 0.75]);
            assert!(length > 11.0, "{length} m in corridors {index}");
            length
        });
        lengths.sum::<f32>() / 24.0
    };
    let (blind, open) = (mean_way("0"), mean_way("0.5"));
    assert!(blind > open + 2.0, "{blind} m on average where all walls stand, {open} m where half do");
    let found = corridors("0.6").unwrap_err();
    assert!(found.contains("corridors.loops: found 0.6"), "{found}");
}

/// The same with people.
fn peopled() -> Scenario {
    checked(&FORESTS.replace("trunks_per_square_metre: 0.3", "people: 5, walking_m_per_s: 1.5")).unwrap()
}

#[test]
fn people_walk_to_and_fro_between_trunks() {
    let scenario = peopled();
    let mut simulation = Simulation::<8>::new(&scenario, Seed(4), 0, 24);
    let places = |simulation: &Simulation<8>, environment: usize| -> Vec<nalgebra::Vector3<f64>> {
        simulation.movables(environment).iter().map(|pose| pose.position).collect()
    };
    let at_rest = vec![0.0; 4 * 24];
    let mut turns = 0;
    for _ in 0..120 {
        let before: Vec<_> = (0..24).map(|environment| places(&simulation, environment)).collect();
        simulation.step(&at_rest);
        for (environment, before) in before.iter().enumerate() {
            let now = places(&simulation, environment);
            assert_eq!(now.len(), 5);
            if simulation.outcomes()[environment] != crate::outcome::Outcome::Running {
                continue;
            }
            let solids = &scenario.aviary_of(simulation.room(environment)).world.solids;
            for (now, before) in now.iter().zip(before) {
                let gone = (now - before).norm();
                assert!(gone < 1.501 / 50.0, "{gone} m in a control period");
                turns += u32::from(gone < 1.499 / 50.0);
                let (_, free) = crate::contact::nearest_obstacle(solids, now).unwrap();
                assert!(free > 0.24, "{free} m from a trunk");
            }
        }
    }
    assert!(turns > 20, "{turns} turned round");
}

#[test]
fn people_are_seen_by_zones_and_run_into() {
    let mut scenario = peopled();
    scenario.rewards = vec![crate::reward::Encounter { weight: -50.0, reach_m: 0.9, ahead_secs: 0.1 }.into()];
    let mut simulation = Simulation::<8>::new(&scenario, Seed(4), 0, 1);
    let facing = |simulation: &mut Simulation<8>, metres: f64| {
        let person = simulation.movables(0)[0].position;
        let state = kestrel_core::vehicle::State {
            position: nalgebra::Vector3::new(person.x - metres, person.y, 1.0).cast(),
            world_from_body: kestrel_core::attitude::Attitude::level(),
            velocity: nalgebra::Vector3::zeros(),
            ..simulation.state(0)
        };
        simulation.put(0, state);
        simulation.step(&[0.0; 4]);
    };
    // A reading is 40 ms old.
    let mut nearness = Vec::new();
    for _ in 0..12 {
        facing(&mut simulation, 0.7);
        nearness.push(simulation.observations()[scenario.observation.len() - 64 + 27]);
    }
    let seen = 4.0 * (1.0 - nearness.iter().copied().fold(0.0, f32::max));
    assert!((seen - 0.45).abs() < 0.15, "{seen} m to somebody of 25 cm");
    assert_eq!(simulation.outcomes()[0], crate::outcome::Outcome::Running);
    // Half a metre from the surface of somebody who walks at 1.5 m/s.
    assert!((-0.5..-0.05).contains(&simulation.terms(0)[0]), "{:?}", simulation.terms(0));
    facing(&mut simulation, 0.2);
    let episode = simulation.take_episodes().pop().expect("it ends");
    assert_eq!(episode.ending, crate::outcome::Ending::Collision);
}

#[test]
fn what_people_do_does_not_depend_on_lanes_and_goes_on_after_a_restore() {
    let scenario = peopled();
    for environment in [0, 3, 7] {
        let alone = first_episode(&scenario, environment);
        let mut together = Simulation::<8>::new(&scenario, Seed(9), 0, 8);
        let actions = |step: u32| -> Vec<f32> {
            let of: Vec<_> = (0..8).map(|environment| noise(environment, step, 4)).collect();
            (0..4).flat_map(|value| of.iter().map(move |noise| noise[value])).collect()
        };
        let mut trace = Vec::new();
        for step in 0.. {
            let len = scenario.observation.len();
            let seen = |index: usize| together.observations()[index * 8 + environment as usize].to_bits();
            trace.extend((0..len).map(seen));
            let state = together.save();
            let mut other = Simulation::<8>::new(&scenario, Seed(1), 0, 8);
            assert!(other.restore(&state));
            together = other;
            together.step(&actions(step));
            if together.take_episodes().iter().any(|episode| episode.environment == environment) {
                break;
            }
            trace.push(together.rewards()[environment as usize].to_bits());
        }
        let differs = trace.iter().zip(&alone.0).position(|(one, other)| one != other);
        assert_eq!((differs, trace.len()), (None, alone.0.len()), "environment {environment}");
    }
}

#[test]
fn more_people_than_find_room_are_refused_and_beams_that_do_not_see_them() {
    let refused = |from: &str, to: &str| {
        let forest = FORESTS.replace("trunks_per_square_metre: 0.3", "people: 2");
        checked(&forest.replace(from, to)).unwrap_err()
    };
    let found = refused("people: 2", "people: 13");
    assert!(found.contains("forest.people: found 13, expected a whole number from 0 to 12"), "{found}");
    let found = refused("people: 2", "people: 2, walking_m_per_s: 0");
    assert!(found.contains("forest.walking_m_per_s: found 0"), "{found}");
    let found = refused("tof: {}", "scan: { rings: [{ beams: 7 }], limit_m: 2 }");
    assert!(found.contains("sensors: found a `scan` among people, expected `tof`"), "{found}");
}

/// A team of three crosses forests.
const TEAM: &str = "
aviary: { drawn: { worlds: { seed: 3, count: 6 }, from: { forest: { people: 2 } } } }
agents: { count: 3, ends: together }
goals: { per_agent: { points_m: [[17.8, 1, 1.2], [17.8, 0, 1.2], [17.8, -1, 1.2]] } }
action: { velocity: { speed_limit_m_per_s: 2 } }
sensors: [ tof: {}, mates: { nearest: 2, position_scale_m: 1, velocity_scale_m_per_s: 2, radio: {} } ]
observation: { pilot_measured: {} }
start: { position: { exactly: [ { position_m: [-0.5, -1, 1], spread_m: 0.2 }, { position_m: [-0.5, 0, 1] }, { position_m: [-0.5, 1, 1] } ] } }
rewards: [ progress: { weight: 2 } ]
terminations: [ { arrival: { radius_m: 0.3 } }, collision, { speed: { limit_m_per_s: 0.3 } } ]
success: ending
";

#[test]
fn a_team_is_in_one_forest_whoever_begins_anew() {
    for (ends, moves_on) in [("together", true), ("alone", false)] {
        let scenario = checked(&TEAM.replace("together", ends)).unwrap();
        let mut simulation = Simulation::<8>::new(&scenario, Seed(4), 0, 6);
        let (mut ended, mut moved) = (0, false);
        for step in 0..120 {
            let rooms: Vec<u32> = (0..6).map(|environment| simulation.room(environment)).collect();
            let actions: Vec<f32> = (0..18).flat_map(|row| noise(row, step, 4)).collect();
            simulation.step(&actions);
            ended += simulation.take_episodes().len();
            for (environment, before) in rooms.iter().enumerate() {
                let now = [0, 6, 12].map(|agent| simulation.room(agent + environment));
                assert!(now.iter().all(|room| *room == now[0]), "{now:?}");
                moved |= now[0] != *before;
            }
        }
        assert!(ended > 18, "{ended} episodes");
        assert_eq!(moved, moves_on);
    }
}

#[test]
fn goals_and_starts_of_a_team_that_may_be_in_a_trunk_are_refused() {
    let refused = |from: &str, to: &str| checked(&TEAM.replace(from, to)).unwrap_err();
    let found = refused("[17.8, 0, 1.2]", "[16, 0, 1.2]");
    assert!(found.contains("points_m.1: found a goal that may be in a trunk"), "{found}");
    let found = refused("[-0.5, 0, 1] }", "[2.5, 0, 1] }");
    assert!(found.contains("exactly.1: found a place where something may stand"), "{found}");
    let found = refused("radio: {}", "radio: { lost: 1 }");
    assert!(found.contains("mates.radio.lost: found 1, expected a number from 0 to 0.9"), "{found}");
}

#[test]
fn ranges_overlap_where_they_share_a_number_of_a_seed() {
    let range = |seed, first, count| RoomRange { seed: Seed(seed), first, count };
    assert!(range(1, 0, 10).overlaps(&range(1, 9, 1)) && range(1, 9, 1).overlaps(&range(1, 0, 10)));
    assert!(!range(1, 0, 10).overlaps(&range(1, 10, 5)) && !range(1, 0, 10).overlaps(&range(2, 0, 10)));
    assert!(!range(1, u32::MAX, 1).overlaps(&range(1, 0, 1)));
}

#[test]
fn what_has_no_meaning_in_drawn_worlds_is_refused() {
    let refused = |from: &str, to: &str| checked(&ROOMS.replace(from, to)).unwrap_err();
    let found = refused("episode_secs: 1", "goals: { per_agent: { points_m: [[6, 0, 1]] } }");
    assert!(found.contains("goals: found goals beside `aviary.drawn`, expected none"), "{found}");
    let found =
        refused("success: ending", "success: { visit: { region: { low_m: [0, 0, 0], high_m: [1, 1, 1] } } }");
    assert!(found.contains("success: found a region beside `aviary.drawn`"), "{found}");
    let found = refused("  drawn:", "  goal_m: [0, 0, 1]\n  drawn:");
    assert!(found.contains("aviary.goal_m: found a key beside `drawn`"), "{found}");
    let found = refused("count: 5", "count: 0");
    assert!(found.contains("worlds.count: found 0, expected a whole number from 1 to 100000"), "{found}");
    let found = refused("scales: [0.8, 1.2]", "scales: [0.8, 0.2]");
    assert!(found.contains("furniture.0.scales.1: found 0.2"), "{found}");
    let start = "free_within: { low_m: [-0.8, -1.3, 0.2], high_m: [6.8, 1.3, 1.3], clearance_m: 0.12 }";
    let found = refused(start, "within: { low_m: [-0.7, -0.3, 0.4], high_m: [3, 0.3, 0.6] }");
    assert!(found.contains("start.position.within: found a box in which something may stand"), "{found}");
    let found = refused(start, "around_goal: { farthest_m: 0.1 }");
    assert!(found.contains("start.position: found another start beside `aviary.drawn`"), "{found}");
    let found = refused("physics: {", "physics: { contacts: solved,");
    assert!(found.contains("physics.contacts: found solved contacts"), "{found}");
    assert!(
        checked(&ROOMS.replace(start, "within: { low_m: [-0.7, -0.3, 0.4], high_m: [-0.4, 0.3, 0.6] }")).is_ok()
    );
}

#[test]
fn the_arenas_of_an_airframe_are_made_once() {
    let scenario = scenario();
    let rooms = scenario.drawn.as_ref().unwrap();
    let arenas = || rooms.arenas(&scenario.airframe, ContactReport::Touch, None);
    assert!(Arc::ptr_eq(&arenas(), &arenas()));
    let other = rooms.arenas(&scenario.airframe, ContactReport::Bullet, None);
    assert!(!Arc::ptr_eq(&arenas(), &other));
}

/// The rooms of above, but one room whose boxes are moved.
fn moved() -> String {
    let generator = ROOMS.find("      furnished_rooms:").unwrap()..ROOMS.find("physics:").unwrap();
    let room = "      moved_furniture:
        shift_m: 0.3
        room:
          goal_m: [6.5, 0, 0.65]
          room: { low_m: [-1, -1.5, 0], high_m: [7, 1.5, 1.5] }
          pillars: [[1.5, 0.4]]
          furniture:
            - { name: table, role: landing, parts: [{ low_m: [6.2, -0.3, 0], high_m: [6.8, 0.3, 0.6] }] }
            - { name: two, parts: [{ low_m: [3, -1.5, 0], high_m: [3.2, -0.3, 1.5] }, { low_m: [3, 0.3, 0], high_m: [3.2, 0.5, 1.5] }] }
            - { name: in the wall, parts: [{ low_m: [4, 1.2, 0], high_m: [4.4, 1.6, 1] }] }
";
    [&ROOMS[..generator.start], room, &ROOMS[generator.end..]].concat()
}

#[test]
fn moved_furniture_stands_elsewhere_and_leaves_a_way() {
    let scenario = checked(&moved()).unwrap();
    let rooms = scenario.drawn.as_ref().unwrap();
    let first_of = |room: &Room, name: &str| {
        let solid = room.aviary.world.solids.iter().find(|solid| solid.name.starts_with(name)).unwrap();
        solid.pose.position
    };
    let mut farthest: f64 = 0.0;
    for index in 0..5 {
        let room = rooms.room(index);
        assert_eq!(room.aviary.goal, nalgebra::Vector3::new(6.5, 0.0, 0.65));
        assert!(room.ways.as_ref().unwrap().free_path_from([-0.55, 0.0, 0.5]).is_some());
        assert_eq!(first_of(room, "table").x, 6.5);
        for (name, x, y) in [("pillar", 1.5, 0.4), ("two", 3.1, -0.9), ("in the wall", 4.2, 1.4)] {
            let by = first_of(room, name) - nalgebra::Vector3::new(x, y, first_of(room, name).z);
            assert!(by.amax() <= 0.3001, "{name} of room {index} by {by}");
            farthest = farthest.max(by.amax());
        }
        // Both parts of a piece go together.
        let parts: Vec<_> =
            room.aviary.world.solids.iter().filter(|solid| solid.name.starts_with("two")).collect();
        let apart = parts[1].pose.position - parts[0].pose.position;
        assert!((apart - nalgebra::Vector3::new(0.0, 1.3, 0.0)).norm() < 1e-9, "{apart}");
    }
    assert!(farthest > 0.2, "{farthest}");
    assert_ne!(first_of(rooms.room(0), "two"), first_of(rooms.room(1), "two"));
}

#[test]
fn rooms_whose_furniture_cannot_be_moved_are_refused() {
    let refused = |from: &str, to: &str| checked(&moved().replace(from, to)).unwrap_err();
    let found = refused("shift_m: 0.3", "shift_m: 3");
    assert!(found.contains("moved_furniture.shift_m: found 3"), "{found}");
    let blocked = "moved_furniture.room: found a room whose starts are not free, or without a free way";
    let found = refused("high_m: [3.2, -0.3, 1.5]", "high_m: [3.2, 1.5, 1.5]");
    assert!(found.contains(blocked), "{found}");
    let found = refused("pillars: [[1.5, 0.4]]", "pillars: [[-0.4, 0.4]]");
    assert!(found.contains(blocked), "{found}");
    let found = refused("pillars:", "gates: [{ at_m: [1, 0, 1], opening_m: [0.6, 0.6] }]\n          pillars:");
    assert!(found.contains("moved_furniture.room.gates: found a key beside furniture"), "{found}");
    let found = refused("pillars:", "at_m: [1, 0, 0]\n          pillars:");
    assert!(found.contains("moved_furniture.room.at_m: found a key beside furniture"), "{found}");
    let found = refused("goal_m: [6.5, 0, 0.65]", "floor: true");
    assert!(found.contains("moved_furniture.room: found no key `goal_m`"), "{found}");
}
