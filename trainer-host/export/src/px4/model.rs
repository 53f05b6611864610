//! A `TFLite` model of dense layers: one input vector, one output vector, `FULLY_CONNECTED` operators and nothing else.
//!
//! Numbers of fields and of operators are those of TensorFlow Lite's schema, version 3.

use super::flat_buffer::{Table, Value};

const IDENTIFIER: [u8; 4] = *b"TFL3";
const SCHEMA_VERSION: u32 = 3;

/// `BuiltinOperator.FULLY_CONNECTED`, and its options in `BuiltinOptions`.
const FULLY_CONNECTED: u8 = 9;
const FULLY_CONNECTED_OPTIONS: u8 = 8;

/// `TensorType.FLOAT32`.
const FLOAT32: u8 = 0;

/// Tensors of a layer: weights, biases, outputs; the input is before those of the first.
const TENSORS_PER_LAYER: usize = 3;

/// Dense layers one after the other.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Model {
    pub(super) name: String,
    pub(super) layers: Vec<Dense>,
}

/// `follow(W x + b)`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Dense {
    pub(super) inputs: usize,
    /// `[outputs][inputs]`.
    pub(super) weights: Vec<f32>,
    /// `[outputs]`.
    pub(super) biases: Vec<f32>,
    pub(super) follow: Follow,
}

/// What follows the sums of a layer, under its number in `ActivationFunctionType`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Follow {
    Nothing = 0,
    Rectifier = 1,
}

impl Dense {
    /// `bias - x`, value by value.
    pub(super) fn negation(len: usize, bias: f32, follow: Follow) -> Self {
        let weights = (0..len * len).map(|place| if place % (len + 1) == 0 { -1.0 } else { 0.0 }).collect();
        Self { inputs: len, weights, biases: vec![bias; len], follow }
    }

    fn outputs(&self) -> usize {
        self.biases.len()
    }
}

impl Model {
    /// The file.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let operator = Table::default()
            .with(0, Value::Byte(FULLY_CONNECTED)) // for readers before version 2.4
            .with(2, Value::Word(1))
            .with(3, Value::Word(u32::from(FULLY_CONNECTED)));
        Table::default()
            .with(0, Value::Word(SCHEMA_VERSION))
            .with(1, Value::Tables(vec![operator]))
            .with(2, Value::Tables(vec![self.graph()]))
            .with(3, Value::Text(format!("{}, written by kestrel {}", self.name, env!("CARGO_PKG_VERSION"))))
            .with(4, Value::Tables(self.buffers()))
            .buffer(IDENTIFIER)
    }

    fn graph(&self) -> Table {
        let inputs = self.layers.first().map_or(0, |layer| layer.inputs);
        let mut tensors = vec![tensor("observation", &[1, inputs], 0)];
        for (index, layer) in self.layers.iter().enumerate() {
            let buffer = 1 + 2 * index;
            let is_last = index + 1 == self.layers.len();
            let output = if is_last { "action".to_owned() } else { format!("layer_{index}") };
            tensors.push(tensor(&format!("weights_{index}"), &[layer.outputs(), layer.inputs], buffer));
            tensors.push(tensor(&format!("biases_{index}"), &[layer.outputs()], buffer + 1));
            tensors.push(tensor(&output, &[1, layer.outputs()], 0));
        }
        let output = TENSORS_PER_LAYER * self.layers.len();
        Table::default()
            .with(0, Value::Tables(tensors))
            .with(1, Value::Words(vec![0]))
            .with(2, Value::Words(vec![output as u32]))
            .with(3, Value::Tables(self.layers.iter().enumerate().map(operation).collect()))
            .with(4, Value::Text("main".to_owned()))
    }

    /// The empty one of what is computed, then weights and biases of each layer.
    fn buffers(&self) -> Vec<Table> {
        let filled = |values: &[f32]| {
            let data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            Table::default().with(0, Value::Data(data))
        };
        let of_layers = self.layers.iter().flat_map(|layer| [filled(&layer.weights), filled(&layer.biases)]);
        std::iter::once(Table::default()).chain(of_layers).collect()
    }
}

fn operation((index, layer): (usize, &Dense)) -> Table {
    let first = (TENSORS_PER_LAYER * index) as u32;
    let options = Table::default().with(0, Value::Byte(layer.follow as u8));
    Table::default()
        .with(0, Value::Word(0))
        .with(1, Value::Words(vec![first, first + 1, first + 2]))
        .with(2, Value::Words(vec![first + 3]))
        .with(3, Value::Byte(FULLY_CONNECTED_OPTIONS))
        .with(4, Value::Table(options))
}

fn tensor(name: &str, shape: &[usize], buffer: usize) -> Table {
    Table::default()
        .with(0, Value::Words(shape.iter().map(|len| *len as u32).collect()))
        .with(1, Value::Byte(FLOAT32))
        .with(2, Value::Word(buffer as u32))
        .with(3, Value::Text(name.to_owned()))
}
