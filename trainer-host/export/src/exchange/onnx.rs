//! ONNX: a graph of `Gemm`, `Tanh` and `Clip`, which every version of its runtimes since 2021 takes.

mod schema;

use prost::Message;

use super::{ExchangeError, Layer, bytes_of, float_policy, layers, metadata};
use schema::{
    Attribute, Dimension, Entry, Graph, Model, Node, OperatorSet, Tensor, TensorType, Type, Value, attribute,
    data, dimension,
};

/// Version of the file format, of 2021, and of the operators in it.
const FORMAT_VERSION: i64 = 8;
const OPERATORS_VERSION: i64 = 15;

/// The policy file `bytes` in float, which start on a four-byte boundary of memory, as an ONNX model: from `observation [batch, observation length]` to `action [batch,
/// action length]`, limited to \[-1, 1\]. The model's metadata says under `kestrel` what the policy sees and commands.
///
/// # Errors
/// [`ExchangeError`].
pub fn onnx_model(bytes: &[u8]) -> Result<Vec<u8>, ExchangeError> {
    let policy = float_policy(bytes)?;
    let about = policy.metadata();
    let (observation_len, action_len) = (about.observation.len(), about.action.len());
    let model = Model {
        format_version: FORMAT_VERSION,
        producer: "kestrel".to_owned(),
        producer_version: env!("CARGO_PKG_VERSION").to_owned(),
        graph: Some(graph(about.name, &layers(&policy), observation_len, action_len)),
        operators: vec![OperatorSet { domain: String::new(), version: OPERATORS_VERSION }],
        metadata: vec![Entry { key: "kestrel".to_owned(), value: metadata(&policy) }],
    };
    Ok(model.encode_to_vec())
}

fn graph(name: &str, layers: &[Layer], observation_len: usize, action_len: usize) -> Graph {
    let (mut nodes, mut tensors) = (Vec::new(), vec![scalar("lowest", -1.0), scalar("highest", 1.0)]);
    let mut input = "observation".to_owned();
    for (index, Layer { inputs, outputs, weights, biases }) in layers.iter().enumerate() {
        let [weight, bias, sum] = ["weight", "bias", "sum"].map(|what| format!("{what}.{index}"));
        tensors.push(tensor(&weight, &[*outputs, *inputs], weights));
        tensors.push(tensor(&bias, &[*outputs], biases));
        let transposed = Attribute { name: "transB".to_owned(), integer: 1, kind: attribute::INTEGER };
        nodes.push(node("Gemm", [input, weight, bias].into(), &sum, vec![transposed]));
        input = if index + 1 == layers.len() {
            sum
        } else {
            let output = format!("tanh.{index}");
            nodes.push(node("Tanh", vec![sum], &output, Vec::new()));
            output
        };
    }
    nodes.push(node("Clip", vec![input, "lowest".to_owned(), "highest".to_owned()], "action", Vec::new()));
    Graph {
        nodes,
        name: name.to_owned(),
        tensors,
        inputs: vec![value("observation", observation_len)],
        outputs: vec![value("action", action_len)],
    }
}

fn node(operator: &str, inputs: Vec<String>, output: &str, attributes: Vec<Attribute>) -> Node {
    Node {
        inputs,
        outputs: vec![output.to_owned()],
        name: output.to_owned(),
        operator: operator.to_owned(),
        attributes,
    }
}

fn tensor(name: &str, shape: &[usize], values: &[f32]) -> Tensor {
    Tensor {
        shape: shape.iter().map(|len| *len as i64).collect(),
        kind: data::FLOAT,
        name: name.to_owned(),
        bytes: bytes_of(values),
    }
}

fn scalar(name: &str, value: f32) -> Tensor {
    tensor(name, &[], &[value])
}

/// A batch of vectors of so many values.
fn value(name: &str, len: usize) -> Value {
    let dimensions = [dimension::Size::Name("batch".to_owned()), dimension::Size::Number(len as i64)];
    let shape = schema::Shape { dimensions: dimensions.map(|size| Dimension { size: Some(size) }).into() };
    let tensor = TensorType { kind: data::FLOAT, shape: Some(shape) };
    Value { name: name.to_owned(), kind: Some(Type { tensor: Some(tensor) }) }
}
