//! What the vehicle has to say about itself beyond messages: MAVLink component metadata, in files.
//!
//! Source: <https://mavlink.io/en/services/component_metadata.html> and the schemas of MAVLink's folder `component_metadata`.

use serde::{Serialize, Serializer};

use super::ServedFile;
use crate::message::sent::events;
use crate::parameter::ParameterValue;
use crate::parameter::table::{Access, Domain, Parameter, ParameterDefinition, ParameterType};

/// The file that says where the others are.
pub const GENERAL: &str = "general.json";

/// Where it is, as messages tell.
pub const GENERAL_URI: &str = "mftp:///general.json";

/// The file that describes the parameters, and where it is.
const PARAMETERS: &str = "parameters.json";
const PARAMETERS_URI: &str = "mftp:///parameters.json";

/// The file that words the events, and where it is.
const EVENTS: &str = "events.json";
const EVENTS_URI: &str = "mftp:///events.json";

/// `COMP_METADATA_TYPE_PARAMETER` and `COMP_METADATA_TYPE_EVENTS`.
const PARAMETER_METADATA: u8 = 1;
const EVENT_METADATA: u8 = 4;

/// Of the first two files; QGroundControl reads no other one.
const VERSION: u8 = 1;

/// Fewest decimal places of a real number: in m and s, what a drone of this size may notice.
const DECIMAL_PLACES: usize = 2;

/// Beginnings of the parameters' names, and what PX4 calls such a group, where it has one.
const GROUPS: [(&str, &str); 11] = [
    ("BAT", "Battery"),
    ("COM", "Commander"),
    ("FD", "Failure Detector"),
    ("GF", "Geofence"),
    ("MIS", "Mission"),
    ("MPC", "Multicopter Position Control"),
    ("NAV", "Navigator"),
    ("RL", "Policy"),
    ("RTL", "Return Mode"),
    ("SIM", "Simulator"),
    ("SYS", "System"),
];

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct General {
    version: u8,
    metadata_types: [MetadataType; 2],
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct MetadataType {
    r#type: u8,
    uri: &'static str,
    file_crc: u32,
}

#[derive(Serialize)]
struct ParameterList {
    version: u8,
    parameters: Vec<ParameterMetadata>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct ParameterMetadata {
    name: &'static str,
    r#type: &'static str,
    short_desc: &'static str,
    group: &'static str,
    #[serde(skip_serializing_if = "str::is_empty")]
    units: &'static str,
    default: ParameterValue,
    min: ParameterValue,
    max: ParameterValue,
    #[serde(skip_serializing_if = "Option::is_none")]
    decimal_places: Option<usize>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    values: Vec<ChoiceMetadata>,
    read_only: bool,
}

#[derive(Serialize)]
struct ChoiceMetadata {
    value: i32,
    description: &'static str,
}

impl Serialize for ParameterValue {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Real(value) => serializer.serialize_f32(*value),
            Self::Integer(value) => serializer.serialize_i32(*value),
        }
    }
}

