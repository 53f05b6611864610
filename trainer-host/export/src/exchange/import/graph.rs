//! A model's graph, followed from the action back to the observation.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Component, Path};

use kestrel_core::policy_file::Activation;
use prost::Message;

use super::super::onnx_schema::{self as schema, Attribute, Graph, Model, Node, data};
use super::perceptron::{Orientation, Perceptron, Tensor};
use super::{FILE_LIMIT, ImportError, ImportSettings, ImportedNetwork};

const EXPECTED_OPERATORS: &str = "Gemm, MatMul, Add, Sub, Mul, Div, Tanh, Relu, or Clip to [-1, 1] at the end";

/// Operators that leave the values of a vector as they are.
const UNCHANGING: [&str; 8] =
    ["Identity", "Flatten", "Reshape", "Squeeze", "Unsqueeze", "Expand", "Dropout", "Cast"];

/// Nodes between a constant and where it is used, at most: a model may be damaged in any way.
const CONSTANT_NODES_LIMIT: usize = 8;

/// The network in a model; `folder` is where its file lies.
///
/// # Errors
/// [`ImportError`]: which node or tensor, what was found and what was expected.
pub(super) fn network(
    bytes: &[u8],
    folder: &Path,
    settings: &ImportSettings<'_>,
) -> Result<ImportedNetwork, ImportError> {
    if settings.activation.is_some() || settings.output.is_some() {
        return Err(ImportError::file("an activation to assume", "none: an ONNX model says its own"));
    }
    let model = Model::decode(bytes)
        .map_err(|cause| ImportError::file(format!("a damaged ONNX model ({cause})"), super::EXPECTED_FILE))?;
    let graph = model.graph.filter(|graph| !graph.nodes.is_empty());
    let graph = graph.ok_or_else(|| ImportError::file("no graph", super::EXPECTED_FILE))?;
    let values = Values::of(&graph, folder);
    let mut perceptron = Perceptron::new(settings);
    let path = values.path()?;
    for (index, node) in path.iter().enumerate() {
        values.apply(node, &path[index + 1..], &mut perceptron)?;
    }
    perceptron.finish("An ONNX model")
}

/// Where values of a graph come from.
struct Values<'a> {
    graph: &'a Graph,
    folder: &'a Path,
    nodes: HashMap<&'a str, &'a Node>,
    tensors: HashMap<&'a str, &'a schema::Tensor>,
}

impl<'a> Values<'a> {
    fn of(graph: &'a Graph, folder: &'a Path) -> Self {
        let outputs = |node: &'a Node| node.outputs.iter().map(move |output| (output.as_str(), node));
        let nodes = graph.nodes.iter().flat_map(outputs).collect();
        let tensors = graph.tensors.iter().map(|tensor| (tensor.name.as_str(), tensor)).collect();
        Self { graph, folder, nodes, tensors }
    }

