//! Networks by the names and graphs of other programs, and what is wrong with some. `tests/golden/foreign` holds what
//! Stable-Baselines3 wrote.

use std::fs;
use std::path::PathBuf;

use kestrel_core::observation::{BodyLayout, PilotLayout};
use kestrel_core::policy_file::{PolicyFile, PolicyMetadata};
use prost::Message;

use super::super::onnx_schema::{Attribute, Entry, Graph, Model, Node, Tensor as Weights, Value};
use super::super::{bytes_of, onnx_model, safetensors_file};
use super::*;
use crate::tests::METADATA;
use crate::{DenseLayer, export};

const OBSERVATION: usize = 22;

fn settings() -> ImportSettings<'static> {
    ImportSettings { observation: &METADATA.observation, action: &METADATA.action, activation: None, output: None }
}

/// Numbers that differ from each other.
fn numbers(shape: &[usize]) -> Vec<f32> {
    let count: usize = shape.iter().product();
    (0..count).map(|index| libm::sinf(1.0 + index as f32 + count as f32)).collect()
}

fn state_dict(tensors: &[(&str, &[usize])]) -> StateDict {
    let mut found = StateDict::default();
    for (name, shape) in tensors {
        found.insert((*name).to_owned(), shape, numbers(shape));
    }
    found
}

fn message<T: std::fmt::Debug>(refused: Result<T, ImportError>) -> String {
    refused.unwrap_err().to_string()
}

/// The mean action by the textbook.
fn act(network: &ImportedNetwork, observation: &[f32]) -> Vec<f64> {
    let mut values: Vec<f64> = observation.iter().copied().map(f64::from).collect();
    let layers = network.layers();
    for (index, layer) in layers.iter().enumerate() {
        let row =
            |row: &[f32]| row.iter().zip(&values).map(|(weight, value)| f64::from(*weight) * value).sum::<f64>();
        let sums = layer
            .weights
            .chunks(layer.inputs)
            .zip(layer.bias)
            .map(|(weights, bias)| row(weights) + f64::from(*bias));
        let activate = |sum: f64| match layer.activation {
            _ if index + 1 == layers.len() => sum,
            Activation::Tanh => libm::tanh(sum),
            Activation::Relu => sum.max(0.0),
        };
        values = sums.map(activate).collect();
    }
    values
}

const SB3: [(&str, &[usize]); 7] = [
    ("mlp_extractor.policy_net.0.weight", &[8, OBSERVATION]),
    ("mlp_extractor.policy_net.0.bias", &[8]),
    ("mlp_extractor.value_net.0.weight", &[16, OBSERVATION]),
    ("action_net.weight", &[4, 8]),
    ("action_net.bias", &[4]),
    ("value_net.weight", &[1, 16]),
    ("log_std", &[4]),
];

#[test]
fn names_of_stable_baselines_cleanrl_and_jax_are_read() {
    let sb3 = state_dict(&SB3).network(&settings()).unwrap();
    assert_eq!(sb3.to_string(), "Stable-Baselines3's PPO: 22-8-4, tanh between the layers");
    assert_eq!(sb3.layers()[0].weights, numbers(&[8, OBSERVATION]));
    assert_eq!(sb3.layers()[1].bias, numbers(&[4]));
    let clean_rl = [
        ("actor_mean.0.weight", &[8, OBSERVATION][..]),
        ("actor_mean.0.bias", &[8]),
        ("actor_mean.2.weight", &[8, 8]),
        ("actor_mean.2.bias", &[8]),
        ("actor_mean.4.weight", &[4, 8]),
        ("actor_mean.4.bias", &[4]),
        ("actor_logstd", &[1, 4]),
        ("critic.0.weight", &[8, OBSERVATION]),
    ];
    let clean_rl = state_dict(&clean_rl).network(&settings()).unwrap();
    assert_eq!(clean_rl.to_string(), "CleanRL's PPO: 22-8-8-4, tanh between the layers");
    let flax = [
        ("params/Dense_0/kernel", &[OBSERVATION, 8][..]),
        ("params/Dense_0/bias", &[8]),
        ("params/Dense_10/kernel", &[8, 4]),
        ("params/Dense_10/bias", &[4]),
        ("params/Dense_9/kernel", &[8, 8]),
    ];
    let told = ImportSettings { activation: Some(Activation::Relu), ..settings() };
    let flax = state_dict(&flax).network(&told).unwrap();
    assert_eq!(flax.to_string(), "A state dict: 22-8-8-4, relu between the layers");
    assert_eq!(flax.layers()[0].weights[1], numbers(&[OBSERVATION, 8])[8], "transposed");
    assert_eq!(flax.layers()[1].bias, [0.0; 8], "a bias may be missing");
    let rl_tools = [
        ("hidden_layer_0.weights.parameters", &[8, 8][..]),
        ("hidden_layer_0.biases.parameters", &[1, 8]),
        ("input_layer.weights.parameters", &[8, OBSERVATION]),
        ("input_layer.biases.parameters", &[1, 8]),
        ("output_layer.weights.parameters", &[4, 8]),
        ("output_layer.biases.parameters", &[1, 4]),
    ];
    let rl_tools = state_dict(&rl_tools).network(&told).unwrap();
    assert_eq!(rl_tools.layers()[0].bias, numbers(&[8]), "layers follow each other by their shapes");
}

