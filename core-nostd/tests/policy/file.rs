//! Writing and reading policy files.

use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_core::activation::Activation;
use kestrel_core::airframe::CF2X;
use kestrel_core::crc32::crc32;
use kestrel_core::fixed::{self, FixedFormat, FixedMlp};
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::{ObservationLayout, PILOT_LEN, PilotLayout};
use kestrel_core::policy_file::{
    Aligned, Arithmetic, HEADER_LEN, ParameterFormat, PolicyAirframe, PolicyDraft, PolicyError, PolicyFile,
    PolicyMetadata, PolicyScratch,
};
use proptest::prelude::*;

use crate::support::{Model, draft, golden, metadata, observations, rotor_speeds, seal, thrust_body_rates, write};

proptest! {
    #[test]
    fn what_is_written_is_read(
        seed: u64,
        name in "\\PC{0,16}",
        scales in prop::array::uniform3(0.01_f32..100.0),
        control_period_secs in 1e-3_f32..1.0,
        training_steps: u64,
        hidden in prop::collection::vec(1_usize..=128, 0..=3),
        vectors in 1_usize..=64,
        fixed: bool,
        rectified: bool,
        rates: bool,
    ) {
        let [position_scale_m, velocity_scale, body_rates_scale] = scales;
        let metadata = PolicyMetadata {
            name: &name,
            observation: ObservationLayout::Pilot(PilotLayout { position_scale_m, velocity_scale, body_rates_scale }),
            action: if rates { thrust_body_rates() } else { rotor_speeds() },
            control_period_secs,
            seed,
            training_steps,
            airframe: rates.then(|| PolicyAirframe::from(&CF2X)),
        };
        let widths = [vec![PILOT_LEN], hidden, vec![4]].concat();
        let model = Model::random(seed, &widths, 1.0);
        let model = if rectified { model.rectified() } else { model };
        let parameters = if fixed { model.fixed_format() } else { ParameterFormat::Float32 };
        let layers = model.layers();
        let golden_observations = &observations(seed, vectors, 2.0);
        let bytes = write(&PolicyDraft { metadata, parameters, layers: &layers, golden_observations });
        let policy = PolicyFile::parse(&bytes).unwrap();
        prop_assert_eq!(policy.metadata(), &metadata);
        prop_assert_eq!(policy.parameter_format(), parameters);
        let shapes: Vec<_> = widths.windows(2).map(|pair| (pair[0], pair[1])).collect();
        prop_assert_eq!(policy.shapes().collect::<Vec<_>>(), shapes);
        prop_assert_eq!(policy.self_test(), Ok(()));
    }
}

#[test]
fn the_size_of_a_policy_is_known() {
    let model = Model::typical(1);
    let (float, fixed) = (model.float_file(), model.fixed_file());
    let policy = PolicyFile::parse(&fixed).unwrap();
    let multiplications = 22 * 64 + 64 * 64 + 64 * 4;
    assert_eq!(policy.arithmetic(), Arithmetic::Fixed16);
    assert_eq!(policy.multiply_accumulates(), multiplications);
    assert_eq!(policy.parameter_bytes(), 2 * multiplications + 4 * 132);
    assert_eq!(PolicyFile::parse(&float).unwrap().parameter_bytes(), 4 * multiplications + 4 * 132);
}

