use kestrel_core::action::ActionSpace;
use kestrel_core::airframe::CF2X;
use nalgebra::Vector3;
use proptest::prelude::*;

use super::geometry::{contains, gap, surrounds};
use super::*;
use crate::reward::{self, AgentSet};
use crate::world::Cuboid;

const SCENARIO: &str = "\
aviary:
  goal_m: [1, 2, 3]
  room: {low_m: [0, 0, 0], high_m: [4, 5, 6], wall_m: 0.5}
start:
  position: {within: {low_m: [1, 1, 1], high_m: [2, 2, 2]}}
  tilt_limit_deg: 90
rewards:
  - proximity: {weight: 2, scale_m: 0.5}
  - body_rates: {weight: -0.1}
success:
  settle: {radius_m: 0.1, within_secs: 2}
";

fn checked(document: &Document) -> Result<Scenario, ConfigError> {
    Scenario::of("trial", document)
}

fn scenario(assignments: &[&str]) -> Result<Scenario, ConfigError> {
    let mut document = Document::parse("trial.yaml", SCENARIO)?;
    for assignment in assignments {
        document.set(assignment)?;
    }
    checked(&document)
}

fn cuboid(low: [f32; 3], high: [f32; 3]) -> Cuboid {
    Cuboid { low: low.into(), high: high.into() }
}

#[test]
fn what_is_written_becomes_si() {
    let scenario = scenario(&["physics.control_rate_hz=50", "vehicle.mass_kg=0.03"]).unwrap();
    assert_eq!(scenario.physics.control_secs(), 0.02);
    assert_eq!(scenario.start.tilt_limit, std::f32::consts::FRAC_PI_2);
    assert_eq!(scenario.airframe.mass, 0.03);
    assert_eq!(scenario.airframe.inertia, CF2X.inertia);
    let proximity =
        reward::Proximity { weight: scenario.rewards[0].weight(), scale_m: 0.5, agents: AgentSet::All };
    assert_eq!(scenario.rewards[0], proximity.into());
    assert_eq!(scenario.rewards[1].weight(), -0.1);
}

#[test]
fn walls_close_the_room_and_leave_its_inside_free() {
    let walls = scenario(&[]).unwrap().aviary.world.bounds();
    assert_eq!(walls.len(), 4);
    let interior = cuboid([0.0; 3], [4.0, 5.0, 6.0]);
    for wall in &walls {
        assert_eq!(gap(wall, &interior), 0.0);
        assert!(!contains(wall, &Vector3::new(2.0, 2.5, 3.0)));
    }
    for (x, y) in [(-0.25, -0.25), (4.25, 5.25), (-0.25, 2.0), (4.25, 2.0), (2.0, -0.25), (2.0, 5.25)] {
        assert!(walls.iter().any(|wall| contains(wall, &Vector3::new(x, y, 3.0))), "hole at {x}, {y}");
    }
}

#[test]
fn velocities_have_an_integral_if_it_has_a_gain() {
    let action = |gain: &str| {
        scenario(&[&format!("action={{velocity: {{integral_gain_per_s2: {gain}}}}}")])
            .map(|scenario| scenario.action)
    };
    assert!(matches!(action("0"), Ok(ActionSpace::Velocities(_))));
    assert_eq!(action("0").unwrap(), scenario(&["action={velocity: {}}"]).unwrap().action);
    assert!(matches!(action("6"), Ok(ActionSpace::IntegralVelocities(space)) if space.integral_gain == 6.0));
    for gain in ["-1", "101", ".nan"] {
        let message = action(gain).unwrap_err().to_string();
        assert!(message.contains("action.velocity.integral_gain_per_s2: found"), "{message}");
    }
}

#[test]
fn an_impact_that_no_touch_would_reach_is_refused() {
    let rules = |list: &str| scenario(&[&format!("terminations=[{list}]")]).map(drop);
    rules("impact: {speed_limit_m_per_s: 0.5}, landing").unwrap();
    let message = rules("landing, impact: {speed_limit_m_per_s: 0.5}").unwrap_err().to_string();
    assert!(message.contains("found `impact` after `landing`"), "{message}");
}

#[test]
fn starts_around_a_goal_on_a_curve_are_where_the_curve_begins() {
    let around_a_pillar = |shape: &str, farthest: &str| {
        let goals = format!("goals.trajectory={{shapes: [{shape}], reach_m: [0.6, 1.0]}}");
        let position = format!("start.position={{around_goal: {{farthest_m: {farthest}}}}}");
        let place = ["aviary={pillars: [[0, 0]], goal_m: [0.0, 0.0, 0.8]}", "terminations=[collision]"];
        scenario(&[&place[..], &[&goals, &position]].concat()).map(drop)
    };
    around_a_pillar("circle", "0.3").unwrap();
    for [shape, farthest] in [["circle", "0.5"], ["figure_eight", "0.1"]] {
        let message = around_a_pillar(shape, farthest).unwrap_err().to_string();
        assert!(message.contains("from the solid") && message.contains("the drone's radius"), "{message}");
    }
    let low = around_a_pillar("circle, figure_eight", "0.3").unwrap_err().to_string();
    assert!(low.contains("starts 0.000 m from the solid"), "{low}");
}

