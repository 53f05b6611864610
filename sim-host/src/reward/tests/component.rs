//! The reference's components: the numbers follow from the formulas of section 7 of its fact sheet.

use super::*;

#[test]
fn bounds_cost_outside_the_box_and_not_on_its_surface() {
    let mut bounds = Trial::of("bounds: { weight: 10, bounds: { low_m: [-1, -1, 0.5], high_m: [5, 1, 1] } }");
    let places = [[0.0, 0.0, 0.75], [5.0, 1.0, 1.0], [5.001, 0.0, 0.75], [0.0, -1.001, 0.75], [0.0, 0.0, 0.499]];
    assert_all_near(&bounds.along(&places), &[0.0, 0.0, -10.0, -10.0, -10.0]);
}

#[test]
fn bounds_can_cost_more_with_every_step() {
    let mut bounds = Trial::of(
        "bounds: { weight: 1, bounds: { low_m: [0, 0, 0], high_m: [1, 1, 1] }, grows_with_steps: true }",
    );
    let paid: Vec<f64> = (0..100).map(|_| bounds.at(2.0, 0.5, 0.5)).collect();
    assert_all_near(&[paid[0], paid[3], paid[99]], &[0.0, -0.5, -0.9]);
}

#[test]
fn collisions_cost_outside_the_area_where_they_are_allowed() {
    let mut anywhere = Trial::of("collision: { weight: 10 }");
    assert_near(anywhere.pay(), 0.0);
    anywhere.touches[1] = [1.0];
    assert_near(anywhere.pay(), 0.0);
    anywhere.touches[0] = [1.0];
    assert_near(anywhere.pay(), -10.0);
    let mut allowed = Trial::of("collision: { weight: 1, allowed: { x_m: [4, 5], y_m: [-1, 1] } }");
    allowed.touches[0] = [1.0];
    let places = [[4.5, 0.0, 9.0], [4.0, 0.0, 0.1], [4.5, 1.0, 0.1]];
    assert_all_near(&allowed.along(&places), &[0.0, -1.0, -1.0]);
}

#[test]
fn staying_clear_pays_and_touching_costs_as_much() {
    let mut clear = Trial::of("no_collision: { weight: 0.001, allowed: { x_m: [4, 5], y_m: [-1, 1] } }");
    assert_near(clear.at(0.0, 0.0, 1.0), 0.001);
    clear.touches[0] = [1.0];
    assert_all_near(&clear.along(&[[0.0, 0.0, 1.0], [4.5, 0.0, 1.0]]), &[-0.001, 0.001]);
}

#[test]
fn delta_distance_pays_for_coming_nearer() {
    let text = "delta_distance: { weight: 1, landing_zone_m: [1, 0, 0.5]";
    let mut published = Trial::of(&format!("{text}, as_published: true }}"));
    // First step; 5 mm, 15 mm nearer; arrived, which is not remembered; nearer than before that; standing; away.
    let places = [2.0, 1.995, 1.98, 1.05, 1.96, 1.96, 2.5].map(|x| [x, 0.0, 9.0]);
    assert_all_near(&published.along(&places), &[0.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0]);
    let mut corrected = Trial::of(&format!("{text} }}"));
    assert_all_near(&corrected.along(&places), &[0.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0]);
}

#[test]
fn delta_distance_v2_looks_at_the_wrong_height_as_published() {
    let text = "delta_distance_v2: { weight: 1, landing_zone_m: [0, 0, 0.25]";
    let mut published = Trial::of(&format!("{text}, as_published: true }}"));
    let mut corrected = Trial::of(&format!("{text} }}"));
    // 0.51347 m and 0.25 m high; the radius of both is 9.9 cm.
    let heights = [0.51347, 0.51347 + 0.0989, 0.51347 + 0.0991, 0.25, 0.25 - 0.0989].map(|z| [0.0, 0.0, z]);
    assert_all_near(&published.along(&heights), &[1.0, 1.0, 0.0, -1.0, -1.0]);
    assert_all_near(&corrected.along(&heights), &[0.0, -1.0, -1.0, 1.0, 1.0]);
}

#[test]
fn safe_delta_distance_pays_by_the_stride() {
    let text = "safe_delta_distance: { weight: 1, landing_zone_m: [6.5, 0, 0.75], delta_m: 0.05";
    let mut published = Trial::of(&format!("{text}, as_published: true }}"));
    // The first step sets the reference; then a quarter of a metre, 15 cm, back out, and 25 cm from the reference.
    let places = [-0.5, -0.25, -0.1, -3.0, 0.01].map(|x| [x, 0.0, 1.51347]);
    assert_all_near(&published.along(&places), &[0.0, 1.0, 0.0, 0.0, 1.0]);
    assert_all_near(&published.along(&[[6.5, 0.0, 1.42], [6.5, 0.0, 1.42]]), &[1.0, 1.0]);
    let mut corrected = Trial::of(&format!("{text} }}"));
    let places = [-0.5, -0.46, -0.44, 6.41, 6.41].map(|x| [x, 0.0, 0.75]);
    assert_all_near(&corrected.along(&places), &[0.0, 0.0, 1.0, 1.0, 1.0]);
}

