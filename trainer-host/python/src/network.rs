//! Networks that other programs trained, as policies.

use std::path::PathBuf;

use kestrel_core::policy_file::Activation;
use kestrel_experiments::foreign_actor::{AssumedActivations, NetworkSource, foreign_actor};
use kestrel_experiments::results;
use kestrel_experiments::run_config::Subject;
use kestrel_experiments::run_directory::RunDirectory;
use kestrel_export::exchange::import::{OutputActivation, StateDict as Tensors};
use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;

use crate::error::{expected, refused};
use crate::policy::Policy;
use crate::run::work;
use crate::task::Task;

/// Tensors by name.
#[pyclass(module = "kestrel_drones._native")]
pub(crate) struct StateDict {
    tensors: Tensors,
}

#[pymethods]
impl StateDict {
    #[new]
    fn new() -> Self {
        Self { tensors: Tensors::default() }
    }

    /// Adds an array.
    fn insert(&mut self, name: String, array: PyReadonlyArrayDyn<'_, f32>) {
        let array = array.as_array();
        self.tensors.insert(name, array.shape(), array.iter().copied().collect());
    }

    /// Adds an array of another kind of number.
    fn insert_other(&mut self, name: String, kind: &str) {
        self.tensors.insert_other(name, kind);
    }
}

/// Where a network is: a path, or its tensors.
#[derive(FromPyObject)]
pub(crate) enum Network {
    Tensors(Py<StateDict>),
    File(PathBuf),
}

/// The policy of a `network` for a task, in fixed point. `assumed` are the activations between the layers and behind the last
/// one, where names of weights do not tell. With `out`, that directory holds what `kestrel import` writes.
#[pyfunction]
pub(crate) fn import_policy(
    py: Python<'_>,
    network: Network,
    task: &Task,
    assumed: (Option<String>, Option<String>),
    out: Option<PathBuf>,
) -> PyResult<Policy> {
    let experiment = &*task.experiment;
    let source = match network {
        Network::Tensors(state_dict) => NetworkSource::Tensors(state_dict.borrow(py).tensors.clone()),
        Network::File(path) => NetworkSource::File(path),
    };
    let subject = Subject::of(experiment);
    let (actor, _) = foreign_actor(source, &subject, activations(assumed)?).map_err(refused)?;
    let directory = match out {
        Some(path) => Some(RunDirectory::create_untrained(&path, &experiment.resolved_yaml).map_err(refused)?),
        None => None,
    };
    let bytes = work(py, None, None, |_| {
        let Some(directory) = directory else { return Ok(results::exported(&subject, &actor, 0)?.fixed_policy) };
        results::export_policy(&subject, &directory, &actor, 0)?;
        results::evaluate_run(&subject, &directory)?;
        results::draw_flights(&subject, &directory)?;
        Ok(results::checked_policy(experiment, &directory)?)
    })?;
    Ok(Policy::of(bytes))
}

fn activations((hidden, output): (Option<String>, Option<String>)) -> PyResult<AssumedActivations> {
    let hidden = match hidden.as_deref() {
        None => None,
        Some("tanh") => Some(Activation::Tanh),
        Some("relu") => Some(Activation::Relu),
        Some(other) => return Err(expected("activation", other, "tanh or relu")),
    };
    let output = match output.as_deref() {
        None => None,
        Some("none") => Some(OutputActivation::Identity),
        Some("tanh") => Some(OutputActivation::Tanh),
        Some(other) => return Err(expected("output_activation", other, "none or tanh")),
    };
    Ok(AssumedActivations { hidden, output })
}
