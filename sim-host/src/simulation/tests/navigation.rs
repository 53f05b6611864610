//! Flights past obstacles: scans, starts where it is free, landings that last.

use super::*;
use crate::outcome::Ending;
use crate::scenario::Start;
use crate::sensor::instrument::Sampling;
use crate::sensor::{Scan, ScanRing, SensorSuite, Tof, TofParts, Told, Way};
use crate::world::{Role, Solid};
use kestrel_core::attitude::Attitude;
use kestrel_core::observation::{BodyLayout, ObservationLayout, PilotLayout};
use kestrel_core::planner::NodeGrid;
use kestrel_core::vehicle::State;

/// A room with a wall across, which leaves a passage at y above 0.4, and starts on its near side.
fn behind_a_wall(position: &str) -> Scenario {
    scenario(&format!(
        "aviary:
  goal_m: [1.5, 0, 0.5]
  room: {{ low_m: [-1, -1, 0], high_m: [2, 1, 1], wall_m: 0.1 }}
  solids: [ {{ low_m: [0.5, -1, 0], high_m: [0.6, 0.4, 1] }} ]
action: {{ velocity: {{}} }}
sensors:
  - barometer: {{ noise_m: 0, bias_m: 0, bias_walk_m_per_sqrt_s: 0, latency_secs: 0, rate_hz: 1000 }}
  - scan: {{ rings: [ {{ beams: 4 }} ], limit_m: 1 }}
observation: {{ pilot_measured: {{}} }}
start: {{ position: {position} }}
rewards: [ advance: {{ weight: 1 }} ]
terminations: [ collision, out_of_bounds: {{ low_m: [-1, -1, 0], high_m: [2, 1, 1] }} ]
episode_secs: 1
success: {{ visit: {{ region: {{ low_m: [1, -1, 0], high_m: [2, 1, 1] }} }} }}"
    ))
}

const ANYWHERE: &str =
    "{ free_within: { low_m: [-0.99, -0.99, 0.01], high_m: [1.99, 0.99, 0.99], clearance_m: 0.1 } }";
const ON_THE_WAY: &str = "{ along_way: { from: { low_m: [-0.6, -0.1, 0.4], high_m: [-0.4, 0.1, 0.6] }, spread_m: 0.1, \
                          clearance_m: 0.1, box_share: 0.25 } }";

fn starts(position: &str) -> Vec<Vector3<f32>> {
    let simulation = Simulation::<64>::new(&behind_a_wall(position), Seed(4), 0, 512);
    (0..512).map(|row| simulation.state(row).position).collect()
}

fn is_free(point: &Vector3<f32>) -> bool {
    let inside = (point - Vector3::new(0.5, 0.0, 0.5)).abs();
    let in_wall = (0.4..0.7).contains(&point.x) && point.y < 0.5;
    !in_wall && inside.x <= 1.4 && inside.y <= 0.9 && point.z >= 0.1
}

#[test]
fn starts_anywhere_are_everywhere_where_it_is_free() {
    let starts = starts(ANYWHERE);
    assert!(starts.iter().all(is_free));
    let share = |part: fn(&Vector3<f32>) -> bool| starts.iter().filter(|start| part(start)).count();
    assert!(share(|start| start.x < 0.4) > 150 && share(|start| start.x > 0.7) > 150);
    assert!(share(|start| (0.4..0.7).contains(&start.x)) > 10, "some are in the passage");
}

#[test]
fn starts_along_the_way_are_on_both_sides_and_in_the_passage() {
    let starts = starts(ON_THE_WAY);
    let in_box = |start: &&Vector3<f32>| (*start - Vector3::new(-0.5, 0.0, 0.5)).abs().max() <= 0.1;
    assert!(starts.iter().all(|start| is_free(start) || in_box(&start)));
    assert!(starts.iter().filter(in_box).count() > 128);
    assert!(starts.iter().filter(|start| start.x > 0.7).count() > 64);
    assert!(starts.iter().filter(|start| (0.4..0.7).contains(&start.x)).count() > 16);
}

