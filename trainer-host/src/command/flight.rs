//! The flight that is looked at: recorded, of a run, or flown for it.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use kestrel_draw::video::RecordedScene;
use kestrel_experiments::evaluation::Flyer;
use kestrel_experiments::experiment_config::Experiment;
use kestrel_experiments::recording::Recording;
use kestrel_experiments::results::{record_pilot, record_policy, record_run, record_start};
use kestrel_experiments::run_config::RunConfig;

use super::run;
use crate::shipped;

/// What flies, and where.
#[derive(Debug, clap::Args)]
pub(crate) struct FlightArguments {
    /// Experiment file, directory of a run, recording (from `--record`), or the name of a shipped pilot or task
    #[arg(value_name = "EXPERIMENT|RUN|RECORDING|NAME")]
    subject: PathBuf,

    /// Which task, where there are several [default: the first]
    #[arg(long, value_name = "NAME")]
    task: Option<String>,

    /// Policy file, or name of a shipped pilot, that flies the experiment
    #[arg(long, value_name = "FILE", conflicts_with = "pilot")]
    policy: Option<PathBuf>,

    /// Who flies the experiment without a policy [default: scripted]
    #[arg(long, value_enum)]
    pilot: Option<Pilot>,

    /// What the start follows from [default: the experiment's]
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    seed: Option<u64>,

    /// Change a value of the configuration, such as `scenario.episode_secs=5`
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
}

/// Who flies without a policy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Pilot {
    /// Does nothing
    Nothing,
    /// Acts at random
    Random,
    /// Flies to the goal by hand-written rules
    Scripted,
}

impl Pilot {
    pub(crate) fn flyer(self) -> Flyer<'static> {
        match self {
            Self::Nothing => Flyer::Nothing,
            Self::Random => Flyer::Random,
            Self::Scripted => Flyer::Scripted,
        }
    }
}

/// A flight and where it comes from.
pub(crate) struct Flown {
    pub(crate) recording: Recording,
    pub(crate) experiment: Experiment,
    pub(crate) path: PathBuf,
}

impl Flown {
    /// The flight in its aviary, to be looked at with one of its drones.
    pub(crate) fn scene(&self, drone: usize) -> Result<RecordedScene> {
        let scene = self.staged()?;
        let drones = scene.drones();
        let path = self.path.display();
        ensure!(drone < drones, "found --drone {drone}, expected a number below {drones}, the drones of {path}");
        Ok(scene)
    }
}

impl Flown {
    fn staged(&self) -> Result<RecordedScene> {
        let flight = self.recording.flight(&self.experiment, &self.path)?;
        Ok(RecordedScene::new(flight, &self.experiment.scenario, &self.path.display().to_string())?)
    }
}

impl FlightArguments {
    /// The recorded flight, or that of the run or the pilot from the first start of the evaluation. Of an experiment, when
    /// only the start is looked at, nothing is flown.
    pub(crate) fn fly(&self, start_alone: bool) -> Result<Flown> {
        let path = self.path()?;
        let seed = self.seed.map(|seed| format!("evaluation.seed={seed}"));
        let overrides: Vec<String> = self.overrides.iter().cloned().chain(seed).collect();
        if path.is_dir() {
            self.refuse_pilots("the directory of a run")?;
            let (directory, config) = run::open(&path, &overrides)?;
            directory.exported_policy()?;
            let experiment = config.task(self.task.as_deref())?.clone();
            return Ok(Flown { recording: record_run(&experiment, &directory)?, experiment, path });
        }
        if !is_yaml(&path) {
            self.refuse_pilots("no experiment file")?;
            ensure!(self.task.is_none(), "{}: found --task beside a recording, which is of one", path.display());
            if let Some(overridden) = overrides.first() {
                bail!(
                    "{}: found `{overridden}` for a recording, expected it for a run or an experiment",
                    path.display()
                );
            }
            let recording = Recording::read(&path)?;
            return Ok(Flown { experiment: recording.experiment(&path)?, recording, path });
        }
        let experiment = RunConfig::load(&path, &overrides)?.task(self.task.as_deref())?.clone();
        let recording = match (&self.policy, self.pilot) {
            (Some(policy), _) => record_policy(&experiment, &shipped::policy(policy)?)?,
            (None, None) if start_alone => record_start(&experiment),
            (None, pilot) => record_pilot(&experiment, pilot.unwrap_or(Pilot::Scripted).flyer()),
        };
        Ok(Flown { recording, experiment, path })
    }

    /// The file or directory that is meant. A name is a pilot's, and a task's where somebody else flies or there is no pilot.
    fn path(&self) -> Result<PathBuf> {
        let name = shipped::as_name(&self.subject).filter(|name| shipped::pilot(name).is_some());
        if name.is_some() && self.policy.is_none() && self.pilot.is_none() {
            return shipped::run(&self.subject);
        }
        shipped::task(&self.subject)
    }

    fn refuse_pilots(&self, found: &str) -> Result<()> {
        if self.policy.is_some() || self.pilot.is_some() {
            bail!(
                "{}: found {found} for --policy and --pilot, expected an experiment (.yaml)",
                self.subject.display()
            );
        }
        Ok(())
    }
}

pub(crate) fn is_yaml(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "yaml" || ending == "yml")
}
