//! Weights by name: which of them are the actor's, and in which order.

use std::collections::BTreeMap;
use std::fmt::Display;

use kestrel_core::mlp::LAYER_LIMIT;
use kestrel_core::policy_file::Activation;

use super::perceptron::{Orientation, Perceptron, Tensor};
use super::{ImportError, ImportSettings, ImportedNetwork, OutputActivation};

/// Tensors by name, as PyTorch's `state_dict()` and flax's parameters have them.
#[derive(Clone, Debug, Default)]
pub struct StateDict {
    tensors: BTreeMap<String, Tensor>,
    /// Kinds of number of those that are not `f32`.
    others: BTreeMap<String, String>,
    /// What Kestrel wrote about it.
    kestrel: Option<String>,
}

/// Last parts of the names of matrices that are `[outputs, inputs]` unless a bias says otherwise.
const OUTPUTS_FIRST: [&str; 2] = ["weight", "weights"];

/// Last parts of the names of matrices that are `[inputs, outputs]`: flax's and Keras', Haiku's.
const INPUTS_FIRST: [&str; 2] = ["kernel", "w"];

/// Last parts of the names of biases.
const BIASES: [&str; 3] = ["bias", "biases", "b"];

/// Parts of names of what is not the mean action: critics, the spread of actions, targets, and our golden vectors.
const OTHER_PARTS: [&str; 9] =
    ["critic", "value", "target", "log_std", "logstd", "log_alpha", "ret_rms", "optimizer", "golden"];

/// What SB3 and gymnasium add to a variance under its root.
const VARIANCE_FLOOR: f64 = 1e-8;

/// What a name says of activations and origin.
struct Convention {
    /// A part of a tensor's name.
    part: &'static str,
    activation: Activation,
    output: OutputActivation,
    origin: &'static str,
}

const fn convention(
    part: &'static str,
    origin: &'static str,
    activation: Activation,
    output: OutputActivation,
) -> Convention {
    Convention { part, activation, output, origin }
}

/// Names and defaults of `stable_baselines3` 2 and of `CleanRL`'s files for continuous actions; the first that fits counts.
const CONVENTIONS: [Convention; 6] = [
    convention("latent_pi", "Stable-Baselines3's SAC", Activation::Relu, OutputActivation::Tanh),
    convention("action_net", "Stable-Baselines3's PPO", Activation::Tanh, OutputActivation::Identity),
    convention("actor_mean", "CleanRL's PPO", Activation::Tanh, OutputActivation::Identity),
    convention("fc_mean", "CleanRL's SAC", Activation::Relu, OutputActivation::Tanh),
    convention("fc_mu", "CleanRL's TD3", Activation::Relu, OutputActivation::Tanh),
    convention("mu", "Stable-Baselines3's TD3", Activation::Relu, OutputActivation::Tanh),
];

/// A dense layer by its names.
struct Dense {
    matrix: Tensor,
    orientation: Orientation,
    bias: Option<Tensor>,
}

impl Dense {
    fn shape(&self) -> [usize; 2] {
        match (self.orientation, &self.matrix.shape[..]) {
            (Orientation::OutputsFirst, &[outputs, inputs]) | (Orientation::InputsFirst, &[inputs, outputs]) => {
                [inputs, outputs]
            }
            (Orientation::OutputsFirst | Orientation::InputsFirst, _) => [0, 0],
        }
    }
}

impl StateDict {
    /// Without tensors yet; what Kestrel wrote about them, if it was Kestrel.
    pub fn new(kestrel: Option<String>) -> Self {
        Self { kestrel, ..Self::default() }
    }

    /// Adds a tensor of `f32`, row by row.
    pub fn insert(&mut self, name: String, shape: &[usize], values: Vec<f32>) {
        self.tensors.insert(name.clone(), Tensor { name, shape: shape.to_owned(), values });
    }

    /// Adds a tensor of another kind of number.
    pub fn insert_other(&mut self, name: String, kind: impl Display) {
        self.others.insert(name, kind.to_string());
    }

