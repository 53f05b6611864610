//! The terms that are rates, or paid once.

use super::*;

#[test]
fn rates_are_paid_by_the_second() {
    assert_near(Trial::of("alive: { weight: 3 }").pay(), 3.0 / 48.0);
    assert_near(Trial::of("distance: { weight: -2 }").away(1.5), -3.0 / 48.0);
    let mut proximity = Trial::of("proximity: { weight: 4, scale_m: 0.5 }");
    assert_all_near(&[0.0, 0.5, 1.0].map(|d| proximity.away(d)), &[4.0, 2.0, 0.8].map(|v| v / 48.0));
    assert_near(Trial::of("velocity: { weight: 1 }").moving([1.0, -2.0, 3.0]), 14.0 / 48.0);
}

#[test]
fn body_rates_tilt_and_actions_cost_their_squares() {
    let mut rates = Trial::of("body_rates: { weight: -1 }");
    rates.swarm.body_rates = [[2.0], [1.0], [-1.0]];
    assert_near(rates.pay(), -6.0 / 48.0);
    let mut tilt = Trial::of("tilt: { weight: 1 }");
    assert_near(tilt.turned(turn(ROLL, core::f64::consts::FRAC_PI_3)), 0.5 / 48.0);
    assert_near(tilt.turned(turn(YAW, 2.0)), 0.0);
    let mut action = Trial::of("action: { weight: 1 }");
    action.action = [0.5, -0.5, 1.0, 0.0];
    assert_near(action.pay(), 1.5 / 48.0);
    let mut change = Trial::of("action_change: { weight: 1 }");
    (change.action, change.previous_action) = ([1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.5]);
    assert_near(change.pay(), 4.25 / 48.0);
}

#[test]
fn turning_costs_either_way_round_and_rolling_nothing() {
    let mut turning = Trial::of("yaw_rate: { weight: -1 }");
    for about_z in [0.5, -0.5] {
        turning.swarm.body_rates = [[2.0], [1.0], [about_z]];
        assert_near(turning.pay(), -0.5 / 48.0);
    }
}

#[test]
fn advance_pays_for_the_way_around_a_wall() {
    let mut advance = Trial::of("advance: { weight: 2 }");
    assert_near(advance.at(0.0, 0.5, 0.0), 0.0);
    assert!((advance.at(0.0, 0.25, 0.0) - 0.5).abs() < 1e-3);
    assert!((advance.at(0.0, 0.5, 0.0) + 0.5).abs() < 1e-3);
    // Behind the wall it pays for flying away from the goal, towards the passage, as far as that is the way.
    advance.at(1.5, 0.0, 0.0);
    assert!(advance.at(1.5, -0.5, 0.0) > 0.5);
    let mut progress = Trial::of("progress: { weight: 2 }");
    (progress.previous_distance, progress.distance) = (1.5, 1.5_f64.hypot(0.5));
    assert!(progress.pay() < 0.0);
}

#[test]
fn progress_shaping_and_endings_are_paid_as_they_are() {
    let mut progress = Trial::of("progress: { weight: 2 }");
    (progress.previous_distance, progress.distance) = (1.0, 0.75);
    assert_near(progress.pay(), 0.5);
    let mut shaping = Trial::of("shaping: { weight: 1, discount: 0.5 }");
    (shaping.previous_distance, shaping.distance) = (1.0, 0.75);
    assert_near(shaping.pay(), 0.625);
    let mut success = Trial::of("success: { weight: 10 }");
    let mut failure = Trial::of("failure: { weight: -5 }");
    assert_all_near(&[success.pay(), failure.pay()], &[0.0, 0.0]);
    (success.ends.success, failure.ends.failure) = ([1.0], [1.0]);
    assert_all_near(&[success.pay(), failure.pay()], &[10.0, -5.0]);
}

#[test]
fn only_those_who_are_named_are_paid() {
    let paid = |agents: &str| {
        let mut trial = Trial::of(&format!("squared_distance: {{ weight: 1, agents: {agents} }}"));
        trial.team = vec![[[0.0]; 3]; 3];
        trial.distance = 1.0;
        [0, 1, 2].map(|agent| {
            trial.agent = agent;
            trial.pay()
        })
    };
    assert_eq!(paid("all"), [-1.0; 3]);
    assert_eq!(paid("first"), [-1.0, 0.0, 0.0]);
    assert_eq!(paid("others"), [0.0, -1.0, -1.0]);
}
