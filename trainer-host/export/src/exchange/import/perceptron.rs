//! A perceptron, put together from what another program wrote, step by step from the observation on.

use std::fmt;

use kestrel_core::mlp::{LAYER_LIMIT, WIDTH_LIMIT};
use kestrel_core::policy_file::Activation;

use super::super::Layer;
use super::{ImportError, ImportSettings};
use crate::DenseLayer;

/// A perceptron that another program trained, of which policy files can be made.
#[derive(Clone, Debug, PartialEq)]
pub struct ImportedNetwork {
    layers: Vec<Layer>,
    activation: Activation,
    origin: &'static str,
}

impl ImportedNetwork {
    /// The layers, first to last. Behind a tangent after the last one stands a layer that changes nothing.
    pub fn layers(&self) -> Vec<DenseLayer<'_>> {
        let activation = self.activation;
        let layers = self.layers.iter().map(|layer| {
            let Layer { inputs, outputs, weights, biases } = layer;
            DenseLayer { inputs: *inputs, outputs: *outputs, weights, bias: biases, activation }
        });
        layers.collect()
    }
}

impl fmt::Display for ImportedNetwork {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let widths = widths(&self.layers, |layer| [layer.inputs, layer.outputs]);
        write!(f, "{}: {widths}, {} between the layers", self.origin, self.activation.name())
    }
}

/// Inputs of the first layer, and the outputs of each.
fn widths<L>(layers: &[L], shape: impl Fn(&L) -> [usize; 2]) -> String {
    let inputs = layers.first().map_or(0, |layer| shape(layer)[0]);
    let outputs = layers.iter().map(|layer| format!("-{}", shape(layer)[1]));
    format!("{inputs}{}", outputs.collect::<String>())
}

/// Numbers under a name.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tensor {
    pub(super) name: String,
    pub(super) shape: Vec<usize>,
    pub(super) values: Vec<f32>,
}

impl Tensor {
    pub(super) fn refuse(&self, expected: impl fmt::Display) -> ImportError {
        ImportError::tensor(&self.name, format_args!("{:?}", self.shape), expected)
    }

    fn check_finite(&self) -> Result<(), ImportError> {
        let Some(at) = self.values.iter().position(|value| !value.is_finite()) else { return Ok(()) };
        let mut index = Vec::new();
        let mut rest = at;
        for len in self.shape.iter().rev() {
            index.insert(0, rest % len);
            rest /= len;
        }
        let found = format_args!("{} at {index:?}", self.values[at]);
        Err(ImportError::tensor(&self.name, found, "finite numbers"))
    }
}

/// How a matrix of weights lies in its tensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Orientation {
    /// `[outputs, inputs]`, as PyTorch has it.
    OutputsFirst,
    /// `[inputs, outputs]`, as JAX has it.
    InputsFirst,
}

impl Orientation {
    /// A shape, as the tensor has it.
    fn shown(self, inputs: &str, outputs: &str) -> String {
        match self {
            Self::OutputsFirst => format!("[{outputs}, {inputs}]"),
            Self::InputsFirst => format!("[{inputs}, {outputs}]"),
        }
    }
}

/// `y = W x + b` in double precision, so that folding several into one rounds once, and not at all where there is one.
struct Affine {
    inputs: usize,
    /// `[outputs][inputs]`.
    weights: Vec<Vec<f64>>,
    biases: Vec<f64>,
}

impl Affine {
    fn identity(width: usize) -> Self {
        let row = |row| (0..width).map(|column| f64::from(u8::from(row == column))).collect();
        Self { inputs: width, weights: (0..width).map(row).collect(), biases: vec![0.0; width] }
    }

    fn scale(factors: &[f64]) -> Self {
        let mut scale = Self::identity(factors.len());
        for (index, (row, factor)) in scale.weights.iter_mut().zip(factors).enumerate() {
            row[index] = *factor;
        }
        scale
    }

    /// Both, this one first.
    fn then(&self, next: &Self) -> Self {
        let dot = |row: &[f64], value: &dyn Fn(usize) -> f64| -> f64 {
            row.iter().enumerate().map(|(at, weight)| weight * value(at)).sum()
        };
        let product =
            |row: &Vec<f64>| (0..self.inputs).map(|column| dot(row, &|at| self.weights[at][column])).collect();
        let bias = |(row, bias): (&Vec<f64>, &f64)| bias + dot(row, &|at| self.biases[at]);
        Self {
            inputs: self.inputs,
            weights: next.weights.iter().map(product).collect(),
            biases: next.weights.iter().zip(&next.biases).map(bias).collect(),
        }
    }

    fn rounded(self) -> Layer {
        let biases: Vec<f32> = self.biases.into_iter().map(|bias| bias as f32).collect();
        let weights = self.weights.into_iter().flatten().map(|weight| weight as f32).collect();
        Layer { inputs: self.inputs, outputs: biases.len(), weights, biases }
    }
}

/// A perceptron that is put together.
pub(super) struct Perceptron<'a> {
    settings: &'a ImportSettings<'a>,
    /// Each with an activation behind it.
    layers: Vec<Affine>,
    activation: Option<Activation>,
    /// Behind the last activation, or at the beginning.
    open: Option<Affine>,
    /// Values at this point.
    width: usize,
    /// The matrix that wrote them, and how it lies.
    last: Option<(Tensor, Orientation)>,
}