    /// The network of the mean action in it.
    ///
    /// # Errors
    /// [`ImportError`]: which tensor, what was found and what was expected.
    pub fn network(mut self, settings: &ImportSettings<'_>) -> Result<ImportedNetwork, ImportError> {
        self.keep_the_actor()?;
        let convention = self.convention();
        let origin = convention.map_or("A state dict", |convention| convention.origin);
        let (activation, output) = self.activations(settings, convention)?;
        let normalisation = self.take_normalisation();
        let [scale, bias] = ["action_scale", "action_bias"].map(|part| self.take(part));
        let layers = in_order(self.take_layers()?, settings.observation.len());
        self.refuse_rest()?;
        let mut perceptron = Perceptron::new(settings);
        for (tensor, what) in &normalisation {
            match what {
                Normalisation::Mean => perceptron.shift(tensor)?,
                Normalisation::Deviation => perceptron.scale(tensor)?,
            }
        }
        if let (Activation::Relu, OutputActivation::Tanh, Some(last)) = (activation, output, layers.last()) {
            let expected = "one activation throughout: train with tanh, and say so, --activation tanh";
            return Err(ImportError::tensor(&last.matrix.name, "tanh behind it, and relu before", expected));
        }
        let count = layers.len();
        for (index, Dense { matrix, orientation, bias }) in layers.into_iter().enumerate() {
            let place = format!("tensor {}", matrix.name);
            perceptron.dense(matrix, orientation, bias.as_ref())?;
            if index + 1 < count {
                perceptron.activate(activation, &place)?;
            } else if output == OutputActivation::Tanh {
                perceptron.activate(Activation::Tanh, &place)?;
            }
        }
        scale.iter().try_for_each(|scale| perceptron.scale(scale))?;
        bias.iter().try_for_each(|bias| perceptron.shift(bias))?;
        perceptron.finish(origin)
    }

    /// Drops what is not the mean action, and refuses what is and can't be held.
    fn keep_the_actor(&mut self) -> Result<(), ImportError> {
        let other = |name: &str| {
            parts(name).any(|part| {
                OTHER_PARTS.iter().any(|other| part.contains(other))
                    || ["qf", "vf"].iter().any(|q| part.starts_with(q))
            })
        };
        self.tensors.retain(|name, _| !other(name));
        self.others.retain(|name, _| !other(name));
        if let Some((name, kind)) = self.others.first_key_value() {
            return Err(ImportError::tensor(name, kind, "F32: save weights as 32-bit numbers"));
        }
        let recurrent = |name: &&String| parts(name).any(|part| part.starts_with("weight_hh") || part == "memory");
        match self.tensors.keys().find(recurrent) {
            Some(name) => Err(ImportError::tensor(
                name,
                "a recurrent network",
                "dense layers alone: the memory of a policy file gates its state in another place",
            )),
            None => Ok(()),
        }
    }

    /// Whose names these are.
    fn convention(&self) -> Option<&'static Convention> {
        CONVENTIONS.iter().find(|known| self.tensors.keys().any(|name| parts(name).any(|part| part == known.part)))
    }

    /// What stands between the layers and behind the last one: as the user says, else as our metadata or names tell.
    fn activations(
        &self,
        settings: &ImportSettings<'_>,
        convention: Option<&Convention>,
    ) -> Result<(Activation, OutputActivation), ImportError> {
        let ours = self.kestrel.as_ref().map(|about| {
            if about.contains("\"activation\":\"relu\"") { Activation::Relu } else { Activation::Tanh }
        });
        let activation = settings.activation.or(ours).or(convention.map(|known| known.activation));
        let Some(activation) = activation else {
            let name = self.tensors.keys().next().map_or("none", String::as_str);
            let found = format_args!("tensors whose names tell no activation, such as {name}");
            return Err(ImportError::file(found, "to be told it: --activation tanh or relu"));
        };
        let output = settings.output.or(convention.map(|known| known.output));
        Ok((activation, output.unwrap_or(OutputActivation::Identity)))
    }

    /// The running mean and variance of observations, as a shift and a factor.
    fn take_normalisation(&mut self) -> Vec<(Tensor, Normalisation)> {
        let named = |last: &'static str| {
            move |name: &&String| {
                let mut parts = parts(name).rev();
                parts.next() == Some(last) && parts.next() == Some("obs_rms")
            }
        };
        let mut found = Vec::new();
        if let Some(name) = self.tensors.keys().find(named("mean")).cloned() {
            let mut mean = self.tensors.remove(&name).expect("it was found");
            mean.values.iter_mut().for_each(|value| *value = -*value);
            found.push((mean, Normalisation::Mean));
        }
        if let Some(name) = self.tensors.keys().find(named("var")).cloned() {
            let mut variance = self.tensors.remove(&name).expect("it was found");
            let factor = |value: f32| (1.0 / (f64::from(value) + VARIANCE_FLOOR).sqrt()) as f32;
            variance.values.iter_mut().for_each(|value| *value = factor(*value));
            found.push((variance, Normalisation::Deviation));
        }
        if let Some(name) = self.tensors.keys().find(named("count")).cloned() {
            self.tensors.remove(&name);
        }
        found
    }

    fn take(&mut self, last: &str) -> Option<Tensor> {
        let name = self.tensors.keys().find(|name| parts(name).next_back() == Some(last)).cloned()?;
        self.tensors.remove(&name)
    }

    /// Matrices with their biases, in the order in which people count names.
    fn take_layers(&mut self) -> Result<Vec<Dense>, ImportError> {
        let is_matrix = |name: &&String| {
            let last = last_part(name);
            OUTPUTS_FIRST.contains(&last) || INPUTS_FIRST.contains(&last)
        };
        let mut names: Vec<String> = self
            .tensors
            .iter()
            .filter(|(name, tensor)| is_matrix(name) && tensor.shape.len() == 2)
            .map(|(name, _)| name.clone())
            .collect();
        names.sort_by_key(|name| counted(name));
        if names.is_empty() {
            return Err(ImportError::file("no matrix of weights", "dense layers, such as 0.weight and 0.bias"));
        }
        if names.len() > LAYER_LIMIT {
            let found = format_args!("{} layers, {} to {}", names.len(), names[0], names[names.len() - 1]);
            return Err(ImportError::file(found, format_args!("at most {LAYER_LIMIT}")));
        }
        Ok(names.iter().map(|name| self.take_layer(name)).collect())
    }

    fn take_layer(&mut self, name: &str) -> Dense {
        let matrix = self.tensors.remove(name).expect("it was listed");
        let last = last_part(name);
        let at = name.rfind(last).unwrap_or(0);
        let with = |bias: &&str| [&name[..at], *bias, &name[at + last.len()..]].concat();
        let bias = BIASES.iter().map(with).find_map(|bias| self.tensors.remove(&bias));
        let named =
            if INPUTS_FIRST.contains(&last) { Orientation::InputsFirst } else { Orientation::OutputsFirst };
        let orientation = match (&matrix.shape[..], bias.as_ref().map(|bias| bias.values.len())) {
            (&[first, second], Some(outputs)) if first != second && outputs == first => Orientation::OutputsFirst,
            (&[first, second], Some(outputs)) if first != second && outputs == second => Orientation::InputsFirst,
            _ => named,
        };
        Dense { matrix, orientation, bias }
    }

    /// What nobody took would change what the network computes.
    fn refuse_rest(&self) -> Result<(), ImportError> {
        match self.tensors.values().next() {
            Some(tensor) => {
                Err(tensor.refuse("the weights and biases of dense layers, and nothing else in an actor"))
            }
            None => Ok(()),
        }
    }
}