#[test]
fn headings_stay_within_their_limit_and_fill_it() {
    let headings = |limit_deg: f32| -> Vec<f32> {
        let mut scenario = behind_a_wall(ANYWHERE);
        scenario.start = Start { heading_limit: limit_deg.to_radians(), tilt_limit: 0.1, ..scenario.start };
        let simulation = Simulation::<64>::new(&scenario, Seed(4), 0, 512);
        let heading = |row: usize| {
            let forward = simulation.state(row).world_from_body.rotate(Vector3::x());
            libm::atan2f(forward.y, forward.x).to_degrees()
        };
        (0..512).map(heading).collect()
    };
    let farthest =
        |headings: &[f32]| headings.iter().fold([0.0_f32; 2], |[low, high], h| [low.min(*h), high.max(*h)]);
    // A tilt of 0.1 rad moves the projected axis by less than half a degree.
    let [low, high] = farthest(&headings(30.0));
    assert!((-30.5..-28.0).contains(&low) && (28.0..30.5).contains(&high), "{low} to {high}");
    let [low, high] = farthest(&headings(180.0));
    assert!(low < -175.0 && high > 175.0, "{low} to {high}");
}

#[test]
fn starts_without_room_are_refused() {
    let refused = |position: &str, terminations: &str| {
        let text = format!(
            "aviary: {{ goal_m: [0, 0, 1] }}\nstart: {{ position: {position} }}\nrewards: [ alive: {{ weight: 1 }} ]
terminations: [ {terminations} ]\nsuccess: {{ settle: {{ radius_m: 1, within_secs: 1 }} }}"
        );
        let document = Document::parse("trial.yaml", &text).unwrap();
        let error = Scenario::of("trial", &document).unwrap_err().to_string();
        error.lines().next().unwrap_or_default().to_owned()
    };
    assert_eq!(
        refused("{ free_within: { low_m: [0, 0, 0], high_m: [1, 1, 1], clearance_m: 2 } }", ""),
        "trial.yaml:2:35: start.position.free_within: found a box without a point 2 m from everything, expected one \
         that is partly free"
    );
    assert_eq!(
        refused("{ free_within: { low_m: [0, 0, 0], high_m: [1, 1, 1], clearance_m: 0.05 } }", "collision"),
        "trial.yaml:2:87: start.position.free_within.clearance_m: found 0.05, expected at least 0.06 m, the drone's \
         radius"
    );
}

#[test]
fn the_observation_ends_with_what_the_beams_see() {
    let scenario = behind_a_wall(ANYWHERE);
    let mut simulation = Simulation::<64>::new(&scenario, Seed(4), 0, 64);
    let arena = crate::contact::Arena::shared(
        &scenario.aviary.world,
        &scenario.airframe,
        ContactReport::Touch,
        scenario.sensors.scan(),
    );
    for step in 0..20 {
        let rows = simulation.rows();
        for row in 0..rows {
            let value = |index: usize| simulation.observations()[index * rows + row];
            let position = simulation.state(row).position;
            let nearness = arena.nearness(position.into(), 0);
            assert_eq!(
                [value(23), value(24), value(25), value(26)],
                nearness[..4],
                "at {position} in step {step}"
            );
            let height = value(22);
            assert!(
                (height - position.z).abs() < 0.02,
                "the barometer stands before them: {height} m at {position}"
            );
        }
        simulation.step(&noise(step, 4 * rows));
    }
}

/// The room with the wall, of which drones make maps.
fn with_a_way() -> Scenario {
    let mut scenario = behind_a_wall(ANYWHERE);
    let beams = [-0.6, -0.3, 0.0, 0.3, 0.6].map(|elevation| ScanRing { elevation, beams: 12 });
    let scan = Scan { rings: beams.to_vec(), limit: 2.0, near_scale: Some(0.3), sweeps: true };
    let grid = NodeGrid::new([-1.0, -1.0, 0.0], [2.0, 1.0, 1.0], 0.1).unwrap();
    let way = Way {
        grid,
        periods: 2,
        lookahead_m: 0.3,
        nearness_cost: 12.0,
        mapped_within_m: 100.0,
        unseen_cost: 1.0,
        shows_nearest: false,
    };
    scenario.sensors = SensorSuite::none().with_scan(Some(scan)).with_told(Some(Told::Way(way)));
    if let ObservationLayout::PilotMeasured(layout) = &mut scenario.observation {
        layout.measured_len = 63;
    }
    scenario
}

/// Where the drone is told that its way leads.
fn told(simulation: &Simulation<8>) -> Vector3<f32> {
    let values = simulation.observations();
    Vector3::new(values[82], values[83], values[84])
}