#[test]
fn a_tangent_behind_the_last_layer_is_a_layer_more() {
    let sac = |activation| {
        let names = [
            ("actor.latent_pi.0.weight", &[8, OBSERVATION][..]),
            ("actor.latent_pi.0.bias", &[8]),
            ("actor.mu.weight", &[4, 8]),
            ("actor.mu.bias", &[4]),
            ("actor.log_std.weight", &[4, 8]),
            ("critic.qf0.0.weight", &[8, OBSERVATION + 4]),
        ];
        state_dict(&names).network(&ImportSettings { activation, ..settings() })
    };
    let network = sac(Some(Activation::Tanh)).unwrap();
    assert_eq!(network.to_string(), "Stable-Baselines3's SAC: 22-8-4-4, tanh between the layers");
    let observation = numbers(&[OBSERVATION]);
    let unsquashed = ImportSettings { output: Some(OutputActivation::Identity), ..settings() };
    let sums = state_dict(&[
        ("actor_mean.0.weight", &[8, OBSERVATION]),
        ("actor_mean.0.bias", &[8]),
        ("actor_mean.2.weight", &[4, 8]),
        ("actor_mean.2.bias", &[4]),
    ]);
    let sums = act(&sums.network(&unsquashed).unwrap(), &observation);
    for (found, sum) in act(&network, &observation).iter().zip(sums) {
        assert!((found - libm::tanh(sum)).abs() < 1e-12);
    }
    assert_eq!(
        message(sac(None)),
        "tensor actor.mu.weight: found tanh behind it, and relu before, expected one activation throughout: train with \
         tanh, and say so, --activation tanh"
    );
}

#[test]
fn a_normalisation_of_observations_is_folded_into_the_first_layer() {
    let mut normalised = state_dict(&SB3);
    let [mean, mut variance] = [numbers(&[OBSERVATION]), numbers(&[1, OBSERVATION])];
    for value in &mut variance {
        *value = value.abs() + 0.1;
    }
    normalised.insert("obs_rms.mean".to_owned(), &[OBSERVATION], mean.clone());
    normalised.insert("obs_rms.var".to_owned(), &[OBSERVATION], variance.clone());
    let folded = normalised.network(&settings()).unwrap();
    assert_eq!(folded.layers().len(), 2);
    let observation = numbers(&[OBSERVATION, 1]);
    let seen: Vec<f32> = observation
        .iter()
        .zip(mean.iter().zip(&variance))
        .map(|(value, (mean, var))| (value - mean) / var.sqrt())
        .collect();
    let plain = state_dict(&SB3).network(&settings()).unwrap();
    for (found, expected) in act(&folded, &observation).iter().zip(act(&plain, &seen)) {
        assert!((found - expected).abs() < 1e-5, "{found} is not {expected}");
    }
}