#[test]
fn distance_root_is_one_at_the_target_and_negative_beyond_five_metres() {
    let mut planar = Trial::of("distance_root: { weight: 2, landing_zone_m: [0, 0, 0.25] }");
    let places = [[0.0, 0.0, 7.0], [0.75, -1.0, 7.0], [5.0, 0.0, 7.0], [0.0, 20.0, 7.0]];
    assert_all_near(&planar.along(&places), &[2.0, 1.0, 0.0, -2.0]);
    let text = "distance_root_v2: { weight: 1, landing_zone_m: [0, 0, 0.25]";
    assert_near(Trial::of(&format!("{text} }}")).at(0.0, 0.0, 1.5), 0.5);
    assert_near(Trial::of(&format!("{text}, as_published: true }}")).at(0.0, 0.0, 1.76347), 0.5);
}

#[test]
fn safe_distance_pays_for_being_in_the_room() {
    let text = "safe_distance: { weight: 0.5, landing_zone_m: [6.5, 0, 0.75]";
    let mut room = Trial::of(&format!("{text} }}"));
    // Half of 0.34274 at the start of the rooms, as the reference pays.
    assert!((room.at(-0.5, 0.0, 0.5) - 0.17137).abs() < 5e-6);
    assert_all_near(&room.along(&[[6.5, 0.0, 0.75], [26.5, 0.0, 0.75], [99.0, 0.0, 0.75]]), &[0.5, 0.0, 0.0]);
    let mut near = Trial::of(&format!("{text}, reach_m: 1 }}"));
    assert_near(near.at(6.5, 0.0, 0.75 - 0.03125), 0.5 * (1.0 - 0.25));
}

#[test]
fn dropping_pays_near_the_target() {
    let mut drop = Trial::of("drop_altitude: { weight: 1, landing_zone_m: [0, 0, 0], start_distance_m: 1 }");
    let places = [
        [1.0, 0.0, 1.0],       // not yet
        [0.9, 0.0, 2.0],       // first
        [0.9, 0.0, 2.0],       // level
        [0.9, 0.0, 2.000_001], // within 1e-6, nearly
        [0.9, 0.0, 1.5],
        [0.9, 0.0, 1.6],
        [2.0, 0.0, 1.5],
        [0.9, 0.0, 1.9], // first again
    ];
    assert_all_near(&drop.along(&places), &[0.0, 1.0, 1.0, 1.0, 1.0, -1.0, 0.0, 1.0]);
}

#[test]
fn a_cell_pays_once() {
    let mut field = Trial::of("field_coverage: { weight: 2, cells: 5 }");
    let places = [[0.0, 0.0, 1.0], [0.4, 0.4, 3.0], [0.6, 0.4, 1.0], [0.0, 0.0, 1.0], [-2.4, 2.4, 1.0]];
    assert_all_near(&field.along(&places), &[2.0, 0.0, 2.0, 0.0, 2.0]);
    // A metre beyond the low borders rounds towards zero; beyond the high ones nothing does.
    let beyond = [[-3.4, 0.0, 1.0], [0.0, -3.49, 1.0], [-3.5, 1.0, 1.0], [2.5, 0.0, 1.0]];
    assert_all_near(&field.along(&beyond), &[0.0; 4]);
    let mut published = Trial::of("field_coverage: { weight: 2, cells: 5, as_published: true }");
    assert_all_near(&published.along(&beyond), &[2.0, 2.0, 0.0, 0.0]);
}

#[test]
fn landing_pays_ten_from_the_tenth_step_above_the_pad() {
    let text = "landing: { weight: 1, landing_zone_m: [0, 0, 0.0625]";
    let mut published = Trial::of(&format!("{text}, as_published: true }}"));
    assert_near(published.at(0.15, 0.0, 1.0), 0.0);
    // The height that pays most is 3.75 cm below the floor.
    assert_near(published.at(0.149, 0.0, 0.1625), 0.8);
    let paid: Vec<f64> = (0..9).map(|_| published.at(0.0, 0.0, 0.1625)).collect();
    assert_all_near(&paid, &[0.8, 0.8, 0.8, 0.8, 0.8, 0.8, 0.8, 0.8, 10.0]);
    assert!(published.term.memory().lasts);
    let mut corrected = Trial::of(&format!("{text} }}"));
    assert_near(corrected.at(0.0, 0.0, 0.13847), 1.0);
    assert_near(corrected.at(0.0, 0.0, 0.33847), 0.8);
    assert!(!corrected.term.memory().lasts);
}

