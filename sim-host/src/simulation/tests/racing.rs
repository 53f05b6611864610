//! Races: gates are passed in their order, forwards, and what leads along the course is progress.

use super::*;
use crate::config::Document;
use crate::outcome::Ending;

/// Through the first gate towards +x, through the second, on the left, towards +y, and through the first again.
fn course(goals: &str, more: &str) -> Result<Scenario, String> {
    let yaml = format!(
        "aviary:
  gates:
    - {{ at_m: [1, 0, 1] }}
    - {{ at_m: [2, 1, 1.2], heading_deg: 90, opening_m: [0.8, 0.6] }}
goals: {goals}
action: {{ velocity: {{}} }}
start: {{ position: {{ within: {{ low_m: [-0.1, -0.1, 0.9], high_m: [0.1, 0.1, 1.1] }} }} }}
rewards: [ progress: {{ weight: 1 }} ]
terminations: [ finish, collision ]
episode_secs: 8
success: ending
{more}"
    );
    let document = Document::parse("race.yaml", &yaml).unwrap();
    let first_line = |text: String| text.lines().next().unwrap_or_default().to_owned();
    Scenario::of("race", &document).map_err(|error| first_line(error.to_string()))
}

const GATES_AHEAD: &str =
    "sensors: [ gates: { ahead: 2, position_scale_m: 2 } ]\nobservation: { pilot_measured: {} }";

/// Puts the lone drone at these places one after the other, and lets it hover there for a control period.
fn led(simulation: &mut Simulation<1>, places: &[[f32; 3]]) -> (f32, Vec<Episode>) {
    let mut reward = 0.0;
    for place in places {
        simulation.put(0, State { position: (*place).into(), velocity: Vector3::zeros(), ..simulation.state(0) });
        simulation.step(&[0.0; 4]);
        reward += simulation.rewards()[0];
    }
    (reward, simulation.take_episodes())
}

/// The goal of the lone drone in centimetres.
fn goal(simulation: &Simulation<1>) -> [i32; 3] {
    simulation.goal(0).map(|metres| (100.0 * metres).round() as i32).into()
}

#[test]
fn gates_are_passed_in_their_order_until_the_finish() {
    let scenario = course("{ gates: { order: [1, 2, 1] } }", GATES_AHEAD).unwrap();
    let mut simulation = Simulation::<1>::new(&scenario, Seed(3), 0, 1);
    let begin = (simulation.state(0).position - simulation.goal(0)).norm();
    assert_eq!(goal(&simulation), [100, 0, 100]);
    let (nearer, _) = led(&mut simulation, &[[0.5, 0.0, 1.0], [1.2, 0.6, 1.0]]);
    assert_eq!(goal(&simulation), [100, 0, 100], "it went past the first gate, not through it");
    let (through, _) = led(&mut simulation, &[[0.5, 0.0, 1.0], [1.2, 0.0, 1.0]]);
    assert_eq!(goal(&simulation), [200, 100, 120]);
    let (second, _) = led(&mut simulation, &[[2.0, 0.8, 1.2], [2.0, 1.3, 1.2]]);
    assert_eq!(goal(&simulation), [100, 0, 100], "the first gate comes again");
    let (back, episodes) = led(&mut simulation, &[[1.2, 0.0, 1.0]]);
    assert!(episodes.is_empty() && goal(&simulation) == [100, 0, 100], "it came back through it from behind");
    let (last, episodes) = led(&mut simulation, &[[0.8, 0.0, 1.0], [1.0, 0.0, 1.0]]);
    let [episode] = &episodes[..] else { panic!("{episodes:?}") };
    assert!(episode.success && episode.ending == Ending::Success);
    // From the start to the middle of the first gate and along both legs; it hovers a few millimetres away from there.
    let length = begin + 2.0 * Vector3::new(1.0_f32, 1.0, 0.2).norm();
    let rewards = nearer + through + second + back + last;
    assert!((rewards - length).abs() < 0.02, "{rewards} for {length} m");
}

