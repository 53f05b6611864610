//! What the export of an actor with an eye measured.

use core::fmt;

use kestrel_core::encoder::{Encoder, EncoderFormat, EncoderStage, FixedEncoder};
use kestrel_core::policy_file::{Arithmetic, PolicyEncoder, PolicyError, PolicyScratch, VisionPolicy};
use serde::{Deserialize, Serialize};

use super::{Memory, SeeingActor, SeeingCalibration};
use crate::cycles::Cycles;
use crate::{FileSize, largest_magnitude};

/// Size and accuracy of an exported policy with an eye.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeeingReport {
    /// Name of the policy.
    pub name: String,
    /// Observations with an image on which the two files were compared.
    pub calibration_samples: usize,
    /// Fraction bits of observations and features.
    pub input_fraction_bits: u8,
    /// Largest difference between a fixed-point and a float action, in the unit of actions (\[-1, 1\]).
    pub largest_action_error: f32,
    /// Mean absolute difference.
    pub mean_action_error: f64,
    /// Multiplications per action, without those of an image, padding not counted.
    pub multiply_accumulates: usize,
    /// Of an action, in fixed point.
    pub cycles: Cycles,
    /// Of the float file; the weights are those of eye and network.
    pub float: FileSize,
    /// Of the fixed-point file.
    pub fixed: FileSize,
    /// What turns images into features.
    pub eye: EyeReport,
}

/// Size and accuracy of an eye.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EyeReport {
    /// Rows, columns and channels of the image.
    pub image: [u16; 3],
    /// Multiplications per image, padding not counted.
    pub multiply_accumulates: usize,
    /// Bytes of parameters in float, padding included.
    pub float_bytes: usize,
    /// Bytes of parameters in fixed point, padding included.
    pub fixed_bytes: usize,
    /// Values of working memory for eye and network together: 4 bytes each in float, 2 in fixed point.
    pub memory_values: usize,
    /// Of an image, in fixed point.
    pub cycles: Cycles,
    /// The convolutions, then the dense layer.
    pub stages: Vec<StageReport>,
}

/// Shape, number format and accuracy of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StageReport {
    /// Rows and columns of a filter.
    pub kernel: [u16; 2],
    /// Rows, columns and filters of the output.
    pub output: [u16; 3],
    /// Bits of an activation.
    pub code_bits: u8,
    /// Value of one unit of an activation.
    pub step: f32,
    /// Largest float activation of the calibration.
    pub largest_activation: f32,
    /// Largest difference between a fixed-point and a float activation.
    pub largest_error: f32,
    /// Mean absolute difference.
    pub mean_error: f64,
    /// Fixed-point activations at their limit.
    pub saturations: usize,
}

/// Compares the two files on `calibration`.
pub(super) fn measured(
    actor: &SeeingActor<'_>,
    (float_policy, fixed_policy): (&[u8], &[u8]),
    format: &EncoderFormat,
    calibration: SeeingCalibration<'_>,
) -> Result<SeeingReport, PolicyError> {
    let (float, fixed) = (VisionPolicy::parse(float_policy)?, VisionPolicy::parse(fixed_policy)?);
    let (largest_action_error, mean_action_error) = action_errors(&float, &fixed, calibration)?;
    let observation_len = float.metadata().observation.len();
    let size = |policy: &VisionPolicy<'_>, file: &[u8]| FileSize {
        weight_bytes: policy.parameter_bytes() + policy.encoder_bytes(),
        file_bytes: file.len(),
    };
    let shape = &actor.shape;
    let image = shape.image();
    let dense_stage = shape.stages().len() - 1;
    Ok(SeeingReport {
        name: float.metadata().name.to_owned(),
        calibration_samples: calibration.observations.len() / observation_len,
        input_fraction_bits: (-format.steps[dense_stage].log2()) as u8,
        largest_action_error,
        mean_action_error,
        multiply_accumulates: fixed.multiply_accumulates(),
        cycles: Cycles::of_network(fixed.multiply_accumulates(), Arithmetic::Fixed16),
        float: size(&float, float_policy),
        fixed: size(&fixed, fixed_policy),
        eye: EyeReport {
            image: [image.rows, image.columns, image.channels],
            multiply_accumulates: shape.multiply_accumulates(),
            float_bytes: float.encoder_bytes(),
            fixed_bytes: fixed.encoder_bytes(),
            memory_values: fixed.memory_len(),
            cycles: Cycles::of_eye(shape, Arithmetic::Fixed16),
            stages: stage_reports(&float, &fixed, format, calibration.images)?,
        },
    })
}

