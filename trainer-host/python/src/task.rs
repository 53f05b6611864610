//! A checked configuration.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use kestrel_experiments::drone_environment::DroneEnvironment;
use kestrel_experiments::experiment_config::{self, Experiment};
use kestrel_learn::environment::{Environment, TaskShape};
use kestrel_sim::config::Library;
use pyo3::prelude::*;

use crate::error::refused;

/// Where the shipped files are, for imports such as `kestrel:configs/hover.yaml`.
static SHIPPED: OnceLock<PathBuf> = OnceLock::new();

/// Lets configurations import the files in `folder` as those of the library `kestrel`.
#[pyfunction]
pub(crate) fn use_library(folder: PathBuf) {
    SHIPPED.get_or_init(|| folder);
    let folder = || SHIPPED.get().cloned().ok_or_else(|| "no shipped files".to_owned());
    Library { name: "kestrel", folder }.install();
}

/// An experiment, checked: the task, how to train on it and how to judge the result.
#[pyclass(frozen, module = "kestrel_drones._native")]
pub(crate) struct Task {
    pub(crate) experiment: Arc<Experiment>,
}

impl Task {
    pub(crate) fn shape(&self) -> TaskShape {
        DroneEnvironment::shape(&self.experiment.scenario)
    }

    /// Rows, columns and channels.
    pub(crate) fn image_shape(&self) -> Option<[usize; 3]> {
        self.shape().image.map(|image| [image.rows, image.columns, image.channels].map(usize::from))
    }
}

#[pymethods]
impl Task {
    /// The experiment in the YAML file at the path `name`, or in `text` that messages call `name`, after `overrides` such
    /// as `training.epochs=3`.
    #[new]
    #[pyo3(signature = (name, text, overrides))]
    fn new(name: &str, text: Option<&str>, overrides: Vec<String>) -> PyResult<Self> {
        let experiment = match text {
            Some(text) => experiment_config::parse(name, text, &overrides),
            None => experiment_config::load(name.as_ref(), &overrides),
        };
        Ok(Self { experiment: Arc::new(experiment.map_err(refused)?) })
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.experiment.name
    }

    /// Drones of a team; 1 alone.
    #[getter]
    fn agents(&self) -> usize {
        self.shape().agents
    }

    /// Values of an observation.
    #[getter]
    fn observation_len(&self) -> usize {
        self.shape().observation_len
    }

    /// Values of an action.
    #[getter]
    fn action_len(&self) -> usize {
        self.shape().action_len
    }

    /// Rows, columns and channels of the image beside the observation, if there is one.
    #[getter]
    fn image(&self) -> Option<[usize; 3]> {
        self.image_shape()
    }

    /// Names of the reward's terms, in the order of the configuration; the second `proximity` is `proximity_2`.
    #[getter]
    fn reward_terms(&self) -> Vec<String> {
        self.experiment.reward_names()
    }

    /// Steps per second of flight [Hz].
    #[getter]
    fn control_rate_hz(&self) -> f64 {
        self.experiment.scenario.physics.control_rate_hz
    }

    /// The configuration as YAML with every import resolved, overrides applied and every default filled in.
    #[getter]
    fn yaml(&self) -> &str {
        &self.experiment.resolved_yaml
    }
}