impl<'a> Perceptron<'a> {
    pub(super) fn new(settings: &'a ImportSettings<'a>) -> Self {
        let width = settings.observation.len();
        Self { settings, layers: Vec::new(), activation: None, open: None, width, last: None }
    }

    /// Adds a dense layer, whose `bias` is `[outputs]` or missing.
    pub(super) fn dense(
        &mut self,
        matrix: Tensor,
        orientation: Orientation,
        bias: Option<&Tensor>,
    ) -> Result<(), ImportError> {
        let [first, second] = matrix.shape[..] else { return Err(matrix.refuse("two dimensions")) };
        let (inputs, outputs) = match orientation {
            Orientation::OutputsFirst => (second, first),
            Orientation::InputsFirst => (first, second),
        };
        if inputs != self.width {
            let expected = orientation.shown(&self.width.to_string(), "outputs");
            return Err(matrix.refuse(format_args!("{expected}: {}", self.source())));
        }
        if !(1..=WIDTH_LIMIT).contains(&outputs) {
            return Err(
                matrix.refuse(format_args!("1 to {WIDTH_LIMIT} outputs, the widest layer of a policy file"))
            );
        }
        matrix.check_finite()?;
        let value = |row: usize, column: usize| match orientation {
            Orientation::OutputsFirst => matrix.values[row * inputs + column],
            Orientation::InputsFirst => matrix.values[column * outputs + row],
        };
        let row = |row| (0..inputs).map(|column| f64::from(value(row, column))).collect();
        let weights = (0..outputs).map(row).collect();
        self.width = outputs;
        let biases = match bias {
            None => vec![0.0; outputs],
            Some(bias) => self.broadcast(bias)?,
        };
        self.append(Affine { inputs, weights, biases });
        self.last = Some((matrix, orientation));
        Ok(())
    }

    /// Adds a value to each of the values here, or one to all of them.
    pub(super) fn shift(&mut self, by: &Tensor) -> Result<(), ImportError> {
        let biases = self.broadcast(by)?;
        self.append(Affine { biases, ..Affine::identity(self.width) });
        Ok(())
    }

    /// Multiplies each of the values here by a factor of its own, or all by one.
    pub(super) fn scale(&mut self, by: &Tensor) -> Result<(), ImportError> {
        let factors = self.broadcast(by)?;
        self.append(Affine::scale(&factors));
        Ok(())
    }

    /// Divides each of the values here by a number of its own, or all by one.
    pub(super) fn divide(&mut self, by: &Tensor) -> Result<(), ImportError> {
        if by.values.contains(&0.0) {
            return Err(ImportError::tensor(&by.name, "a zero", "numbers to divide by"));
        }
        let factors: Vec<f64> = self.broadcast(by)?.into_iter().map(f64::recip).collect();
        self.append(Affine::scale(&factors));
        Ok(())
    }

    /// Puts an activation here; `place` is where, for messages.
    pub(super) fn activate(&mut self, found: Activation, place: &str) -> Result<(), ImportError> {
        match self.activation {
            Some(expected) if expected != found => {
                let said = format_args!(
                    "{} as behind the first layer: a policy file has one activation",
                    expected.name()
                );
                return Err(ImportError::behind(place, found.name(), said));
            }
            Some(_) | None => self.activation = Some(found),
        }
        let affine = self.open.take().unwrap_or_else(|| Affine::identity(self.width));
        self.layers.push(affine);
        Ok(())
    }

    /// The network, which was found in a file of this origin.
    pub(super) fn finish(mut self, origin: &'static str) -> Result<ImportedNetwork, ImportError> {
        let action = self.settings.action;
        if self.width != action.len() {
            let said = format!("the action `{}` of the task has {} values", action.name(), action.len());
            return Err(match &self.last {
                Some((matrix, orientation)) => {
                    let expected = orientation.shown("inputs", &action.len().to_string());
                    matrix.refuse(format_args!("{expected}: {said}"))
                }
                None => ImportError::file("no dense layer", said),
            });
        }
        let last = self.open.take().unwrap_or_else(|| Affine::identity(self.width));
        self.layers.push(last);
        if self.layers.len() > LAYER_LIMIT {
            let widths = widths(&self.layers, |layer| [layer.inputs, layer.biases.len()]);
            let found = format_args!("{} layers ({widths})", self.layers.len());
            return Err(ImportError::file(found, format_args!("at most {LAYER_LIMIT}")));
        }
        let activation = self.activation.unwrap_or_default();
        Ok(ImportedNetwork { layers: self.layers.into_iter().map(Affine::rounded).collect(), activation, origin })
    }

    fn append(&mut self, affine: Affine) {
        self.open = Some(match self.open.take() {
            Some(open) => open.then(&affine),
            None => affine,
        });
    }

    /// A value for each of the values here.
    fn broadcast(&self, tensor: &Tensor) -> Result<Vec<f64>, ImportError> {
        tensor.check_finite()?;
        match tensor.values[..] {
            [value] => Ok(vec![f64::from(value); self.width]),
            _ if tensor.values.len() == self.width => Ok(tensor.values.iter().copied().map(f64::from).collect()),
            _ => Err(tensor.refuse(format_args!("[{}]", self.width))),
        }
    }

    /// Where the values here come from.
    fn source(&self) -> String {
        let observation = self.settings.observation;
        match &self.last {
            Some((matrix, _)) => format!("{} writes {} values", matrix.name, self.width),
            None => format!("the observation `{}` of the task has {} values", observation.name(), self.width),
        }
    }
}
