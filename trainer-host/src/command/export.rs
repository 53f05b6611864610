//! `kestrel export`.

use std::path::PathBuf;

use anyhow::Result;
use kestrel_experiments::output::say;
use kestrel_experiments::results;
use kestrel_experiments::run_config::policy_of;

use super::{Done, run};

/// Arguments of `kestrel export`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Directory of the run
    run: PathBuf,
    /// What to write besides the policy files
    #[arg(long, value_enum, default_value_t = Target::File)]
    target: Target,
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
    /// A model for ONNX runtimes, in float: policy.onnx
    Onnx,
    /// Weights by name for PyTorch and others, in float: policy.safetensors
    Safetensors,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let (directory, config) = run::open(&arguments.run, &[])?;
    if directory.holds_checkpoints() {
        let (actor, steps) = policy_of(&config, &directory)?;
        say(format_args!("{}\n", results::export_policy(&config.subject(), &directory, &actor, steps)?))?;
    } else {
        // Of a job of a study there is the exported policy alone.
        directory.require_policies()?;
    }
    say(directory.policy().display())?;
    say(directory.policy_f32().display())?;
    let written = match arguments.target {
        Target::File => Vec::new(),
        Target::Rust => vec![results::export_rust(&directory)?],
        Target::C => results::export_c(&directory)?.into(),
        Target::Crazyflie => vec![results::export_crazyflie(&directory)?],
        Target::Betaflight => vec![results::export_betaflight(&directory)?],
        Target::Onnx => vec![results::export_onnx(&directory)?],
        Target::Safetensors => vec![results::export_safetensors(&directory)?],
    };
    for path in written {
        say(path.display())?;
    }
    Ok(Done::Finished)
}