#[test]
fn a_drone_sees_itself_as_from_the_next_gates() {
    let scenario = course("{ gates: {} }", GATES_AHEAD).unwrap();
    let mut simulation = Simulation::<1>::new(&scenario, Seed(3), 0, 1);
    let told = |simulation: &Simulation<1>| -> Vec<i32> {
        simulation.observations()[22..].iter().map(|value| (20.0 * value).round() as i32).collect()
    };
    led(&mut simulation, &[[0.0, 0.2, 1.0]]);
    // 1 m before the first and 0.2 m left of it; 0.8 m before the second, 2 m left of it and 0.2 m below.
    assert_eq!(told(&simulation), [-10, 2, 0, 20, 0, -8, 20, -2, 0, 20]);
    led(&mut simulation, &[[1.2, 0.0, 1.0]]);
    assert_eq!(told(&simulation), [-10, 8, -2, 0, 20, -10, 8, -2, 0, 20], "the last is told again");
}

#[test]
fn a_race_is_the_same_for_lanes_and_goes_on_to_the_same_bits() {
    let scenario = course("{ gates: { laps: 3 } }", GATES_AHEAD).unwrap();
    let mut wide = Simulation::<64>::new(&scenario, Seed(8), 0, 16);
    let mut lone = Simulation::<1>::new(&scenario, Seed(8), 0, 16);
    let fly = |step: usize| -> Vec<f32> { noise(step, 64).iter().map(|value| 0.3 * value + 0.2).collect() };
    let mut saved = None;
    for step in 0..240 {
        if step == 100 {
            saved = Some(wide.save());
        }
        wide.step(&fly(step));
        lone.step(&fly(step));
        assert_eq!(wide.observations(), lone.observations(), "step {step}");
    }
    let end = wide.observations().to_vec();
    assert!(wide.restore(&saved.unwrap()));
    (100..240).for_each(|step| wide.step(&fly(step)));
    assert_eq!(wide.observations(), end);
}

#[test]
fn courses_that_cannot_be_flown_are_refused() {
    let refused = |goals: &str, more: &str| course(goals, more).unwrap_err();
    let found = refused("{ gates: { order: [1, 3] } }", "");
    assert!(found.contains("goals.gates.order.1: found 3, expected a whole number from 1 to 2"), "{found}");
    let found = refused("{ gates: { order: [1, 1] } }", "");
    assert!(found.contains("goals.gates.order.1: found 1, expected another gate than the one before"), "{found}");
    let found = refused("{ gates: { order: [1, 2, 1], laps: 2 } }", "");
    assert!(found.contains("found a lap that begins at the gate where it ends"), "{found}");
    let found = refused("{ gates: { laps: 101 } }", "");
    assert!(found.contains("goals.gates.laps: found 101"), "{found}");
    let found = refused("{ line: { velocity_m_per_s: [0, 0, 0] } }", "");
    assert!(found.contains("found `finish` without a course, expected `gates` under `goals`"), "{found}");
}

#[test]
fn what_needs_gates_is_refused_without_them() {
    let refused = |yaml: &str| {
        let document = Document::parse("race.yaml", yaml).unwrap();
        Scenario::of("race", &document).unwrap_err().to_string()
    };
    let task = |more: &str| {
        format!(
            "aviary: {{ goal_m: [0, 0, 1] }}\nstart: {{ position: {{ around_goal: {{ farthest_m: 0.1 }} }} }}\n\
             rewards: [ alive: {{ weight: 1 }} ]\nsuccess: {{ settle: {{ radius_m: 0.1, within_secs: 1 }} }}\n{more}"
        )
    };
    let found = refused(&task("goals: { gates: {} }"));
    assert!(
        found.contains("goals.gates: found a course without gates, expected `gates` in the `aviary`"),
        "{found}"
    );
    let found = refused(&task(GATES_AHEAD));
    assert!(
        found.contains("sensors.0: found `gates` without a course, expected `gates` under `goals`"),
        "{found}"
    );
    let gate = task("goals: { gates: {} }")
        .replace("goal_m", "gates: [ { at_m: [1, 0, 1], opening_m: [0.1, 1] } ], goal_m");
    let found = refused(&gate);
    assert!(found.contains("aviary.gates.0.opening_m.0: found 0.1"), "{found}");
}
