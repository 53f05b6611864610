//! Puts some policies of `assets/pilots` into the image, each in both arithmetics, with a network to measure; and tells
//! the linker where the memory lies.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs};

use kestrel_core::action::{ActionSpace, RotorSpeeds};
use kestrel_core::activation::Activation;
use kestrel_core::airframe::CF2X;
use kestrel_core::encoder::{Convolution, EncoderFormat, EncoderShape, STAGE_LIMIT, Volume};
use kestrel_core::fixed::FixedFormat;
use kestrel_core::mlp::{DenseLayer, WIDTH_LIMIT};
use kestrel_core::observation::{MeasuredLayout, ObservationLayout};
use kestrel_core::policy_file::{
    EncoderDraft, EncoderWorkspace, MemoryDraft, ParameterFormat, PolicyDraft, PolicyError, PolicyFile,
    PolicyMetadata, RecurrentDraft, VisionDraft,
};

/// Policies of one kind each: velocities or rates as actions, each layout of the observation, each airframe of the vehicle.
const PILOTS: [&str; 4] = ["cross", "hover-2-1-plus", "hover-cf2x", "hover"];

/// The network whose instructions are budgeted.
const MEASURED_WIDTHS: [usize; 4] = [16, 64, 64, 4];

/// Units of the memory that is budgeted in front of it.
const MEASURED_UNITS: usize = 32;

/// The grey image of an eye in front of both, and the convolutions of the eye that training calls `small`.
const MEASURED_IMAGE: Volume = Volume { rows: 24, columns: 32, channels: 1 };
const MEASURED_CONVOLUTIONS: [Convolution; 2] =
    [Convolution { filters: 16, kernel: 4, stride: 2 }, Convolution { filters: 32, kernel: 4, stride: 2 }];
const MEASURED_FEATURES: u16 = 64;

/// STM32F405 of the Crazyflie 2.1: 128 KiB of the RAM that code and data may both use (RM0090, section 2.3).
const STM32F405: &str =
    "MEMORY { FLASH : ORIGIN = 0x08000000, LENGTH = 1024K RAM : ORIGIN = 0x20000000, LENGTH = 128K }";

/// MPS2 with the AN386 image of a Cortex-M4 (ARM DAI 0386): SSRAM1 at zero, SSRAM2 and 3.
const AN386: &str =
    "MEMORY { FLASH : ORIGIN = 0x00000000, LENGTH = 4096K RAM : ORIGIN = 0x20000000, LENGTH = 4096K }";

/// QEMU's `virt`: RAM from 2 GiB on, which is flash and RAM here.
const VIRT: &str =
    "MEMORY { FLASH : ORIGIN = 0x80000000, LENGTH = 4096K RAM : ORIGIN = 0x80400000, LENGTH = 4096K }
