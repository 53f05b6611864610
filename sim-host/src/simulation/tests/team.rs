//! Several drones in an environment, moving goals, and the clocks that move them.

use super::*;
use crate::outcome::Ending;
use crate::outcome::Outcome::{Running, Terminated, Truncated};

/// Drones that hang in the air at these places \[m\], each with its own physics and a goal of its own.
fn hanging(places: &[[f64; 3]], more: &str) -> Scenario {
    let places: Vec<String> = places.iter().map(|place| format!("{{ position_m: {place:?} }}")).collect();
    scenario(&format!(
        "aviary: {{ goal_m: [0, 0, 1] }}
start: {{ position: {{ exactly: [ {} ] }} }}
physics: {{ control_rate_hz: 50 }}
critic: observation
success: {{ settle: {{ radius_m: 0.5, within_secs: 0.1 }} }}
{more}
",
        places.join(", ")
    ))
}

/// Flies steps of the zero action and returns rewards and outcomes of each.
fn steps(simulation: &mut Simulation<1, f64>, count: usize) -> Vec<(Vec<f64>, Vec<Outcome>)> {
    let actions = vec![0.0; simulation.scenario().action.len() * simulation.rows()];
    let step = |_| {
        simulation.step(&actions);
        (simulation.rewards().to_vec(), simulation.outcomes().to_vec())
    };
    (0..count).map(step).collect()
}

const THREE: [[f64; 3]; 3] = [[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 2.0, 1.0]];

/// The third of three drones is out of bounds from the start.
fn third_is_lost(agents: &str) -> Simulation<1, f64> {
    let agents = format!("agents: {{ count: 3, {agents} }}");
    let more = format!("{agents}\nrewards: [ distance: {{ weight: 50 }} ]\nepisode_secs: 0.2");
    let mut scenario = hanging(&THREE, &more);
    // A configuration that said so would be refused.
    scenario.terminations = vec![termination::Distance { limit_m: 1.5 }.into()];
    Simulation::new(&scenario, Seed(0), 0, 1)
}

#[test]
fn a_team_that_ends_together_ends_with_the_first_of_it() {
    let mut simulation = third_is_lost("ends: together");
    let flown = steps(&mut simulation, 2);
    assert_eq!(flown[0].1, [Outcome::Terminated; 3]);
    let episodes = simulation.take_episodes();
    let ends: Vec<_> = episodes.iter().map(|episode| (episode.agent, episode.steps, episode.ending)).collect();
    let one = [(0, 1, Ending::Teammate), (1, 1, Ending::Teammate), (2, 1, Ending::Distance)];
    assert_eq!(ends, [one, one].concat());
}

#[test]
fn a_team_that_ends_alone_flies_on() {
    let mut simulation = third_is_lost("ends: alone");
    let flown = steps(&mut simulation, 10);
    assert!(flown[..9].iter().all(|(_, outcomes)| outcomes[..] == [Running, Running, Terminated]));
    assert_eq!(flown[9].1, [Truncated, Truncated, Terminated]);
    let episodes = simulation.take_episodes();
    assert_eq!(episodes.iter().filter(|episode| episode.agent == 2 && episode.steps == 1).count(), 10);
    assert!(
        episodes
            .iter()
            .filter(|episode| episode.agent < 2)
            .all(|episode| { (episode.steps, episode.ending) == (10, Ending::TimeLimit) })
    );
}

#[test]
fn drones_are_paid_their_own_or_the_sum() {
    let own = steps(&mut third_is_lost("rewards: own"), 1).remove(0).0;
    assert!(own.iter().zip([0.0, 1.0, 2.0]).all(|(paid, worth)| (paid - worth).abs() < 1e-9), "{own:?}");
    let mut sharing = third_is_lost("rewards: shared");
    let shared = steps(&mut sharing, 1).remove(0).0;
    assert_eq!(shared, [own.iter().sum::<f64>(); 3]);
    // What an episode is worth is what was paid; its terms stay each drone's own.
    for (episode, own) in sharing.take_episodes().iter().zip(own) {
        assert_eq!((episode.total_reward, episode.terms[0]), (shared[0] as f32, own as f32));
    }
}