    /// The nodes from the observation to the action.
    fn path(&self) -> Result<Vec<&'a Node>, ImportError> {
        let outputs = || self.graph.outputs.iter().map(|output| output.name.as_str());
        let called = outputs().find(|name| name.to_lowercase().contains("action"));
        let Some(mut name) = called.or(outputs().next()) else {
            return Err(ImportError::file("a graph without an output", "one that writes the action"));
        };
        let mut path = Vec::new();
        while let Some(node) = self.nodes.get(name) {
            if path.len() > self.graph.nodes.len() {
                return Err(ImportError::node(label(node), "a loop", "a path from observation to action"));
            }
            path.push(*node);
            name = self.computed_input(node)?;
        }
        if !self.graph.inputs.iter().any(|input| input.name == name) {
            let found = format_args!("{name:?}, which nothing computes");
            return Err(ImportError::file(found, "a path from observation to action"));
        }
        path.reverse();
        Ok(path)
    }

    /// The input of a node that follows from the observation.
    fn computed_input(&self, node: &'a Node) -> Result<&'a str, ImportError> {
        let takes_two = ["MatMul", "Add", "Sub", "Mul", "Div"].contains(&node.operator.as_str());
        let count = if takes_two { 2 } else { 1 };
        let mut computed = node.inputs.iter().take(count).filter(|name| !self.is_constant(name));
        match (computed.next(), computed.next()) {
            (Some(name), None) => Ok(name),
            (Some(_), Some(_)) => {
                let found = format_args!("{} of two computed values", node.operator);
                Err(ImportError::node(label(node), found, "one path from observation to action"))
            }
            (None, _) => Err(ImportError::node(label(node), "a constant", "what follows from the observation")),
        }
    }

    /// Whether a value is a tensor, or a constant of the graph, as it is or transposed.
    fn is_constant(&self, mut name: &'a str) -> bool {
        for _ in 0..CONSTANT_NODES_LIMIT {
            if self.tensors.contains_key(name) {
                return true;
            }
            let Some(node) = self.nodes.get(name) else { return false };
            match (node.operator.as_str(), node.inputs.first()) {
                ("Constant", _) => return true,
                ("Transpose" | "Identity", Some(input)) => name = input,
                _ => return false,
            }
        }
        false
    }

    /// Adds what a node does, behind which come the `rest`.
    fn apply(&self, node: &'a Node, rest: &[&Node], perceptron: &mut Perceptron<'_>) -> Result<(), ImportError> {
        let place = format!("node {}", label(node));
        let refuse = |found: &str, expected: &str| Err(ImportError::node(label(node), found, expected));
        if !["", "ai.onnx"].contains(&node.domain.as_str()) {
            return refuse(&format!("{}::{}", node.domain, node.operator), EXPECTED_OPERATORS);
        }
        let constant_first = node.inputs.first().is_some_and(|input| self.is_constant(input));
        let other = || self.input(node, usize::from(!constant_first));
        match (node.operator.as_str(), constant_first) {
            ("Gemm", false) => self.apply_gemm(node, perceptron),
            ("MatMul", false) => perceptron.dense(other()?, Orientation::InputsFirst, None),
            ("Gemm" | "MatMul", true) => refuse("a matrix on the left", "rows of observations times a matrix"),
            ("Add", _) => perceptron.shift(&other()?),
            ("Sub", false) => perceptron.shift(&negated(other()?)),
            ("Sub", true) => {
                perceptron.scale(&number(label(node), -1.0))?;
                perceptron.shift(&other()?)
            }
            ("Mul", _) => perceptron.scale(&other()?),
            ("Div", false) => perceptron.divide(&other()?),
            ("Tanh", _) => perceptron.activate(Activation::Tanh, &place),
            ("Relu", _) => perceptron.activate(Activation::Relu, &place),
            ("Clip", _) => self.check_limits(node, rest),
            ("Cast", _) if attribute(node, "to").is_none_or(|to| to.integer != i64::from(data::FLOAT)) => {
                refuse("Cast to another kind of number", "float32 throughout")
            }
            (found, _) if UNCHANGING.contains(&found) => Ok(()),
            (found, _) => refuse(found, EXPECTED_OPERATORS),
        }
    }

    fn apply_gemm(&self, node: &'a Node, perceptron: &mut Perceptron<'_>) -> Result<(), ImportError> {
        let flag = |name| attribute(node, name).is_some_and(|attribute| attribute.integer != 0);
        let factor = |name| attribute(node, name).map_or(1.0, |attribute| attribute.number);
        if flag("transA") || factor("alpha") != 1.0 || factor("beta") != 1.0 {
            return Err(ImportError::node(label(node), "Gemm with transA, alpha or beta", "x W + b"));
        }
        let orientation = if flag("transB") { Orientation::OutputsFirst } else { Orientation::InputsFirst };
        let bias = if node.inputs.len() > 2 { Some(self.input(node, 2)?) } else { None };
        perceptron.dense(self.input(node, 1)?, orientation, bias.as_ref())
    }

    /// Accepts the limits that a policy's actions have anyway.
    fn check_limits(&self, node: &'a Node, rest: &[&Node]) -> Result<(), ImportError> {
        let limit = |index: usize, name| -> Result<Option<f32>, ImportError> {
            match node.inputs.get(index) {
                Some(input) if !input.is_empty() => Ok(self.input(node, index)?.values.first().copied()),
                Some(_) | None => Ok(attribute(node, name).map(|attribute| attribute.number)),
            }
        };
        let limits = [limit(1, "min")?, limit(2, "max")?];
        if limits == [Some(-1.0), Some(1.0)]
            && rest.iter().all(|node| UNCHANGING.contains(&node.operator.as_str()))
        {
            return Ok(());
        }
        let [low, high] = limits.map(|limit| limit.map_or("none".to_owned(), |limit| limit.to_string()));
        let found = format_args!("Clip to [{low}, {high}]");
        Err(ImportError::node(
            label(node),
            found,
            "none but to [-1, 1] at the end: a policy file has no other limits",
        ))
    }

    /// The constant that is an input of a node.
    fn input(&self, node: &'a Node, index: usize) -> Result<Tensor, ImportError> {
        let name = node.inputs.get(index).filter(|name| self.is_constant(name));
        let missing = || ImportError::node(label(node), format_args!("no constant as input {index}"), "weights");
        self.constant(name.ok_or_else(missing)?)
    }

    fn constant(&self, name: &'a str) -> Result<Tensor, ImportError> {
        if let Some(tensor) = self.tensors.get(name) {
            return self.read(name, tensor);
        }
        let Some(node) = self.nodes.get(name) else {
            return Err(ImportError::tensor(name, "nothing", "a constant"));
        };
        match node.operator.as_str() {
            "Transpose" => Ok(transposed(self.constant(&node.inputs[0])?)),
            "Identity" => self.constant(&node.inputs[0]),
            _ => self.literal(node, name),
        }
    }

    /// The value of a node `Constant`.
    fn literal(&self, node: &Node, name: &str) -> Result<Tensor, ImportError> {
        let Some(literal) = node.attributes.first() else {
            return Err(ImportError::tensor(name, "nothing", "a constant"));
        };
        match (literal.name.as_str(), &literal.tensor) {
            ("value", Some(tensor)) => self.read(name, tensor),
            ("value_float", _) => Ok(number(name, literal.number)),
            ("value_floats", _) => {
                let values = literal.numbers.clone();
                Ok(Tensor { name: name.to_owned(), shape: vec![values.len()], values })
            }
            (found, _) => Err(ImportError::tensor(name, format_args!("a constant by {found}"), "numbers")),
        }
    }

    /// The numbers of a tensor, wherever they lie.
    fn read(&self, name: &str, tensor: &schema::Tensor) -> Result<Tensor, ImportError> {
        if tensor.kind != data::FLOAT {
            let kind = data::NAMES.get(tensor.kind as usize).copied().unwrap_or("an unknown kind");
            return Err(ImportError::tensor(name, kind, "float32: save weights as 32-bit numbers"));
        }
        let shape: Vec<usize> =
            tensor.shape.iter().map(|len| usize::try_from(*len).unwrap_or(usize::MAX)).collect();
        let expected = shape.iter().try_fold(1_usize, |product, len| product.checked_mul(*len));
        let expected = expected.filter(|count| *count as u64 <= FILE_LIMIT);
        let expected =
            expected.ok_or_else(|| ImportError::tensor(name, format_args!("{shape:?}"), "a smaller one"))?;
        let words = |bytes: &[u8]| bytes.as_chunks().0.iter().map(|word| f32::from_le_bytes(*word)).collect();
        let values: Vec<f32> = match (&tensor.external[..], &tensor.bytes[..]) {
            ([], []) => tensor.numbers.clone(),
            ([], bytes) => words(bytes),
            (_, _) => words(&self.read_external(name, tensor, 4 * expected as u64)?),
        };
        if values.len() == expected {
            return Ok(Tensor { name: name.to_owned(), shape, values });
        }
        Err(ImportError::tensor(name, format_args!("{} numbers", values.len()), format_args!("{shape:?}")))
    }

    /// The bytes of a tensor in a file beside the model's, which PyTorch writes.
    fn read_external(&self, name: &str, tensor: &schema::Tensor, expected: u64) -> Result<Vec<u8>, ImportError> {
        let entry = |key| tensor.external.iter().find(|entry| entry.key == key).map(|entry| entry.value.as_str());
        let location = Path::new(entry("location").unwrap_or_default());
        let beside = location.components().all(|part| matches!(part, Component::Normal(_)));
        if !beside || location.as_os_str().is_empty() {
            let found = format_args!("external data in {}", location.display());
            return Err(ImportError::tensor(name, found, "a file beside the model's"));
        }
        let offset = entry("offset").map_or(Ok(0), str::parse::<u64>);
        let offset = offset.map_err(|_| ImportError::tensor(name, "an offset that is no number", "a number"))?;
        let read = || {
            let mut file = File::open(self.folder.join(location))?;
            file.seek(SeekFrom::Start(offset))?;
            let mut bytes = Vec::new();
            file.take(expected).read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        let refuse = |cause: std::io::Error| {
            let found = format_args!("external data in {}, which cannot be read ({cause})", location.display());
            ImportError::tensor(name, found, "it beside the model")
        };
        read().map_err(refuse)
    }
}

/// A node's name, or its operator where it has none.
fn label(node: &Node) -> &str {
    if node.name.is_empty() { &node.operator } else { &node.name }
}

fn attribute<'n>(node: &'n Node, name: &str) -> Option<&'n Attribute> {
    node.attributes.iter().find(|attribute| attribute.name == name)
}

fn number(name: &str, value: f32) -> Tensor {
    Tensor { name: name.to_owned(), shape: Vec::new(), values: vec![value] }
}

fn negated(mut tensor: Tensor) -> Tensor {
    tensor.values.iter_mut().for_each(|value| *value = -*value);
    tensor
}

/// A matrix with rows for columns; what has another number of dimensions stays as it is, and is refused later.
fn transposed(tensor: Tensor) -> Tensor {
    let Tensor { name, shape, values } = tensor;
    let [rows, columns] = shape[..] else { return Tensor { name, shape, values } };
    let turned = (0..columns).flat_map(|column| (0..rows).map(move |row| row * columns + column));
    let values = turned.map(|index| values[index]).collect();
    Tensor { name, shape: vec![columns, rows], values }
}