#[test]
fn what_does_not_fit_is_named_with_its_shape() {
    let with = |name: &'static str, shape: &'static [usize]| {
        let mut found = state_dict(&SB3);
        found.insert(name.to_owned(), shape, numbers(shape));
        message(found.network(&settings()))
    };
    for (name, shape, expected) in [
        (
            "mlp_extractor.policy_net.0.weight",
            &[8, 12][..],
            "tensor mlp_extractor.policy_net.0.weight: found [8, 12], expected [outputs, 22]: the observation `pilot` of the \
             task has 22 values",
        ),
        ("action_net.weight", &[6, 8], "tensor action_net.bias: found [4], expected [6]"),
        (
            "action_net.weight",
            &[4, 7],
            "tensor action_net.weight: found [4, 7], expected [outputs, 8]: mlp_extractor.policy_net.0.weight writes 8 values",
        ),
        ("action_net.bias", &[5], "tensor action_net.bias: found [5], expected [4]"),
        (
            "mlp_extractor.policy_net.1.weight",
            &[8],
            "tensor mlp_extractor.policy_net.1.weight: found [8], expected the weights and biases of dense layers, and \
             nothing else in an actor",
        ),
        (
            "lstm_actor.weight_hh_l0",
            &[32, 8],
            "tensor lstm_actor.weight_hh_l0: found a recurrent network, expected dense layers alone: the memory of a policy \
             file gates its state in another place",
        ),
    ] {
        assert_eq!(with(name, shape), expected);
    }
    let wide = state_dict(&[("actor_mean.0.weight", &[256, OBSERVATION]), ("actor_mean.2.weight", &[4, 256])]);
    assert_eq!(
        message(wide.network(&settings())),
        "tensor actor_mean.0.weight: found [256, 22], expected 1 to 128 outputs, the widest layer of a policy file"
    );
    let six = state_dict(&[("actor_mean.0.weight", &[8, OBSERVATION]), ("actor_mean.2.weight", &[6, 8])]);
    assert_eq!(
        message(six.network(&settings())),
        "tensor actor_mean.2.weight: found [6, 8], expected [4, inputs]: the action `rotor_speeds` of the task has 4 values"
    );
    let unknown = state_dict(&[("fc1.weight", &[8, OBSERVATION]), ("fc2.weight", &[4, 8])]);
    assert_eq!(
        message(unknown.network(&settings())),
        "found tensors whose names tell no activation, such as fc1.weight, expected to be told it: --activation tanh or relu"
    );
    let mut half = state_dict(&SB3);
    half.insert_other("mlp_extractor.policy_net.0.weight".to_owned(), "F16");
    assert_eq!(
        message(half.network(&settings())),
        "tensor mlp_extractor.policy_net.0.weight: found F16, expected F32: save weights as 32-bit numbers"
    );
    let mut broken = state_dict(&SB3);
    let mut weights = numbers(&[8, OBSERVATION]);
    weights[OBSERVATION + 3] = f32::NAN;
    broken.insert("mlp_extractor.policy_net.0.weight".to_owned(), &[8, OBSERVATION], weights);
    assert_eq!(
        message(broken.network(&settings())),
        "tensor mlp_extractor.policy_net.0.weight: found NaN at [1, 3], expected finite numbers"
    );
}

/// What importing a file with these bytes says.
fn imported(name: &str, bytes: &[u8]) -> Result<ImportedNetwork, ImportError> {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join(name);
    fs::write(&path, bytes).unwrap();
    import_network(&path, &settings())
}

#[test]
fn files_that_are_something_else_are_refused() {
    let expected = "expected a model as ONNX, or a state dict as safetensors";
    for (bytes, found) in [
        (&b""[..], "an empty file"),
        (b"PK\x03\x04\x00", "a zip archive, as PyTorch and Stable-Baselines3 save"),
        (b"Hello, pilots of the world", "a file that begins with \"Hello, pilot\""),
    ] {
        assert_eq!(message(imported("network", bytes)), format!("found {found}, {expected}"));
    }
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("huge.onnx");
    fs::File::create(&path).unwrap().set_len(FILE_LIMIT + (1 << 20)).unwrap();
    assert_eq!(message(import_network(&path, &settings())), "found 65 MiB, expected at most 64 MiB");
    assert_eq!(message(import_network(&place.path().join("none"), &settings())), "cannot be read");
}

#[test]
fn a_policy_does_what_stable_baselines_predicts() {
    let place: PathBuf = [env!("CARGO_MANIFEST_DIR"), "../../tests/golden/foreign"].iter().collect();
    let predicted = fs::read_to_string(place.join("sb3-ppo.json")).unwrap();
    let predicted: serde_json::Value = serde_json::from_str(&predicted).unwrap();
    let rows = |name: &str| -> Vec<Vec<f32>> { serde_json::from_value(predicted[name].clone()).unwrap() };
    let scales = PilotLayout { position_scale_m: 0.5, velocity_scale: 2.0, body_rates_scale: 10.0 };
    let observation = ObservationLayout::Body(BodyLayout { scales, action_len: 4, measured_len: 0 });
    let metadata = PolicyMetadata { observation, ..METADATA };
    for form in ["sb3-ppo.onnx", "sb3-ppo.safetensors"] {
        let settings = ImportSettings { observation: &observation, ..settings() };
        let network = import_network(&place.join(form), &settings).unwrap();
        let exported = export(&network.layers(), &metadata, &rows("observations").concat()).unwrap();
        let policy = PolicyFile::parse(&exported.float_policy).unwrap();
        let mut scratch = policy.scratch();
        for (observation, expected) in rows("observations").iter().zip(rows("actions")) {
            for (found, expected) in policy.act(observation, &mut scratch).iter().zip(expected) {
                assert!((found - expected).abs() < 2e-6, "{form}: {found} is not {expected}");
            }
        }
    }
}

