//! What a policy file says of itself, and what it would cost a microcontroller.

use core::fmt;

use kestrel_core::airframe::GRAVITY;
use kestrel_core::encoder::{EncoderShape, EncoderStage};
use kestrel_core::policy_file::{
    Arithmetic, PolicyAirframe, PolicyEncoder, PolicyError, PolicyMemory, PolicyMetadata, VisionPolicy,
};

use serde::Serialize;

use crate::cycles::Cycles;
use crate::policy::Policy;

/// A policy file that passed its self-test.
#[derive(Clone, Debug)]
pub struct Inspection<'a>(Policy<'a>);

impl<'a> Inspection<'a> {
    /// Reads `bytes`, which start on a four-byte boundary of memory, and computes the golden vectors again.
    ///
    /// # Errors
    /// A variant per kind of damage, or [`PolicyError::SelfTest`].
    pub fn of(bytes: &'a [u8]) -> Result<Self, PolicyError> {
        let policy = Policy::parse(bytes)?;
        policy.self_test()?;
        Ok(Self(policy))
    }

    /// The same for programs.
    pub fn summary(&self) -> PolicySummary<'_> {
        let (shapes, multiply_accumulates, weight_bytes) = match &self.0 {
            Policy::Blind(policy) => {
                let shapes: Vec<_> = policy.shapes().collect();
                let products = products(&shapes);
                (shapes, products, policy.parameter_bytes())
            }
            Policy::Seeing(policy) => {
                let bytes = policy.parameter_bytes() + policy.encoder_bytes();
                (policy.shapes().collect(), policy.multiply_accumulates(), bytes)
            }
            Policy::Recurrent(policy) => {
                (policy.shapes().collect(), policy.multiply_accumulates(), policy.parameter_bytes())
            }
        };
        let widths = shapes.first().map(|(inputs, _)| *inputs).into_iter();
        let PolicyMetadata { name, observation, action, control_period_secs, seed, training_steps, .. } =
            *self.0.metadata();
        PolicySummary {
            name,
            arithmetic: self.0.arithmetic().name(),
            seed,
            training_steps,
            observation: observation.name(),
            action: action.name(),
            control_period_secs,
            network: widths.chain(shapes.iter().map(|(_, outputs)| *outputs)).collect(),
            multiply_accumulates,
            weight_bytes,
        }
    }
}

/// What a policy file says of itself.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PolicySummary<'a> {
    /// Name of the policy.
    pub name: &'a str,
    /// Of its numbers, such as `fixed16`.
    pub arithmetic: &'static str,
    /// What its training followed from.
    pub seed: u64,
    /// Environment steps of training; 0 where it was trained elsewhere.
    pub training_steps: u64,
    /// Name of the observation's layout.
    pub observation: &'static str,
    /// Name of the action space.
    pub action: &'static str,
    /// \[s\].
    pub control_period_secs: f32,
    /// Widths of the layers behind encoder and memory, the input first.
    pub network: Vec<usize>,
    /// Of those layers and the memory, per step.
    pub multiply_accumulates: usize,
    /// Of all weights, the encoder's too.
    pub weight_bytes: usize,
}

impl fmt::Display for Inspection<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_metadata(f, self.0.metadata(), self.0.arithmetic())?;
        match &self.0 {
            Policy::Blind(policy) => {
                let shapes: Vec<_> = policy.shapes().collect();
                write_network(f, &shapes, policy.parameter_bytes(), policy.arithmetic())
            }
            Policy::Seeing(policy) => {
                let shapes: Vec<_> = policy.shapes().collect();
                let memory = policy.memory();
                let bytes = policy.parameter_bytes() - memory.map_or(0, PolicyMemory::bytes);
                write_network(f, &shapes, bytes, policy.arithmetic())?;
                if let Some(memory) = memory {
                    let cost = (memory.multiply_accumulates(), memory.bytes());
                    write_memory(f, memory.units(), cost, policy.arithmetic())?;
                }
                write_eye(f, policy)
            }
            Policy::Recurrent(policy) => {
                let shapes: Vec<_> = policy.shapes().collect();
                let products = policy.multiply_accumulates() - products(&shapes);
                let network = policy.network().parameter_bytes();
                write_network(f, &shapes, network, policy.arithmetic())?;
                let cost = (products, policy.parameter_bytes() - network);
                write_memory(f, policy.units(), cost, policy.arithmetic())
            }
        }
    }
}

