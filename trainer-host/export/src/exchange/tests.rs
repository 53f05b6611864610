//! What other programs read: the standard's bytes, and the weights. `tests/python/exchange_test.py` runs them.

use ::safetensors::SafeTensors;
use kestrel_core::policy_file::{Activation, PolicyMetadata};

use super::*;
use crate::tests::METADATA;
use crate::{DenseLayer, export};

fn policies(activation: Activation) -> (Vec<u8>, Vec<u8>) {
    let first: Vec<f32> = (0..22 * 3).map(|index| 0.01 * index as f32 - 0.3).collect();
    let second: Vec<f32> = (0..3 * 4).map(|index| 0.2 - 0.05 * index as f32).collect();
    let layers = [
        DenseLayer { inputs: 22, outputs: 3, weights: &first, bias: &[0.1, 0.2, 0.3], activation },
        DenseLayer { inputs: 3, outputs: 4, weights: &second, bias: &[0.0, 0.5, -0.5, 1.0], activation },
    ];
    let metadata = PolicyMetadata { name: "tiny", ..METADATA };
    let calibration: Vec<f32> = (0..22 * 4).map(|index| libm::sinf(index as f32)).collect();
    let exported = export(&layers, &metadata, &calibration).unwrap();
    (exported.float_policy, exported.fixed_policy)
}

#[test]
fn safetensors_hold_the_weights_under_the_names_of_a_sequential() {
    let (policy, _) = policies(Activation::Tanh);
    let file = safetensors_file(&policy).unwrap();
    assert_eq!(file, safetensors_file(&policy).unwrap());
    let read = SafeTensors::deserialize(&file).unwrap();
    let mut names = read.names();
    names.sort_unstable();
    assert_eq!(names, ["0.bias", "0.weight", "2.bias", "2.weight", "golden.actions", "golden.observations"]);
    assert_eq!(read.tensor("0.weight").unwrap().shape(), [3, 22]);
    assert_eq!(read.tensor("2.bias").unwrap().data(), bytes_of(&[0.0, 0.5, -0.5, 1.0]));
    assert_eq!(read.tensor("golden.observations").unwrap().shape(), [4, 22]);
    let (_, header) = SafeTensors::read_metadata(&file).unwrap();
    let about: serde_json::Value = serde_json::from_str(&header.metadata().as_ref().unwrap()["kestrel"]).unwrap();
    assert_eq!((&about["name"], &about["seed"]), (&"tiny".into(), &1.into()));
}

#[test]
fn a_model_is_the_standards_bytes() {
    let (policy, _) = policies(Activation::Tanh);
    let model = onnx_model(&policy).unwrap();
    assert_eq!(model, onnx_model(&policy).unwrap());
    // Field 1, the version of the format, then field 2, who wrote it.
    assert_eq!(model[..11], *b"\x08\x08\x12\x07kestrel");
    let holds = |text: &[u8]| model.windows(text.len()).any(|window| window == text);
    for text in
        ["observation", "action", "Gemm", "Tanh", "Clip", "transB", "weight.1", "batch", "\"name\":\"tiny\""]
    {
        assert!(holds(text.as_bytes()), "{text}");
    }
    assert!(holds(&bytes_of(&[0.1, 0.2, 0.3])));
}

#[test]
fn rectifiers_are_written_and_said() {
    let (policy, _) = policies(Activation::Relu);
    let model = onnx_model(&policy).unwrap();
    let holds = |bytes: &[u8], text: &[u8]| bytes.windows(text.len()).any(|window| window == text);
    assert!(holds(&model, b"Relu") && !holds(&model, b"Tanh"));
    assert!(holds(&safetensors_file(&policy).unwrap(), br#"activation\":\"relu"#));
}

#[test]
fn what_is_no_float_policy_is_refused() {
    let (policy, fixed) = policies(Activation::Tanh);
    assert_eq!(onnx_model(&fixed).unwrap_err(), ExchangeError::Fixed);
    assert_eq!(safetensors_file(&fixed).unwrap_err(), ExchangeError::Fixed);
    assert!(matches!(onnx_model(&policy[..100]).unwrap_err(), ExchangeError::Policy(_)));
}
