//! ONNX: a graph of `Gemm`, `Tanh` or `Relu`, and `Clip`, and of elementary operators for a memory, which every version of its runtimes since 2021 takes.

use kestrel_core::policy_file::Activation;
use prost::Message;

use super::onnx_schema::{
    Attribute, Dimension, Entry, Graph, Model, Node, OperatorSet, Shape, Tensor, TensorType, Type, Value,
    attribute, data, dimension,
};
use super::{ExchangeError, Exchanged, Layer, bytes_of};

/// Version of the file format, of 2021, and of the operators in it.
const FORMAT_VERSION: i64 = 8;
const OPERATORS_VERSION: i64 = 15;

/// The policy file `bytes` in float, which start on a four-byte boundary of memory, as an ONNX model: from `observation [batch, observation length]` to `action [batch,
/// action length]`, limited to \[-1, 1\]. A recurrent policy also reads `hidden [batch, units]`, zeros at the start of a
/// flight, and gives `next_hidden` to be read at the next step. The model's metadata says under `kestrel` what the policy
/// sees and commands.
///
/// # Errors
/// [`ExchangeError`].
pub fn onnx_model(bytes: &[u8]) -> Result<Vec<u8>, ExchangeError> {
    let policy = Exchanged::parse(bytes)?;
    let model = Model {
        format_version: FORMAT_VERSION,
        producer: "kestrel".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        graph: Some(graph(&policy)),
        operators: vec![OperatorSet { domain: String::new(), version: OPERATORS_VERSION }],
        metadata: vec![Entry { key: "kestrel".to_owned(), value: policy.metadata }],
    };
    Ok(model.encode_to_vec())
}

fn graph(policy: &Exchanged) -> Graph {
    let mut graph = Graph {
        nodes: Vec::new(),
        name: policy.name.clone(),
        tensors: vec![scalar("lowest", -1.0), scalar("highest", 1.0)],
        inputs: vec![value("observation", policy.observation_len)],
        outputs: vec![value("action", policy.action_len)],
    };
    let mut input = "observation".to_owned();
    if let Some(memory) = &policy.memory {
        input = remember(&mut graph, memory);
    }
    for (index, layer) in policy.layers.iter().enumerate() {
        let sum = affine(&mut graph, &index.to_string(), layer, input);
        input = if index + 1 == policy.layers.len() {
            sum
        } else {
            let operator = match policy.activation {
                Activation::Tanh => "Tanh",
                Activation::Relu => "Relu",
            };
            let output = format!("{}.{index}", policy.activation.name());
            graph.nodes.push(node(operator, vec![sum], &output, Vec::new()));
            output
        };
    }
    let limits = vec![input, "lowest".to_owned(), "highest".to_owned()];
    graph.nodes.push(node("Clip", limits, "action", Vec::new()));
    graph
}

/// The nodes of a memory, as [`kestrel_core::gru`] defines it; returns the name of observation and hidden state together.
fn remember(graph: &mut Graph, [gates, candidate]: &[Layer; 2]) -> String {
    let Layer { inputs, outputs: units, .. } = *candidate;
    graph.inputs.push(value("hidden", units));
    graph.outputs.push(value("next_hidden", units));
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<String>>();
    let together = |graph: &mut Graph, hidden: &str, output: &str| {
        let axis =
            Attribute { name: "axis".to_owned(), integer: 1, kind: attribute::INTEGER, ..Attribute::default() };
        graph.nodes.push(node("Concat", names(&["observation", hidden]), output, vec![axis]));
    };
    together(graph, "hidden", "seen");
    let gate = |graph: &mut Graph, name: &str, first: usize| {
        let part = Layer {
            inputs,
            outputs: units,
            weights: gates.weights[first * inputs..][..units * inputs].to_vec(),
            biases: gates.biases[first..][..units].to_vec(),
        };
        let sum = affine(graph, name, &part, "seen".to_owned());
        graph.nodes.push(node("Sigmoid", vec![sum], name, Vec::new()));
    };
    gate(graph, "r", 0);
    gate(graph, "z", units);
    graph.nodes.push(node("Mul", names(&["r", "hidden"]), "gated", Vec::new()));
    together(graph, "gated", "gated_seen");
    let sum = affine(graph, "n", candidate, "gated_seen".to_owned());
    graph.nodes.push(node("Tanh", vec![sum], "n", Vec::new()));
    for (operator, inputs, output) in [
        ("Sub", ["hidden", "n"], "change"),
        ("Mul", ["z", "change"], "kept"),
        ("Add", ["n", "kept"], "next_hidden"),
    ] {
        graph.nodes.push(node(operator, names(&inputs), output, Vec::new()));
    }
    together(graph, "next_hidden", "remembered");
    "remembered".to_owned()
}

/// The node of a layer and its numbers; returns the name of its sums.
fn affine(graph: &mut Graph, name: &str, layer: &Layer, input: String) -> String {
    let Layer { inputs, outputs, weights, biases } = layer;
    let [weight, bias, sum] = ["weight", "bias", "sum"].map(|what| format!("{what}.{name}"));
    graph.tensors.push(tensor(&weight, &[*outputs, *inputs], weights));
    graph.tensors.push(tensor(&bias, &[*outputs], biases));
    let transposed =
        Attribute { name: "transB".to_owned(), integer: 1, kind: attribute::INTEGER, ..Attribute::default() };
    graph.nodes.push(node("Gemm", [input, weight, bias].into(), &sum, vec![transposed]));
    sum
}

fn node(operator: &str, inputs: Vec<String>, output: &str, attributes: Vec<Attribute>) -> Node {
    Node {
        inputs,
        outputs: vec![output.to_owned()],
        name: output.to_owned(),
        operator: operator.to_owned(),
        attributes,
        domain: String::new(),
    }
}

fn tensor(name: &str, shape: &[usize], values: &[f32]) -> Tensor {
    Tensor {
        shape: shape.iter().map(|len| *len as i64).collect(),
        kind: data::FLOAT,
        name: name.to_owned(),
        bytes: bytes_of(values),
        ..Tensor::default()
    }
}

fn scalar(name: &str, value: f32) -> Tensor {
    tensor(name, &[], &[value])
}

/// A batch of vectors of so many values.
fn value(name: &str, len: usize) -> Value {
    let dimensions = [dimension::Size::Name("batch".to_owned()), dimension::Size::Number(len as i64)];
    let shape = Shape { dimensions: dimensions.map(|size| Dimension { size: Some(size) }).into() };
    let tensor = TensorType { kind: data::FLOAT, shape: Some(shape) };
    Value { name: name.to_owned(), kind: Some(Type { tensor: Some(tensor) }) }
}