fn write_metadata(
    f: &mut fmt::Formatter<'_>,
    metadata: &PolicyMetadata<'_>,
    arithmetic: Arithmetic,
) -> fmt::Result {
    let PolicyMetadata { name, observation, action, control_period_secs, seed, training_steps, airframe } =
        metadata;
    writeln!(f, "policy \"{name}\" in {}, which passes its self-test", arithmetic.name())?;
    match training_steps {
        0 => writeln!(f, "  trained elsewhere")?,
        _ => writeln!(f, "  trained for {training_steps} steps from seed {seed}")?,
    }
    writeln!(f, "  sees {} ({} values)", observation.name(), observation.len())?;
    writeln!(f, "  commands {} ({} values) every {control_period_secs} s", action.name(), action.len())?;
    match airframe {
        Some(airframe) => write_airframe(f, airframe),
        None => Ok(()),
    }
}

fn write_airframe(f: &mut fmt::Formatter<'_>, airframe: &PolicyAirframe) -> fmt::Result {
    let PolicyAirframe { mass, rotor_thrust_limit, .. } = airframe;
    let weights = 100.0 * airframe.thrust_to_weight(GRAVITY as f32);
    write!(f, "  learned on a drone of {:.1} g whose rotors pull {rotor_thrust_limit:.3} N each", 1000.0 * mass)?;
    writeln!(f, ", {weights:.0} % of its weight together")
}

fn write_network(
    f: &mut fmt::Formatter<'_>,
    shapes: &[(usize, usize)],
    bytes: usize,
    arithmetic: Arithmetic,
) -> fmt::Result {
    write!(f, "  network {}", shapes.first().map_or(0, |(inputs, _)| *inputs))?;
    shapes.iter().try_for_each(|(_, outputs)| write!(f, "-{outputs}"))?;
    let products = products(shapes);
    writeln!(f, ": {products} multiply-accumulates per step, {bytes} bytes of weights")?;
    write!(f, "    {}", Cycles::of_network(products, arithmetic))
}

/// Of so many multiply-accumulates per step and bytes of weights.
fn write_memory(
    f: &mut fmt::Formatter<'_>,
    units: usize,
    (products, bytes): (usize, usize),
    arithmetic: Arithmetic,
) -> fmt::Result {
    writeln!(
        f,
        "\n  memory of {units} units: {products} multiply-accumulates per step, {bytes} bytes of weights"
    )?;
    write!(f, "    {}", Cycles::of_network(products, arithmetic))
}

/// Multiply-accumulates of dense layers, each of so many inputs and outputs.
fn products(shapes: &[(usize, usize)]) -> usize {
    shapes.iter().map(|(inputs, outputs)| inputs * outputs).sum()
}

fn write_eye(f: &mut fmt::Formatter<'_>, policy: &VisionPolicy<'_>) -> fmt::Result {
    let (shape, bytes_per_value) = match policy.encoder() {
        PolicyEncoder::Float32(eye) => (eye.shape(), size_of::<f32>()),
        PolicyEncoder::Fixed16(eye) => (eye.shape(), size_of::<i16>()),
    };
    let image = shape.image();
    let products = shape.multiply_accumulates();
    write!(f, "\n  eye of {} x {} x {} bytes", image.rows, image.columns, image.channels)?;
    writeln!(f, " every {} control periods, {} features", policy.control_periods_per_image(), shape.features())?;
    writeln!(f, "    {products} multiply-accumulates per image, {} bytes of weights", policy.encoder_bytes())?;
    writeln!(f, "    {} bytes of memory", bytes_per_value * policy.memory_len())?;
    write!(f, "    {}", Cycles::of_eye(shape, policy.arithmetic()))?;
    write_stages(f, shape)
}