#[test]
fn landing_v2_pays_most_inside_the_pad_as_published() {
    let text = "landing_v2: { weight: 10, landing_zone_m: [0, 0, 0.0625]";
    let mut published = Trial::of(&format!("{text}, as_published: true }}"));
    // A resting drone is paid 0.932, not 1.
    assert!((published.at(0.0, 0.0, 0.1385) - 9.32).abs() < 5e-3);
    assert_near(published.at(0.0, 0.0, 0.1385), 10.0 * (0.92403 - (0.1385 - 0.07597)) / 0.92403);
    assert_near(published.at(0.0, 0.0, 0.0764), 10.0);
    let mut corrected = Trial::of(&format!("{text} }}"));
    assert_all_near(&corrected.along(&[[0.0, 0.0, 0.1385], [0.099, 0.0, 0.1385]]), &[10.0, 0.0]);
    assert_near(corrected.at(0.0, 0.0, 1.0), 0.0);
    assert_near(corrected.turned(turn(ROLL, 1.001)), 0.0);
}

#[test]
fn level_pays_and_tilted_costs() {
    let mut orientation = Trial::of("orientation: { weight: 0.01 }");
    let attitudes = [
        turn(ROLL, 0.999),
        turn(ROLL, -1.001),
        turn(PITCH, -0.999),
        turn(PITCH, 1.001),
        turn(YAW, 3.0),
        turn(ROLL, 3.1),
        // Roll and pitch of 0.8: the tilt, 1.064, is none of the two.
        turn(PITCH, 0.8).after(&turn(ROLL, 0.8)),
    ];
    let paid = attitudes.map(|attitude| 100.0 * orientation.turned(attitude));
    assert_all_near(&paid, &[1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0]);
}

#[test]
fn rebase_judges_at_intervals() {
    let text = "rebase: { weight: 1, landing_zone_m: [0, 0, 1], interval_secs: 0.5";
    let judged = |yaml: String| {
        let mut trial = Trial::of(&yaml);
        let paid: Vec<f64> = (0..240).map(|_| trial.at(0.0, 0.0, 1.124)).collect();
        let steps: Vec<usize> = (1..=240).filter(|step| paid[step - 1] != 0.0).collect();
        assert_eq!((steps.len(), trial.at(0.0, 0.0, 1.126)), (steps.len(), 0.0));
        steps
    };
    assert_eq!(judged(format!("{text} }}")), (1..=10).map(|k| 24 * k).collect::<Vec<_>>());
    assert_eq!(judged(format!("{text}, as_published: true }}")), [120, 240]);
    let mut far = Trial::of(&format!("{text} }}"));
    assert_near((0..24).map(|_| far.at(0.0, 0.0, 1.126)).sum(), -1.0);
}

#[test]
fn slowing_down_pays_near_the_target() {
    let mut slow = Trial::of("slowdown: { weight: 1, landing_zone_m: [0, 0, 1], slowdown_distance_m: 1 }");
    slow.swarm.position = [[0.0], [0.0], [1.5]];
    let paid = [[0.0, 0.0, 3.0], [0.75, 1.0, 0.0], [3.0, 4.0, 0.0], [20.0, 0.0, 0.0]].map(|v| slow.moving(v));
    assert_all_near(&paid, &[1.0, 0.5, 0.0, -1.0]);
    assert_near(slow.at(0.0, 0.0, 2.001), 0.0);
}

#[test]
fn speeding_costs() {
    let mut speed = Trial::of("speed: { weight: 3, limit_m_per_s: 5 }");
    assert_all_near(&[[0.0, 3.0, 4.0], [0.1, 3.0, 4.0]].map(|v| speed.moving(v)), &[0.0, -3.0]);
}

#[test]
fn the_landing_zone_pays_while_it_is_touched() {
    let mut touch = Trial::of("touch_landing_zone: { weight: 100 }");
    touch.touches[0] = [1.0];
    assert_near(touch.pay(), 0.0);
    touch.touches[1] = [1.0];
    assert_near(touch.pay(), 100.0);
}

#[test]
fn waypoints_pay_for_the_way_and_the_arrival() {
    let mut way = Trial::of("waypoint: { weight: 1, waypoints_m: [[1, 0, 0], [3, 0, 0]] }");
    // 1 m away, 0.8 m, arrived; from there 2.6 m to the last, which is never used up; away from it again.
    let places = [0.0, 0.2, 0.4, 1.0, 2.5, 2.6, 2.0].map(|x| [x, 0.0, 0.0]);
    assert_all_near(&way.along(&places), &[0.0, 0.2, 1.0, 0.6, 1.0, 1.0, 1.6]);
}