/// A policy of Kestrel's own in the two forms that it exports.
fn exported() -> [Vec<u8>; 2] {
    let [first, second] = [numbers(&[8, OBSERVATION]), numbers(&[4, 8])];
    let activation = Activation::Relu;
    let layers = [
        DenseLayer { inputs: OBSERVATION, outputs: 8, weights: &first, bias: &[0.1; 8], activation },
        DenseLayer { inputs: 8, outputs: 4, weights: &second, bias: &[0.2; 4], activation },
    ];
    let policy = export(&layers, &METADATA, &numbers(&[8, OBSERVATION])).unwrap().float_policy;
    [onnx_model(&policy).unwrap(), safetensors_file(&policy).unwrap()]
}

#[test]
fn what_kestrel_exports_comes_back() {
    for bytes in exported() {
        let network = imported("network", &bytes).unwrap();
        assert!(network.to_string().ends_with(": 22-8-4, relu between the layers"), "{network}");
        assert_eq!(network.layers()[0].weights, numbers(&[8, OBSERVATION]));
        assert_eq!(network.layers()[1].bias, [0.2; 4]);
    }
}

#[test]
fn no_damage_panics() {
    for bytes in exported() {
        for cut in 0..bytes.len() {
            drop(imported("cut", &bytes[..cut]));
        }
        for at in (0..bytes.len()).filter(|at| at % 7 == 0 || *at < 300) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << (at % 8);
            drop(imported("damaged", &damaged));
        }
    }
}

fn node(operator: &str, inputs: &[&str], output: &str) -> Node {
    Node {
        inputs: inputs.iter().map(|name| (*name).to_owned()).collect(),
        outputs: vec![output.to_owned()],
        name: format!("/{output}"),
        operator: operator.to_owned(),
        ..Node::default()
    }
}

fn weights(name: &str, shape: &[usize]) -> Weights {
    Weights {
        shape: shape.iter().map(|len| *len as i64).collect(),
        kind: 1,
        name: name.to_owned(),
        bytes: bytes_of(&numbers(shape)),
        ..Weights::default()
    }
}

/// A model as PyTorch's exporters write them, of two layers by `MatMul` and `Add` behind a normalisation by constants.
fn model() -> Model {
    let literal =
        Attribute { name: "value".to_owned(), tensor: Some(weights("", &[OBSERVATION])), ..Attribute::default() };
    let value = |name: &str| Value { name: name.to_owned(), kind: None };
    Model {
        format_version: 8,
        graph: Some(Graph {
            nodes: vec![
                Node { attributes: vec![literal], ..node("Constant", &[], "mean") },
                node("Flatten", &["obs"], "flat"),
                node("Sub", &["flat", "mean"], "centred"),
                node("Div", &["centred", "std"], "seen"),
                node("Transpose", &["W0"], "W0.T"),
                node("MatMul", &["seen", "W0.T"], "product"),
                node("Add", &["b0", "product"], "sum"),
                node("Relu", &["sum"], "hidden"),
                node("MatMul", &["hidden", "W1"], "mean_actions"),
                node("Add", &["mean_actions", "b1"], "actions"),
                node("Exp", &["sum"], "value"),
            ],
            tensors: vec![
                weights("std", &[OBSERVATION]),
                weights("W0", &[8, OBSERVATION]),
                weights("b0", &[8]),
                weights("W1", &[8, 4]),
                weights("b1", &[4]),
            ],
            inputs: vec![value("obs")],
            outputs: vec![value("value"), value("actions")],
            ..Graph::default()
        }),
        ..Model::default()
    }
}

/// What importing the model says after a change.
fn changed(change: impl Fn(&mut Graph)) -> Result<ImportedNetwork, ImportError> {
    let mut model = model();
    change(model.graph.as_mut().unwrap());
    imported("changed.onnx", &model.encode_to_vec())
}

