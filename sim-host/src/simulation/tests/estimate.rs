//! What drones know of their state: later than the rest, with outages, with errors.

use super::*;

const CONTROL_RATE_HZ: f32 = 50.0;

/// A drone in an endless sky that knows its state so.
fn knowing(latency: &str, estimate: &str) -> Scenario {
    scenario(&format!(
        "
aviary: {{ goal_m: [0, 0, 1] }}
physics: {{ substeps: 4, control_rate_hz: {CONTROL_RATE_HZ} }}
action: {{ thrust_body_rates: {{}} }}
observation: {{ body: {{}} }}
latency: {latency}
estimate: {estimate}
start: {{ position: {{ around_goal: {{ farthest_m: 0.5 }} }}, speed_limit_m_per_s: 1 }}
rewards: [ proximity: {{ weight: 1, scale_m: 0.5 }} ]
episode_secs: 60
success: {{ settle: {{ radius_m: 0.5, within_secs: 1 }} }}
"
    ))
}

/// True and known states of `steps` control periods of one drone with the same noisy commands.
fn flown(scenario: &Scenario, steps: usize) -> Vec<[State<f32>; 2]> {
    let mut simulation = Simulation::<8>::new(scenario, Seed(7), 0, 1);
    let mut states = |step: usize| {
        simulation.step(&noise(step, ACTION_LEN).iter().map(|action| 0.1 * action).collect::<Vec<_>>());
        [simulation.state(0), simulation.known_state(0)]
    };
    (0..steps).map(&mut states).collect()
}

#[test]
fn position_and_velocity_are_later_than_the_rest() {
    // Two control periods and a half, of which half a one is everybody's.
    let late = flown(&knowing("{ state_secs: [0.01, 0.01], position_extra_secs: [0.04, 0.04] }", "{}"), 40);
    let usual = flown(&knowing("{ state_secs: [0.01, 0.01] }", "{}"), 40);
    for step in 3..40 {
        let ([truth, known], [_, early]) = (late[step], usual[step]);
        assert_eq!(known.world_from_body, early.world_from_body);
        assert_eq!(known.body_rates, early.body_rates);
        assert!((known.position - usual[step - 2][1].position).norm() < 1e-6, "step {step}");
        assert!((known.velocity - usual[step - 2][1].velocity).norm() < 1e-5, "step {step}");
        assert!(known.position != truth.position);
    }
    // In the first control periods nothing older than the start is known.
    assert!((late[0][1].position - late[0][0].position).norm() < 0.03);
}

#[test]
fn in_an_outage_position_and_velocity_stay_what_they_were() {
    let states = flown(&knowing("{ outages: { per_sec: 2, secs: [0.1, 0.2] } }", "{}"), 2000);
    let held = states.windows(2).filter(|pair| pair[0][1].position == pair[1][1].position).count();
    // Two a second, of 0.15 s on average, but none within another: 23 % of the time.
    assert!((350..600).contains(&held), "{held} of 2000");
    let (mut longest, mut now) = (0, 0);
    for pair in states.windows(2) {
        let [[past, before], [truth, known]] = [pair[0], pair[1]];
        now = if before.position == known.position { now + 1 } else { 0 };
        longest = longest.max(now);
        assert_eq!(known.body_rates, truth.body_rates);
        // After an outage the truth is known again, or that of before where another outage follows at once.
        assert!(now > 0 || [past.position, truth.position].contains(&known.position));
    }
    assert!((8..=20).contains(&longest), "{longest} control periods");
}