/// Everything from small integers, so that every machine makes the same files; the checksums were recorded when format
/// version 1 was defined. A change here asks for a new version. Golden actions of the float file are left out: they
/// depend on the activation function to the last bit, the format does not.
#[test]
fn the_format_has_not_moved() {
    let numbers = |count: usize, step: usize| -> Vec<f32> {
        (0..count).map(|i| ((i * step) % 17) as f32 / 64.0 - 0.125).collect()
    };
    let shapes = [(PILOT_LEN, 20), (20, 5), (5, 4)];
    let parameters = shapes.map(|(inputs, outputs)| (numbers(inputs * outputs, 5), numbers(outputs, 3)));
    let mut layers =
        [DenseLayer { inputs: 0, outputs: 0, weights: &[], bias: &[], activation: Activation::Tanh }; 3];
    for (layer, ((inputs, outputs), (weights, bias))) in layers.iter_mut().zip(shapes.iter().zip(&parameters)) {
        *layer = DenseLayer { inputs: *inputs, outputs: *outputs, weights, bias, ..*layer };
    }
    let action = ActionSpace::RotorSpeeds(RotorSpeeds {
        hover_rotor_speed: 1500.0,
        rotor_speed_limit: 2250.0,
        fraction: 0.25,
    });
    let golden_observations = &numbers(2 * PILOT_LEN, 7);
    let parameters = ParameterFormat::Float32;
    let draft = PolicyDraft { metadata: metadata(&action), parameters, layers: &layers, golden_observations };
    let format = FixedFormat::finest(&layers, 1.0).unwrap();
    let float = write(&draft);
    let fixed = write(&PolicyDraft { parameters: ParameterFormat::Fixed16(format), ..draft });
    let end = float.len() - 4;
    let start = end - PolicyFile::parse(&float).unwrap().parameter_bytes();
    assert_eq!(
        (float.len(), crc32(&float[..HEADER_LEN]), crc32(&float[start..end])),
        (2_904, 0x97EB_B0EC, 0xC0E4_C4AB)
    );
    assert_eq!((fixed.len(), crc32(&fixed[..fixed.len() - 4])), (1_672, 0x4D0C_4C85));
}

#[test]
fn writing_twice_gives_the_same_bytes() {
    let model = Model::typical(4);
    assert_eq!(model.fixed_file(), model.fixed_file());
    assert_eq!(model.float_file(), model.float_file());
}

#[test]
fn a_buffer_may_be_longer_than_the_file_but_not_shorter() {
    let model = Model::typical(4);
    let layers = model.layers();
    let golden = golden();
    let draft = draft(&layers, ParameterFormat::Float32, &golden);
    let expected = draft.file_len().unwrap();
    let mut long = vec![7; expected + 9];
    assert_eq!(draft.write(&mut long), Ok(expected));
    assert_eq!(&long[..expected], write(&draft));
    assert!(long[expected..].iter().all(|byte| *byte == 7));
    let found = expected - 1;
    assert_eq!(draft.write(&mut long[..found]), Err(PolicyError::BufferTooSmall { found, expected }));
}

#[test]
fn a_policy_lives_in_a_static() {
    static BYTES: Aligned<3> = Aligned(*b"\x89KP");
    assert_eq!(
        PolicyFile::parse(&BYTES.0).unwrap_err(),
        PolicyError::Truncated { found: 3, expected: HEADER_LEN }
    );
}

#[test]
fn altered_golden_vectors_fail_the_self_test() {
    let model = Model::typical(6);
    let golden_start = |bytes: &[u8]| {
        let metadata_len = usize::from(u16::from_le_bytes([bytes[20], bytes[21]]));
        HEADER_LEN + metadata_len.next_multiple_of(4)
    };
    for intact in [model.float_file(), model.fixed_file()] {
        let at = golden_start(&intact) + 4 * (PILOT_LEN + 4 + PILOT_LEN + 1);
        let recorded = f32::from_le_bytes(intact[at..at + 4].try_into().unwrap());
        for altered in [recorded + 1e-3, f32::NAN] {
            let mut bytes = intact.clone();
            bytes[at..at + 4].copy_from_slice(&altered.to_le_bytes());
            seal(&mut bytes);
            let failure = PolicyFile::parse(&bytes).unwrap().self_test().unwrap_err();
            assert!(matches!(failure, PolicyError::SelfTest { vector: 1, output: 1, .. }), "{failure}");
        }
    }
}