#[test]
fn a_graph_is_followed_from_the_action_to_the_observation() {
    let network = changed(|_| ()).unwrap();
    assert_eq!(network.to_string(), "An ONNX model: 22-8-4, relu between the layers");
    let observation = numbers(&[OBSERVATION, 1, 1]);
    let seen = |index: usize| {
        f64::from(observation[index] - numbers(&[OBSERVATION])[index]) / f64::from(numbers(&[OBSERVATION])[index])
    };
    let hidden: Vec<f64> = numbers(&[8, OBSERVATION])
        .chunks(OBSERVATION)
        .zip(numbers(&[8]))
        .map(|(row, bias)| {
            row.iter().enumerate().map(|(at, weight)| f64::from(*weight) * seen(at)).sum::<f64>() + f64::from(bias)
        })
        .map(|sum| sum.max(0.0))
        .collect();
    for (index, found) in act(&network, &observation).into_iter().enumerate() {
        let sum: f64 = (0..8).map(|row| hidden[row] * f64::from(numbers(&[8, 4])[row * 4 + index])).sum();
        let expected = sum + f64::from(numbers(&[4])[index]);
        assert!((found - expected).abs() < 1e-4 * expected.abs().max(1.0), "{found} is not {expected}");
    }
}

#[test]
fn what_a_policy_file_cannot_hold_is_named_by_its_node() {
    let operators = "expected Gemm, MatMul, Add, Sub, Mul, Div, Tanh, Relu, or Clip to [-1, 1] at the end";
    assert_eq!(
        message(changed(|graph| graph.nodes[7].operator = "Softplus".to_owned())),
        format!("node /hidden: found Softplus, {operators}")
    );
    assert_eq!(
        message(changed(|graph| graph.nodes[7].domain = "com.microsoft".to_owned())),
        format!("node /hidden: found com.microsoft::Relu, {operators}")
    );
    assert_eq!(
        message(changed(|graph| graph.nodes[6].inputs[0] = "hidden".to_owned())),
        "node /sum: found Add of two computed values, expected one path from observation to action"
    );
    assert_eq!(
        message(changed(|graph| graph.tensors[1] = weights("W0", &[8, 12]))),
        "tensor W0: found [12, 8], expected [22, outputs]: the observation `pilot` of the task has 22 values"
    );
    assert_eq!(
        message(changed(|graph| graph.tensors[3].kind = 11)),
        "tensor W1: found float64, expected float32: save weights as 32-bit numbers"
    );
    assert_eq!(
        message(changed(|graph| graph.tensors[3].bytes.truncate(100))),
        "tensor W1: found 25 numbers, expected [8, 4]"
    );
    assert_eq!(
        message(changed(|graph| graph.tensors[0].bytes.fill(0))),
        "tensor std: found a zero, expected numbers to divide by"
    );
    assert_eq!(
        message(changed(|graph| graph.nodes[2].inputs[0] = "centred".to_owned())),
        "node /centred: found a loop, expected a path from observation to action"
    );
    let squashed = |graph: &mut Graph| {
        graph.nodes.push(node("Tanh", &["actions"], "action"));
        graph.outputs[1].name = "action".to_owned();
    };
    assert_eq!(
        message(changed(squashed)),
        "behind node /action: found tanh, expected relu as behind the first layer: a policy file has one activation"
    );
    let limits = |graph: &mut Graph| {
        graph.nodes.push(node("Clip", &["actions", "", ""], "action"));
        graph.outputs[1].name = "action".to_owned();
    };
    assert_eq!(
        message(changed(limits)),
        "node /action: found Clip to [none, none], expected none but to [-1, 1] at the end: a policy file has no other limits"
    );
}

#[test]
fn numbers_in_a_file_beside_the_model_are_read_and_no_others() {
    let place = tempfile::tempdir().unwrap();
    let external = |location: &str| {
        let mut model = model();
        let tensor = &mut model.graph.as_mut().unwrap().tensors[3];
        tensor.bytes.clear();
        let entries = [("location", location), ("offset", "8"), ("length", "128")];
        tensor.external =
            entries.map(|(key, value)| Entry { key: key.to_owned(), value: value.to_owned() }).into();
        let path = place.path().join("policy.onnx");
        fs::write(&path, model.encode_to_vec()).unwrap();
        import_network(&path, &settings())
    };
    let missing = message(external("policy.onnx.data"));
    assert!(
        missing.starts_with("tensor W1: found external data in policy.onnx.data, which cannot be read"),
        "{missing}"
    );
    let bytes = [vec![0; 8], bytes_of(&numbers(&[8, 4]))].concat();
    fs::write(place.path().join("policy.onnx.data"), &bytes).unwrap();
    assert_eq!(external("policy.onnx.data").unwrap(), changed(|_| ()).unwrap());
    fs::write(place.path().join("policy.onnx.data"), &bytes[..40]).unwrap();
    assert_eq!(message(external("policy.onnx.data")), "tensor W1: found 8 numbers, expected [8, 4]");
    assert_eq!(
        message(external("../secret")),
        "tensor W1: found external data in ../secret, expected a file beside the model's"
    );
}