/// Holds the drone at a place for a control period.
fn hold(simulation: &mut Simulation<8>, position: Vector3<f32>) {
    simulation.put(0, State { position, ..simulation.state(0) });
    simulation.step(&[0.0; 4]);
}

#[test]
fn the_way_leads_around_what_the_beams_have_met() {
    let mut simulation = Simulation::<8>::new(&with_a_way(), Seed(3), 0, 1);
    (0..40).for_each(|_| hold(&mut simulation, Vector3::new(-0.3, -0.5, 0.5)));
    // The goal is behind the wall, whose end is at y = 0.4.
    let (way, ahead) = (told(&simulation), simulation.ahead(0).unwrap());
    assert!((way.norm() - 1.0).abs() < 1e-3, "{way}");
    assert!(((ahead - simulation.state(0).position).normalize() - way).norm() < 1e-3, "{ahead} and {way}");
    assert!(way.y > 0.5, "{way} leads along the wall, not through it");
}

#[test]
fn what_is_met_far_away_is_not_mapped() {
    let way_of = |mapped_within_m: f32| {
        let mut scenario = with_a_way();
        if let Some(Told::Way(way)) = scenario.sensors.told().copied() {
            scenario.sensors = scenario.sensors.with_told(Some(Told::Way(Way { mapped_within_m, ..way })));
        }
        let mut simulation = Simulation::<8>::new(&scenario, Seed(3), 0, 1);
        (0..40).for_each(|_| hold(&mut simulation, Vector3::new(-0.3, 0.0, 0.5)));
        told(&simulation)
    };
    // The wall is 80 cm away.
    let (far, near) = (way_of(0.5), way_of(2.0));
    assert!(far.x > 0.99 && near.x < 0.9, "{far} leads to the goal, {near} around the wall");
}

#[test]
fn in_the_body_layout_the_way_is_seen_in_body_axes() {
    let mut scenario = with_a_way();
    let scales = PilotLayout { position_scale_m: 2.0, velocity_scale: 2.0, body_rates_scale: 10.0 };
    scenario.observation = ObservationLayout::Body(BodyLayout { scales, action_len: 4, measured_len: 66 });
    if let Some(Told::Way(way)) = scenario.sensors.told().copied() {
        scenario.sensors = scenario.sensors.with_told(Some(Told::Way(Way { shows_nearest: true, ..way })));
    }
    let mut simulation = Simulation::<8>::new(&scenario, Seed(3), 0, 1);
    let half = 0.5_f32.sqrt();
    let left = Attitude { w: half, x: 0.0, y: 0.0, z: half };
    for _ in 0..10 {
        simulation.put(0, State { world_from_body: left, ..simulation.state(0) });
        hold(&mut simulation, Vector3::new(0.25, -0.3, 0.5));
    }
    let [.., x, y, z, along, left, up] = simulation.observations() else { panic!("a way") };
    let turned = |x: &f32, y: &f32, z: &f32| simulation.state(0).world_from_body.rotate(Vector3::new(*x, *y, *z));
    let (seen, away) = (turned(x, y, z), turned(along, left, up));
    let leg = simulation.ahead(0).unwrap() - simulation.state(0).position;
    assert!((leg.normalize() - seen).norm() < 1e-3, "{seen} is seen, and {leg} leads to the point ahead");
    // The wall is 25 cm away along +x.
    let expected = Vector3::new(-(1.0 - 0.25 / 0.38), 0.0, 0.0);
    assert!((away - expected).norm() < 0.1, "{away} leads away from the wall, expected {expected}");
}