#[test]
fn one_unit_in_the_last_place_fails_the_fixed_point_self_test() {
    let model = Model::typical(6);
    let mut bytes = model.fixed_file();
    let golden = golden();
    let action = PolicyFile::parse(&bytes).unwrap().act(&golden[..PILOT_LEN], &mut PolicyScratch::new());
    assert!(action[0].abs() < 1.0);
    let needle = action[0].to_le_bytes();
    let at = bytes.windows(4).position(|window| window == needle).unwrap();
    bytes[at] ^= 1;
    seal(&mut bytes);
    assert!(matches!(
        PolicyFile::parse(&bytes).unwrap().self_test(),
        Err(PolicyError::SelfTest { vector: 0, .. })
    ));
}

#[test]
fn drafts_that_no_file_can_hold_are_refused() {
    let model = Model::typical(8);
    let layers = model.layers();
    let golden = golden();
    let valid = draft(&layers, ParameterFormat::Float32, &golden);
    let refusal = |draft: PolicyDraft<'_>| draft.file_len().unwrap_err();
    let expected = PILOT_LEN;
    assert_eq!(
        refusal(PolicyDraft { golden_observations: &[], ..valid }),
        PolicyError::GoldenObservations { found: 0, expected }
    );
    assert_eq!(
        refusal(PolicyDraft { golden_observations: &golden[1..], ..valid }),
        PolicyError::GoldenObservations { found: 65, expected }
    );
    assert_eq!(
        refusal(PolicyDraft { golden_observations: &observations(1, 65, 1.0), ..valid }),
        PolicyError::GoldenObservations { found: 65 * PILOT_LEN, expected }
    );
    assert_eq!(refusal(PolicyDraft { layers: &[], ..valid }), PolicyError::LayerCount { found: 0 });
    assert_eq!(
        refusal(PolicyDraft { layers: &layers[1..], ..valid }),
        PolicyError::ObservationLength { found: 64, expected }
    );
    assert_eq!(
        refusal(PolicyDraft { layers: &layers[..2], ..valid }),
        PolicyError::ActionLength { found: 64, expected: 4 }
    );
    let skipping =
        [layers[0], DenseLayer { inputs: 63, weights: &layers[1].weights[..64 * 63], ..layers[1] }, layers[2]];
    assert_eq!(
        refusal(PolicyDraft { layers: &skipping, ..valid }),
        PolicyError::LayerShape { layer: 1, weights: 64 * 63, biases: 64, inputs: 64, outputs: 64 }
    );
    let wide = Model::random(1, &[PILOT_LEN, 129, 4], 1.0);
    assert_eq!(
        refusal(PolicyDraft { layers: &wide.layers(), ..valid }),
        PolicyError::Width { layer: 1, found: 129 }
    );
    let name = "x".repeat(65);
    let named = PolicyMetadata { name: &name, ..metadata(&rotor_speeds()) };
    assert_eq!(refusal(PolicyDraft { metadata: named, ..valid }), PolicyError::Name { found: 65, expected: 64 });
    let timeless = PolicyMetadata { control_period_secs: 0.0, ..metadata(&rotor_speeds()) };
    assert!(matches!(
        refusal(PolicyDraft { metadata: timeless, ..valid }),
        PolicyError::MetadataValue { field: "control_period_secs", .. }
    ));
}

#[test]
fn a_file_gives_its_parameters_and_golden_vectors_back() {
    let model = Model::random(5, &[PILOT_LEN, 23, 18, 4], 1.0);
    let (float_file, fixed_file) = (model.float_file(), model.fixed_file());
    let (float, fixed) = (PolicyFile::parse(&float_file).unwrap(), PolicyFile::parse(&fixed_file).unwrap());
    for (index, layer) in model.layers().iter().enumerate() {
        for row in 0..=layer.outputs {
            for column in 0..=layer.inputs {
                let inside = row < layer.outputs && column < layer.inputs;
                let expected = if inside { layer.weights[row * layer.inputs + column] } else { 0.0 };
                assert_eq!(float.weight(index, row, column), expected);
                assert!((fixed.weight(index, row, column) - expected).abs() < 1e-3);
            }
            let expected = layer.bias.get(row).copied().unwrap_or_default();
            assert_eq!(float.bias(index, row), expected);
            assert!((fixed.bias(index, row) - expected).abs() < 1e-6);
        }
    }
    let (observation, action) = fixed.golden_vectors().next().unwrap();
    assert_eq!(fixed.act(&observation[..PILOT_LEN], &mut fixed.scratch())[..4], action[..4]);
}

