//! Weights by name, as PyTorch names those of `nn.Linear`s in an `nn.Sequential` with tangents between them.

use ::safetensors::serialize;
use ::safetensors::tensor::{Dtype, TensorView};

use super::{ExchangeError, Layer, bytes_of, float_policy, layers, metadata};

/// Modules of a `Sequential` from one dense layer to the next: the layer and its tangents.
const STRIDE: usize = 2;

/// The policy file `bytes` in float, which start on a four-byte boundary of memory, as a safetensors file: `0.weight [outputs, inputs]`, `0.bias`, `2.weight`, ...; beside
/// them `golden.observations` and `golden.actions`, which whoever builds the network anew can check it with. Actions are
/// limited to \[-1, 1\] behind the last layer. The file's metadata says under `kestrel` what the policy sees and commands.
///
/// # Errors
/// [`ExchangeError`].
///
/// # Panics
/// Never: names and shapes are sound.
pub fn safetensors_file(bytes: &[u8]) -> Result<Vec<u8>, ExchangeError> {
    let policy = float_policy(bytes)?;
    let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
    for (index, Layer { inputs, outputs, weights, biases }) in layers(&policy).into_iter().enumerate() {
        let module = index * STRIDE;
        tensors.push((format!("{module}.weight"), vec![outputs, inputs], bytes_of(&weights)));
        tensors.push((format!("{module}.bias"), vec![outputs], bytes_of(&biases)));
    }
    let lens = [policy.metadata().observation.len(), policy.metadata().action.len()];
    let (mut observations, mut actions) = (Vec::new(), Vec::new());
    for (observation, action) in policy.golden_vectors() {
        observations.extend_from_slice(&observation[..lens[0]]);
        actions.extend_from_slice(&action[..lens[1]]);
    }
    for (name, len, values) in
        [("golden.observations", lens[0], observations), ("golden.actions", lens[1], actions)]
    {
        tensors.push((name.to_owned(), vec![values.len() / len, len], bytes_of(&values)));
    }
    let views = tensors.iter().map(|(name, shape, data)| {
        (name, TensorView::new(Dtype::F32, shape.clone(), data).expect("as many values as the shape says"))
    });
    // One entry only: the order of several would not be the same each time.
    let about = [("kestrel".to_owned(), metadata(&policy))].into();
    Ok(serialize(views, Some(about)).expect("names and shapes are sound"))
}