#[test]
fn the_way_leads_around_what_a_multizone_ranger_has_met() {
    let mut scenario = with_a_way();
    let sampling = Sampling { rate_hz: 15.0, latency_secs: 0.0, drop_out: 0.0 };
    let parts = TofParts { side: 8, field_of_view: 1.6, pitch: 0.0, limit: 4.0, noise: [0.0; 2], sampling };
    let told_before = scenario.sensors.told().copied();
    scenario.sensors = SensorSuite::none().with_tof(Some(Tof::new(&parts))).with_told(told_before);
    if let ObservationLayout::PilotMeasured(layout) = &mut scenario.observation {
        layout.measured_len = 67;
    }
    let told = |simulation: &Simulation<8>| {
        let [.., x, y, z] = simulation.observations() else { panic!("a way") };
        Vector3::new(*x, *y, *z)
    };
    let mut simulation = Simulation::<8>::new(&scenario, Seed(3), 0, 1);
    (0..40).for_each(|_| hold(&mut simulation, Vector3::new(-0.3, -0.2, 0.5)));
    let way = told(&simulation);
    assert!(way.y > 0.4, "{way} leads along the wall ahead, not through it");
    // Whoever looks the other way has met no end of the wall, but for a glance at the start.
    let mut blind = Simulation::<8>::new(&scenario, Seed(3), 0, 1);
    let behind = Attitude { w: 0.0, x: 0.0, y: 0.0, z: 1.0 };
    for _ in 0..40 {
        blind.put(0, State { world_from_body: behind, ..blind.state(0) });
        hold(&mut blind, Vector3::new(-0.3, -0.2, 0.5));
    }
    let way = told(&blind);
    assert!(way.y < 0.2 && way.x > 0.7, "{way} leads on to the wall");
}

#[test]
fn near_the_goal_the_direction_reads_shorter() {
    let mut simulation = Simulation::<8>::new(&with_a_way(), Seed(3), 0, 1);
    for (x, length) in [(1.1, 0.5), (1.3, 0.25)] {
        (0..40).for_each(|_| hold(&mut simulation, Vector3::new(x, 0.0, 0.5)));
        let way = told(&simulation);
        assert!((way.norm() - length).abs() < 0.05 && way.x > 0.9 * way.norm(), "{way} at x = {x}");
    }
}

#[test]
fn a_table_is_reached_from_above() {
    let mut scenario = with_a_way();
    let (low, high) = (Vector3::new(1.2, -0.3, 0.0), Vector3::new(1.8, 0.3, 0.48));
    let table = Solid::block("table", low, high);
    scenario.aviary.world.solids.push(Solid { role: Role::Landing, ..table });
    let mut simulation = Simulation::<8>::new(&scenario, Seed(3), 0, 1);
    (0..40).for_each(|_| hold(&mut simulation, Vector3::new(0.9, 0.0, 0.3)));
    let ahead = simulation.ahead(0).unwrap();
    assert!(ahead.z > 0.48 || ahead.x < 1.1, "{ahead} is beside the table's edge");
}

#[test]
fn an_episode_begins_without_a_map() {
    let [mut one, mut other] = [(); 2].map(|()| Simulation::<8>::new(&with_a_way(), Seed(3), 0, 1));
    let mut periods = 0;
    while one.take_episodes().is_empty() {
        hold(&mut one, Vector3::new(-0.3, -0.5, 0.5));
        hold(&mut other, Vector3::new(-0.7, 0.6, 0.7));
        periods += usize::from(one.observations() != other.observations());
    }
    assert!(periods > 10, "they were in different places for {periods} periods");
    for _ in 0..10 {
        assert_eq!(one.observations(), other.observations());
        one.step(&[0.0; 4]);
        other.step(&[0.0; 4]);
    }
}

#[test]
fn maps_are_the_same_for_any_lanes_and_after_a_restore() {
    let scenario = with_a_way();
    let mut one = Simulation::<64>::new(&scenario, Seed(5), 0, 9);
    let mut other = Simulation::<1>::new(&scenario, Seed(5), 0, 9);
    for step in 0..90 {
        if step == 33 {
            let saved = one.save();
            one = Simulation::new(&scenario, Seed(6), 0, 9);
            assert!(one.restore(&saved));
            let mapless = Simulation::<64>::new(&behind_a_wall(ANYWHERE), Seed(6), 0, 9).restore(&saved);
            assert!(!mapless, "a state belongs to its scenario");
        }
        let actions = noise(step, 36);
        one.step(&actions);
        other.step(&actions);
        assert_eq!(one.observations(), other.observations(), "step {step}");
    }
}

/// Observations and rewards of flights of noise.
fn trace<const LANES: usize>(scenario: &Scenario) -> Vec<f32>
where
    Simulation<LANES>: Compiled<f32>,
{
    let mut simulation = Simulation::<LANES>::new(scenario, Seed(6), 0, 24);
    let mut trace = Vec::new();
    for step in 0..80 {
        simulation.step(&noise(step, 96));
        trace.extend_from_slice(simulation.observations());
        trace.extend_from_slice(simulation.rewards());
    }
    trace
}

