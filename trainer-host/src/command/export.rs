//! `kestrel export`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use kestrel_core::airframe::CF2X;
use kestrel_core::policy_file::{Arithmetic, PolicyAirframe};
use kestrel_experiments::atomic_file::write_atomically;
use kestrel_experiments::experiment_config::Experiment;
use kestrel_experiments::output::say;
use kestrel_experiments::results;
use kestrel_experiments::run_config::{RunConfig, policy_of};
use kestrel_experiments::run_directory::RunDirectory;
use kestrel_export::cost::{Built, Cost, Form};
use kestrel_export::policy::Policy;
use kestrel_shim::bridge::motors::MotorOrder;
use kestrel_shim::policy_bytes::PolicyBytes;

use super::{Done, run};
use crate::shipped;

/// Arguments of `kestrel export`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Directory of a run, a policy file, or the name of a pilot that comes with the program
    #[arg(value_name = "RUN|POLICY|PILOT")]
    source: PathBuf,
    /// What to write besides the policy files
    #[arg(long, value_enum, default_value_t = Target::File)]
    target: Target,
    /// Folder to write to [default: the run's; for a policy a folder of its name, here]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Forms of a policy.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Target {
    /// Policy files only, in fixed point and in float
    File,
    /// A Rust module for firmwares that link kestrel-core: policy.rs
    Rust,
    /// C99 without a library, in fixed point: policy.h and policy.c, with the guard of all policies in C
    C,
    /// An app for crazyflie-firmware with the policy in fixed point: the folder crazyflie
    Crazyflie,
    /// The neural interface of Betaflight's forks with the policy in fixed point: the folder betaflight
    Betaflight,
    /// For PX4's neural control module, in float: the folder px4
    Px4,
    /// A model for ONNX runtimes, in float: policy.onnx
    Onnx,
    /// Weights by name for PyTorch and others, in float: policy.safetensors
    Safetensors,
}

impl Target {
    /// Which of a run's two policies it is made of.
    const fn arithmetic(self) -> Option<Arithmetic> {
        match self {
            Self::File => None,
            Self::Rust | Self::C | Self::Crazyflie | Self::Betaflight => Some(Arithmetic::Fixed16),
            Self::Px4 | Self::Onnx | Self::Safetensors => Some(Arithmetic::Float32),
        }
    }

