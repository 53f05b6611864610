//! A small task for the unit tests of this crate.

use kestrel_core::airframe::CF2X;
use kestrel_core::dynamics::Integrator;

use crate::reward::{self, AgentSet};
use crate::scenario::{CriticView, Physics, Randomisation, Scenario, Start};
use crate::termination::{self, Termination};

/// Hover one metre above the origin, everything randomised, every kind of dense reward, short episodes.
pub(crate) fn hover() -> Scenario {
    let least = Scenario::hover(&CF2X, Physics::clean(Integrator::SemiImplicitEuler, 2, 100.0));
    Scenario {
        critic: CriticView::Privileged,
        start: Start { tilt_limit: 1.5, speed_limit: 1.0, body_rates_limit: 3.0, ..least.start },
        randomisation: Randomisation {
            mass: 0.1,
            inertia: 0.1,
            thrust: 0.1,
            rotor_lag: [0.7, 1.3],
            wind_speed: 0.5,
            ..Randomisation::NONE
        },
        rewards: vec![
            reward::Alive { weight: 1.0 }.into(),
            reward::Proximity { weight: 2.0, scale_m: 0.5, agents: AgentSet::All }.into(),
            reward::Velocity { weight: -0.1 }.into(),
            reward::BodyRates { weight: -0.01 }.into(),
            reward::ActionChange { weight: -0.1 }.into(),
            reward::Progress { weight: 1.0 }.into(),
            reward::Failure { weight: -1.0 }.into(),
        ],
        terminations: vec![Termination::Collision, termination::Distance { limit_m: 1.5 }.into()],
        episode_secs: 1.0,
        ..least
    }
}

/// The smallest YAML of one key of a list of terms with this schema: its required keys, each with a value that is allowed.
pub(crate) fn smallest(schema: &serde_json::Value, key: &str) -> String {
    let variants = schema["oneOf"].as_array().expect("a term is one of several");
    match variants.iter().find_map(|variant| variant["properties"].get(key)) {
        Some(mapping) => format!("{key}: {}", value(schema, mapping, key)),
        None => key.to_owned(),
    }
}

fn value(root: &serde_json::Value, schema: &serde_json::Value, key: &str) -> serde_json::Value {
    if let Some(path) = schema["$ref"].as_str() {
        let definition = path.trim_start_matches('#');
        return value(root, root.pointer(definition).expect("a definition of the schema"), key);
    }
    if let Some(choices) = schema["oneOf"].as_array() {
        return choices[0]["const"].clone();
    }
    match schema["type"].as_str() {
        Some("integer") => 1.into(),
        Some("number") => 0.5.into(),
        Some("array") => {
            let length = schema["minItems"].as_u64().unwrap_or(1);
            let item = |index: u64| match schema["items"]["type"].as_str() {
                // So that ranges and boxes have an inside, boxes with the goal of [`hover`] in it.
                Some("number") if key == "low_m" => (index as f64 - 1.5).into(),
                Some("number") if key == "high_m" => (index as f64 + 0.2).into(),
                Some("number") => index.into(),
                Some(_) | None => value(root, &schema["items"], key),
            };
            (0..length).map(item).collect()
        }
        Some(_) | None => {
            let required = schema["required"].as_array().map_or(&[][..], Vec::as_slice);
            let keys = required.iter().filter_map(serde_json::Value::as_str);
            keys.map(|key| (key.to_owned(), value(root, &schema["properties"][key], key))).collect()
        }
    }
}