#[test]
fn heavier_drones_have_less_thrust_to_steer_with() {
    let rates = "action={thrust_body_rates: {fraction_of_hover: 1.2}}";
    assert!(scenario(&[rates]).is_ok());
    let message = scenario(&[rates, "vehicle.mass_kg=0.05"]).unwrap_err().to_string();
    assert_eq!(
        message,
        format!(
            "--set {rates}: action.thrust_body_rates.fraction_of_hover: found 1.2, expected a number above 0, at most 0.215"
        )
    );
}

#[test]
fn numbers_are_quoted_as_they_are_spelled_even_after_wide_letters() {
    let text = format!("# étoile ★\n{SCENARIO}").replace("settle: {radius_m: 0.1", "settle: {radius_m: -1.50e-1");
    let message = checked(&Document::parse("trial.yaml", &text).unwrap()).unwrap_err();
    assert_eq!(
        message.to_string(),
        "trial.yaml:12:22: success.settle.radius_m: found -1.50e-1, expected a number above 0, at most 1000 m
  12 |   settle: {radius_m: -1.50e-1, within_secs: 2}
     |                      ^"
    );
}

#[test]
fn overrides_reach_into_what_is_not_written_yet() {
    let mut document = Document::parse("trial.yaml", SCENARIO).unwrap();
    document.set("randomisation.mass_fraction=0.2").unwrap();
    document.set("rewards.1={alive: {weight: 1}}").unwrap();
    document.set(" aviary.floor = false").unwrap();
    let scenario = checked(&document).unwrap();
    assert_eq!(scenario.randomisation.mass, 0.2);
    assert_eq!(scenario.rewards[1], reward::Alive { weight: 1.0 }.into());
    assert_eq!(scenario.aviary.world.floor, crate::world::Floor::Absent);
}

#[test]
fn every_reward_is_called_in_yaml_as_in_the_log() {
    let names = ["alive", "distance", "velocity", "body_rates", "tilt", "action", "action_change", "progress"];
    for name in names.into_iter().chain(["success", "failure"]) {
        let scenario = scenario(&[&format!("rewards=[{name}: {{weight: 3}}]")]).unwrap();
        assert_eq!((scenario.rewards[0].name(), scenario.rewards[0].weight()), (name, 3.0));
    }
}

#[test]
fn a_box_surrounds_only_what_is_strictly_inside() {
    let room = cuboid([0.0; 3], [1.0; 3]);
    assert!(surrounds(&room, &cuboid([0.1; 3], [0.9; 3])));
    assert!(!surrounds(&room, &cuboid([0.0; 3], [0.9; 3])));
    assert_eq!(gap(&room, &cuboid([4.0, 5.0, 0.0], [5.0, 6.0, 1.0])), 5.0);
}

proptest! {
    /// A number passes if and only if it is within its limits; NaN and infinities never do.
    #[test]
    fn numbers_pass_within_their_limits(value in proptest::num::f64::ANY) {
        let document = Document::parse("trial.yaml", "value: 1").unwrap();
        let field = document.root().at("value");
        prop_assert_eq!(field.number(value, &Limits::from(-1.0, 1.0, "")).is_ok(), (-1.0..=1.0).contains(&value));
        prop_assert_eq!(field.number(value, &Limits::above(-1.0, 1.0, "")).is_ok(), value > -1.0 && value <= 1.0);
        prop_assert_eq!(field.number(value, &Limits::between(-1.0, 1.0, "")).is_ok(), value > -1.0 && value < 1.0);
    }
}

#[test]
fn every_mapping_may_import() {
    let schema: serde_json::Value = serde_json::from_str(&schema_of::<StartConfig>()).unwrap();
    assert!(schema["properties"]["import"].is_object());
    assert_eq!(schema["anyOf"], serde_json::json!([{"required": ["position"]}, {"required": ["import"]}]));
    let choices = schema["$defs"]["StartPositionConfig"]["oneOf"].as_array().unwrap();
    assert_eq!(choices.len(), 6);
    assert_eq!(choices[5]["required"], serde_json::json!(["import"]));
    let around = &choices[0]["properties"]["around_goal"];
    assert!(around["properties"]["import"].is_object() && choices[0]["properties"]["import"].is_null());
    let world: serde_json::Value = serde_json::from_str(&schema_of::<AviaryConfig>()).unwrap();
    assert!(world["$defs"]["FurnitureConfig"]["properties"]["import"].is_object());
}
