use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_core::encoder::{Convolution, Volume};
use kestrel_core::observation::{ObservationLayout, PILOT_LEN, PilotLayout};
use kestrel_core::policy_file::Arithmetic;
use kestrel_sim::seed::{Purpose, Seed, Stream};

use super::*;
use kestrel_learn::actor_critic::{Actor, ActorLengths, ActorWorkspace, Front};
use kestrel_learn::encoder::Encoder;
use kestrel_learn::gru::Gru;
use kestrel_learn::network::cnn::Cnn;
use kestrel_learn::network::{InputBatch, Mlp};

const METADATA: PolicyMetadata<'static> = PolicyMetadata {
    name: "look",
    observation: ObservationLayout::Pilot(PilotLayout {
        position_scale_m: 0.5,
        velocity_scale: 2.0,
        body_rates_scale: 10.0,
    }),
    action: ActionSpace::RotorSpeeds(RotorSpeeds {
        hover_rotor_speed: 1500.0,
        rotor_speed_limit: 2250.0,
        fraction: 0.3,
    }),
    control_period_secs: 0.01,
    seed: 1,
    training_steps: 1_000_000,
    airframe: None,
};

/// 24 rows of 32 columns, 16 filters 5 × 5 / 2, 16 of 3 × 3 / 2, 64 features.
fn shape() -> EncoderShape {
    let image = Volume { rows: 24, columns: 32, channels: 1 };
    let convolution = |filters, kernel| Convolution { filters, kernel, stride: 2 };
    EncoderShape::new(image, &[convolution(16, 5), convolution(16, 3)], 64).unwrap()
}

fn encoder_parameters(gain: f32) -> Vec<f32> {
    let mut stream = Stream::new(Seed(5), 0, Purpose::Weights);
    let mut parameters = Vec::new();
    for stage in shape().stages() {
        let limit = gain * (6.0 / stage.terms() as f32).sqrt();
        parameters.extend((0..stage.terms() * stage.filters()).map(|_| stream.between(-limit, limit)));
        parameters.extend((0..stage.filters()).map(|_| stream.between(-0.1, 0.1)));
    }
    parameters
}

/// Pictures of a bright rectangle, each elsewhere.
fn calibration(count: usize) -> (Vec<f32>, Vec<u8>) {
    let mut stream = Stream::new(Seed(4), 0, Purpose::Evaluation);
    let observations = (0..count * PILOT_LEN).map(|_| stream.between(-1.5, 1.5)).collect();
    let images = (0..count).flat_map(|index| {
        let (top, left) = (index * 5 % 16, index * 7 % 24);
        (0..24 * 32).map(move |at| {
            let (row, column) = (at / 32, at % 32);
            let inside = (top..top + 8).contains(&row) && (left..left + 8).contains(&column);
            if inside { 220 } else { (2 * row + column) as u8 }
        })
    });
    (observations, images.collect())
}

pub(crate) fn exported(gain: f32, samples: usize) -> Result<SeeingExport, ExportError> {
    let network = Mlp::new(PILOT_LEN + 64, &[64, 64], 4);
    let parameters = network.initialise(0.5, &mut Stream::new(Seed(3), 0, Purpose::Weights));
    let layers: Vec<DenseLayer<'_>> = network.layers(&parameters).into_iter().map(DenseLayer::from).collect();
    let encoder_parameters = encoder_parameters(gain);
    let actor = SeeingActor {
        shape: shape(),
        encoder_parameters: &encoder_parameters,
        memory: None,
        layers: &layers,
        control_periods_per_image: 4,
    };
    let (observations, images) = calibration(samples);
    export_seeing(&actor, &METADATA, SeeingCalibration { observations: &observations, images: &images })
}

#[test]
fn both_files_see_and_agree() {
    let SeeingExport { float_policy, fixed_policy, report } = exported(1.0, 40).unwrap();
    for (bytes, arithmetic) in [(&float_policy, Arithmetic::Float32), (&fixed_policy, Arithmetic::Fixed16)] {
        let policy = VisionPolicy::parse(bytes).unwrap();
        assert_eq!((policy.arithmetic(), policy.metadata()), (arithmetic, &METADATA));
        let mut memory = Memory::new(policy.parameter_format(), policy.memory_len());
        assert_eq!(policy.self_test_with(&mut memory.borrowed(), &mut PolicyScratch::new()), Ok(()));
    }
    assert!(report.largest_action_error > 0.0 && report.largest_action_error < 1e-2, "{report}");
    assert!(report.mean_action_error < f64::from(report.largest_action_error) / 3.0, "{report}");
}

