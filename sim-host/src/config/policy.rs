//! Policy files in configurations.
//!
//! `import: hover.kestrel` in an `initial_policy` is the mapping `base64: …` with the bytes of that file: a resolved
//! configuration is complete without it.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use kestrel_config::ConfigError;
use kestrel_config::node::{Entry, Node, Value};
use kestrel_config::notation::ImportedFile;
use kestrel_config::text::read_bytes;

/// The key whose mapping may import a policy file.
const INITIAL_POLICY: &str = "initial_policy";

/// Largest policy file \[bytes\].
const SIZE_LIMIT: u64 = 1 << 20;

/// What a file that is imported as a policy should be.
const EXPECTED: &str = "a policy: a file `.kestrel`, relative to the file that imports it";

/// Whether a file that is imported is a policy, by the end of its name and the key that imports it.
///
/// # Errors
/// For a file of another kind, or a policy that is imported where none can be.
pub(super) fn is_policy(file: &ImportedFile<'_>) -> Result<bool, ConfigError> {
    let extension = file.path.extension().map(|extension| extension.to_string_lossy().to_ascii_lowercase());
    let refuse = |what: &str, expected: &str| Err(file.refuse(what, expected));
    match (extension.as_deref() == Some("kestrel"), file.mapping_key == Some(INITIAL_POLICY)) {
        (true, true) => Ok(true),
        (true, false) => {
            let expected =
                format!("policies only in a key `{INITIAL_POLICY}`: `{INITIAL_POLICY}: {{ import: … }}`");
            refuse("a policy", &expected)
        }
        (false, true) => refuse("a file of another kind", EXPECTED),
        (false, false) => Ok(false),
    }
}

/// The file as a mapping, and how long that is \[bytes\].
///
/// # Errors
/// When it cannot be read.
pub(super) fn tree(file: &ImportedFile<'_>) -> Result<(Node, usize), ConfigError> {
    let bytes = read_bytes(file.path, SIZE_LIMIT).map_err(|fault| file.refuse(fault, EXPECTED))?;
    let text = STANDARD.encode(bytes);
    let len = text.len();
    let place = file.beginning();
    let node = |value: Value| Node { value, place: place.clone(), import: None };
    let entry = Entry::new("base64".to_owned(), place.clone(), node(Value::Text(text)));
    Ok((Node { import: Some(file.importer.clone()), ..node(Value::Mapping(vec![entry])) }, len))
}

/// The bytes of a policy file from the text that configurations hold.
///
/// # Errors
/// What is wrong with the text.
pub fn policy_bytes(base64: &str) -> Result<Vec<u8>, base64::DecodeError> {
    STANDARD.decode(base64)
}
