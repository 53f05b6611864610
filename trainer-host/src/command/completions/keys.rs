//! The keys of a configuration, as a JSON schema has them, for whoever types `--set scenario.rew`.

use serde_json::Value;

/// What stands below the root of a schema.
#[derive(Debug)]
pub(super) struct Keys {
    schema: Value,
}

impl Keys {
    /// Of a schema's text, if it is one.
    pub(super) fn parse(schema: &str) -> Option<Self> {
        serde_json::from_str(schema).ok().map(|schema| Self { schema })
    }

    /// Words that begin with `typed`, with what they mean: keys one level on, or after a `=` the values that have names.
    pub(super) fn after(&self, typed: &str) -> Vec<(String, Option<String>)> {
        let (path, value) = typed.split_once('=').map_or((typed, None), |(path, value)| (path, Some(value)));
        let mut segments: Vec<&str> = path.split('.').collect();
        let last = if value.is_none() { segments.pop().unwrap_or_default() } else { "" };
        let Some(node) = segments.iter().try_fold(&self.schema, |node, segment| self.below(node, segment)) else {
            return Vec::new();
        };
        if let Some(value) = value {
            let fitting = self.values(node).into_iter().filter(|(name, _)| name.starts_with(value));
            return fitting.map(|(name, about)| (format!("{path}={name}"), about)).collect();
        }
        let before: String = segments.iter().flat_map(|segment| [segment, "."]).collect();
        let fitting = self.properties(node).into_iter().filter(|(name, _)| name.starts_with(last));
        let word = |(name, node): (&str, &Value)| {
            let sign = if self.properties(node).is_empty() { "=" } else { "." };
            (format!("{before}{name}{sign}"), about(node))
        };
        fitting.map(word).collect()
    }

    /// What a key of a node holds; of a list, what an item of this name or number does.
    fn below<'a>(&'a self, node: &'a Value, segment: &str) -> Option<&'a Value> {
        let named = self.properties(node).into_iter().find(|(name, _)| *name == segment).map(|(_, below)| below);
        named.or_else(|| {
            segment
                .parse::<usize>()
                .ok()
                .and_then(|_| self.parts(node).into_iter().find(|part| part.get("properties").is_some()))
        })
    }

    /// The keys of a node, of whatever it can be, and of the items of a list.
    fn properties<'a>(&'a self, node: &'a Value) -> Vec<(&'a str, &'a Value)> {
        let keys = |part: &'a Value| part.get("properties").and_then(Value::as_object).into_iter().flatten();
        let mut keys: Vec<_> =
            self.parts(node).into_iter().flat_map(keys).map(|(name, node)| (name.as_str(), node)).collect();
        keys.sort_by_key(|(name, _)| *name);
        keys.dedup_by_key(|(name, _)| *name);
        keys
    }

    /// The words that a node can be.
    fn values(&self, node: &Value) -> Vec<(String, Option<String>)> {
        let word = |value: &Value| match value {
            Value::String(text) => Some(text.clone()),
            Value::Null | Value::Bool(_) | Value::Number(_) | Value::Array(_) | Value::Object(_) => None,
        };
        let of = |part: &Value| -> Vec<(String, Option<String>)> {
            if part.get("type").is_some_and(|kind| kind == "boolean") {
                return ["true", "false"].map(|name| (name.to_owned(), None)).into();
            }
            let listed = part.get("enum").and_then(Value::as_array).into_iter().flatten();
            listed.chain(part.get("const")).filter_map(word).map(|name| (name, about(part))).collect()
        };
        self.parts(node).into_iter().flat_map(of).collect()
    }

    /// The node itself, what it refers to, its alternatives, and the items of a list.
    fn parts<'a>(&'a self, node: &'a Value) -> Vec<&'a Value> {
        let referred =
            node.get("$ref").and_then(Value::as_str).and_then(|path| self.schema.pointer(path.strip_prefix('#')?));
        let listed = ["anyOf", "oneOf", "allOf"].into_iter().filter_map(|key| node.get(key)?.as_array()).flatten();
        let below = referred.into_iter().chain(listed).chain(node.get("items"));
        let mut parts = vec![node];
        parts.extend(below.flat_map(|part| self.parts(part)));
        parts
    }
}

/// The first sentence of a node's description.
fn about(node: &Value) -> Option<String> {
    let text = node.get("description")?.as_str()?;
    Some(text.lines().next()?.split(". ").next()?.trim_end_matches('.').to_owned())
}

#[cfg(test)]
mod tests {
    use kestrel_experiments::experiment_config;

    use super::*;

    fn after(typed: &str) -> Vec<String> {
        let keys = Keys::parse(&experiment_config::schema()).unwrap();
        keys.after(typed).into_iter().map(|(word, _)| word).collect()
    }

    #[test]
    fn keys_go_on_level_by_level_to_values() {
        assert_eq!(after(""), ["evaluation.", "import=", "name=", "scenario.", "training.", "version="]);
        assert_eq!(after("scenario.rew"), ["scenario.rewards."]);
        assert!(after("scenario.rewards.prox").contains(&"scenario.rewards.proximity.".to_owned()));
        assert!(after("scenario.rewards.proximity.w").contains(&"scenario.rewards.proximity.weight=".to_owned()));
        assert_eq!(after("scenario.physics.integrator=r"), ["scenario.physics.integrator=runge_kutta_4"]);
        assert_eq!(
            after("scenario.physics.downwash="),
            ["scenario.physics.downwash=true", "scenario.physics.downwash=false"]
        );
        assert!(after("scenario.nothing.at.all").is_empty());
    }

    #[test]
    fn keys_say_what_they_are() {
        let keys = Keys::parse(&experiment_config::schema()).unwrap();
        let told = keys.after("scenario.episode");
        assert_eq!(
            told,
            [(
                "scenario.episode_secs=".to_owned(),
                Some("Time after which an episode ends, which is no failure".to_owned())
            )]
        );
    }
}
