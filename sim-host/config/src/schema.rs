//! JSON schemas of configuration files, for editors.

use schemars::{JsonSchema, schema_for};
use serde_json::{Map, Value, json};

use crate::import::IMPORT;

/// The JSON schema of files that hold a `T`, in which every mapping may also import another file.
///
/// # Panics
/// Never: a schema is JSON.
pub fn schema_of<T: JsonSchema>() -> String {
    let mut schema = Value::from(schema_for!(T));
    allow_imports(&mut schema);
    let text = serde_json::to_string_pretty(&schema).expect("a schema is JSON");
    format!("{text}\n")
}

fn allow_imports(schema: &mut Value) {
    let Value::Object(keywords) = schema else { return };
    if keywords.contains_key("properties") {
        allow_import_beside(keywords);
    }
    for (keyword, inner) in keywords.iter_mut() {
        match (keyword.as_str(), inner) {
            ("oneOf", Value::Array(variants)) => allow_import_as_variant(variants),
            ("anyOf" | "prefixItems", Value::Array(schemas)) => schemas.iter_mut().for_each(allow_imports),
            ("properties" | "$defs", Value::Object(schemas)) => schemas.values_mut().for_each(allow_imports),
            ("items" | "additionalProperties", inner) => allow_imports(inner),
            _ => {}
        }
    }
}

/// Keys that are required may come from the file.
fn allow_import_beside(keywords: &mut Map<String, Value>) {
    if let Some(Value::Object(properties)) = keywords.get_mut("properties") {
        properties.insert(IMPORT.to_owned(), import());
    }
    if let Some(required) = keywords.remove("required") {
        let either = json!([{ "required": required }, { "required": [IMPORT] }]);
        keywords.insert("anyOf".to_owned(), either);
    }
}

/// A choice has one key; with an import beside it, it covers the one in the file.
fn allow_import_as_variant(variants: &mut Vec<Value>) {
    let mut mappings = false;
    for variant in variants.iter_mut() {
        if let Some(Value::Object(contents)) = variant.get_mut("properties") {
            contents.values_mut().for_each(allow_imports);
            mappings = true;
        }
    }
    if mappings {
        variants.push(json!({
            "description": "As the file says, except for the keys here.",
            "type": "object",
            "properties": { IMPORT: import() },
            "required": [IMPORT],
        }));
    }
}

fn import() -> Value {
    json!({
        "description": "A YAML file, relative to this one: its keys count where they are not written here.",
        "type": "string",
    })
}
