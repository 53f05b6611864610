//! Networks that other programs trained, as ONNX or safetensors: multilayer perceptrons, with one kind of activation between
//! their layers and behind the last one nothing or a tangent. What stands in front of the first layer or behind the last and
//! is affine, such as a normalisation of observations, is folded into it.

mod error;
mod graph;
mod perceptron;
mod state_dict;
#[cfg(test)]
mod tests;

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use ::safetensors::tensor::{Dtype, SafeTensors};
use kestrel_core::action::ActionSpace;
use kestrel_core::observation::ObservationLayout;
use kestrel_core::policy_file::Activation;

pub use error::ImportError;
pub use perceptron::ImportedNetwork;
pub use state_dict::StateDict;

/// Most bytes of a file: the largest policy takes 0.3 MB, critics and their targets beside it a few more.
const FILE_LIMIT: u64 = 64 << 20;

/// What stands behind the last layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutputActivation {
    /// Nothing: actions are the sums, limited to \[-1, 1\].
    Identity,
    /// Hyperbolic tangent, as of SAC and TD3.
    Tanh,
}

/// What a task asks of a network, and what its user knows of it.
#[derive(Clone, Copy, Debug)]
pub struct ImportSettings<'a> {
    /// What the first layer reads.
    pub observation: &'a ObservationLayout,
    /// What the last layer writes.
    pub action: &'a ActionSpace,
    /// Between the layers; weights do not tell, but names may.
    pub activation: Option<Activation>,
    /// Behind the last layer; weights do not tell, but names may.
    pub output: Option<OutputActivation>,
}

/// The network in the ONNX or safetensors file at `path`.
///
/// # Errors
/// [`ImportError`]: which tensor or node, what was found and what was expected.
pub fn import_network(path: &Path, settings: &ImportSettings<'_>) -> Result<ImportedNetwork, ImportError> {
    let bytes = read_limited(path)?;
    match kind(&bytes)? {
        Kind::Safetensors => StateDict::parse(&bytes)?.network(settings),
        Kind::Onnx => graph::network(&bytes, path.parent().unwrap_or(Path::new("")), settings),
    }
}

/// Forms of networks.
enum Kind {
    Safetensors,
    Onnx,
}

/// The form of the network in a file, by its first bytes.
fn kind(bytes: &[u8]) -> Result<Kind, ImportError> {
    let starts = [
        (&b"PK\x03\x04"[..], "a zip archive, as PyTorch and Stable-Baselines3 save"),
        (b"\x80\x02", "a pickle, as older PyTorch saves"),
        (b"\x89HDF", "an HDF5 file"),
        (b"\x89KPOL", "a policy file of Kestrel, which needs no import"),
    ];
    if let Some((_, found)) = starts.iter().find(|(start, _)| bytes.starts_with(start)) {
        return Err(ImportError::file(*found, EXPECTED_FILE));
    }
    match bytes {
        [] => Err(ImportError::file("an empty file", EXPECTED_FILE)),
        // Behind the length of a header in JSON stands the header.
        [_, _, _, _, _, _, _, _, b'{', ..] => Ok(Kind::Safetensors),
        // The version of the format, or the name of who wrote it, or the graph: the first fields of a model.
        [0x08 | 0x12 | 0x3a, ..] => Ok(Kind::Onnx),
        _ => Err(ImportError::file(format!("a file that begins with {:?}", beginning(bytes)), EXPECTED_FILE)),
    }
}

const EXPECTED_FILE: &str = "a model as ONNX, or a state dict as safetensors";

/// For people to recognise a file by.
fn beginning(bytes: &[u8]) -> String {
    String::from_utf8_lossy(&bytes[..bytes.len().min(12)]).into_owned()
}

fn read_limited(path: &Path) -> Result<Vec<u8>, ImportError> {
    let found = fs::metadata(path)?;
    if found.len() > FILE_LIMIT {
        let megabytes = found.len() >> 20;
        return Err(ImportError::file(format!("{megabytes} MiB"), format!("at most {} MiB", FILE_LIMIT >> 20)));
    }
    let mut bytes = Vec::new();
    // A file that grows meanwhile, or a device, has no length to rely on.
    File::open(path)?.take(FILE_LIMIT).read_to_end(&mut bytes)?;
    Ok(bytes)
}

impl StateDict {
    /// The tensors of a safetensors file.
    fn parse(bytes: &[u8]) -> Result<Self, ImportError> {
        let damaged = |cause| ImportError::file(format!("a damaged safetensors file ({cause})"), EXPECTED_FILE);
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
        let about = header.metadata().as_ref().and_then(|metadata| metadata.get("kestrel")).cloned();
        let mut tensors = Self::new(about);
        for (name, view) in SafeTensors::deserialize(bytes).map_err(damaged)?.tensors() {
            if view.dtype() == Dtype::F32 {
                let values = view.data().as_chunks().0.iter().map(|word| f32::from_le_bytes(*word));
                tensors.insert(name, view.shape(), values.collect());
            } else {
                tensors.insert_other(name, view.dtype());
            }
        }
        Ok(tensors)
    }
}