/// What is done to observations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Normalisation {
    Mean,
    Deviation,
}

/// Parts of a tensor's name.
fn parts(name: &str) -> impl DoubleEndedIterator<Item = &str> {
    name.split(['.', '/'])
}

/// The last part of a name that says what a tensor is; `rl_tools` has `parameters` behind it.
fn last_part(name: &str) -> &str {
    parts(name).rev().find(|part| *part != "parameters").unwrap_or(name)
}

/// A name as people sort it: `layers.10` comes behind `layers.9`.
fn counted(name: &str) -> Vec<(String, u64)> {
    let mut found = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let text = rest.find(|letter: char| letter.is_ascii_digit()).unwrap_or(rest.len());
        let digits = rest[text..].find(|letter: char| !letter.is_ascii_digit()).unwrap_or(rest.len() - text);
        found.push((rest[..text].to_owned(), rest[text..text + digits].parse().unwrap_or(0)));
        rest = &rest[text + digits..];
    }
    found
}

/// The layers in an order in which each reads what the one before writes, the first of them the observation; where there is
/// none, in one that shows what does not fit.
fn in_order(layers: Vec<Dense>, observation_len: usize) -> Vec<Dense> {
    let shapes: Vec<[usize; 2]> = layers.iter().map(Dense::shape).collect();
    let from = |width| longest_chain(&shapes, width, &mut Vec::new());
    let starts = std::iter::once(observation_len).chain(shapes.iter().map(|[inputs, _]| *inputs));
    let whole = starts.map(from).find(|chain| chain.len() == shapes.len());
    let mut order = whole.unwrap_or_else(|| from(observation_len));
    let rest: Vec<usize> = (0..shapes.len()).filter(|index| !order.contains(index)).collect();
    order.extend(rest);
    let mut slots: Vec<Option<Dense>> = layers.into_iter().map(Some).collect();
    order.into_iter().filter_map(|index| slots[index].take()).collect()
}

/// The first of the longest orders of shapes, `[inputs, outputs]`, that begin with those `taken` and go on from a width.
fn longest_chain(shapes: &[[usize; 2]], width: usize, taken: &mut Vec<usize>) -> Vec<usize> {
    let mut longest = taken.clone();
    for (index, [inputs, outputs]) in shapes.iter().enumerate() {
        if *inputs == width && !taken.contains(&index) {
            taken.push(index);
            let chain = longest_chain(shapes, *outputs, taken);
            taken.pop();
            if chain.len() > longest.len() {
                longest = chain;
            }
        }
    }
    longest
}
