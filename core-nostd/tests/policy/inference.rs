//! Float against an f64 reference, fixed point against an integer reference and against float.

use kestrel_core::activation::Activation;
use kestrel_core::fixed::{ACTIVATION_FRACTION_BITS, FixedFormat, RECTIFIED_FRACTION_BITS};
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::PILOT_LEN;
use kestrel_core::policy_file::{ParameterFormat, PolicyError, PolicyFile, PolicyScratch};
use proptest::prelude::*;

use crate::support::{Model, draft, golden, observations, write};

/// Hidden widths with every remainder of the row blocks and column pairs.
fn widths() -> impl Strategy<Value = Vec<usize>> {
    prop::collection::vec(1_usize..70, 0..=3).prop_map(|hidden| [vec![PILOT_LEN], hidden, vec![4]].concat())
}

fn largest_error(model: &Model, bytes: &[u8], observations: &[f32]) -> f64 {
    let policy = PolicyFile::parse(bytes).expect("the file is intact");
    let mut scratch = PolicyScratch::new();
    let errors = observations.chunks_exact(PILOT_LEN).flat_map(|observation| {
        let action = policy.act(observation, &mut scratch);
        let reference = model.reference(observation);
        action
            .into_iter()
            .zip(reference)
            .map(|(found, expected)| (f64::from(found) - expected).abs())
            .collect::<Vec<_>>()
    });
    errors.fold(0.0, f64::max)
}