    /// What a microcontroller is given.
    const fn form(self) -> Option<Form> {
        match self {
            Self::File | Self::Onnx | Self::Safetensors => None,
            Self::Rust => Some(Form::Rust),
            Self::C => Some(Form::C),
            Self::Crazyflie => Some(Form::Crazyflie),
            Self::Betaflight => Some(Form::Betaflight),
            Self::Px4 => Some(Form::Px4),
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let (directory, config) = directory_of(arguments)?;
    for path in [directory.policy(), directory.policy_f32()] {
        if path.exists() {
            say(path.display())?;
        }
    }
    let subject = config.as_ref().map(RunConfig::subject);
    let tasks = subject.as_ref().map_or(&[][..], |subject| subject.tasks);
    let failure = || format!("cannot export {}", directory.policy().display());
    let cost = match arguments.target.form() {
        Some(form) => Some(expected_cost(&directory, form, tasks).with_context(failure)?),
        None => None,
    };
    let written = written(arguments.target, &directory, tasks).with_context(failure)?;
    for path in &written {
        say(path.display())?;
    }
    if let Some(cost) = cost {
        compare(&cost, &written)?;
    }
    Ok(Done::Finished)
}

/// Writes what the target needs; the paths.
fn written(target: Target, directory: &RunDirectory, tasks: &[Experiment]) -> Result<Vec<PathBuf>> {
    Ok(match target {
        Target::File => Vec::new(),
        Target::Rust => vec![results::export_rust(directory)?],
        Target::C => results::export_c(directory)?.into(),
        Target::Crazyflie => vec![results::export_crazyflie(directory, tasks)?],
        Target::Betaflight => vec![results::export_betaflight(directory)?],
        Target::Px4 => vec![results::export_px4(directory, px4_motors(directory, tasks)?)?],
        Target::Onnx => vec![results::export_onnx(directory)?],
        Target::Safetensors => vec![results::export_safetensors(directory)?],
    })
}

/// Where the policies lie, made anew of a run's checkpoints if it has some, and the configuration of the run.
fn directory_of(arguments: &Arguments) -> Result<(RunDirectory, Option<RunConfig>)> {
    let (source, output) = (&arguments.source, arguments.output.as_deref());
    let shipped = shipped::as_name(source).and_then(shipped::pilot);
    if shipped.is_none() && source.is_dir() {
        let (directory, config) = run::open(source, &[])?;
        if directory.holds_checkpoints() {
            let (actor, steps) = policy_of(&config, &directory)?;
            say(format_args!("{}\n", results::export_policy(&config.subject(), &directory, &actor, steps)?))?;
        } else {
            // Of a job of a study there is the exported policy alone.
            directory.exported_policy()?;
        }
        let Some(output) = output else { return Ok((directory, Some(config))) };
        let copies = RunDirectory::of_policies(output)?;
        for (from, to) in [(directory.policy(), copies.policy()), (directory.policy_f32(), copies.policy_f32())] {
            if from.exists() {
                write_atomically(
                    &to,
                    &fs::read(&from).with_context(|| format!("cannot read {}", from.display()))?,
                )?;
            }
        }
        return Ok((copies, Some(config)));
    }
    let (bytes, stem) = policy_file(source, shipped)?;
    let policy = Policy::parse(bytes.bytes()).with_context(|| format!("cannot export {}", source.display()))?;
    let found = policy.arithmetic();
    if let Some(expected) = arguments.target.arithmetic() {
        ensure!(
            found == expected,
            "{} is in {}, expected a policy in {} for this target: export the run that it is from",
            source.display(),
            found.name(),
            expected.name()
        );
    }
    let copies = RunDirectory::of_policies(output.unwrap_or(Path::new(&stem)))?;
    let path = match found {
        Arithmetic::Fixed16 => copies.policy(),
        Arithmetic::Float32 => copies.policy_f32(),
    };
    write_atomically(&path, bytes.bytes())?;
    let config = match shipped {
        // The tasks of a pilot that comes with the program are known.
        Some(_) => Some(run::open(&shipped::run(source)?, &[])?.1),
        None => None,
    };
    Ok((copies, config))
}

/// A policy of the program's own or by its file, and what a folder for it is called.
fn policy_file(source: &Path, shipped: Option<&[u8]>) -> Result<(PolicyBytes, String)> {
    match shipped {
        Some(file) => Ok((PolicyBytes::copy_of(file), source.display().to_string())),
        None if source.exists() || source.extension().is_some() => {
            let stem = source.file_stem().unwrap_or(source.as_os_str()).to_string_lossy().into_owned();
            Ok((PolicyBytes::read(source)?, stem))
        }
        None => bail!(
            "found neither a run nor a policy file at {}, expected one of them or a pilot that comes with the program: {}",
            source.display(),
            shipped::pilots_like(&source.to_string_lossy())
        ),
    }
}

/// Says what a microcontroller will spend on it.
fn expected_cost(directory: &RunDirectory, form: Form, tasks: &[Experiment]) -> Result<Cost> {
    let path = match form {
        Form::Px4 => directory.policy_f32(),
        Form::Rust | Form::C | Form::Crazyflie | Form::Betaflight => directory.policy(),
    };
    let bytes = PolicyBytes::read(&path)?;
    let policy = Policy::parse(bytes.bytes()).with_context(|| format!("cannot export {}", path.display()))?;
    let maps = if form == Form::Crazyflie { results::crazyflie_maps(directory, tasks)? } else { 0 };
    let cost = Cost::of(&policy, form, bytes.bytes().len()).with_maps(maps);
    say(format_args!("It will take {cost}."))?;
    Ok(cost)
}

/// Compares what was written with what it was to cost, if this machine has a compiler for the microcontroller.
fn compare(cost: &Cost, written: &[PathBuf]) -> Result<()> {
    let built = Built::of(written).context("cannot compile what was written for a Cortex-M4")?;
    let Some(built) = built else { return Ok(()) };
    say(format_args!("{built}"))?;
    ensure!(built.within(cost), "it takes more than was said: please report this");
    Ok(())
}

/// Rotors of the policy's drone that PX4's motors turn; of a policy that does not say, the task's, or those of the airframes
/// that come with the program.
fn px4_motors(directory: &RunDirectory, tasks: &[Experiment]) -> Result<[usize; 4]> {
    let path = directory.policy_f32();
    let bytes = PolicyBytes::read(&path)?;
    let policy = Policy::parse(bytes.bytes()).with_context(|| format!("cannot export {}", path.display()))?;
    let of_task = || tasks.first().map_or(CF2X, |task| task.scenario.airframe);
    let airframe = policy.metadata().airframe.unwrap_or_else(|| PolicyAirframe::from(&of_task()));
    Ok(MotorOrder::QuadX.rotors(&airframe)?)
}
