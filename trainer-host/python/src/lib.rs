//! The native half of the Python package `kestrel-drones`: converts and calls, and knows no task, physics or file format
//! of its own.
//!
//! A [`task`] is a checked configuration; [`environments`] step it; a [`policy`] acts in it, a [`controller`] is what stands
//! around it; a [`run`] trains one, a [`network`] becomes one. What users of gymnasium and `PettingZoo` see is Python, in the
//! folder `kestrel_drones`.

#![expect(clippy::needless_pass_by_value, reason = "PyO3 hands arguments over by value")]

mod controller;
mod environments;
mod error;
mod network;
mod policy;
mod render;
mod run;
mod task;

use pyo3::prelude::*;

/// The module `kestrel_drones._native`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("KestrelError", module.py().get_type::<error::KestrelError>())?;
    module.add_class::<task::Task>()?;
    module.add_class::<environments::Environments>()?;
    module.add_class::<policy::Policy>()?;
    module.add_class::<policy::Memory>()?;
    module.add_class::<controller::Controller>()?;
    module.add_class::<network::StateDict>()?;
    module.add_function(wrap_pyfunction!(network::import_policy, module)?)?;
    module.add_function(wrap_pyfunction!(task::use_library, module)?)?;
    module.add_function(wrap_pyfunction!(run::train, module)?)?;
    module.add_function(wrap_pyfunction!(run::learning_curve, module)?)?;
    module.add_function(wrap_pyfunction!(run::resume, module)?)?;
    module.add_function(wrap_pyfunction!(run::evaluate, module)?)?;
    module.add_function(wrap_pyfunction!(run::export, module)?)
}