fn write_stages(f: &mut fmt::Formatter<'_>, shape: &EncoderShape) -> fmt::Result {
    shape.stages().iter().try_for_each(|stage| {
        let EncoderStage { kernel_rows, kernel_columns, stride, output, .. } = stage;
        write!(f, "\n    {kernel_rows} x {kernel_columns} / {stride}")?;
        write!(f, " -> {} x {} x {}", output.rows, output.columns, output.channels)
    })
}

#[cfg(test)]
mod tests {
    use kestrel_core::observation::PILOT_LEN;
    use kestrel_sim::seed::{Purpose, Seed, Stream};

    use super::*;
    use crate::seeing::tests::{exported, remembering};
    use crate::tests::METADATA;
    use crate::{DenseLayer, export};
    use kestrel_learn::network::Mlp;

    #[test]
    fn a_blind_policy_says_what_it_is_and_costs() {
        let network = Mlp::new(PILOT_LEN, &[64, 64], 4);
        let parameters = network.initialise(0.5, &mut Stream::new(Seed(3), 0, Purpose::Weights));
        let layers: Vec<DenseLayer<'_>> = network.layers(&parameters).into_iter().map(DenseLayer::from).collect();
        let file = export(&layers, &METADATA, &[0.5; PILOT_LEN]).unwrap().fixed_policy;
        let text = Inspection::of(&file).unwrap().to_string();
        assert_eq!(
            text,
            "policy \"hover\" in fixed16, which passes its self-test
  trained for 1000000 steps from seed 1
  sees pilot (22 values)
  commands rotor_speeds (4 values) every 0.01 s
  network 22-64-64-4: 5760 multiply-accumulates per step, 12048 bytes of weights
    estimated 13.8 to 17.3 thousand cycles of a Cortex-M4F, 0.08 to 0.10 ms at 168 MHz"
        );
    }

    #[test]
    fn a_policy_with_an_eye_also_says_what_an_image_costs() {
        let file = exported(1.0, 4).unwrap().fixed_policy;
        let text = Inspection::of(&file).unwrap().to_string();
        let (_, network) = text.split_once("  network ").unwrap();
        assert_eq!(
            network,
            "86-64-64-4: 9856 multiply-accumulates per step, 20240 bytes of weights
    estimated 23.7 to 29.6 thousand cycles of a Cortex-M4F, 0.14 to 0.18 ms at 168 MHz
  eye of 24 x 32 x 1 bytes every 4 control periods, 64 features
    135872 multiply-accumulates per image, 28096 bytes of weights
    5664 bytes of memory
    estimated 399.8 to 612.0 thousand cycles of a Cortex-M4F, 2.38 to 3.64 ms at 168 MHz
    5 x 5 / 2 -> 10 x 14 x 16
    3 x 3 / 2 -> 4 x 6 x 16
    4 x 6 / 1 -> 1 x 1 x 64"
        );
    }

    #[test]
    fn an_eye_may_have_a_memory_behind_it() {
        let file = remembering(4).fixed_policy;
        let text = Inspection::of(&file).unwrap().to_string();
        let (_, network) = text.split_once("  network ").unwrap();
        assert_eq!(
            network.lines().take(5).collect::<Vec<_>>().join("\n"),
            "102-32-4: 3392 multiply-accumulates per step, 6928 bytes of weights
    estimated 8.1 to 10.2 thousand cycles of a Cortex-M4F, 0.05 to 0.06 ms at 168 MHz
  memory of 16 units: 4896 multiply-accumulates per step, 9984 bytes of weights
    estimated 11.8 to 14.7 thousand cycles of a Cortex-M4F, 0.07 to 0.09 ms at 168 MHz
  eye of 24 x 32 x 1 bytes every 1 control periods, 64 features"
        );
        assert_eq!(Inspection::of(&file).unwrap().summary().multiply_accumulates, 3392 + 4896);
    }

    #[test]
    fn what_is_damaged_is_said() {
        let mut file = exported(1.0, 4).unwrap().fixed_policy;
        file[100] ^= 1;
        assert!(matches!(Inspection::of(&file).unwrap_err(), PolicyError::Checksum { .. }));
    }
}