#[test]
fn the_bits_of_a_scan_do_not_depend_on_lanes() {
    let scenario = behind_a_wall(ON_THE_WAY);
    assert!(trace::<64>(&scenario) == trace::<1>(&scenario));
}

#[test]
fn a_drone_that_sinks_onto_the_pad_and_stays_there_has_landed() {
    let landing = |rules: &str| {
        let mut scenario = scenario(&format!(
            "aviary: {{ goal_m: [0, 0, 0.14], solids: [ {{ low_m: [-0.2, -0.2, 0], high_m: [0.2, 0.2, 0.125], role: landing }} ] }}
action: {{ velocity: {{}} }}
start: {{ position: {{ exactly: [ {{ position_m: [0, 0, 0.3] }} ] }} }}
rewards: [ success: {{ weight: 1 }} ]
terminations: [ {rules}, collision ]
episode_secs: 4
success: ending"
        ));
        scenario.start = Start { tilt_limit: 0.0, ..scenario.start };
        let mut simulation = Simulation::<64>::new(&scenario, Seed(2), 0, 1);
        (0..400).for_each(|_| simulation.step(&[0.0, 0.0, -0.2, 0.0]));
        simulation.take_episodes().remove(0)
    };
    let touched = landing("landing");
    let rested = landing("rest: { speed_limit_m_per_s: 0.05, tilt_limit_deg: 15, rest_secs: 1 }");
    assert_eq!((touched.ending, rested.ending), (Ending::Success, Ending::Success));
    assert!(rested.steps >= touched.steps + 99, "{} steps after {}", rested.steps, touched.steps);
}

#[test]
fn a_drone_knows_the_cells_that_it_visited_in_this_episode_and_the_nearest_that_is_left() {
    const CELLS: usize = 3;
    const DRONES: usize = 8;
    let scenario = scenario(
        "aviary: { goal_m: [0, 0, 1] }
start: { position: { within: { low_m: [-1.4, -1.4, 1], high_m: [1.4, 1.4, 2] } }, speed_limit_m_per_s: 3 }
physics: { control_rate_hz: 50 }
sensors: [ coverage: { cells: 3, next_scale_m: 2 } ]
observation: measured
critic: observation
rewards: [ field_coverage: { weight: 1, cells: 3 } ]
episode_secs: 0.6
success: { settle: { radius_m: 0.5, within_secs: 0.1 } }
",
    );
    let mut simulation = Simulation::<8>::new(&scenario, Seed(2), 0, DRONES);
    let mut visited = vec![[0.0; CELLS * CELLS]; DRONES];
    let (mut entered, mut forgotten) = (0.0, 0);
    for step in 0..100 {
        for (row, visited) in visited.iter_mut().enumerate() {
            let place = simulation.state(row).position;
            let cell = [place.x, place.y].map(|along| (along + 1.5).floor());
            if cell.iter().all(|index| (0.0..3.0).contains(index)) {
                visited[CELLS * cell[0] as usize + cell[1] as usize] = 1.0;
            }
            let seen: Vec<f32> =
                simulation.observations().chunks_exact(DRONES).map(|column| column[row]).collect();
            assert_eq!(seen[..CELLS * CELLS], visited[..], "drone {row} after {step} steps");
            let told = [seen[CELLS * CELLS], seen[CELLS * CELLS + 1]].map(|along| 2.0 * along);
            let ways = (0..CELLS * CELLS)
                .filter(|cell| visited[*cell] == 0.0)
                .map(|cell| [(cell / CELLS) as f32 - 1.0 - place.x, (cell % CELLS) as f32 - 1.0 - place.y]);
            let length = |way: &[f32; 2]| way[0].hypot(way[1]);
            let expected = ways.min_by(|one, other| length(one).total_cmp(&length(other))).unwrap_or([0.0; 2]);
            let apart = length(&[told[0] - expected[0], told[1] - expected[1]]);
            assert!(apart < 1e-5, "{told:?}, expected {expected:?}");
        }
        simulation.step(&determinism::actions_of(&scenario, 0, DRONES, step));
        entered += simulation.rewards().iter().sum::<f32>();
        for (row, outcome) in simulation.outcomes().iter().enumerate() {
            if *outcome != Outcome::Running {
                visited[row] = [0.0; CELLS * CELLS];
                forgotten += 1;
            }
        }
    }
    assert!(entered > 4.0 && forgotten >= 12, "{entered} cells entered, {forgotten} episodes ended");
}
