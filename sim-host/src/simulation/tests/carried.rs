//! Bodies that go with the goal: a landing pad that moves.

use kestrel_core::airframe::CF2X;

use super::determinism::assert_deterministic;
use super::*;
use crate::outcome::Ending::TimeLimit;

/// A drone close above a pad, half of a metre square, that drives along x.
const PAD: &str = "
aviary:
  goal_m: [0, 0, 0.33]
  carried: [ { name: pad, low_m: [-0.5, -0.5, 0.2], high_m: [0.5, 0.5, 0.3], role: landing } ]
goals: { line: { velocity_m_per_s: [0.4, 0, 0] } }
physics: { substeps: 4, control_rate_hz: 50, contacts: solved }
start: { position: { within: { low_m: [-0.05, -0.05, 0.33], high_m: [0.05, 0.05, 0.36] } } }
rewards: [ no_collision: { weight: 1 } ]
episode_secs: 2
success: { settle: { radius_m: 0.2, within_secs: 1 } }
";

/// Where the pad is, and the drone.
fn places(simulation: &Simulation<8>, environment: usize) -> [Vector3<f64>; 2] {
    [simulation.movables(environment)[0].position, simulation.state(environment).position.cast()]
}

#[test]
fn bits_of_drones_on_a_pad_that_moves() {
    assert_deterministic(PAD, 120, &[TimeLimit]);
    let wave = "wave: { amplitude_m: [0.3, 0, 0], rate_rad_per_s: 2, until_secs: 60 }";
    assert_deterministic(&PAD.replace("line: { velocity_m_per_s: [0.4, 0, 0] }", wave), 120, &[TimeLimit]);
}

#[test]
fn a_drone_that_lies_on_a_pad_goes_with_it() {
    let scenario = scenario(PAD);
    let mut simulation = Simulation::<8>::new(&scenario, Seed(1), 0, 3);
    let idle = vec![-1.0; scenario.action.len() * 3];
    let mut settled = Vec::new();
    for step in 0..99 {
        simulation.step(&idle);
        let [pad, drone] = places(&simulation, 0);
        assert!((pad - Vector3::new(0.4 * 0.02 * f64::from(step + 1), 0.0, 0.25)).norm() < 1e-6, "{step}: {pad}");
        if step >= 50 {
            settled.push(drone - pad);
        }
    }
    let drift = (settled[settled.len() - 1] - settled[0]).norm();
    assert!(drift < 2e-3, "it slides by {drift} m");
    assert!((settled[0].z - 0.05 - 0.5 * CF2X.collision_height).abs() < 0.01, "{}", settled[0]);
    simulation.step(&idle);
    let [pad, _] = places(&simulation, 0);
    assert_eq!(pad, Vector3::new(0.0, 0.0, 0.25), "it is back where episodes begin");
}

#[test]
fn a_pad_moves_as_well_where_no_drone_is_near() {
    let far = PAD.replace("0.33], high_m: [0.05, 0.05, 0.36]", "3.0], high_m: [0.05, 0.05, 3.1]");
    let [near, far] = [scenario(PAD), scenario(&far)].map(|scenario| {
        let mut simulation = Simulation::<8>::new(&scenario, Seed(1), 0, 1);
        (0..20).for_each(|_| simulation.step(&vec![-1.0; scenario.action.len()]));
        places(&simulation, 0)[0]
    });
    assert_eq!(near, far);
}

#[test]
fn a_wall_that_moves_is_touched_in_the_period_in_which_it_arrives() {
    // 23.5 control periods from the hovering drone.
    let gap = 0.5 * 0.02 * 23.5;
    let wall = format!(
        "
aviary:
  goal_m: [0, 0, 0.5]
  carried: [ {{ low_m: [-1, -1, 0], high_m: [{}, 1, 1] }} ]
goals: {{ line: {{ velocity_m_per_s: [0.5, 0, 0] }} }}
physics: {{ substeps: 4, control_rate_hz: 50 }}
start: {{ position: {{ exactly: [ {{ position_m: [0, 0, 0.5] }} ] }} }}
rewards: [ no_collision: {{ weight: 1 }} ]
terminations: [ collision ]
success: {{ settle: {{ radius_m: 0.2, within_secs: 1 }} }}
",
        -CF2X.collision_radius - gap
    );
    let scenario = scenario(&wall);
    let mut simulation = Simulation::<8>::new(&scenario, Seed(1), 0, 1);
    let hover = vec![0.0; scenario.action.len()];
    let steps = (1..100).find(|_| {
        simulation.step(&hover);
        !simulation.take_episodes().is_empty()
    });
    assert_eq!(steps, Some(24));
}

#[test]
fn what_would_stay_or_be_pushed_is_refused() {
    let refused = |yaml: &str| {
        let document = Document::parse("trial.yaml", yaml).unwrap();
        Scenario::of("trial", &document).unwrap_err().to_string()
    };
    let stays = refused(&PAD.replace("goals: { line: { velocity_m_per_s: [0.4, 0, 0] } }", ""));
    assert!(stays.contains("`pad`, which goes with the goal, and a goal that stays"), "{stays}");
    let bullet = "{ bullet: { mode: pyb }, substeps: 5, control_rate_hz: 48 }";
    let pushed = refused(&PAD.replace("{ substeps: 4, control_rate_hz: 50, contacts: solved }", bullet));
    assert!(pushed.contains("carried in `physics.bullet`"), "{pushed}");
}
