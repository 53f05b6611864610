//! Networks, states and files to test with.

use kestrel_core::action::{ActionSpace, RotorSpeeds, ThrustBodyRates};
use kestrel_core::activation::Activation;
use kestrel_core::airframe::CF2X;
use kestrel_core::crc32::crc32;
use kestrel_core::fixed::FixedFormat;
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::{ObservationLayout, PILOT_LEN, PilotLayout};
use kestrel_core::policy_file::{ParameterFormat, PolicyDraft, PolicyMetadata};

pub(crate) const PILOT: ObservationLayout =
    ObservationLayout::Pilot(PilotLayout { position_scale_m: 0.6, velocity_scale: 2.0, body_rates_scale: 8.0 });

/// `SplitMix64`, enough to fill test networks.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }

    /// Uniform in ±`limit`.
    pub(crate) fn within(&mut self, limit: f32) -> f32 {
        ((self.next() >> 40) as f32 / (1 << 23) as f32 - 1.0) * limit
    }
}

/// A network that owns its weights.
pub(crate) struct Model {
    layers: Vec<(usize, usize, Vec<f32>, Vec<f32>)>,
    activation: Activation,
}

impl Model {
    /// Weights uniform with `gain` times the standard deviation 1/√inputs, biases within ±0.1.
    pub(crate) fn random(seed: u64, widths: &[usize], gain: f32) -> Self {
        let mut random = Random(seed);
        let layers = widths.windows(2).map(|pair| {
            let limit = gain * (3.0 / pair[0] as f32).sqrt();
            let weights = (0..pair[0] * pair[1]).map(|_| random.within(limit)).collect();
            let bias = (0..pair[1]).map(|_| random.within(0.1)).collect();
            (pair[0], pair[1], weights, bias)
        });
        Self { layers: layers.collect(), activation: Activation::Tanh }
    }

    /// The same weights with rectifiers behind hidden layers.
    pub(crate) fn rectified(self) -> Self {
        Self { activation: Activation::Relu, ..self }
    }

    /// 22-64-64-4, as trained networks are.
    pub(crate) fn typical(seed: u64) -> Self {
        Self::random(seed, &[PILOT_LEN, 64, 64, 4], 1.0)
    }

    pub(crate) fn layers(&self) -> Vec<DenseLayer<'_>> {
        self.layers
            .iter()
            .map(|(inputs, outputs, weights, bias)| DenseLayer {
                inputs: *inputs,
                outputs: *outputs,
                weights,
                bias,
                activation: self.activation,
            })
            .collect()
    }

    /// The output in `f64` with an exact activation, limited to \[-1, 1\].
    pub(crate) fn reference(&self, observation: &[f32]) -> Vec<f64> {
        let mut values: Vec<f64> = observation.iter().map(|&value| f64::from(value)).collect();
        for (index, (inputs, outputs, weights, bias)) in self.layers.iter().enumerate() {
            values = (0..*outputs)
                .map(|row| {
                    let products =
                        (0..*inputs).map(|column| f64::from(weights[row * inputs + column]) * values[column]);
                    f64::from(bias[row]) + products.sum::<f64>()
                })
                .map(|sum| match self.activation {
                    _ if index + 1 == self.layers.len() => sum.clamp(-1.0, 1.0),
                    Activation::Tanh => libm::tanh(sum),
                    Activation::Relu => sum.max(0.0),
                })
                .collect();
        }
        values
    }

    pub(crate) fn float_file(&self) -> Vec<u8> {
        write(&draft(&self.layers(), ParameterFormat::Float32, &golden()))
    }

    pub(crate) fn fixed_file(&self) -> Vec<u8> {
        write(&draft(&self.layers(), self.fixed_format(), &golden()))
    }

    pub(crate) fn fixed_format(&self) -> ParameterFormat {
        ParameterFormat::Fixed16(FixedFormat::finest(&self.layers(), 2.0).expect("test weights are small"))
    }
}

pub(crate) fn draft<'a>(
    layers: &'a [DenseLayer<'a>],
    parameters: ParameterFormat,
    golden_observations: &'a [f32],
) -> PolicyDraft<'a> {
    PolicyDraft { metadata: metadata(&rotor_speeds()), parameters, layers, golden_observations }
}

pub(crate) fn rotor_speeds() -> ActionSpace {
    ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 0.3))
}

pub(crate) fn thrust_body_rates() -> ActionSpace {
    ActionSpace::ThrustBodyRates(ThrustBodyRates::new(&CF2X, 0.8, [10.0, 10.0, 5.0], [40.0, 40.0, 20.0]))
}

pub(crate) fn metadata(action: &ActionSpace) -> PolicyMetadata<'static> {
    PolicyMetadata {
        name: "hover",
        observation: PILOT,
        action: *action,
        control_period_secs: 0.01,
        seed: 7,
        training_steps: 12_000_000,
        airframe: None,
    }
}

/// `count` observations within ±`limit`, one after the other.
pub(crate) fn observations(seed: u64, count: usize, limit: f32) -> Vec<f32> {
    let mut random = Random(seed);
    (0..count * PILOT_LEN).map(|_| random.within(limit)).collect()
}

pub(crate) fn golden() -> Vec<f32> {
    observations(99, 3, 1.5)
}

pub(crate) fn write(draft: &PolicyDraft<'_>) -> Vec<u8> {
    let mut bytes = vec![0xAA; draft.file_len().expect("the draft is valid")];
    let written = draft.write(&mut bytes).expect("the draft is valid");
    assert_eq!(written, bytes.len());
    bytes
}

/// Puts the right checksum behind altered contents.
pub(crate) fn seal(bytes: &mut [u8]) {
    let end = bytes.len() - 4;
    let checksum = crc32(&bytes[..end]);
    bytes[end..].copy_from_slice(&checksum.to_le_bytes());
}
