//! Layers that several networks share: what they make of an observation is the input of a head for each.

use kestrel_core::seed::Stream;
use pulp::{Simd, WithSimd};
use serde::{Deserialize, Serialize};

use super::aligned::Aligned;
use super::kernel::dispatch;
use super::sample_matrix::transpose;
use super::{HIDDEN_GAIN, Mlp, Workspace};

/// A multilayer perceptron with tanh after every layer, the last one too.
///
/// An actor and a critic that share 512-256 and then have 256 of their own are a trunk of widths 512-256 and two [`Mlp`]
/// with 256 inputs and one hidden layer of 256. On the way back, each head's [`Mlp::backward_to_inputs`] gives the loss
/// gradient of what the trunk put out; their sum goes into [`SharedTrunk::backward`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct SharedTrunk {
    mlp: Mlp,
}

impl SharedTrunk {
    /// `inputs`, then the widths of the layers.
    ///
    /// # Panics
    /// When there is no layer.
    pub fn new(inputs: usize, widths: &[usize]) -> Self {
        let (outputs, hidden) = widths.split_last().expect("a trunk has at least one layer");
        Self { mlp: Mlp::new(inputs, hidden, *outputs) }
    }

    /// Its shape and the order of its parameters, but for the tanh behind the last layer.
    pub fn mlp(&self) -> &Mlp {
        &self.mlp
    }

    /// Orthogonal weights of gain root two and zero biases.
    pub fn initialise(&self, stream: &mut Stream) -> Vec<f32> {
        self.mlp.initialise(HIDDEN_GAIN, stream)
    }

    /// Evaluates a slice, `inputs [inputs][columns]`, and returns what the heads have as inputs, `[outputs][columns]`.
    ///
    /// # Panics
    /// When `inputs` is not of this shape or the workspace is of another trunk.
    pub fn forward<'w>(
        &self,
        parameters: &[f32],
        inputs: &[f32],
        workspace: &'w mut SharedTrunkWorkspace,
    ) -> &'w [f32] {
        let SharedTrunkWorkspace { network, transposed, activations } = workspace;
        let (last, behind_hidden, outputs) = self.mlp.forward_hidden(parameters, inputs, network);
        last.affine_activated(behind_hidden, transposed, activations);
        transpose(activations, self.mlp.outputs(), outputs);
        &network.outputs
    }

    /// Adds the parameters' gradient of a slice to `gradient`, from `output_deltas [outputs][columns]`, the loss gradient
    /// of what [`Self::forward`] of the same `inputs` returned; and writes the loss gradient of the last inputs, as
    /// many as `input_deltas [inputs][columns]` has rows, or none.
    pub fn backward(
        &self,
        parameters: &[f32],
        inputs: &[f32],
        (workspace, output_deltas): (&mut SharedTrunkWorkspace, &[f32]),
        gradient: &mut [f32],
        input_deltas: &mut [f32],
    ) {
        let (outputs, deltas) = workspace.network.output_delta();
        deltas.copy_from_slice(output_deltas);
        dispatch(TanhDerivative { outputs, deltas });
        if input_deltas.is_empty() {
            self.mlp.backward(parameters, inputs, &mut workspace.network, gradient);
        } else {
            self.mlp.backward_to_inputs(parameters, inputs, &mut workspace.network, gradient, input_deltas);
        }
    }
}

/// What a slice leaves behind on its way through a trunk, and the loss gradients on the way back.
#[derive(Clone, Debug)]
pub struct SharedTrunkWorkspace {
    network: Workspace,
    /// The last layer's weights, `[inputs][outputs]`.
    transposed: Aligned,
    /// The last layer's, `[columns][outputs]`.
    activations: Aligned,
}

impl SharedTrunkWorkspace {
    /// For slices of `columns` samples.
    pub fn new(trunk: &SharedTrunk, columns: usize) -> Self {
        let widths = trunk.mlp.widths();
        let [inputs, outputs] = [widths[widths.len() - 2], widths[widths.len() - 1]];
        Self {
            network: Workspace::new(&trunk.mlp, columns),
            transposed: Aligned::zeros(inputs * outputs),
            activations: Aligned::zeros(outputs * columns),
        }
    }
}

/// `deltas[i] *= 1 - outputs[i]^2`.
struct TanhDerivative<'a> {
    outputs: &'a [f32],
    deltas: &'a mut [f32],
}

impl WithSimd for TanhDerivative<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (delta, output) in self.deltas.iter_mut().zip(self.outputs) {
            *delta *= 1.0 - output * output;
        }
    }
}

#[cfg(test)]
mod tests;