#[test]
fn a_network_in_fixed_point_needs_no_file_around_it() {
    let model = Model::random(6, &[PILOT_LEN, 20, 4], 1.0);
    let file = model.fixed_file();
    let policy = PolicyFile::parse(&file).unwrap();
    let ParameterFormat::Fixed16(format) = policy.parameter_format() else { panic!("fixed point was asked for") };
    let end = file.len() - 4;
    let parameters = &file[end - policy.parameter_bytes()..end];
    let widths = [PILOT_LEN as u16, 20, 4];
    let network = FixedMlp::from_parameters(&widths, format, parameters).unwrap();
    for (observation, _) in policy.golden_vectors() {
        let alone = network.act(&observation[..PILOT_LEN], &mut fixed::FixedScratch::new());
        assert_eq!(alone, policy.act(&observation[..PILOT_LEN], &mut policy.scratch()));
    }
    let refusal = |widths: &[u16], parameters| FixedMlp::from_parameters(widths, format, parameters).unwrap_err();
    assert!(matches!(refusal(&widths, &parameters[..100]), PolicyError::Length { found: 100, .. }));
    assert!(matches!(refusal(&widths, &parameters[2..]), PolicyError::Misaligned { found: 2 }));
    assert_eq!(refusal(&[22, 129], parameters), PolicyError::Width { layer: 1, found: 129 });
}

#[test]
fn a_file_knows_the_drone_and_an_older_one_does_not() {
    let model = Model::random(7, &[PILOT_LEN, 8, 4], 1.0);
    let (layers, golden) = (model.layers(), golden());
    let older = draft(&layers, ParameterFormat::Float32, &golden);
    let airframe = Some(PolicyAirframe::from(&CF2X));
    let metadata = PolicyMetadata { airframe, ..older.metadata };
    let mut file = write(&PolicyDraft { metadata, ..older });
    assert_eq!(PolicyFile::parse(&file).unwrap().metadata(), &metadata);
    let older = write(&older);
    assert_eq!(PolicyFile::parse(&older).unwrap().metadata().airframe, None);
    assert_eq!(file.len(), older.len() + 56);
    // One byte more than the numbers of an airframe.
    let len = u16::from_le_bytes([file[20], file[21]]);
    file[20..22].copy_from_slice(&(len + 1).to_le_bytes());
    seal(&mut file);
    assert!(matches!(PolicyFile::parse(&file), Err(PolicyError::Metadata { .. } | PolicyError::Length { .. })));
}

#[test]
fn a_drone_that_cannot_be_is_refused() {
    let model = Model::random(8, &[PILOT_LEN, 8, 4], 1.0);
    let (layers, golden) = (model.layers(), golden());
    let valid = draft(&layers, ParameterFormat::Float32, &golden);
    let airframe = PolicyAirframe::from(&CF2X);
    for airframe in [
        PolicyAirframe { mass: 0.0, ..airframe },
        PolicyAirframe { rotor_thrust_limit: f32::INFINITY, ..airframe },
        PolicyAirframe { torque_per_thrust: [f32::NAN; 4], ..airframe },
    ] {
        let metadata = PolicyMetadata { airframe: Some(airframe), ..valid.metadata };
        let error = PolicyDraft { metadata, ..valid }.file_len().unwrap_err();
        assert!(matches!(error, PolicyError::MetadataValue { .. }), "{error}");
    }
}