#[test]
fn rows_are_agents_and_then_environments() {
    let scenario = hanging(&THREE, "agents: { count: 3 }\nrewards: [ alive: { weight: 1 } ]");
    let simulation = Simulation::<8, f64>::new(&scenario, Seed(0), 0, 5);
    assert_eq!((simulation.rows(), simulation.environments()), (15, 5));
    for row in 0..15 {
        assert_eq!(simulation.state(row).position.y, (row / 5) as f64);
    }
}

#[test]
fn every_drone_has_its_goal() {
    let scenario = hanging(
        &THREE,
        "agents: { count: 3 }
rewards: [ squared_distance: { weight: 1 } ]
goals: { per_agent: { points_m: [[0, 0, 1.5], [1, 1, 1], [0, 2, 3]] } }",
    );
    let mut simulation = Simulation::<1, f64>::new(&scenario, Seed(0), 0, 1);
    assert_eq!(simulation.goal(1), Vector3::new(1.0, 1.0, 1.0));
    let paid = steps(&mut simulation, 1).remove(0).0;
    assert!(paid.iter().zip([-0.25, -1.0, -4.0]).all(|(paid, worth)| (paid - worth).abs() < 1e-9), "{paid:?}");
}

#[test]
fn starts_around_the_goal_are_around_each_drone_s_own() {
    let mut scenario = hanging(
        &THREE,
        "agents: { count: 3 }
rewards: [ alive: { weight: 1 } ]
goals: { per_agent: { points_m: [[0, 0, 1.5], [9, 1, 1], [0, 20, 3]] } }",
    );
    scenario.start.position = StartPosition::AroundGoal { nearest_m: 0.1, farthest_m: 0.5 };
    let simulation = Simulation::<8, f64>::new(&scenario, Seed(0), 0, 4);
    for row in 0..12 {
        let distance = (simulation.state(row).position - simulation.goal(row)).norm();
        assert!((0.0999..0.5001).contains(&distance), "row {row}: {distance} m");
    }
}

const LINE: &str = "goals: { line: { velocity_m_per_s: [0, -0.5, 0.25] } }";
const WAVE: &str = "goals: { wave: { amplitude_m: [0, 2, 0], rate_rad_per_s: 3, until_secs: 0.1 } }";

/// Goals after none, one, two … steps.
fn goals(goals: &str, clock: &str, count: usize) -> Vec<[f64; 3]> {
    let more = format!("{goals}\n{clock}\nrewards: [ squared_distance: {{ weight: 1 }} ]");
    let mut simulation = Simulation::<1, f64>::new(&hanging(&THREE[..1], &more), Seed(0), 0, 1);
    let mut found = vec![simulation.goal(0).into()];
    for _ in 0..count {
        let rewards = steps(&mut simulation, 1).remove(0).0;
        let goal = simulation.goal(0);
        assert!((rewards[0] + (simulation.state(0).position - goal).norm_squared()).abs() < 1e-12);
        found.push(goal.into());
    }
    found
}

#[test]
fn a_goal_moves_with_the_clock_and_one_period_late_as_published() {
    let on_line = |periods: f64| [0.0, -0.01 * periods, 1.0 + 0.005 * periods];
    assert_all_near(&goals(LINE, "", 3), &[0.0, 1.0, 2.0, 3.0].map(on_line));
    assert_all_near(&goals(LINE, "clock: { as_published: true }", 3), &[0.0, 0.0, 1.0, 2.0].map(on_line));
}

#[test]
fn a_wave_stops_when_it_is_told() {
    let at = |secs: f64| [0.0, 2.0 * (3.0 * secs).cos(), 1.0];
    let elapsed = [0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.1, 0.1].map(at);
    assert_all_near(&goals(WAVE, "", 7), &elapsed);
    let published = [0.0, 0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.1].map(at);
    assert_all_near(&goals(WAVE, "clock: { as_published: true }", 7), &published);
}

