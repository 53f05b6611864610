//! What ships, for tests.

use std::fs;
use std::path::Path;

use kestrel_experiments::experiment_config;

use crate::policy::WebPolicy;

/// The shipped task of a name, with resolved imports.
pub(crate) fn task(name: &str) -> String {
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let paths = ["configs", "configs/aviaries"].map(|folder| repository.join(folder).join(format!("{name}.yaml")));
    let path = paths.iter().find(|path| path.exists()).unwrap();
    experiment_config::load(path, &[]).unwrap().resolved_yaml
}

/// Its shipped pilot.
pub(crate) fn pilot(name: &str) -> WebPolicy {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/pilots");
    WebPolicy::of(fs::read(folder.join(format!("{name}.kestrel"))).unwrap()).unwrap()
}
