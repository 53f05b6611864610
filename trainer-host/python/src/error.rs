//! Our errors as a Python exception.

use std::error::Error;

use pyo3::PyErr;
use pyo3::exceptions::PyValueError;

pyo3::create_exception!(
    kestrel_drones,
    KestrelError,
    PyValueError,
    "What Kestrel refuses: where, what was found and what was expected."
);

/// The exception of an error, with its causes.
pub(crate) fn refused(error: impl Error) -> PyErr {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let said = error.to_string();
        // Some errors already say what caused them.
        if !message.contains(&said) {
            message = format!("{message}: {said}");
        }
        cause = error.source();
    }
    KestrelError::new_err(message)
}

/// The exception of what a caller passed.
pub(crate) fn expected(what: &str, found: impl std::fmt::Display, expected: impl std::fmt::Display) -> PyErr {
    KestrelError::new_err(format!("{what}: found {found}, expected {expected}"))
}
