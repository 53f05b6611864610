//! docs/reference.md: every key of a task, as the schema tells it.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use serde_json::Value;

/// Headings of the page, the type of the schema below each, and where the key stands.
const SECTIONS: [(&str, &str, &str); 16] = [
    ("Rewards", "RewardTerm", "`scenario.rewards`, a list"),
    ("Terminations", "Termination", "`scenario.terminations`, a list"),
    ("Success", "SuccessConfig", "`scenario.success`"),
    ("Observations", "ObservationConfig", "`scenario.observation`"),
    ("Actions", "ActionConfig", "`scenario.action`"),
    ("Sensors", "SensorConfig", "`scenario.sensors`, a list"),
    ("Cameras", "CameraConfig", "`scenario.camera`"),
    ("Starts", "StartPositionConfig", "`scenario.start.position`"),
    ("Goals", "GoalsConfig", "`scenario.goals`"),
    ("Domain randomisation", "RandomisationConfig", "`scenario.randomisation`"),
    ("Latency", "LatencyConfig", "`scenario.latency`"),
    ("Outages", "OutagesConfig", "`scenario.latency.outages`"),
    ("Errors of the estimate", "EstimateConfig", "`scenario.estimate`"),
    ("Deviation", "DeviationConfig", "`scenario.estimate.position_m` and the like"),
    ("Training by PPO", "TrainingConfig", "`training`"),
    ("Training by gradients", "AnalyticConfig", "`training.analytic`"),
];

/// Before the first section.
const HEAD: &str = "# Reference

<!-- Made from configs/schema.json by tests/suite/reference.rs: BLESS=1 cargo test -p kestrel-tests reference -->

Every key with which a task says what is paid, what ends it, what is seen, commanded and drawn, and
how it is learned. `kestrel new NAME` writes a task to begin with, `kestrel check FILE` says what is
wrong with one, `kestrel check --resolved FILE` what it comes to; `kestrel schema > schema.json` is for
editors. Types are the schema's; a value behind `=` is what a key has when it is left out.
";

struct Schema(Value);

impl Schema {
    /// What a reference leads to; anything else is itself.
    fn resolved<'a>(&'a self, node: &'a Value) -> &'a Value {
        let name = node["$ref"].as_str().and_then(|path| path.strip_prefix("#/$defs/"));
        name.map_or(node, |name| &self.0["$defs"][name])
    }

    fn section(&self, name: &str) -> String {
        let definition = &self.0["$defs"][name];
        let mut text = format!("{}\n\n", sentence(definition));
        if let Some(variants) = definition["oneOf"].as_array() {
            text += "| key | holds | |\n|---|---|---|\n";
            text.extend(variants.iter().map(|variant| self.variant(variant)));
            return text;
        }
        text += "| key | type | |\n|---|---|---|\n";
        for (key, node) in keys(definition) {
            let about = [sentence(node), sentence(self.resolved(node))].into_iter().find(|text| !text.is_empty());
            let about = about.unwrap_or_default();
            writeln!(text, "| `{key}` | {} | {about} |", self.kind(node)).unwrap();
        }
        text
    }

    /// Lines of a choice: a word, or a key with what is below it.
    fn variant(&self, variant: &Value) -> String {
        let row = |key: &str, holds: &str, about: &str| format!("| `{key}` | {holds} | {about} |\n");
        if let Some(word) = variant["const"].as_str() {
            return row(word, "", &sentence(variant));
        }
        if let Some(words) = variant["enum"].as_array() {
            return words.iter().filter_map(Value::as_str).map(|word| row(word, "", &of_file(word))).collect();
        }
        let of_variant = |(key, node): (&String, &Value)| {
            let below = self.resolved(node);
            let about = [variant, node, below].into_iter().map(sentence).find(|text| !text.is_empty());
            let holds = match below["properties"].as_object() {
                Some(_) => {
                    keys(below).map(|(key, node)| format!("`{key}`: {}", self.kind(node))).collect::<Vec<_>>()
                }
                None => vec![self.kind(node)],
            };
            row(key, &holds.join("<br>"), &about.unwrap_or_default())
        };
        keys(variant).map(of_variant).collect()
    }

    /// The type of a value, and its default.
    fn kind(&self, node: &Value) -> String {
        let kind = self.bare_kind(node);
        let default = &node["default"];
        if default.is_null() { kind } else { format!("{kind} = `{default}`") }
    }

    fn bare_kind(&self, node: &Value) -> String {
        if let Some(choices) = node["anyOf"].as_array() {
            let kinds =
                choices.iter().filter(|choice| choice["type"] != "null").map(|choice| self.bare_kind(choice));
            return kinds.collect::<Vec<_>>().join(" or ");
        }
        let definition = self.resolved(node);
        let words: Vec<String> = definition["oneOf"].as_array().into_iter().flatten().flat_map(words).collect();
        if !words.is_empty() {
            return words.join(", ");
        }
        let named =
            node["$ref"].as_str().map(|path| path.trim_start_matches("#/$defs/").trim_end_matches("Config"));
        match (definition["type"].as_str(), named) {
            (Some("array"), _) => {
                let count =
                    definition["maxItems"].as_u64().filter(|_| definition["maxItems"] == definition["minItems"]);
                let of = self.bare_kind(&definition["items"]);
                count.map_or(format!("list of {of}"), |count| format!("{count} × {of}"))
            }
            (Some("object") | None, Some(name)) => format!("*{name}*"),
            (Some("integer"), _) => "whole number".to_owned(),
            (Some("boolean"), _) => "true or false".to_owned(),
            (Some(other), _) => other.to_owned(),
            (None, None) => {
                definition["type"].as_array().and_then(|kinds| kinds[0].as_str()).unwrap_or("object").to_owned()
            }
        }
    }
}

/// What the file of a termination says of it, for those without keys, of which the schema says nothing.
fn of_file(word: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../sim-host/src/termination/{word}.rs"));
    let text = fs::read_to_string(path).unwrap();
    text.lines().find_map(|line| line.strip_prefix("/// ")).unwrap().to_owned()
}

/// The words or keys of a choice.
fn words(variant: &Value) -> Vec<String> {
    let quoted = |word: &str| format!("`{word}`");
    let constant = variant["const"].as_str().map(quoted);
    let listed = variant["enum"].as_array().into_iter().flatten().filter_map(Value::as_str).map(quoted);
    constant.into_iter().chain(listed).chain(keys(variant).map(|(key, _)| quoted(key))).collect()
}

/// Keys of a mapping but `import`, which every one has.
fn keys(node: &Value) -> impl Iterator<Item = (&String, &Value)> {
    node["properties"].as_object().into_iter().flatten().filter(|(key, _)| *key != "import")
}

/// What the schema says of something, on one line.
fn sentence(node: &Value) -> String {
    let text = node["description"].as_str().unwrap_or_default();
    text.split_whitespace().collect::<Vec<_>>().join(" ").replace('|', "\\|")
}

#[test]
fn the_reference_is_what_the_schema_says() {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let schema = fs::read_to_string(repository.join("configs/schema.json")).unwrap();
    let schema = Schema(serde_json::from_str(&schema).unwrap());
    let mut page = HEAD.to_owned();
    for (heading, name, place) in SECTIONS {
        write!(page, "\n## {heading}\n\n{place}. {}", schema.section(name)).unwrap();
    }
    crate::assert_blessed(&repository.join("docs/reference.md"), &page);
}
