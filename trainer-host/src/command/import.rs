//! `kestrel import`.

use std::path::{Path, PathBuf};

use anyhow::Result;
use kestrel_core::policy_file::Activation;
use kestrel_experiments::foreign_actor::{AssumedActivations, NetworkSource, foreign_actor};
use kestrel_experiments::output::say;
use kestrel_experiments::results;
use kestrel_experiments::run_config::Subject;
use kestrel_experiments::run_directory::RunDirectory;
use kestrel_export::exchange::import::OutputActivation;

use super::{Done, run::task_config, table};

/// Arguments of `kestrel import`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// A multilayer perceptron as ONNX, or its weights as safetensors: of Stable-Baselines3, CleanRL, JAX, …
    network: PathBuf,

    /// Experiment file of the task that it was trained for, or the directory of a run of it
    #[arg(long, value_name = "FILE")]
    task: PathBuf,

    /// Replace a value of the experiment file, such as evaluation.episodes=64 (repeatable)
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,

    /// Directory to write to, new or empty [default: one with the network's name, here]
    #[arg(short, long, value_name = "DIRECTORY")]
    output: Option<PathBuf>,

    /// What stands between the layers, where names of weights do not tell
    #[arg(long, value_enum)]
    activation: Option<Hidden>,

    /// What stands behind the last layer, where names of weights do not tell
    #[arg(long, value_enum)]
    output_activation: Option<Output>,
}

/// Activations between layers.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Hidden {
    /// Hyperbolic tangent
    Tanh,
    /// Rectifier
    Relu,
}

/// Activations behind the last layer.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Output {
    /// None: actions are the sums, limited to [-1, 1]
    None,
    /// Hyperbolic tangent
    Tanh,
}

impl Arguments {
    fn assumed(&self) -> AssumedActivations {
        AssumedActivations {
            hidden: self.activation.map(|hidden| match hidden {
                Hidden::Tanh => Activation::Tanh,
                Hidden::Relu => Activation::Relu,
            }),
            output: self.output_activation.map(|output| match output {
                Output::None => OutputActivation::Identity,
                Output::Tanh => OutputActivation::Tanh,
            }),
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<Done> {
    let config = task_config(&arguments.task, &arguments.set)?;
    let stem = arguments.network.file_stem().unwrap_or(arguments.network.as_os_str()).to_string_lossy();
    let subject = Subject { name: &stem, ..config.subject() };
    let source = NetworkSource::File(arguments.network.clone());
    let (actor, network) = foreign_actor(source, &subject, arguments.assumed())?;
    say(format_args!("{network}\n"))?;
    let directory = arguments.output.as_deref().unwrap_or(Path::new(&*stem));
    let directory = RunDirectory::create_untrained(directory, config.resolved_yaml())?;
    say(format_args!("{}\n", results::export_policy(&subject, &directory, &actor, 0)?))?;
    say(format_args!("{}\n", table::evaluations(&results::evaluate_run(&subject, &directory)?)))?;
    for path in results::draw_flights(&subject, &directory)?.into_iter().chain([directory.policy()]) {
        say(path.display())?;
    }
    Ok(Done::Finished)
}