#[test]
fn areas_exclude_their_border() {
    let mut area = Trial::of("enter_area: { weight: 100, area: { x_m: [4, 5], y_m: [-1, 1] } }");
    let places = [[4.5, 0.0, -7.0], [4.0, 0.0, 0.5], [5.0, 0.0, 0.5], [4.5, 1.0, 0.5], [3.9, 0.0, 0.5]];
    assert_all_near(&area.along(&places), &[100.0, 0.0, 0.0, 0.0, 0.0]);
}

#[test]
fn going_along_x_pays() {
    let mut increase = Trial::of("increase_x: { weight: 1 }");
    assert_all_near(&increase.along(&[[3.0, 0.0, 0.0], [-3.0, 0.0, 0.0]]), &[0.3, 0.0]);
    let places = [-0.5, -0.31, -0.29, 1.0, 1.2, 1.21].map(|x| [x, 0.0, 0.0]);
    let mut published = Trial::of("increase_x_v2: { weight: 1, as_published: true }");
    assert_all_near(&published.along(&places), &[1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let mut corrected = Trial::of("increase_x_v2: { weight: 1 }");
    assert_all_near(&corrected.along(&places), &[0.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
}

#[test]
fn hovering_and_climbing_pay_by_the_goal_and_the_height() {
    assert_near(Trial::of("squared_distance: { weight: 10 }").away(0.5), -2.5);
    let mut quartic = Trial::of("quartic_distance: { weight: 1 }");
    assert_all_near(&[0.0, 1.0, 2.0].map(|d| quartic.away(d)), &[2.0, 1.0, 0.0]);
    let mut climb = Trial::of("climb: { weight: 1 }");
    let places = [0.019, 0.02, 0.1125, 0.5].map(|z| [0.0, 0.0, z]);
    assert_all_near(&climb.along(&places), &[-5.0, -5.0, -1.0 / 1.125, -0.2]);
}

#[test]
fn the_exit_of_the_maze_asks_for_a_level_drone_as_published() {
    let text = "exit: { weight: 1, region: { low_m: [-2, 0, 0], high_m: [-1, 1, 1] }";
    let mut published = Trial::of(&format!("{text}, as_published: true }}"));
    let mut corrected = Trial::of(&format!("{text} }}"));
    for trial in [&mut published, &mut corrected] {
        assert_all_near(&trial.along(&[[0.0, 0.5, 0.5], [-1.5, 0.5, 0.5]]), &[-1.0, 1000.0]);
    }
    // The quaternion's x, sin 0.11, is beyond 0.1.
    assert_near(published.turned(turn(ROLL, -0.22)), -1.0);
    assert_near(corrected.turned(turn(ROLL, -0.22)), 1000.0);
}

#[test]
fn land_vision_is_a_staircase() {
    let mut stairs = Trial::of("land_vision: { weight: 1, landing_zone_m: [0, 0, 0.125] }");
    assert_near(stairs.at(0.0, 0.0, 2.125), 0.5);
    stairs.swarm.velocity = [[0.0], [0.5], [0.0]];
    assert_near(stairs.at(0.0, 0.0, 0.2), 2.0 - 0.15 * 1.5);
    assert_near(stairs.moving([2.0, 0.0, 0.0]), 2.0 - 0.15 * 0.5);
    let landed: Vec<f64> = (0..10).map(|_| stairs.moving([0.09, 0.0, 0.0])).collect();
    assert_all_near(&landed, &[80.0, 80.0, 80.0, 80.0, 80.0, 80.0, 80.0, 80.0, 80.0, 2240.0]);
    stairs.ends.failure = [1.0];
    assert_near(stairs.at(0.0, 0.0, 0.2), 2240.0);
    assert_near(stairs.at(0.0, 0.0, 6.0), -240.0);
    (stairs.ends.failure, stairs.ends.time_up) = ([0.0], [1.0]);
    assert_near(stairs.at(0.0, 0.0, 2.125), -240.0);
}

#[test]
fn drones_are_paid_by_where_the_others_are() {
    let at = |z: f64| [[0.0], [1.0], [z]];
    let paid = |yaml: &str| {
        let mut trial = Trial::of(yaml);
        trial.team = vec![at(1.0), at(2.0), at(4.0)];
        [0, 1, 2].map(|agent| {
            trial.agent = agent;
            trial.swarm.position = trial.team[agent];
            trial.pay()
        })
    };
    // Leader-follower: by the leader's height, over the number of drones.
    assert_eq!(paid("height_difference: { weight: 3, to: first, factor: 0.5 }"), [0.0, -1.5, -13.5]);
    assert_eq!(paid("height_difference: { weight: 1, to: previous, agents: others }"), [0.0, -1.0, -4.0]);
    // Meetup: the first with the last, the middle with itself.
    assert_eq!(paid("meeting: { weight: 1 }"), [-9.0, 0.0, -9.0]);
}