/// The quantised network computed row by row from row-major weights with 64-bit sums, by the formulas of the format.
fn integer_reference(layers: &[DenseLayer<'_>], format: FixedFormat, observation: &[f32]) -> Vec<f32> {
    let in_bits = |value: f32, bits: u32| (f64::from(value) * 2.0_f64.powi(bits as i32)).round();
    let mut values: Vec<i64> = observation
        .iter()
        .map(|&value| in_bits(value, format.fraction_bits_into(0)).clamp(-32767.0, 32767.0) as i64)
        .collect();
    for (index, layer) in layers.iter().enumerate() {
        let weight_bits = u32::from(format.weight_fraction_bits[index]);
        let sum_bits = format.fraction_bits_into(index) + weight_bits;
        let sums: Vec<i64> = (0..layer.outputs)
            .map(|row| {
                let weights = &layer.weights[row * layer.inputs..][..layer.inputs];
                let products = weights
                    .iter()
                    .zip(&values)
                    .map(|(&weight, value)| in_bits(weight, weight_bits) as i64 * value);
                let sum = in_bits(layer.bias[row], sum_bits) as i64 + products.sum::<i64>();
                assert!(i32::try_from(sum).is_ok(), "the formats promise 32 bits");
                sum
            })
            .collect();
        if index + 1 == layers.len() {
            return sums
                .iter()
                .map(|&sum| ((sum as f32) / 2.0_f32.powi(sum_bits as i32)).clamp(-1.0, 1.0))
                .collect();
        }
        let activation = match format.activation {
            Activation::Tanh => integer_tanh,
            Activation::Relu => integer_relu,
        };
        values = sums.iter().map(|&sum| activation(in_16_bits(sum, sum_bits))).collect();
    }
    unreachable!("a network has layers")
}

fn in_16_bits(sum: i64, sum_bits: u32) -> i64 {
    if sum_bits > 16 { sum >> (sum_bits - 16) } else { sum << (16 - sum_bits) }
}

/// Rounds and cuts off, by the formula of the format.
fn integer_relu(in_16_bits: i64) -> i64 {
    let shift = 16 - RECTIFIED_FRACTION_BITS;
    ((in_16_bits.max(0) + (1 << (shift - 1))) >> shift).min(32767)
}

/// Interpolates between tangents a 64th apart, by the formula of the format.
fn integer_tanh(in_16_bits: i64) -> i64 {
    let magnitude = in_16_bits.abs().min(6 << 16);
    let entry = |index: i64| (libm::tanh(index as f64 / 64.0) * 32768.0).round() as i64;
    let (below, above) = (entry(magnitude >> 10), entry((magnitude >> 10) + 1));
    let shift = 10 + 15 - ACTIVATION_FRACTION_BITS;
    in_16_bits.signum() * (((below << 10) + (above - below) * (magnitude & 1023) + (1 << (shift - 1))) >> shift)
}

fn fixed_format(parameters: ParameterFormat) -> FixedFormat {
    match parameters {
        ParameterFormat::Fixed16(format) => format,
        ParameterFormat::Float32 => unreachable!("asked for fixed point"),
    }
}

proptest! {
    #[test]
    fn float_inference_follows_f64_for_any_shape(seed: u64, widths in widths(), gain in 0.1_f32..1.5) {
        let model = Model::random(seed, &widths, gain);
        let error = largest_error(&model, &model.float_file(), &observations(seed, 4, 2.0));
        prop_assert!(error < 1e-5, "{error}");
    }

    #[test]
    fn float_inference_with_rectifiers_follows_f64(seed: u64, widths in widths(), gain in 0.1_f32..1.2) {
        let model = Model::random(seed, &widths, gain).rectified();
        let error = largest_error(&model, &model.float_file(), &observations(seed, 4, 2.0));
        prop_assert!(error < 2e-5, "{error}");
    }

    #[test]
    fn fixed_inference_equals_the_integer_reference(
        seed: u64,
        widths in widths(),
        gain in 0.01_f32..20.0,
        reach in 0.1_f32..9.0,
        rectified: bool,
    ) {
        let model = Model::random(seed, &widths, gain);
        let model = if rectified { model.rectified() } else { model };
        let layers = model.layers();
        let bytes = model.fixed_file();
        let policy = PolicyFile::parse(&bytes).unwrap();
        let format = fixed_format(policy.parameter_format());
        for observation in observations(seed, 4, reach).chunks_exact(PILOT_LEN) {
            let action = policy.act(observation, &mut PolicyScratch::new());
            prop_assert_eq!(action[..4].to_vec(), integer_reference(&layers, format, observation));
        }
    }

    #[test]
    fn no_observation_gives_anything_but_an_action(seed: u64, observation in prop::collection::vec(any::<f32>(), 0..30)) {
        let model = Model::random(seed, &[PILOT_LEN, 9, 4], 30.0);
        let rectified = Model::random(seed, &[PILOT_LEN, 9, 4], 30.0).rectified();
        for bytes in [model.float_file(), model.fixed_file(), rectified.float_file(), rectified.fixed_file()] {
            let action = PolicyFile::parse(&bytes).unwrap().act(&observation, &mut PolicyScratch::new());
            prop_assert!(action.iter().all(|value| (-1.0..=1.0).contains(value)), "{:?}", action);
        }
    }
}

/// The largest of the 8192 errors is 4.9e-4: rounded weights and activations, not the format, limit it.
#[test]
fn fixed_point_stays_close_to_f64_in_networks_of_trained_size() {
    let worst = (0..32)
        .map(|seed| {
            let model = Model::typical(seed);
            largest_error(&model, &model.fixed_file(), &observations(seed, 64, 1.5))
        })
        .fold(0.0, f64::max);
    assert!(worst < 1e-3, "{worst}");
}

/// The largest of the 8192 errors is 3e-3, of networks that nobody has trained: activations are three times as coarse as those of
/// tangents, and sums are not squashed.
#[test]
fn fixed_point_stays_close_to_f64_with_rectifiers() {
    let worst = (0..32)
        .map(|seed| {
            let model = Model::typical(seed).rectified();
            largest_error(&model, &model.fixed_file(), &observations(seed, 64, 1.5))
        })
        .fold(0.0, f64::max);
    assert!(worst < 4e-3, "{worst}");
}

#[test]
fn a_missing_or_undefined_value_reads_as_zero() {
    let model = Model::typical(1);
    let mut observation = observations(3, 1, 1.0);
    observation[20] = 0.0;
    observation[21] = 0.0;
    for bytes in [model.float_file(), model.fixed_file()] {
        let policy = PolicyFile::parse(&bytes).unwrap();
        let complete = policy.act(&observation, &mut PolicyScratch::new());
        let mut scratch = PolicyScratch::new();
        policy.act(&observations(4, 1, 1.0), &mut scratch);
        assert_eq!(policy.act(&observation[..20], &mut scratch), complete);
        let mut undefined = observation.clone();
        undefined[20] = f32::NAN;
        assert_eq!(policy.act(&undefined, &mut scratch), complete);
    }
}

#[test]
fn the_scratch_carries_nothing_from_one_inference_to_the_next() {
    let model = Model::random(5, &[PILOT_LEN, 7, 5, 4], 1.0);
    let bytes = model.fixed_file();
    let policy = PolicyFile::parse(&bytes).unwrap();
    let (first, second) = (observations(1, 1, 9.0), observations(2, 1, 1.0));
    let fresh = policy.act(&second, &mut PolicyScratch::new());
    let mut scratch = PolicyScratch::new();
    policy.act(&first, &mut scratch);
    assert_eq!(policy.act(&second, &mut scratch), fresh);
}

#[test]
fn saturation_is_counted_and_the_value_limited() {
    let model = Model::typical(2);
    let format = FixedFormat::finest(&model.layers(), 3.0).unwrap();
    assert_eq!(format.input_fraction_bits, 13);
    let golden = golden();
    let layers = model.layers();
    let bytes = write(&draft(&layers, ParameterFormat::Fixed16(format), &golden));
    let policy = PolicyFile::parse(&bytes).unwrap();
    let mut observation = observations(6, 1, 1.0);
    assert_eq!(policy.saturations(&observation), 0);
    observation[0] = 4.5;
    observation[1] = f32::NEG_INFINITY;
    assert_eq!(policy.saturations(&observation), 2);
    let limited = policy.act(&observation, &mut PolicyScratch::new());
    observation[0] = 3.999_9;
    observation[1] = -3.999_9;
    assert_eq!(policy.saturations(&observation), 0);
    assert_eq!(policy.act(&observation, &mut PolicyScratch::new()), limited);
}

#[test]
fn formats_are_the_finest_that_cannot_overflow() {
    let model = Model::typical(3);
    let layers = model.layers();
    let format = FixedFormat::finest(&layers, 2.0).unwrap();
    for layer in 0..layers.len() {
        let mut finer = format;
        finer.weight_fraction_bits[layer] += 1;
        let golden = golden();
        let draft = draft(&layers, ParameterFormat::Fixed16(finer), &golden);
        let mut bytes = vec![0; draft.file_len().unwrap()];
        assert_eq!(draft.write(&mut bytes), Err(PolicyError::WeightsTooLarge { layer }));
    }
}

#[test]
fn weights_beyond_any_format_are_refused() {
    let widths = [PILOT_LEN, 4, 4];
    let huge = Model::random(1, &widths, 1e6);
    assert_eq!(FixedFormat::finest(&huge.layers(), 2.0), Err(PolicyError::WeightsTooLarge { layer: 0 }));
    let broken = Model::random(1, &widths, f32::NAN);
    assert_eq!(FixedFormat::finest(&broken.layers(), 2.0), Err(PolicyError::WeightsTooLarge { layer: 0 }));
    let layers = broken.layers();
    let golden = golden();
    let draft = draft(&layers, ParameterFormat::Float32, &golden);
    let mut bytes = vec![0; draft.file_len().unwrap()];
    assert_eq!(draft.write(&mut bytes), Err(PolicyError::NotFinite { layer: 0 }));
}
