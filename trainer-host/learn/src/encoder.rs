//! What a policy makes of an image before its own layers.

use kestrel_core::seed::Stream;
use serde::{Deserialize, Serialize};

use crate::network::InputBatch;
use crate::network::cnn::{Cnn, CnnWeights, CnnWorkspace};
use crate::network::{Dense, SharedTrunk, SharedTrunkWorkspace};

/// A CNN, and a trunk behind it where there is one.
///
/// Without a trunk, the features of the CNN stand behind the observation, and the network reads both. A trunk reads
/// the observation, then the features, and the network reads what the trunk makes of them, in place of the
/// observation. Parameters are one slice: the CNN's, then the trunk's.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Encoder {
    cnn: Cnn,
    trunk: Option<SharedTrunk>,
}

impl Encoder {
    /// Of a CNN and the widths of the layers of a trunk, if any, for observations of so many values.
    pub fn new(cnn: Cnn, trunk: &[usize], observation_len: usize) -> Self {
        let trunk = (!trunk.is_empty()).then(|| SharedTrunk::new(observation_len + cnn.features(), trunk));
        Self { cnn, trunk }
    }

    /// What looks at the image.
    pub fn cnn(&self) -> &Cnn {
        &self.cnn
    }

    /// Those of its parameters that are the CNN's.
    pub fn cnn_parameters<'p>(&self, parameters: &'p [f32]) -> &'p [f32] {
        &parameters[..self.cnn.parameter_count()]
    }

    /// The layers of the trunk, if any; tanh after all of them.
    pub fn trunk_layers<'p>(&self, parameters: &'p [f32]) -> Vec<Dense<'p>> {
        let parameters = &parameters[self.cnn.parameter_count()..];
        self.trunk.as_ref().map_or_else(Vec::new, |trunk| trunk.mlp().layers(parameters))
    }

    /// Weights and biases of the layers of the trunk, to be written.
    pub(crate) fn trunk_layers_mut<'p>(&self, parameters: &'p mut [f32]) -> Vec<(&'p mut [f32], &'p mut [f32])> {
        let parameters = &mut parameters[self.cnn.parameter_count()..];
        self.trunk.as_ref().map_or_else(Vec::new, |trunk| trunk.mlp().layers_mut(parameters))
    }

    /// Values of the observation that a network behind it reads itself: none where a trunk has read it.
    pub fn unread(&self, observation_len: usize) -> usize {
        if self.trunk.is_some() { 0 } else { observation_len }
    }

    /// Number of values that it makes.
    pub fn outputs(&self) -> usize {
        self.trunk.as_ref().map_or(self.cnn.features(), |trunk| trunk.mlp().outputs())
    }

    /// Number of weights and biases.
    pub fn parameter_count(&self) -> usize {
        self.cnn.parameter_count() + self.trunk.as_ref().map_or(0, |trunk| trunk.mlp().parameter_count())
    }

    /// Parameters to begin with.
    pub fn initialise(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = self.cnn.initialise(stream);
        parameters.extend(self.trunk.iter().flat_map(|trunk| trunk.initialise(stream)));
        parameters
    }

    /// The parameters of the CNN, arranged for many slices until they change.
    pub(crate) fn arrange(&self, parameters: &[f32]) -> CnnWeights {
        self.cnn.arrange(self.cnn_parameters(parameters))
    }

    /// As [`Self::arrange`], into what was arranged before.
    pub(crate) fn arrange_into(&self, parameters: &[f32], weights: &mut CnnWeights) {
        weights.arrange(&self.cnn, self.cnn_parameters(parameters));
    }

    /// Looks at a slice of `images [columns][image]` beside `values [observation, ..][columns]`; what it makes of them is
    /// in [`EncoderWorkspace::outputs`].
    pub(crate) fn encode(
        &self,
        (parameters, weights): (&[f32], &CnnWeights),
        InputBatch { values, images, .. }: InputBatch<'_>,
        workspace: &mut EncoderWorkspace,
    ) {
        let EncoderWorkspace { cnn, trunk: place, outputs } = workspace;
        let (Some(trunk), Some(place)) = (&self.trunk, place) else {
            return self.cnn.forward(weights, images, cnn, outputs);
        };
        let observation_values = place.inputs.len() - place.feature_deltas.len();
        let (seen, features) = place.inputs.split_at_mut(observation_values);
        seen.copy_from_slice(&values[..observation_values]);
        self.cnn.forward(weights, images, cnn, features);
        let parameters = &parameters[self.cnn.parameter_count()..];
        outputs.copy_from_slice(trunk.forward(parameters, &place.inputs, &mut place.network));
    }

    /// Adds the parameters' gradient of the slice that [`Self::encode`] saw last to `gradient`, from the loss gradient of
    /// what it made of it, `deltas [outputs][columns]`.
    pub(crate) fn backward(
        &self,
        (parameters, weights): (&[f32], &CnnWeights),
        images: &[u8],
        (workspace, deltas): (&mut EncoderWorkspace, &[f32]),
        gradient: &mut [f32],
    ) {
        let (of_cnn, of_trunk) = gradient.split_at_mut(self.cnn.parameter_count());
        let EncoderWorkspace { cnn, trunk: place, .. } = workspace;
        let (Some(trunk), Some(place)) = (&self.trunk, place) else {
            return self.cnn.backward(weights, images, cnn, deltas, of_cnn);
        };
        let TrunkState { inputs, network, feature_deltas } = place;
        let parameters = &parameters[self.cnn.parameter_count()..];
        trunk.backward(parameters, inputs, (network, deltas), of_trunk, feature_deltas);
        self.cnn.backward(weights, images, cnn, feature_deltas, of_cnn);
    }
}

/// What a slice leaves behind on its way through an encoder.
#[derive(Clone, Debug)]
pub(crate) struct EncoderWorkspace {
    cnn: CnnWorkspace,
    trunk: Option<TrunkState>,
    outputs: Vec<f32>,
}

#[derive(Clone, Debug)]
struct TrunkState {
    /// `[observation, then features][columns]`.
    inputs: Vec<f32>,
    network: SharedTrunkWorkspace,
    /// `[features][columns]`.
    feature_deltas: Vec<f32>,
}

impl EncoderWorkspace {
    /// For slices of `columns` samples.
    pub(crate) fn new(encoder: &Encoder, columns: usize) -> Self {
        let Encoder { cnn, trunk } = encoder;
        let place = |trunk: &SharedTrunk| TrunkState {
            inputs: vec![0.0; trunk.mlp().inputs() * columns],
            network: SharedTrunkWorkspace::new(trunk, columns),
            feature_deltas: vec![0.0; cnn.features() * columns],
        };
        Self {
            cnn: CnnWorkspace::new(cnn, columns),
            trunk: trunk.as_ref().map(place),
            outputs: vec![0.0; encoder.outputs() * columns],
        }
    }

    /// `[outputs][columns]`.
    pub(crate) fn outputs(&self) -> &[f32] {
        &self.outputs
    }
}