#[test]
fn goals_have_the_velocity_of_their_path() {
    let goals = hanging(&THREE[..1], &format!("{WAVE}\nrewards: [ alive: {{ weight: 1 }} ]")).goals;
    let along = |secs: f64, lag_secs: f64| goals.velocity_at(secs, lag_secs).y;
    assert!((along(0.05, 0.0) + 6.0 * 0.15_f64.sin()).abs() < 1e-9);
    // The average over the period before; none before the start, and for good that of the last motion.
    let average = 2.0 * (0.15_f64.cos() - 0.09_f64.cos()) / 0.02;
    assert!((along(0.05, 0.02) - average).abs() < 1e-7);
    assert_eq!((along(0.0, 0.02), along(0.2, 0.0)), (0.0, 0.0));
    assert!((along(0.2, 0.02) - 2.0 * (0.3_f64.cos() - 0.24_f64.cos()) / 0.02).abs() < 1e-7);
    let line = hanging(&THREE[..1], &format!("{LINE}\nrewards: [ alive: {{ weight: 1 }} ]")).goals;
    assert_eq!(line.velocity_at(3.0, 0.0), Vector3::new(0.0, -0.5, 0.25));
}

#[track_caller]
fn assert_all_near(found: &[[f64; 3]], expected: &[[f64; 3]]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((found - expected).abs() < 1e-7, "found {found}, expected {expected}");
    }
}

/// Success in the last step of an episode, by each rule that does not end one.
#[test]
fn settling_and_visiting_are_judged_at_the_end() {
    let success = |more: &str| {
        let mut scenario = hanging(
            &[[0.0, 0.0, 1.0]],
            &format!("rewards: [ alive: {{ weight: 1 }} ]\nepisode_secs: 0.2\n{more}"),
        );
        if let Success::Settle { within_secs, .. } = &mut scenario.success {
            *within_secs = 0.1;
        }
        let mut simulation = Simulation::<1, f64>::new(&scenario, Seed(0), 0, 1);
        steps(&mut simulation, 10);
        let episode = simulation.take_episodes().remove(0);
        assert_eq!(episode.ending, Ending::TimeLimit);
        episode.success
    };
    assert!(success(""));
    // The goal leaves the drone behind in the last two steps; the drone settled before.
    assert!(!success("goals: { line: { velocity_m_per_s: [2.9, 0, 0] } }"));
    assert!(success("goals: { line: { velocity_m_per_s: [2.4, 0, 0] } }"));
}

#[test]
fn a_visit_needs_its_periods() {
    let visited = |periods: u32, high: f32| {
        let mut scenario = hanging(&[[0.0, 0.0, 1.0]], "rewards: [ success: { weight: 7 } ]\nepisode_secs: 0.2");
        let region = Cuboid { low: Vector3::repeat(-1.0), high: Vector3::repeat(high) };
        scenario.success = Success::Visit { region, periods };
        let mut simulation = Simulation::<1, f64>::new(&scenario, Seed(0), 0, 1);
        let paid: f64 = steps(&mut simulation, 10).iter().map(|(rewards, _)| rewards[0]).sum();
        (simulation.take_episodes()[0].success, paid)
    };
    assert_eq!(visited(10, 1.1), (true, 7.0));
    assert_eq!(visited(11, 1.1), (false, 0.0));
    assert_eq!(visited(1, 0.9), (false, 0.0));
}

#[test]
fn a_success_of_all_takes_all() {
    // The third is too far from the goal; the others are near it.
    let places = [[0.0, 0.0, 1.0], [0.0, 0.4, 1.0], [0.0, 3.0, 1.0]];
    let successes = |success: &str, places: &[[f64; 3]]| -> Vec<bool> {
        let agents = format!("agents: {{ count: {}, success: {success} }}", places.len());
        let paid = "rewards: [ success: { weight: 2 } ]";
        let scenario = hanging(places, &format!("{agents}\n{paid}\nepisode_secs: 0.2"));
        let mut simulation = Simulation::<1, f64>::new(&scenario, Seed(0), 0, 1);
        let flown = steps(&mut simulation, 10);
        let episodes = simulation.take_episodes();
        let successes: Vec<bool> = episodes.iter().map(|episode| episode.success).collect();
        let paid: Vec<bool> = flown[9].0.iter().map(|reward| *reward == 2.0).collect();
        assert_eq!(successes, paid);
        successes
    };
    assert_eq!(successes("own", &places), [true, true, false]);
    assert_eq!(successes("all", &places), [false; 3]);
    assert_eq!(successes("all", &places[..2]), [true; 2]);
}

