//! What scenarios are written in beside YAML: airframes in URDF, meshes in OBJ and STL; and what a training begins with,
//! policy files.

use std::path::Path;
use std::sync::Arc;

use kestrel_config::ConfigError;
use kestrel_config::error::Source;
use kestrel_config::node::Node;
use kestrel_config::notation::{ImportedFile, Notations};

use super::{mesh, policy, urdf};

/// A configuration of this simulator.
pub type Document = kestrel_config::Document<DroneNotations>;

/// URDF is another form of an airframe's numbers, OBJ and STL are forms of what a key `mesh` holds, and a policy file is one
/// of what `initial_policy` holds.
#[derive(Clone, Copy, Debug)]
pub enum DroneNotations {}

impl Notations for DroneNotations {
    fn text(source: &Arc<Source>) -> Option<Result<Node, ConfigError>> {
        match &**source {
            Source::File { name, text, .. } if is_urdf(name) => Some(urdf::tree(source, text)),
            Source::File { .. } | Source::Override { .. } => None,
        }
    }

    fn file(file: &ImportedFile<'_>) -> Result<Option<(Node, usize)>, ConfigError> {
        if policy::is_policy(file)? {
            return policy::tree(file).map(Some);
        }
        if mesh::is_mesh(file)? { mesh::tree(file).map(Some) } else { Ok(None) }
    }
}

fn is_urdf(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("urdf"))
}