/// All the files there are.
pub fn files() -> Vec<ServedFile> {
    let parameters = Parameter::ALL.into_iter().map(|parameter| describe(parameter.definition())).collect();
    let parameters = ServedFile::new(PARAMETERS, json(&ParameterList { version: VERSION, parameters }));
    let events = ServedFile::new(EVENTS, json(&events::definitions()));
    let metadata_types = [
        MetadataType { r#type: PARAMETER_METADATA, uri: PARAMETERS_URI, file_crc: parameters.checksum() },
        MetadataType { r#type: EVENT_METADATA, uri: EVENTS_URI, file_crc: events.checksum() },
    ];
    let general = General { version: VERSION, metadata_types };
    vec![ServedFile::new(GENERAL, json(&general)), parameters, events]
}

fn json(content: &impl Serialize) -> Vec<u8> {
    // Memory takes every byte, and every field has a form in JSON.
    serde_json::to_vec(content).unwrap_or_default()
}

fn describe(definition: &'static ParameterDefinition) -> ParameterMetadata {
    let ParameterDefinition { name, domain, unit, access, description } = definition;
    let (min, max) = bounds(domain);
    ParameterMetadata {
        name,
        r#type: match domain.kind() {
            ParameterType::Int32 => "Int32",
            ParameterType::Real32 => "Float",
        },
        short_desc: description.trim_end_matches('.'),
        group: group(name),
        units: unit,
        default: domain.default(),
        min,
        max,
        decimal_places: match *domain {
            Domain::Real { default, least, greatest } => Some(decimal_places([default, least, greatest])),
            Domain::Integer { .. } | Domain::Choice { .. } => None,
        },
        values: match domain {
            Domain::Choice { choices, .. } => {
                let described = |value: &i32| choice(*value, description);
                choices.iter().filter_map(described).collect()
            }
            Domain::Real { .. } | Domain::Integer { .. } => Vec::new(),
        },
        read_only: *access == Access::ReadOnly,
    }
}

/// Least and greatest value.
fn bounds(domain: &Domain) -> (ParameterValue, ParameterValue) {
    match *domain {
        Domain::Real { least, greatest, .. } => (ParameterValue::Real(least), ParameterValue::Real(greatest)),
        Domain::Integer { least, greatest, .. } => {
            (ParameterValue::Integer(least), ParameterValue::Integer(greatest))
        }
        Domain::Choice { default, choices } => {
            let least = choices.iter().copied().min().unwrap_or(default);
            let greatest = choices.iter().copied().max().unwrap_or(default);
            (ParameterValue::Integer(least), ParameterValue::Integer(greatest))
        }
    }
}

fn group(name: &'static str) -> &'static str {
    let (prefix, _) = name.split_once('_').unwrap_or((name, ""));
    GROUPS.iter().find(|(known, _)| *known == prefix).map_or(prefix, |(_, group)| group)
}

/// As many as the longest of these numbers has.
fn decimal_places(numbers: [f32; 3]) -> usize {
    let places = |number: f32| number.to_string().split_once('.').map_or(0, |(_, decimals)| decimals.len());
    numbers.into_iter().map(places).fold(DECIMAL_PLACES, usize::max)
}

/// What a value means, which stands in the parameter's description: "what: 0 this, 1 that."
fn choice(value: i32, description: &'static str) -> Option<ChoiceMetadata> {
    let (_, list) = description.trim_end_matches('.').split_once(": ")?;
    let number = value.to_string();
    let description = list.split(", ").find_map(|entry| entry.strip_prefix(&number)?.strip_prefix(' '))?;
    Some(ChoiceMetadata { value, description })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use serde_json::Value;

    use super::*;

    fn read(name: &str) -> Value {
        let file = files().into_iter().find(|file| file.name == name).unwrap();
        serde_json::from_slice(&file.content).unwrap()
    }

    #[test]
    fn the_general_file_says_where_the_others_are_and_their_checksums() {
        let checksum = |name| files().into_iter().find(|file| file.name == name).unwrap().checksum();
        let expected = format!(
            r#"{{"version":1,"metadataTypes":[{{"type":1,"uri":"mftp:///parameters.json","fileCrc":{}}},{{"type":4,"uri":"mftp:///events.json","fileCrc":{}}}]}}"#,
            checksum(PARAMETERS),
            checksum(EVENTS)
        );
        assert_eq!(read(GENERAL), serde_json::from_str::<Value>(&expected).unwrap());
        assert_eq!(GENERAL_URI, format!("mftp:///{GENERAL}"));
        assert_eq!(PARAMETERS_URI, format!("mftp:///{PARAMETERS}"));
        assert_eq!(EVENTS_URI, format!("mftp:///{EVENTS}"));
    }

    #[test]
    fn every_parameter_is_described_with_its_default_within_its_bounds() {
        let described = read(PARAMETERS);
        let described = described["parameters"].as_array().unwrap();
        assert_eq!(described.len(), Parameter::ALL.len());
        for (parameter, described) in Parameter::ALL.into_iter().zip(described) {
            let definition = parameter.definition();
            assert_eq!(described["name"], definition.name);
            let [default, min, max] = ["default", "min", "max"].map(|key| described[key].as_f64().unwrap());
            assert!(min <= default && default <= max, "{described}");
            assert!(min < max, "{described}");
            assert_eq!(described["readOnly"], definition.access == Access::ReadOnly);
            assert_eq!(described.get("units").is_some(), !definition.unit.is_empty());
            assert_eq!(format!("{}.", described["shortDesc"].as_str().unwrap()), definition.description);
            let kind = if definition.domain.kind() == ParameterType::Int32 { "Int32" } else { "Float" };
            assert_eq!(described["type"], kind);
        }
    }

    /// Keys of `parameter.schema.json`, which allows no others.
    #[test]
    fn the_schema_allows_every_key() {
        let known: BTreeSet<&str> = "name type shortDesc longDesc units default decimalPlaces min max increment \
            rebootRequired group category volatile values bitmask readOnly"
            .split_whitespace()
            .collect();
        for described in read(PARAMETERS)["parameters"].as_array().unwrap() {
            for key in described.as_object().unwrap().keys() {
                assert!(known.contains(&**key), "{key}");
            }
        }
    }

    #[test]
    fn every_choice_has_its_words_and_every_group_its_name() {
        for parameter in Parameter::ALL {
            let described = describe(parameter.definition());
            if let Domain::Choice { choices, .. } = parameter.definition().domain {
                let values: Vec<i32> = described.values.iter().map(|choice| choice.value).collect();
                assert_eq!(values, choices, "{parameter}");
            }
            assert!(GROUPS.iter().any(|(_, group)| *group == described.group), "{parameter}");
        }
        let fence = describe(Parameter::GfAction.definition());
        let words: Vec<&str> = fence.values.iter().map(|choice| choice.description).collect();
        assert_eq!(words, ["nothing", "warn", "hold", "return", "land"]);
    }

    #[test]
    fn a_number_is_written_as_short_as_it_is_and_shown_as_fine() {
        let late = describe(Parameter::RlLateT.definition());
        let text = serde_json::to_string(&late).unwrap();
        assert!(text.contains(r#""default":0.02,"min":0.001,"max":1.0,"decimalPlaces":3,"#), "{text}");
        assert_eq!(describe(Parameter::MisTakeoffAlt.definition()).decimal_places, Some(2));
    }
}
