//! What renders: the processor or a GPU.

use std::fmt;
use std::str::FromStr;

/// What is asked to render.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// A GPU where there is one, else the processor; a software adapter is no GPU.
    #[default]
    Auto,
    /// The processor, by the code that is the reference for all others.
    Cpu,
    /// A GPU, or an error.
    Gpu,
    /// An adapter that runs on the processor, such as lavapipe: for tests of the GPU's code, and slower than [`Self::Cpu`].
    Software,
}

/// All of them, in the order of the documentation.
const BACKENDS: [Backend; 4] = [Backend::Auto, Backend::Cpu, Backend::Gpu, Backend::Software];

impl Backend {
    /// As it is written in files and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
            Self::Software => "software",
        }
    }
}

impl fmt::Display for Backend {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

/// A word that names no backend.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("expected `auto`, `cpu`, `gpu` or `software`, found `{0}`")]
pub struct UnknownBackend(String);

impl FromStr for Backend {
    type Err = UnknownBackend;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let named = BACKENDS.into_iter().find(|backend| backend.name() == text);
        named.ok_or_else(|| UnknownBackend(text.to_owned()))
    }
}

/// Why nothing is rendered.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RenderError {
    /// The feature `gpu` is off.
    #[error("this program was built without GPUs: build it with `--features gpu`, or ask for the backend `cpu`")]
    WithoutGpus,
    /// None that was asked for.
    #[error("found no {wanted} ({found}): {advice}")]
    NoAdapter {
        /// What was asked for.
        wanted: &'static str,
        /// What there is instead.
        found: String,
        /// What the user can do.
        advice: &'static str,
    },
    /// The adapter does not open.
    #[error("{adapter} cannot be used: {reason}")]
    Adapter {
        /// Its name.
        adapter: String,
        /// In the words of its driver.
        reason: String,
    },
    /// Not even one view fits.
    #[error("{what} take {bytes} bytes, expected at most {limit}, what a buffer of {adapter} holds")]
    TooLarge {
        /// What does not fit.
        what: &'static str,
        /// How large it is.
        bytes: u64,
        /// How large it may be.
        limit: u64,
        /// Its name.
        adapter: String,
    },
    /// Not even one row or column fits.
    #[error("a view has {pixels} pixels across or down, expected at most {limit}, what {adapter} renders")]
    TooWide {
        /// Of its longer side.
        pixels: usize,
        /// How many it may have.
        limit: usize,
        /// Its name.
        adapter: String,
    },
    /// The memory of the adapter is full.
    #[error("{adapter} has no memory for {views} views of {columns}x{rows} pixels: render fewer at once")]
    OutOfMemory {
        /// Its name.
        adapter: String,
        /// How many were asked for.
        views: usize,
        /// Pixels of a row.
        columns: usize,
        /// Rows of a view.
        rows: usize,
    },
    /// The device was lost while it worked.
    #[error("{adapter} was lost: {reason}")]
    Lost {
        /// Its name.
        adapter: String,
        /// In the words of its driver.
        reason: String,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_backend_is_found_by_its_name() {
        for backend in BACKENDS {
            assert_eq!(backend.to_string().parse(), Ok(backend));
        }
        let error = "cuda".parse::<Backend>().unwrap_err();
        assert_eq!(error.to_string(), "expected `auto`, `cpu`, `gpu` or `software`, found `cuda`");
    }
}