fn action_errors(
    float: &VisionPolicy<'_>,
    fixed: &VisionPolicy<'_>,
    calibration: SeeingCalibration<'_>,
) -> Result<(f32, f64), PolicyError> {
    let mut memory_of_float = Memory::new(float.parameter_format(), float.memory_len());
    let mut memory_of_fixed = Memory::new(fixed.parameter_format(), fixed.memory_len());
    let mut scratch = PolicyScratch::new();
    let (mut largest, mut sum) = (0.0_f32, 0.0);
    let observations = calibration.observations.chunks_exact(float.metadata().observation.len());
    let images = calibration.images.chunks_exact(float.encoder().shape().image().len());
    let count = observations.len() * float.metadata().action.len();
    for (observation, image) in observations.zip(images) {
        let (of_float, of_fixed) = (&mut memory_of_float.borrowed(), &mut memory_of_fixed.borrowed());
        float.encode(image, of_float)?;
        fixed.encode(image, of_fixed)?;
        let wanted = float.act(observation, of_float, &mut scratch)?;
        for (wanted, found) in wanted.into_iter().zip(fixed.act(observation, of_fixed, &mut scratch)?) {
            largest = largest.max((found - wanted).abs());
            sum += f64::from((found - wanted).abs());
        }
    }
    Ok((largest, sum / count as f64))
}

fn stage_reports(
    float: &VisionPolicy<'_>,
    fixed: &VisionPolicy<'_>,
    format: &EncoderFormat,
    images: &[u8],
) -> Result<Vec<StageReport>, PolicyError> {
    let (PolicyEncoder::Float32(float), PolicyEncoder::Fixed16(fixed)) = (float.encoder(), fixed.encoder()) else {
        unreachable!("one policy was written in float, the other in fixed point")
    };
    let stages = float.shape().stages().iter().enumerate();
    let mut reports: Vec<_> = stages.map(|(index, stage)| StageReport::unmeasured(stage, format, index)).collect();
    let images = images.chunks_exact(float.shape().image().len());
    let count = images.len();
    for image in images {
        add_errors(float, fixed, image, &mut reports)?;
    }
    for (report, stage) in reports.iter_mut().zip(float.shape().stages()) {
        report.mean_error /= (count * stage.output.len()) as f64;
    }
    Ok(reports)
}

/// Adds what one image shows; mean errors are sums until the end.
fn add_errors(
    float: &Encoder<'_>,
    fixed: &FixedEncoder<'_>,
    image: &[u8],
    reports: &mut [StageReport],
) -> Result<(), PolicyError> {
    let shape = float.shape();
    let (mut scratch, mut features) = (vec![0.0; shape.scratch_len()], vec![0.0; shape.features()]);
    let mut wanted: Vec<Vec<f32>> = Vec::new();
    float.encode_each(image, &mut scratch, &mut features, |_, activations| wanted.push(activations.to_vec()))?;
    let (mut scratch, mut features) = (vec![0; shape.scratch_len()], vec![0; shape.features()]);
    fixed.encode_each(image, &mut scratch, &mut features, |stage, codes| {
        let report = &mut reports[stage];
        let limit = i16::MAX >> (15 - report.code_bits);
        report.largest_activation = report.largest_activation.max(largest_magnitude(&wanted[stage]));
        for (code, wanted) in codes.iter().zip(&wanted[stage]) {
            let error = (f32::from(*code) * report.step - wanted).abs();
            report.largest_error = report.largest_error.max(error);
            report.mean_error += f64::from(error);
            report.saturations += usize::from(*code == limit);
        }
    })?;
    Ok(())
}

impl StageReport {
    fn unmeasured(stage: &EncoderStage, format: &EncoderFormat, index: usize) -> Self {
        Self {
            kernel: [stage.kernel_rows, stage.kernel_columns],
            output: [stage.output.rows, stage.output.columns, stage.output.channels],
            code_bits: format.code_bits[index],
            step: format.steps[index],
            largest_activation: 0.0,
            largest_error: 0.0,
            mean_error: 0.0,
            saturations: 0,
        }
    }
}

impl fmt::Display for SeeingReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "policy \"{}\": {} multiply-accumulates per step", self.name, self.multiply_accumulates)?;
        writeln!(f, "  {}", self.cycles)?;
        writeln!(f, "  float32: {}", self.float)?;
        writeln!(f, "  fixed16: {}", self.fixed)?;
        writeln!(
            f,
            "  fixed16 against float32 on {} observations: largest action error {:.2e}, mean {:.2e}",
            self.calibration_samples, self.largest_action_error, self.mean_action_error
        )?;
        writeln!(f, "  observations and features Q{}", self.input_fraction_bits)?;
        write!(f, "  {}", self.eye)
    }
}

impl fmt::Display for EyeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [rows, columns, channels] = self.image;
        writeln!(
            f,
            "eye of {rows} x {columns} x {channels}: {} multiply-accumulates per image, {} bytes in fixed16, {} in float32",
            self.multiply_accumulates, self.fixed_bytes, self.float_bytes
        )?;
        writeln!(f, "    memory: {} bytes in fixed16", 2 * self.memory_values)?;
        write!(f, "    {}", self.cycles)?;
        self.stages.iter().try_for_each(|stage| write!(f, "\n    {stage}"))
    }
}

impl fmt::Display for StageReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([height, width], [rows, columns, filters]) = (self.kernel, self.output);
        write!(
            f,
            "{height} x {width} -> {rows} x {columns} x {filters}: {} bits of {:.2e}, error {:.2e} (mean {:.2e}) of {:.3}, {} saturated",
            self.code_bits,
            self.step,
            self.largest_error,
            self.mean_error,
            self.largest_activation,
            self.saturations
        )
    }
}
