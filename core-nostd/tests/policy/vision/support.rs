//! Policies with an encoder to test with.

use kestrel_core::encoder::{Convolution, Encoder, EncoderFormat, EncoderShape, STAGE_LIMIT, Volume, write_float};
use kestrel_core::fixed::FixedFormat;
use kestrel_core::mlp::DenseLayer;
use kestrel_core::observation::PILOT_LEN;
use kestrel_core::policy_file::{
    EncoderDraft, EncoderWorkspace, MemoryDraft, ParameterFormat, PolicyDraft, VisionDraft,
};

use crate::support::{Model, Random, golden, metadata, rotor_speeds};

/// Golden observations of the shared support.
pub(crate) const VECTORS: usize = 3;

/// An encoder, and the network behind it.
pub(crate) struct VisionModel {
    pub(crate) shape: EncoderShape,
    pub(crate) parameters: Vec<f32>,
    pub(crate) model: Model,
    /// Gates and candidate of a memory.
    pub(crate) memory: Option<[Model; 2]>,
    golden: Vec<f32>,
    golden_images: Vec<u8>,
}

impl VisionModel {
    pub(crate) fn random(seed: u64, image: Volume, convolutions: &[Convolution], features: u16) -> Self {
        let shape = EncoderShape::new(image, convolutions, features).expect("the shape is valid");
        let mut random = Random(seed);
        let mut parameters = Vec::new();
        for stage in shape.stages() {
            let limit = (6.0 / stage.terms() as f32).sqrt();
            parameters.extend((0..stage.terms() * stage.filters()).map(|_| random.within(limit)));
            parameters.extend((0..stage.filters()).map(|_| random.within(0.1)));
        }
        let model = Model::random(seed, &[PILOT_LEN + usize::from(features), 16, 4], 1.0);
        let golden_images = images(&shape, seed, VECTORS);
        Self { shape, parameters, model, memory: None, golden: golden(), golden_images }
    }

    /// The same encoder, a memory of so many units behind it, and another network.
    pub(crate) fn remembering(self, units: usize, hidden: usize) -> Self {
        let inputs = PILOT_LEN + self.shape.features() + units;
        let memory = [Model::random(31, &[inputs, 2 * units], 1.5), Model::random(32, &[inputs, units], 1.5)];
        Self { model: Model::random(33, &[inputs, hidden, 4], 1.0), memory: Some(memory), ..self }
    }

    /// So small that every bit of its file can be tried.
    pub(crate) fn tiny() -> Self {
        let image = Volume { rows: 5, columns: 6, channels: 1 };
        let convolutions = [Convolution { filters: 3, kernel: 3, stride: 2 }];
        let mut model = Self::random(1, image, &convolutions, 5);
        model.model = Model::random(1, &[PILOT_LEN + 5, 4, 4], 1.0);
        model
    }

    /// 24 rows of 32 columns, 16 filters 5 × 5 / 2, 16 of 3 × 3 / 2, 64 features.
    pub(crate) fn typical() -> Self {
        let image = Volume { rows: 24, columns: 32, channels: 1 };
        let convolution = |filters, kernel| Convolution { filters, kernel, stride: 2 };
        Self::random(2, image, &[convolution(16, 5), convolution(16, 3)], 64)
    }

    /// The network of Mnih et al. 2015 on four images of 64 × 48: more features than an observation has values.
    pub(crate) fn nature() -> Self {
        let image = Volume { rows: 48, columns: 64, channels: 4 };
        let convolution = |filters, kernel, stride| Convolution { filters, kernel, stride };
        Self::random(3, image, &[convolution(32, 8, 4), convolution(64, 4, 2), convolution(64, 3, 1)], 512)
    }

    /// Features and the largest activations on the golden images.
    pub(crate) fn features(&self, image: &[u8]) -> (Vec<f32>, [f32; STAGE_LIMIT]) {
        let mut bytes = vec![0; self.shape.float_bytes()];
        write_float(&self.shape, &self.parameters, &mut bytes).expect("the parameters fit");
        let encoder = Encoder::from_parameters(self.shape, &bytes).expect("the parameters fit");
        let mut features = vec![0.0; self.shape.features()];
        let mut largest = [0.0; STAGE_LIMIT];
        let mut scratch = vec![0.0; self.shape.scratch_len()];
        encoder
            .encode_each(image, &mut scratch, &mut features, |stage, activations| {
                largest[stage] = activations.iter().copied().fold(0.0, f32::max);
            })
            .expect("the image fits");
        (features, largest)
    }

    fn largest(&self) -> [f32; STAGE_LIMIT] {
        let images = self.golden_images.chunks_exact(self.shape.image().len());
        images.map(|image| self.features(image).1).fold([0.0; STAGE_LIMIT], |largest, other| {
            std::array::from_fn(|stage| f32::max(largest[stage], other[stage]))
        })
    }

    /// `change` alters the draft of the policy in float or fixed point.
    pub(crate) fn with_draft<T>(&self, fixed: bool, change: impl Fn(VisionDraft<'_>) -> T) -> T {
        let layers: Vec<DenseLayer<'_>> = self.model.layers();
        let fixed_format = FixedFormat::finest(&layers, 8.0).expect("test weights are small");
        let memory = self.memory.as_ref().map(|[gates, candidate]| {
            let (gates, candidate) = (gates.layers()[0], candidate.layers()[0]);
            let memory = MemoryDraft { gates, candidate, weight_fraction_bits: [0; 2] };
            let weight_fraction_bits = memory.finest_bits(fixed_format).expect("test weights are small");
            MemoryDraft { weight_fraction_bits, ..memory }
        });
        let bits = fixed_format.input_fraction_bits;
        let format = EncoderFormat::calibrated(&self.shape, &self.parameters, &self.largest(), bits);
        change(VisionDraft {
            policy: PolicyDraft {
                metadata: metadata(&rotor_speeds()),
                parameters: if fixed { ParameterFormat::Fixed16(fixed_format) } else { ParameterFormat::Float32 },
                layers: &layers,
                golden_observations: &self.golden,
            },
            encoder: EncoderDraft {
                shape: self.shape,
                parameters: &self.parameters,
                format: format.expect("test weights are small"),
                control_periods_per_image: 4,
                golden_images: &self.golden_images,
            },
            memory,
        })
    }

    pub(crate) fn file(&self, fixed: bool) -> Vec<u8> {
        self.with_draft(fixed, |draft| {
            let mut bytes = vec![0xAA; draft.file_len().expect("the draft is valid")];
            let written =
                with_memory(draft.memory_len(), fixed, |mut memory| draft.write(&mut bytes, &mut memory));
            assert_eq!(written, Ok(bytes.len()));
            bytes
        })
    }

    pub(crate) fn files(&self) -> [Vec<u8>; 2] {
        [self.file(false), self.file(true)]
    }
}

/// Calls `work` with memory of `len` values, full of what must not matter.
pub(crate) fn with_memory<T>(len: usize, fixed: bool, work: impl FnOnce(EncoderWorkspace<'_>) -> T) -> T {
    let (mut floats, mut integers) = (vec![f32::NAN; len], vec![-7_i16; len]);
    work(if fixed { EncoderWorkspace::Fixed16(&mut integers) } else { EncoderWorkspace::Float32(&mut floats) })
}

/// `count` images of noise, one after the other.
pub(crate) fn images(shape: &EncoderShape, seed: u64, count: usize) -> Vec<u8> {
    let mut random = Random(seed);
    (0..count * shape.image().len()).map(|_| random.next() as u8).collect()
}