#[test]
fn the_report_measures_every_stage() {
    let SeeingExport { float_policy, fixed_policy, report } = exported(1.0, 40).unwrap();
    assert_eq!((report.float.file_bytes, report.fixed.file_bytes), (float_policy.len(), fixed_policy.len()));
    assert_eq!(report.eye.multiply_accumulates, 135_872);
    assert_eq!((report.eye.float_bytes, report.eye.fixed_bytes), (4 * 27_376, 28_096));
    assert_eq!(report.eye.stages.len(), 3);
    for stage in &report.eye.stages {
        assert_eq!(stage.saturations, 0, "{report}");
        assert!(stage.largest_error < 0.02 * stage.largest_activation, "{report}");
        assert!(stage.mean_error < 2e-3 * f64::from(stage.largest_activation), "{report}");
    }
    // 135,872 products, 6,956 gathered terms, 2,688 sums.
    let cycles = report.eye.cycles;
    assert!((cycles.least - (2.5 * 135_872.0 + 4.0 * 6_956.0 + 12.0 * 2_688.0)).abs() < 1.0, "{cycles}");
    let text = report.to_string();
    assert!(text.contains("eye of 24 x 32 x 1: 135872 multiply-accumulates per image, 28096 bytes"), "{text}");
    let json = serde_json::to_string(&report).unwrap();
    assert_eq!(serde_json::from_str::<SeeingReport>(&json).unwrap(), report);
}

#[test]
fn large_features_take_a_coarser_format() {
    let [fine, coarse] = [1.0, 4.0].map(|gain| exported(gain, 10).unwrap().report);
    assert!(coarse.input_fraction_bits < fine.input_fraction_bits, "{fine}\n{coarse}");
    assert_eq!(coarse.eye.stages[2].saturations, 0, "{coarse}");
}

#[test]
fn exporting_twice_gives_the_same_bytes() {
    assert_eq!(exported(1.0, 10), exported(1.0, 10));
}

#[test]
fn images_that_are_missing_are_named() {
    let (observations, images) = calibration(3);
    let (layers, parameters) = ([], encoder_parameters(1.0));
    let actor = SeeingActor {
        shape: shape(),
        encoder_parameters: &parameters,
        memory: None,
        layers: &layers,
        control_periods_per_image: 4,
    };
    let calibration = SeeingCalibration { observations: &observations, images: &images[1..] };
    let error = export_seeing(&actor, &METADATA, calibration).unwrap_err();
    assert_eq!(
        error.to_string(),
        "found 2303 bytes of calibration images, expected 2304: one for each observation"
    );
}

/// An actor with a memory of 16 units.
fn remembering_actor() -> Actor {
    let (cnn, mut stream) = (Cnn::new(shape()), Stream::new(Seed(3), 0, Purpose::Weights));
    let front = Front::EncoderMemory(Encoder::new(cnn, &[], PILOT_LEN), Gru::new(PILOT_LEN + 64, 16));
    Actor::new(ActorLengths { observation: PILOT_LEN, action: 4 }, front, &[32], 0.0, &mut stream)
}

pub(crate) fn remembering(samples: usize) -> SeeingExport {
    let actor = remembering_actor();
    let layers: Vec<DenseLayer<'_>> = actor.layers().into_iter().map(DenseLayer::from).collect();
    let (encoder, memory) = (actor.encoder().unwrap(), actor.memory().unwrap());
    let parts = SeeingActor {
        shape: shape(),
        encoder_parameters: encoder.cnn_parameters(actor.front_parameters()),
        memory: Some(memory.layers(actor.memory_parameters()).map(DenseLayer::from)),
        layers: &layers,
        control_periods_per_image: 1,
    };
    let (observations, images) = calibration(samples);
    export_seeing(&parts, &METADATA, SeeingCalibration { observations: &observations, images: &images }).unwrap()
}

#[test]
fn both_files_remember_what_the_actor_saw() {
    let actor = remembering_actor();
    let SeeingExport { float_policy, fixed_policy, report } = remembering(40);
    let (observations, images) = calibration(40);
    assert_eq!(report.multiply_accumulates, 102 * 48 + 102 * 32 + 32 * 4);
    assert!(report.largest_action_error > 0.0 && report.largest_action_error < 1e-2, "{report}");
    for (bytes, tolerance) in [(&float_policy, 5e-6), (&fixed_policy, 1e-2)] {
        let policy = VisionPolicy::parse(bytes).unwrap();
        let (mut workspace, mut scratch) = (Memory::of(&policy), PolicyScratch::new());
        let (mut pass, mut hidden) = (ActorWorkspace::new(&actor, 1), vec![0.0; 16]);
        let flight = observations.chunks_exact(PILOT_LEN).zip(images.chunks_exact(24 * 32));
        for (values, images) in flight {
            let mean = pass.means(&actor, InputBatch { values, images, hidden: &hidden }).to_vec();
            hidden.copy_from_slice(pass.hidden());
            policy.encode(images, &mut workspace.borrowed()).unwrap();
            let action = policy.act(values, &mut workspace.borrowed(), &mut scratch).unwrap();
            for (found, mean) in action.into_iter().zip(mean) {
                assert!((found - mean.clamp(-1.0, 1.0)).abs() < tolerance, "{found} is not {mean}");
            }
        }
        assert!(hidden.iter().any(|value| value.abs() > 0.1));
    }
}
