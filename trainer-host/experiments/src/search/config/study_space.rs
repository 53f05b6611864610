//! What is varied, as users write it: keys of the study and distributions over their values.

use std::collections::BTreeMap;

use kestrel_sim::config::{ConfigError, Field, Limits};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::search::Search;
use crate::search::space::{Dimension, Values};

/// Greatest number of any kind.
const LIMIT: f64 = 1e12;

/// Most dimensions: with more, so few trials find nothing.
const DIMENSION_LIMIT: usize = 64;

/// Dotted keys of the study and their values.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(transparent)]
pub struct SpaceConfig(BTreeMap<String, ValuesConfig>);

/// What a key may be.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ValuesConfig {
    /// Any number in a range, each as likely.
    Uniform(RangeConfig),
    /// Any number in a range above 0, each order of magnitude as likely.
    LogUniform(RangeConfig),
    /// A whole number in a range.
    Whole(WholeRangeConfig),
    /// One of a list of anything.
    Choice(Vec<serde_json::Value>),
}

/// A range of numbers.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RangeConfig {
    /// Least.
    pub low: f64,
    /// Greatest.
    pub high: f64,
}

/// A range of whole numbers.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WholeRangeConfig {
    /// Least.
    pub low: u64,
    /// Greatest.
    pub high: u64,
}

impl SpaceConfig {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<Vec<Dimension>, ConfigError> {
        if self.0.is_empty() || self.0.len() > DIMENSION_LIMIT {
            let found = format!("{} keys", self.0.len());
            return Err(field.reject(found, format!("1 to {DIMENSION_LIMIT} keys of the study")));
        }
        let dimension = |(key, values): (&String, &ValuesConfig)| {
            let field = field.at(key);
            if key.split('.').any(str::is_empty) || key.contains('=') {
                return Err(
                    field.reject(format!("the key `{key}`"), "a dotted key, such as `training.clip_range`")
                );
            }
            if key == "seeds" || key.starts_with("seeds.") {
                return Err(field.reject("seeds", "other keys: trials have the same seeds"));
            }
            Ok(Dimension { key: key.clone(), values: values.check(&field)? })
        };
        self.0.iter().map(dimension).collect()
    }
}

impl ValuesConfig {
    fn check(&self, field: &Field<'_>) -> Result<Values, ConfigError> {
        match self {
            Self::Uniform(range) => {
                let (low, high) = range.check(&field.at("uniform"), &Limits::from(-LIMIT, LIMIT, ""))?;
                Ok(Values::Uniform { low, high })
            }
            Self::LogUniform(range) => {
                let (low, high) = range.check(&field.at("log_uniform"), &Limits::above(0.0, LIMIT, ""))?;
                Ok(Values::LogUniform { low, high })
            }
            Self::Whole(WholeRangeConfig { low, high }) => {
                let limit = field.at("whole").at("high").whole(*high, 0..=LIMIT as u64)?;
                let low = field.at("whole").at("low").whole(*low, 0..=limit)?;
                Ok(Values::Whole { low, high: *high })
            }
            Self::Choice(options) => {
                let texts: Vec<String> = options.iter().map(written).collect();
                let field = field.at("choice");
                for (index, text) in texts.iter().enumerate() {
                    if texts[..index].contains(text) {
                        return Err(field.at(index).refuse(text, "each option once"));
                    }
                }
                if texts.is_empty() {
                    Err(field.refuse("", "at least one option"))
                } else {
                    Ok(Values::Choice(texts))
                }
            }
        }
    }
}

/// An option as YAML on one line: JSON is that, and a text needs no quotes where it is read as the same text.
fn written(option: &serde_json::Value) -> String {
    match option.as_str() {
        Some(text) if serde_yaml::from_str::<serde_json::Value>(text).is_ok_and(|read| read == *option) => {
            text.to_owned()
        }
        _ => option.to_string(),
    }
}

impl RangeConfig {
    fn check(&self, field: &Field<'_>, limits: &Limits) -> Result<(f64, f64), ConfigError> {
        let low = field.at("low").real(self.low, limits)?;
        let high = field.at("high").real(self.high, limits)?;
        if low < high {
            return Ok((low, high));
        }
        Err(field.at("high").refuse(high, format!("more than the low end, {low}")))
    }
}

/// Refuses values that the study does not take: the ends of every range and every option alone, and the middle of all.
pub(super) fn check_values(search: &Search, field: &Field<'_>) -> Result<(), ConfigError> {
    for dimension in &search.space {
        let places = match dimension.options() {
            None => vec![0.0, 1.0],
            Some(count) => (0..count).map(|option| (option as f64 + 0.5) / count as f64).collect(),
        };
        for place in places {
            let study = search.study_with([(dimension, place)], 1);
            study.map_err(|error| of_the_space(error, &field.at(&dimension.key)))?;
        }
    }
    let together = search.study(&vec![0.5; search.space.len()], 1);
    together.map(drop).map_err(|error| of_the_space(error, field))
}

/// What a study says about a value, said about the dimension that it comes from.
fn of_the_space(error: ConfigError, field: &Field<'_>) -> ConfigError {
    match error {
        ConfigError::Invalid { found, expected, .. } => field.reject(found, expected),
        unreadable @ ConfigError::Unreadable { .. } => unreadable,
    }
}