REGION_ALIAS(\"REGION_TEXT\", FLASH); REGION_ALIAS(\"REGION_RODATA\", FLASH); REGION_ALIAS(\"REGION_DATA\", RAM);
REGION_ALIAS(\"REGION_BSS\", RAM); REGION_ALIAS(\"REGION_HEAP\", RAM); REGION_ALIAS(\"REGION_STACK\", RAM);";

/// A network that owns its weights.
struct Network {
    layers: Vec<(usize, usize, Vec<f32>, Vec<f32>)>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let out = PathBuf::from(env::var("OUT_DIR")?);
    write_policies(&out)?;
    write_memory(&out)
}

fn write_policies(out: &Path) -> Result<(), Box<dyn Error>> {
    let mut source = String::from(
        "/// Policies of `assets/pilots`, in both arithmetics.\npub static PILOTS: &[Artifact] = &[\n",
    );
    for name in PILOTS {
        let path = format!("../../assets/pilots/{name}.kestrel");
        println!("cargo::rerun-if-changed={path}");
        for file in in_both_arithmetics(&fs::read(path)?)? {
            let arithmetic = PolicyFile::parse(&aligned(&file)[..file.len()])?.arithmetic().name();
            write_artifact(&mut source, out, (name, arithmetic), &file)?;
            source.push_str(",\n");
        }
    }
    source.push_str("];\n/// The network whose instructions are budgeted, 16-64-64-4, in both arithmetics.\npub static MEASURED: &[Artifact] = &[\n");
    for (arithmetic, file) in measured_network()? {
        write_artifact(&mut source, out, ("16-64-64-4", arithmetic), &file)?;
        source.push_str(",\n");
    }
    source.push_str("];\n#[cfg(feature = \"encoder\")]\n/// The same behind a memory of 32 units, in both arithmetics.\npub static RECURRENT: &[Artifact] = &[\n");
    for (arithmetic, file) in measured_memory()? {
        write_artifact(&mut source, out, ("16-64-64-4 behind a memory of 32", arithmetic), &file)?;
        source.push_str(",\n");
    }
    source.push_str("];\n#[cfg(feature = \"encoder\")]\n/// The same behind a memory of 32 units and an eye for 24 x 32 grey pixels, in both arithmetics.\npub static SEEING: &[Artifact] = &[\n");
    for (arithmetic, file) in measured_eye()? {
        write_artifact(&mut source, out, ("16-64-64-4 behind an eye and a memory of 32", arithmetic), &file)?;
        source.push_str(",\n");
    }
    source.push_str("];\n/// The one policy of the program `flight`: 16-64-64-4 in fixed point.\npub static FLOWN: Artifact =\n");
    let [(arithmetic, flown), _] = measured_network()?;
    write_artifact(&mut source, out, ("16-64-64-4", arithmetic), &flown)?;
    source.push_str(";\n");
    write_network(&mut source, out, &flown)?;
    fs::write(out.join("policies.rs"), source)?;
    Ok(())
}

fn write_artifact(
    source: &mut String,
    out: &Path,
    (name, arithmetic): (&str, &str),
    file: &[u8],
) -> Result<(), Box<dyn Error>> {
    let file_name = format!("{name}-{arithmetic}.kestrel");
    fs::write(out.join(&file_name), file)?;
    let bytes = format!("include_bytes!(concat!(env!(\"OUT_DIR\"), \"/{file_name}\"))");
    write!(source, "    Artifact {{ name: {name:?}, bytes: &Aligned(*{bytes}).0 }}")?;
    Ok(())
}

/// The network in `file`, without what a policy file has around it.
fn write_network(source: &mut String, out: &Path, file: &[u8]) -> Result<(), Box<dyn Error>> {
    let bytes = aligned(file);
    let policy = PolicyFile::parse(&bytes)?;
    let ParameterFormat::Fixed16(format) = policy.parameter_format() else {
        return Err("not in fixed point".into());
    };
    // The checksum follows the parameters (POLICY_FORMAT.md).
    let end = file.len() - 4;
    fs::write(out.join("parameters.bin"), &file[end - policy.parameter_bytes()..end])?;
    let FixedFormat { input_fraction_bits, weight_fraction_bits, .. } = format;
    let bytes = "include_bytes!(concat!(env!(\"OUT_DIR\"), \"/parameters.bin\"))";
    writeln!(
        source,
        "/// The network of the program `inference`: that of [`FLOWN`].\npub static NETWORK: Embedded = Embedded {{"
    )?;
    writeln!(source, "    widths: {MEASURED_WIDTHS:?},")?;
    writeln!(source, "    input_fraction_bits: {input_fraction_bits},")?;
    writeln!(source, "    weight_fraction_bits: {weight_fraction_bits:?},")?;
    writeln!(source, "    parameters: &Aligned(*{bytes}).0,\n}};")?;
    Ok(())
}

/// `bytes` where a vector starts, which the allocator puts on a boundary of at least eight.
fn aligned(bytes: &[u8]) -> Vec<u8> {
    let mut copy = Vec::with_capacity(bytes.len().next_multiple_of(64).max(64));
    copy.extend_from_slice(bytes);
    copy
}

/// `file` itself, and its network in the other arithmetic; fixed point first.
fn in_both_arithmetics(file: &[u8]) -> Result<[Vec<u8>; 2], PolicyError> {
    let bytes = aligned(file);
    let policy = PolicyFile::parse(&bytes)?;
    let observation_len = policy.metadata().observation.len();
    let observations: Vec<f32> =
        policy.golden_vectors().flat_map(|(observation, _)| observation[..observation_len].to_vec()).collect();
    let network = Network::of(&policy);
    match policy.parameter_format() {
        ParameterFormat::Fixed16(_) => {
            let twin = network.file(policy.metadata(), ParameterFormat::Float32, &observations)?;
            Ok([file.to_vec(), twin])
        }
        ParameterFormat::Float32 => {
            let format = FixedFormat::finest(&network.layers(), largest(&observations))?;
            let twin = network.file(policy.metadata(), ParameterFormat::Fixed16(format), &observations)?;
            Ok([twin, file.to_vec()])
        }
    }
}

/// Weights like those of trained networks (uniform, standard deviation 1/√inputs); their values cost no instructions.
fn measured_network() -> Result<[(&'static str, Vec<u8>); 2], PolicyError> {
    let mut state = 1;
    let network = Network::random(&MEASURED_WIDTHS, &mut state);
    let metadata = measured_metadata();
    let observations: Vec<f32> = (0..8 * MEASURED_WIDTHS[0]).map(|_| uniform(&mut state)).collect();
    let format = FixedFormat::finest(&network.layers(), 2.0)?;
    Ok([
        ("fixed16", network.file(&metadata, ParameterFormat::Fixed16(format), &observations)?),
        ("float32", network.file(&metadata, ParameterFormat::Float32, &observations)?),
    ])
}

/// Network, gates and candidate that read so many values and the hidden state.
fn remembering(observed: usize, state: &mut u64) -> [Network; 3] {
    let [_, first, second, outputs] = MEASURED_WIDTHS;
    let inputs = observed + MEASURED_UNITS;
    [&[inputs, first, second, outputs][..], &[inputs, 2 * MEASURED_UNITS], &[inputs, MEASURED_UNITS]]
        .map(|widths| Network::random(widths, state))
}

/// As [`measured_network`], with a memory.
fn measured_memory() -> Result<[(&'static str, Vec<u8>); 2], PolicyError> {
    let mut state = 2;
    let observed = MEASURED_WIDTHS[0];
    let [network, gates, candidate] = remembering(observed, &mut state);
    let observations: Vec<f32> = (0..8 * observed).map(|_| uniform(&mut state)).collect();
    let (layers, format) = (network.layers(), FixedFormat::finest(&network.layers(), 2.0)?);
    let memory =
        MemoryDraft { gates: gates.layers()[0], candidate: candidate.layers()[0], weight_fraction_bits: [0; 2] };
    let memory = MemoryDraft { weight_fraction_bits: memory.finest_bits(format)?, ..memory };
    let file = |parameters| -> Result<Vec<u8>, PolicyError> {
        let (metadata, golden_observations) = (measured_metadata(), &observations[..]);
        let policy = PolicyDraft { metadata, parameters, layers: &layers, golden_observations };
        let draft = RecurrentDraft { policy, memory };
        let mut bytes = vec![0; draft.file_len()?];
        draft.write(&mut bytes)?;
        Ok(bytes)
    };
    Ok([("fixed16", file(ParameterFormat::Fixed16(format))?), ("float32", file(ParameterFormat::Float32)?)])
}

/// As [`measured_memory`], with an eye.
fn measured_eye() -> Result<[(&'static str, Vec<u8>); 2], PolicyError> {
    let (mut state, vectors) = (3, 2);
    let shape = EncoderShape::new(MEASURED_IMAGE, &MEASURED_CONVOLUTIONS, MEASURED_FEATURES)?;
    let mut parameters = Vec::new();
    for stage in shape.stages() {
        let limit = (3.0 / stage.terms() as f32).sqrt();
        parameters.extend((0..stage.terms() * stage.filters()).map(|_| limit * uniform(&mut state)));
        parameters.extend((0..stage.filters()).map(|_| 0.1 * uniform(&mut state)));
    }
    let [network, gates, candidate] = remembering(MEASURED_WIDTHS[0] + shape.features(), &mut state);
    let observations: Vec<f32> = (0..vectors * MEASURED_WIDTHS[0]).map(|_| uniform(&mut state)).collect();
    let images: Vec<u8> =
        (0..vectors * shape.image().len()).map(|_| (127.5 * (uniform(&mut state) + 1.0)) as u8).collect();
    let (layers, format) = (network.layers(), FixedFormat::finest(&network.layers(), 8.0)?);
    let eye_format =
        EncoderFormat::calibrated(&shape, &parameters, &[4.0; STAGE_LIMIT], format.input_fraction_bits)?;
    let memory =
        MemoryDraft { gates: gates.layers()[0], candidate: candidate.layers()[0], weight_fraction_bits: [0; 2] };
    let memory = MemoryDraft { weight_fraction_bits: memory.finest_bits(format)?, ..memory };
    let file = |parameter_format: ParameterFormat| -> Result<Vec<u8>, PolicyError> {
        let draft = VisionDraft {
            policy: PolicyDraft {
                metadata: measured_metadata(),
                parameters: parameter_format,
                layers: &layers,
                golden_observations: &observations,
            },
            encoder: EncoderDraft {
                shape,
                parameters: &parameters,
                format: eye_format,
                control_periods_per_image: 2,
                golden_images: &images,
            },
            memory: Some(memory),
        };
        let (mut bytes, len) = (vec![0; draft.file_len()?], draft.memory_len());
        match parameter_format {
            ParameterFormat::Float32 => {
                draft.write(&mut bytes, &mut EncoderWorkspace::Float32(&mut vec![0.0; len]))?
            }
            ParameterFormat::Fixed16(_) => {
                draft.write(&mut bytes, &mut EncoderWorkspace::Fixed16(&mut vec![0; len]))?
            }
        };
        Ok(bytes)
    };
    Ok([("fixed16", file(ParameterFormat::Fixed16(format))?), ("float32", file(ParameterFormat::Float32)?)])
}

fn measured_metadata() -> PolicyMetadata<'static> {
    PolicyMetadata {
        name: "measured",
        observation: ObservationLayout::Measured(MeasuredLayout { len: MEASURED_WIDTHS[0] as u8 }),
        action: ActionSpace::RotorSpeeds(RotorSpeeds::new(&CF2X, 0.3)),
        control_period_secs: 0.001,
        seed: 1,
        training_steps: 0,
        airframe: None,
    }
}

/// In [-1, 1), by Knuth's 64-bit linear congruential generator (MMIX).
fn uniform(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 40) as f32 / (1 << 23) as f32 - 1.0
}

fn largest(values: &[f32]) -> f32 {
    values.iter().fold(0.0, |largest, value| value.abs().max(largest))
}

impl Network {
    fn random(widths: &[usize], state: &mut u64) -> Self {
        let mut layers = Vec::new();
        for pair in widths.windows(2) {
            let (inputs, outputs) = (pair[0], pair[1]);
            let limit = (3.0 / inputs as f32).sqrt();
            let weights = (0..inputs * outputs).map(|_| limit * uniform(state)).collect();
            layers.push((inputs, outputs, weights, (0..outputs).map(|_| 0.1 * uniform(state)).collect()));
        }
        Self { layers }
    }

    fn of(policy: &PolicyFile<'_>) -> Self {
        let layer = |(index, (inputs, outputs)): (usize, (usize, usize))| {
            let weights = (0..outputs)
                .flat_map(|row| (0..inputs).map(move |column| (row, column)))
                .map(|(row, column)| policy.weight(index, row, column));
            (inputs, outputs, weights.collect(), (0..outputs).map(|row| policy.bias(index, row)).collect())
        };
        Self { layers: policy.shapes().enumerate().map(layer).collect() }
    }

    fn layers(&self) -> Vec<DenseLayer<'_>> {
        let layers = self.layers.iter();
        layers
            .map(|(inputs, outputs, weights, bias)| DenseLayer {
                inputs: *inputs,
                outputs: *outputs,
                weights,
                bias,
                activation: Activation::Tanh,
            })
            .collect()
    }

    fn file(
        &self,
        metadata: &PolicyMetadata<'_>,
        parameters: ParameterFormat,
        golden_observations: &[f32],
    ) -> Result<Vec<u8>, PolicyError> {
        assert!(metadata.observation.len() <= WIDTH_LIMIT);
        let draft = PolicyDraft { metadata: *metadata, parameters, layers: &self.layers(), golden_observations };
        let mut bytes = vec![0; draft.file_len()?];
        draft.write(&mut bytes)?;
        Ok(bytes)
    }
}

fn write_memory(out: &Path) -> Result<(), Box<dyn Error>> {
    let (architecture, system) = (env::var("CARGO_CFG_TARGET_ARCH")?, env::var("CARGO_CFG_TARGET_OS")?);
    let (memory, scripts): (&str, &[&str]) = match (architecture.as_str(), system.as_str()) {
        ("arm", "none") if env::var("CARGO_FEATURE_AN386").is_ok() => (AN386, &["-Tlink.x"]),
        ("arm", "none") => (STM32F405, &["-Tlink.x"]),
        ("riscv32", "none") => (VIRT, &["-Tmemory.x", "-Tlink.x"]),
        ("wasm32", _) => ("", &["--no-entry", "--export=run"]),
        _ => return Ok(()),
    };
    fs::write(out.join("memory.x"), memory)?;
    println!("cargo::rustc-link-search={}", out.display());
    for script in scripts {
        println!("cargo::rustc-link-arg-bins={script}");
    }
    Ok(())
}
