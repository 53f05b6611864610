//! Recurrent actors as policy files.

use kestrel_core::fixed::FixedFormat;
use kestrel_core::gru::HiddenState;
use kestrel_core::mlp::DenseLayer;
use kestrel_core::policy_file::{
    MemoryDraft, ParameterFormat, PolicyDraft, PolicyError, PolicyMetadata, PolicyScratch, RecurrentDraft,
    RecurrentPolicy,
};

use crate::{
    Contents, Difference, Export, ExportError, ExportReport, FileSize, GOLDEN_VECTORS, LayerReport,
    check_calibration, golden_observations, largest_magnitude, layer_report,
};

/// The parts of an actor with a memory, which is [`kestrel_core::gru`]'s.
#[derive(Clone, Copy, Debug)]
pub struct RecurrentActor<'a> {
    /// From the observation and the hidden state to the gates, `[r, z]`.
    pub gates: DenseLayer<'a>,
    /// From the observation and the gated hidden state to the candidate.
    pub candidate: DenseLayer<'a>,
    /// From the observation and the hidden state to the action; tangents between them.
    pub layers: &'a [DenseLayer<'a>],
}

/// As [`crate::export`]; the calibration observations count as one flight.
///
/// # Errors
/// [`ExportError`].
pub fn export_recurrent(
    actor: &RecurrentActor<'_>,
    metadata: &PolicyMetadata<'_>,
    calibration: &[f32],
) -> Result<Export, ExportError> {
    let RecurrentActor { gates, candidate, layers } = *actor;
    let observation_len = metadata.observation.len();
    check_calibration(calibration, observation_len)?;
    let format = FixedFormat::finest(layers, largest_magnitude(calibration))?;
    let memory = MemoryDraft { gates, candidate, weight_fraction_bits: [0; 2] };
    let memory = MemoryDraft { weight_fraction_bits: memory.finest_bits(format)?, ..memory };
    let golden = golden_observations(calibration, observation_len, GOLDEN_VECTORS);
    let write = |parameters| {
        let policy = PolicyDraft { metadata: *metadata, parameters, layers, golden_observations: &golden };
        written(&RecurrentDraft { policy, memory })
    };
    let float_policy = write(ParameterFormat::Float32)?;
    let fixed_policy = write(ParameterFormat::Fixed16(format))?;
    let report = report((actor, &memory), format, (&float_policy, &fixed_policy), calibration)?;
    Ok(Export { float_policy, fixed_policy, report })
}

fn written(draft: &RecurrentDraft<'_>) -> Result<Vec<u8>, PolicyError> {
    let mut bytes = vec![0; draft.file_len()?];
    draft.write(&mut bytes)?;
    RecurrentPolicy::parse(&bytes)?.self_test_with(&mut HiddenState::new(), &mut PolicyScratch::new())?;
    Ok(bytes)
}

fn report(
    (actor, memory): (&RecurrentActor<'_>, &MemoryDraft<'_>),
    format: FixedFormat,
    (float_file, fixed_file): (&[u8], &[u8]),
    calibration: &[f32],
) -> Result<ExportReport, PolicyError> {
    let (float, fixed) = (RecurrentPolicy::parse(float_file)?, RecurrentPolicy::parse(fixed_file)?);
    let (mut scratch, mut of_float, mut of_fixed) = (PolicyScratch::new(), HiddenState::new(), HiddenState::new());
    let observation_len = float.metadata().observation.len();
    let mut difference = Difference::default();
    for observation in calibration.chunks_exact(observation_len) {
        let wanted = float.act(observation, &mut of_float, &mut scratch);
        let found = fixed.act(observation, &mut of_fixed, &mut scratch);
        difference.add(&wanted, &found, fixed.saturations(observation));
    }
    let input_fraction_bits = u32::from(format.input_fraction_bits);
    let of_memory = [(actor.gates, 0), (actor.candidate, 1)].map(|(layer, index)| LayerReport {
        inputs: layer.inputs,
        outputs: layer.outputs,
        input_fraction_bits,
        weight_fraction_bits: u32::from(memory.weight_fraction_bits[index]),
        largest_weight: largest_magnitude(layer.weights),
    });
    let behind = actor.layers.iter().enumerate().map(|(index, layer)| layer_report(layer, format, index));
    let contents = Contents {
        multiply_accumulates: fixed.multiply_accumulates(),
        float: FileSize { weight_bytes: float.parameter_bytes(), file_bytes: float_file.len() },
        fixed: FileSize { weight_bytes: fixed.parameter_bytes(), file_bytes: fixed_file.len() },
        layers: of_memory.into_iter().chain(behind).collect(),
    };
    Ok(contents.report(float.metadata(), calibration, &difference))
}

#[cfg(test)]
mod tests {
    use kestrel_core::gru::HiddenState;
    use kestrel_core::observation::PILOT_LEN;
    use kestrel_sim::seed::{Purpose, Seed, Stream};

    use super::*;
    use crate::tests::METADATA;
    use kestrel_learn::actor_critic::{Actor, ActorLengths, ActorWorkspace, Front};
    use kestrel_learn::gru::Gru;
    use kestrel_learn::network::InputBatch;

    #[test]
    fn both_files_remember_what_the_actor_remembers() {
        let (units, steps) = (16, 60);
        let mut stream = Stream::new(Seed(3), 0, Purpose::Weights);
        let front = Front::Memory(Gru::new(PILOT_LEN, units));
        let lengths = ActorLengths { observation: PILOT_LEN, action: 4 };
        let actor = Actor::new(lengths, front, &[64, 64], 0.0, &mut stream);
        let flight: Vec<f32> = (0..steps * PILOT_LEN).map(|_| stream.between(-1.5, 1.5)).collect();
        let [gates, candidate] = actor.memory().unwrap().layers(actor.front_parameters()).map(DenseLayer::from);
        let layers: Vec<DenseLayer<'_>> = actor.layers().into_iter().map(DenseLayer::from).collect();
        let parts = RecurrentActor { gates, candidate, layers: &layers };
        let Export { float_policy, fixed_policy, report } = export_recurrent(&parts, &METADATA, &flight).unwrap();
        assert_eq!(report.multiply_accumulates, 38 * 48 + 38 * 64 + 64 * 64 + 64 * 4);
        assert_eq!(report.layers.len(), 5);
        assert!(report.largest_action_error > 0.0 && report.largest_action_error < 2e-3, "{report}");
        let (mut pass, mut hidden) = (ActorWorkspace::new(&actor, 1), vec![0.0; units]);
        for (bytes, tolerance) in [(&float_policy, 2e-6), (&fixed_policy, 2e-3)] {
            let policy = RecurrentPolicy::parse(bytes).unwrap();
            let (mut state, mut scratch) = (HiddenState::new(), PolicyScratch::new());
            hidden.fill(0.0);
            for observation in flight.chunks_exact(PILOT_LEN) {
                let batch = InputBatch { values: observation, images: &[], hidden: &hidden };
                let mean = pass.means(&actor, batch).to_vec();
                hidden.copy_from_slice(pass.hidden());
                for (found, mean) in policy.act(observation, &mut state, &mut scratch).into_iter().zip(mean) {
                    assert!((found - mean.clamp(-1.0, 1.0)).abs() < tolerance, "{found} is not {mean}");
                }
            }
        }
    }
}