#[test]
fn errors_are_as_large_and_as_slow_as_was_said() {
    let errors = "{ position_m: { drift: 0.05 }, velocity_m_per_s: { noise: 0.1 }, drift_secs: 0.5,
        heading_deg: { noise: 3 }, tilt_deg: { drift: 2 }, body_rates_rad_per_s: { noise: 0.2, drift: 0.1 } }";
    let states = flown(&knowing("{}", errors), 20_000);
    let deviation = |of: &dyn Fn(&[State<f32>; 2]) -> f32| {
        let squares: f32 = states.iter().map(|states| of(states).squared()).sum();
        (squares / states.len() as f32).sqrt()
    };
    let rotation = |[truth, known]: &[State<f32>; 2]| {
        // Rotation vector in the world from what is true to what is known.
        let (t, k) = (truth.world_from_body, known.world_from_body);
        let [i, j, k] = [
            t.w * k.x - t.x * k.w - t.y * k.z + t.z * k.y,
            t.w * k.y + t.x * k.z - t.y * k.w - t.z * k.x,
            t.w * k.z - t.x * k.y + t.y * k.x - t.z * k.w,
        ];
        [i, j, k].map(|half| 2.0 * half)
    };
    let near = |found: f32, wanted: f32, of: &str| {
        assert!((found / wanted - 1.0).abs() < 0.12, "{of}: {found} for {wanted}");
    };
    near(deviation(&|[truth, known]| known.position.x - truth.position.x), 0.05, "position");
    near(deviation(&|[truth, known]| known.velocity.y - truth.velocity.y), 0.1, "velocity");
    near(deviation(&|[truth, known]| known.body_rates.z - truth.body_rates.z), 0.05_f32.sqrt(), "rates");
    near(deviation(&|states| rotation(states)[2]), 3.0_f32.to_radians(), "heading");
    near(deviation(&|states| rotation(states)[0]), 2.0_f32.to_radians(), "tilt");
    // A drift of half a second is nearly the same a control period later, noise is not.
    let along = |of: &dyn Fn(&[State<f32>; 2]) -> f32| {
        let sum: f32 = states.windows(2).map(|pair| of(&pair[0]) * of(&pair[1])).sum();
        sum / states.len() as f32 / deviation(of).squared()
    };
    let drift = along(&|[truth, known]| known.position.x - truth.position.x);
    assert!((drift - libm::expf(-0.02 / 0.5)).abs() < 0.02, "{drift}");
    let noise = along(&|[truth, known]| known.velocity.y - truth.velocity.y);
    assert!(noise.abs() < 0.03, "{noise}");
}

#[test]
fn without_errors_the_truth_itself_is_known() {
    for estimate in ["{}", "{ drift_secs: 3 }"] {
        let scenario = knowing("{}", estimate);
        assert!(crate::latency::LatencyMemory::<8, f32>::new(&scenario).is_none(), "{estimate}");
    }
}

#[test]
fn rewards_and_motors_know_the_truth_that_the_policy_does_not() {
    let rewards = |estimate: &str| {
        let scenario = knowing("{}", estimate);
        let mut simulation = Simulation::<8>::new(&scenario, Seed(7), 0, 1);
        (0..20)
            .map(|step| {
                simulation.step(&noise(step, ACTION_LEN).iter().map(|action| 0.1 * action).collect::<Vec<_>>());
                (simulation.rewards()[0], simulation.observations()[0])
            })
            .collect::<Vec<_>>()
    };
    // A position that is wrong changes no command of these.
    let (right, wrong) = (rewards("{}"), rewards("{ position_m: { drift: 0.3 } }"));
    for (step, (right, wrong)) in right.iter().zip(&wrong).enumerate() {
        assert_eq!(right.0, wrong.0, "step {step}");
        assert_ne!(right.1, wrong.1, "step {step}");
    }
}

#[test]
fn an_estimate_that_cannot_be_is_refused() {
    let refused = |latency: &str, estimate: &str| {
        let yaml = format!(
            "aviary: {{ goal_m: [0, 0, 1] }}\nlatency: {latency}\nestimate: {estimate}\nstart: {{ position: {{ around_goal: {{ farthest_m: 0.5 }} }} }}\nrewards: [ proximity: {{ weight: 1, scale_m: 0.5 }} ]\nsuccess: {{ settle: {{ radius_m: 0.5, within_secs: 1 }} }}\n"
        );
        Scenario::of("trial", &Document::parse("trial.yaml", &yaml).unwrap()).unwrap_err().to_string()
    };
    let far = refused("{ position_extra_secs: [0, 2] }", "{}");
    assert!(far.contains("latency.position_extra_secs") && far.contains("1 s"), "{far}");
    let often = refused("{ outages: { per_sec: 1000, secs: [0.1, 0.2] } }", "{}");
    assert!(often.contains("latency.outages.per_sec"), "{often}");
    let turned = refused("{}", "{ tilt_deg: { noise: 31 } }");
    assert!(turned.contains("estimate.tilt_deg.noise") && turned.contains("30 degrees"), "{turned}");
    let negative = refused("{}", "{ position_m: { drift: -0.1 } }");
    assert!(negative.contains("estimate.position_m.drift"), "{negative}");
    let still = refused("{}", "{ drift_secs: 0 }");
    assert!(still.contains("estimate.drift_secs"), "{still}");
}