/// Drones that start near their places and see the nearer of their two mates, or hear of it by `radio`.
fn seeing(ends: &str, radio: &str) -> Scenario {
    let place = |y: usize| format!("{{ position_m: [0, {y}, 1], spread_m: 0.2 }}");
    scenario(&format!(
        "aviary: {{ goal_m: [0, 0, 1] }}
agents: {{ count: 3, ends: {ends} }}
start: {{ position: {{ exactly: [ {}, {}, {} ] }}, tilt_limit_deg: 20, speed_limit_m_per_s: 1 }}
sensors: [ mates: {{ nearest: 1, position_scale_m: 0.5, velocity_scale_m_per_s: 2{radio} }} ]
observation: {{ pilot_measured: {{}} }}
rewards: [ alive: {{ weight: 1 }} ]
terminations: [ collision, distance: {{ limit_m: 3 }}, tilt: {{ limit_deg: 40 }} ]
episode_secs: 0.3
success: {{ settle: {{ radius_m: 0.5, within_secs: 0.1 }} }}",
        place(0),
        place(1),
        place(2)
    ))
}

#[test]
fn drones_see_their_nearest_mate_where_it_is_now_even_when_one_began_anew() {
    for ends in ["together", "alone"] {
        let mut simulation = Simulation::<8>::new(&seeing(ends, ""), Seed(3), 0, 7);
        let mut ended = 0;
        for step in 0..60 {
            for row in 0..21 {
                check_nearest(&simulation, row);
            }
            simulation.step(&noise(step, ACTION_LEN * 21));
            ended += simulation.outcomes().iter().filter(|outcome| **outcome != Running).count();
        }
        assert!(ended > 21, "{ended} episodes ended");
    }
}

fn check_nearest(simulation: &Simulation<8>, row: usize) {
    let own = simulation.state(row);
    let mates = [7, 14].map(|rows| simulation.state((row + rows) % 21));
    let offsets = mates.map(|mate| mate.position - own.position);
    let nearest = usize::from(offsets[1].norm() < offsets[0].norm());
    let offset = offsets[nearest] / 0.5;
    let expected = [offset / offset.norm().max(1.0), (mates[nearest].velocity - own.velocity) / 2.0];
    let expected: Vec<f32> = expected.iter().flat_map(|part| part.iter().copied()).collect();
    let seen = simulation.observations().chunks_exact(21).skip(22).map(|column| column[row]);
    for (seen, expected) in seen.zip(expected) {
        assert!((seen - expected).abs() < 1e-5, "row {row}: {seen}, not {expected}");
    }
}

#[test]
fn bits_of_drones_that_see_each_other_do_not_depend_on_lanes() {
    fn trace<const LANES: usize>(radio: &str) -> Vec<u32>
    where
        Simulation<LANES>: Compiled<f32>,
    {
        let mut simulation = Simulation::<LANES>::new(&seeing("alone", radio), Seed(3), 0, 7);
        let mut trace = Vec::new();
        for step in 0..40 {
            simulation.step(&noise(step, ACTION_LEN * 21));
            let state = simulation.save();
            assert!(simulation.restore(&state));
            trace.extend(simulation.observations().iter().map(|value| value.to_bits()));
        }
        trace
    }
    let radio = ", radio: { rate_hz: 20, noise_m: 0.1, lost: 0.3 }";
    assert_eq!(trace::<1>(""), trace::<8>(""));
    assert_eq!(trace::<1>(radio), trace::<8>(radio));
    assert_ne!(trace::<1>(""), trace::<1>(radio));
}

