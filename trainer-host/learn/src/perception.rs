//! What a policy makes of an image before its own layers.

use kestrel_sim::seed::Stream;
use serde::{Deserialize, Serialize};

use crate::actor_critic::Sight;
use crate::network::eye::{Eye, EyeWeights, EyeWorkspace};
use crate::network::{Dense, Trunk, TrunkWorkspace};

/// An eye, and a trunk behind it where there is one.
///
/// Without a trunk, the features of the eye stand behind the observation, and the network reads both. A trunk reads
/// the observation, then the features, and the network reads what the trunk makes of them, in place of the
/// observation. Parameters are one slice: the eye's, then the trunk's.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Perception {
    eye: Eye,
    trunk: Option<Trunk>,
}

impl Perception {
    /// Of an eye and the widths of the layers of a trunk, if any, for observations of so many values.
    pub fn new(eye: Eye, trunk: &[usize], observation_len: usize) -> Self {
        let trunk = (!trunk.is_empty()).then(|| Trunk::new(observation_len + eye.features(), trunk));
        Self { eye, trunk }
    }

    /// What looks at the image.
    pub fn eye(&self) -> &Eye {
        &self.eye
    }

    /// Those of its parameters that are the eye's.
    pub fn encoder_parameters<'p>(&self, parameters: &'p [f32]) -> &'p [f32] {
        &parameters[..self.eye.parameter_count()]
    }

    /// The layers of the trunk, if any; tanh after all of them.
    pub fn trunk_layers<'p>(&self, parameters: &'p [f32]) -> Vec<Dense<'p>> {
        let parameters = &parameters[self.eye.parameter_count()..];
        self.trunk.as_ref().map_or_else(Vec::new, |trunk| trunk.mlp().layers(parameters))
    }

    /// Weights and biases of the layers of the trunk, to be written.
    pub(crate) fn trunk_layers_mut<'p>(&self, parameters: &'p mut [f32]) -> Vec<(&'p mut [f32], &'p mut [f32])> {
        let parameters = &mut parameters[self.eye.parameter_count()..];
        self.trunk.as_ref().map_or_else(Vec::new, |trunk| trunk.mlp().layers_mut(parameters))
    }

    /// Values of the observation that a network behind it reads itself: none where a trunk has read it.
    pub fn unread(&self, observation_len: usize) -> usize {
        if self.trunk.is_some() { 0 } else { observation_len }
    }

    /// Number of values that it makes.
    pub fn outputs(&self) -> usize {
        self.trunk.as_ref().map_or(self.eye.features(), |trunk| trunk.mlp().outputs())
    }

    /// Number of weights and biases.
    pub fn parameter_count(&self) -> usize {
        self.eye.parameter_count() + self.trunk.as_ref().map_or(0, |trunk| trunk.mlp().parameter_count())
    }

    /// Parameters to begin with.
    pub fn initialise(&self, stream: &mut Stream) -> Vec<f32> {
        let mut parameters = self.eye.initialise(stream);
        parameters.extend(self.trunk.iter().flat_map(|trunk| trunk.initialise(stream)));
        parameters
    }

    /// The parameters of the eye, arranged for many tiles until they change.
    pub(crate) fn arrange(&self, parameters: &[f32]) -> EyeWeights {
        self.eye.arrange(self.encoder_parameters(parameters))
    }

    /// As [`Self::arrange`], into what was arranged before.
    pub(crate) fn arrange_into(&self, parameters: &[f32], weights: &mut EyeWeights) {
        weights.arrange(&self.eye, self.encoder_parameters(parameters));
    }

    /// Looks at a tile of `images [columns][image]` beside `values [observation, ..][columns]`; what it makes of them is
    /// in [`PerceptionWorkspace::outputs`].
    pub(crate) fn look(
        &self,
        (parameters, weights): (&[f32], &EyeWeights),
        Sight { values, images }: Sight<'_>,
        workspace: &mut PerceptionWorkspace,
    ) {
        let PerceptionWorkspace { eye, trunk: place, outputs } = workspace;
        let (Some(trunk), Some(place)) = (&self.trunk, place) else {
            return self.eye.forward(weights, images, eye, outputs);
        };
        let observation_values = place.inputs.len() - place.feature_deltas.len();
        let (seen, features) = place.inputs.split_at_mut(observation_values);
        seen.copy_from_slice(&values[..observation_values]);
        self.eye.forward(weights, images, eye, features);
        let parameters = &parameters[self.eye.parameter_count()..];
        outputs.copy_from_slice(trunk.forward(parameters, &place.inputs, &mut place.network));
    }

    /// Adds the parameters' gradient of the tile that [`Self::look`] saw last to `gradient`, from the loss gradient of
    /// what it made of it, `deltas [outputs][columns]`.
    pub(crate) fn learn(
        &self,
        (parameters, weights): (&[f32], &EyeWeights),
        images: &[u8],
        (workspace, deltas): (&mut PerceptionWorkspace, &[f32]),
        gradient: &mut [f32],
    ) {
        let (of_eye, of_trunk) = gradient.split_at_mut(self.eye.parameter_count());
        let PerceptionWorkspace { eye, trunk: place, .. } = workspace;
        let (Some(trunk), Some(place)) = (&self.trunk, place) else {
            return self.eye.backward(weights, images, eye, deltas, of_eye);
        };
        let TrunkPlace { inputs, network, feature_deltas } = place;
        let parameters = &parameters[self.eye.parameter_count()..];
        trunk.backward(parameters, inputs, (network, deltas), of_trunk, feature_deltas);
        self.eye.backward(weights, images, eye, feature_deltas, of_eye);
    }
}

/// What a tile leaves behind on its way through a perception.
#[derive(Clone, Debug)]
pub(crate) struct PerceptionWorkspace {
    eye: EyeWorkspace,
    trunk: Option<TrunkPlace>,
    outputs: Vec<f32>,
}

#[derive(Clone, Debug)]
struct TrunkPlace {
    /// `[observation, then features][columns]`.
    inputs: Vec<f32>,
    network: TrunkWorkspace,
    /// `[features][columns]`.
    feature_deltas: Vec<f32>,
}

impl PerceptionWorkspace {
    /// For tiles of `columns` samples.
    pub(crate) fn new(perception: &Perception, columns: usize) -> Self {
        let Perception { eye, trunk } = perception;
        let place = |trunk: &Trunk| TrunkPlace {
            inputs: vec![0.0; trunk.mlp().inputs() * columns],
            network: TrunkWorkspace::new(trunk, columns),
            feature_deltas: vec![0.0; eye.features() * columns],
        };
        Self {
            eye: EyeWorkspace::new(eye, columns),
            trunk: trunk.as_ref().map(place),
            outputs: vec![0.0; perception.outputs() * columns],
        }
    }

    /// `[outputs][columns]`.
    pub(crate) fn outputs(&self) -> &[f32] {
        &self.outputs
    }
}
