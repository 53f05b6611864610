//! A policy file at work, in the arithmetic of the file.

use std::path::PathBuf;

use kestrel_core::policy_file::{PolicyError, PolicyScratch, VisionPolicy};
use kestrel_export::policy::Policy as PolicyFile;
use kestrel_export::seeing::Memory;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray4};
use pyo3::prelude::*;

use crate::error::{KestrelError, expected, refused};

/// A trained policy, as `kestrel train` exports it. It acts with the very inference that firmware runs.
#[pyclass(frozen, module = "kestrel_drones._native")]
pub(crate) struct Policy {
    /// The whole file; parsing it borrows and copies nothing.
    bytes: Vec<u8>,
}

#[pymethods]
impl Policy {
    /// The policy in the file at `path`, whose golden vectors it computes again.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let refuse = |said: String| KestrelError::new_err(format!("{}: {said}", path.display()));
        let bytes = std::fs::read(&path).map_err(|error| refuse(error.to_string()))?;
        let checked = PolicyFile::parse(&bytes).and_then(|policy| policy.self_test());
        checked.map_err(|error| refuse(error.to_string()))?;
        Ok(Self { bytes })
    }

    /// The name of its experiment.
    #[getter]
    fn name(&self) -> PyResult<String> {
        Ok(self.parsed()?.metadata().name.to_owned())
    }

    /// `fixed16` or `float32`.
    #[getter]
    fn arithmetic(&self) -> PyResult<&'static str> {
        Ok(self.parsed()?.arithmetic().name())
    }

    /// Values of an observation.
    #[getter]
    fn observation_len(&self) -> PyResult<usize> {
        Ok(self.parsed()?.metadata().observation.len())
    }

    /// Values of an action.
    #[getter]
    fn action_len(&self) -> PyResult<usize> {
        Ok(self.parsed()?.metadata().action.len())
    }

    /// Time from one action to the next [s].
    #[getter]
    fn control_secs(&self) -> PyResult<f32> {
        Ok(self.parsed()?.metadata().control_period_secs)
    }

    /// Actions `[rows][action_len]` for `observations [rows][observation_len]`, and for
    /// `images [rows][image rows][columns][channels]` where the policy looks at some.
    #[pyo3(signature = (observations, images=None))]
    fn act<'py>(
        &self,
        py: Python<'py>,
        observations: PyReadonlyArray2<'py, f32>,
        images: Option<PyReadonlyArray4<'py, u8>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let policy = self.parsed()?;
        let (len, width) = (policy.metadata().observation.len(), policy.metadata().action.len());
        let shape = observations.as_array().shape().to_owned();
        if shape[1] != len {
            return Err(expected("observations", format_args!("{shape:?}"), format_args!("[rows, {len}]")));
        }
        let observations: Vec<f32> = observations.as_array().iter().copied().collect();
        let images = images.map(|images| images.as_array().iter().copied().collect::<Vec<u8>>());
        let rows = observations.chunks_exact(len);
        let actions = match (&policy, images) {
            (PolicyFile::Blind(policy), None) => py.detach(|| {
                let mut scratch = PolicyScratch::new();
                Ok(rows.flat_map(|row| policy.act(row, &mut scratch).into_iter().take(width)).collect())
            }),
            (PolicyFile::Seeing(policy), Some(images)) => py.detach(|| act_seeing(policy, rows, &images)),
            (PolicyFile::Blind(_), Some(_)) => {
                return Err(expected("images", "some", "None: this policy sees none"));
            }
            (PolicyFile::Seeing(_), None) => return Err(expected("images", "None", "one for each observation")),
        };
        let actions: Vec<f32> = actions.map_err(refused)?;
        PyArray1::from_vec(py, actions).reshape([shape[0], width])
    }
}

impl Policy {
    fn parsed(&self) -> PyResult<PolicyFile<'_>> {
        PolicyFile::parse(&self.bytes).map_err(refused)
    }
}

/// Encodes each image and acts.
fn act_seeing<'a>(
    policy: &VisionPolicy<'_>,
    rows: impl ExactSizeIterator<Item = &'a [f32]>,
    images: &[u8],
) -> Result<Vec<f32>, PolicyError> {
    let (mut memory, mut scratch) = (Memory::of(policy), PolicyScratch::new());
    let image_len = images.len() / rows.len().max(1);
    let mut actions = Vec::new();
    for (row, observation) in rows.enumerate() {
        let mut memory = memory.borrowed();
        policy.encode(&images[row * image_len..][..image_len], &mut memory)?;
        let action = policy.act(observation, &mut memory, &mut scratch)?;
        actions.extend_from_slice(&action[..policy.metadata().action.len()]);
    }
    Ok(actions)
}
