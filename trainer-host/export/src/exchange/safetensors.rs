//! Weights by name, as PyTorch names those of `nn.Linear`s in an `nn.Sequential` with `nn.Tanh` or `nn.ReLU` between them.

use ::safetensors::serialize;
use ::safetensors::tensor::{Dtype, TensorView};

use super::{ExchangeError, Exchanged, Layer, bytes_of};

/// Modules of a `Sequential` from one dense layer to the next: the layer and its activation.
const STRIDE: usize = 2;

/// The policy file `bytes` in float, which start on a four-byte boundary of memory, as a safetensors file: `0.weight [outputs, inputs]`, `0.bias`, `2.weight`, ...; beside
/// them, for a recurrent policy, `memory.gates` and `memory.candidate` as [`kestrel_core::gru`] has them, and
/// `golden.observations` and `golden.actions`, which whoever builds the network anew can check it with. Actions are
/// limited to \[-1, 1\] behind the last layer. The file's metadata says under `kestrel` what the policy sees and commands, and its `activation` where
/// that is not the tangent.
///
/// # Errors
/// [`ExchangeError`].
///
/// # Panics
/// Never: names and shapes are sound.
pub fn safetensors_file(bytes: &[u8]) -> Result<Vec<u8>, ExchangeError> {
    let Exchanged { observation_len, action_len, memory, layers, golden, metadata, .. } = Exchanged::parse(bytes)?;
    let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
    let of_memory =
        ["memory.gates", "memory.candidate"].map(str::to_owned).into_iter().zip(memory.into_iter().flatten());
    let modules = layers.into_iter().enumerate().map(|(index, layer)| ((index * STRIDE).to_string(), layer));
    for (module, Layer { inputs, outputs, weights, biases }) in of_memory.chain(modules) {
        tensors.push((format!("{module}.weight"), vec![outputs, inputs], bytes_of(&weights)));
        tensors.push((format!("{module}.bias"), vec![outputs], bytes_of(&biases)));
    }
    let names = [("golden.observations", observation_len), ("golden.actions", action_len)];
    for ((name, len), values) in names.into_iter().zip(golden) {
        tensors.push((name.to_owned(), vec![values.len() / len, len], bytes_of(&values)));
    }
    let views = tensors.iter().map(|(name, shape, data)| {
        (name, TensorView::new(Dtype::F32, shape.clone(), data).expect("as many values as the shape says"))
    });
    // One entry only: the order of several would not be the same each time.
    let about = [("kestrel".to_owned(), metadata)].into();
    Ok(serialize(views, Some(about)).expect("names and shapes are sound"))
}