#[test]
fn mates_are_seen_in_body_axes_where_it_is_asked_for() {
    let [mut in_world, mut in_body] =
        ["", ", in_body_axes: true"].map(|axes| Simulation::<8>::new(&seeing("alone", axes), Seed(3), 0, 7));
    for step in 0..10 {
        let seen = |simulation: &Simulation<8>, row: usize, first: usize| {
            Vector3::from_fn(|axis, _| simulation.observations()[(first + axis) * 21 + row])
        };
        for (row, first) in (0..21).flat_map(|row| [22, 25].map(|first| (row, first))) {
            let turned = in_body.state(row).world_from_body.rotate(seen(&in_body, row, first));
            assert!((turned - seen(&in_world, row, first)).norm() < 1e-5, "row {row}");
            assert!((seen(&in_body, row, first) - turned).norm() > 0.0 || turned.norm() == 0.0);
        }
        for simulation in [&mut in_world, &mut in_body] {
            simulation.step(&noise(step, ACTION_LEN * 21));
        }
    }
}

#[test]
fn of_all_mates_the_one_that_comes_nearest_is_met() {
    let mut scenario = seeing("alone", "");
    scenario.rewards = vec![crate::reward::Encounter { weight: -100.0, reach_m: 2.0, ahead_secs: 0.4 }.into()];
    let mut simulation = Simulation::<8>::new(&scenario, Seed(3), 0, 7);
    let mut met = 0;
    for step in 0..10 {
        simulation.step(&noise(step, ACTION_LEN * 21));
        for row in (0..21).filter(|row| simulation.outcomes()[*row] == Running) {
            let own = simulation.state(row);
            let least = [7, 14].map(|rows| {
                let mate = simulation.state((row + rows) % 21);
                let at = |part: f32| {
                    let secs = 0.4 * part / 1000.0;
                    (own.position - mate.position + (own.velocity - mate.velocity) * secs).norm()
                };
                (0..=1000).map(|part| at(part as f32)).fold(f32::INFINITY, f32::min)
            });
            let fresh = [7, 14].iter().any(|rows| simulation.outcomes()[(row + rows) % 21] != Running);
            let distance = least[0].min(least[1]) - scenario.airframe.collision_radius as f32;
            let expected = -(1.0 - distance / 2.0).max(0.0).powi(2);
            let paid = simulation.terms(row)[0];
            assert!(fresh || (paid - expected).abs() < 1e-3, "row {row}: {paid}, not {expected}");
            met += usize::from(!fresh && paid < -0.1);
        }
    }
    assert!(met > 50, "{met}");
}

const CURVES: &str = "goals: { trajectory: { reach_m: [0.3, 0.6], rise_m: [0.1, 0.1], speed_m_per_s: [0.5, 1] } }
sensors: [ path: { points: 3, spacing_secs: 0.1, position_scale_m: 0.5 } ]
observation: { body: { position_scale_m: 1, velocity_scale_m_per_s: 1, body_rates_scale_rad_per_s: 1 } }
rewards: [ squared_distance: { weight: 1 } ]";

#[test]
fn goals_follow_curves_of_their_own_and_drones_see_where_they_will_be() {
    let scenario = hanging(&THREE[..1], CURVES);
    let mut simulation = Simulation::<1, f64>::new(&scenario, Seed(0), 0, 8);
    let rows = simulation.rows();
    let goals = |simulation: &Simulation<1, f64>| (0..rows).map(|row| simulation.goal(row)).collect::<Vec<_>>();
    // The path ahead, world, by rows: where the goal will be after each tenth of a second, which is five periods.
    let seen = |simulation: &Simulation<1, f64>, point: usize, row: usize| {
        let first = scenario.observation.len() - 9 + 3 * point;
        let value = |axis: usize| 0.5 * simulation.observations()[(first + axis) * rows + row];
        let state = simulation.state(row);
        state.position + state.world_from_body.rotate(Vector3::new(value(0), value(1), value(2)))
    };
    let first: Vec<Vec<Vector3<f64>>> =
        (0..rows).map(|row| (0..3).map(|point| seen(&simulation, point, row)).collect()).collect();
    let start = goals(&simulation);
    assert!((1..rows).all(|row| (start[row] - start[0]).norm() > 1e-3), "each has its own");
    for point in 0..3 {
        steps(&mut simulation, 5);
        for (row, goal) in goals(&simulation).into_iter().enumerate() {
            assert!((first[row][point] - goal).norm() < 1e-6, "point {point} of row {row}");
            assert!(
                (goal - start[row]).norm() < 0.1 * (point + 1) as f64 * 1.001,
                "no faster than a metre a second"
            );
        }
    }
}
