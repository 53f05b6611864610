//! A policy file at work, in the arithmetic of the file.

use std::path::PathBuf;

use kestrel_core::gru::HiddenState;
use kestrel_core::policy_file::{PolicyError, PolicyScratch, RecurrentPolicy, VisionPolicy};
use kestrel_export::policy::Policy as PolicyFile;
use kestrel_export::seeing::Memory as EncoderMemory;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray4};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::error::{KestrelError, expected, refused};

/// A trained policy, as `kestrel train` exports it. It acts with the very inference that firmware runs.
#[pyclass(frozen, module = "kestrel_drones._native")]
pub(crate) struct Policy {
    /// The whole file; parsing it borrows and copies nothing.
    bytes: Vec<u8>,
}

/// What a recurrent policy remembers of the flights of some drones, a row each.
#[pyclass(module = "kestrel_drones._native")]
pub(crate) struct Memory {
    rows: Vec<HiddenState>,
}

#[pymethods]
impl Memory {
    /// The flights of so many drones, at their start.
    #[new]
    fn new(rows: usize) -> Self {
        Self { rows: vec![HiddenState::new(); rows] }
    }

    /// Begins new flights of those drones for which `rows` is true.
    fn clear(&mut self, rows: Vec<bool>) -> PyResult<()> {
        if rows.len() != self.rows.len() {
            return Err(expected("rows", rows.len(), format_args!("{}: one for each drone", self.rows.len())));
        }
        for (memory, _) in self.rows.iter_mut().zip(rows).filter(|(_, cleared)| *cleared) {
            memory.clear();
        }
        Ok(())
    }

    fn __len__(&self) -> usize {
        self.rows.len()
    }
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

    /// The drone that it learned to fly, `None` if its file is older: `mass_kg`, `rotor_thrust_limit_n`,
    /// `rotor_positions_m [4][2]` (forward, left) and `torque_per_thrust_m [4]` (negative where a rotor turns
    /// counter-clockwise).
    #[getter]
    fn airframe<'py>(&self, python: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let Some(airframe) = self.parsed()?.metadata().airframe else { return Ok(None) };
        let facts = PyDict::new(python);
        facts.set_item("mass_kg", airframe.mass)?;
        facts.set_item("rotor_thrust_limit_n", airframe.rotor_thrust_limit)?;
        facts.set_item("rotor_positions_m", airframe.rotor_positions)?;
        facts.set_item("torque_per_thrust_m", airframe.torque_per_thrust)?;
        Ok(Some(facts))
    }

    /// Whether it acts on what it remembers.
    #[getter]
    fn is_recurrent(&self) -> PyResult<bool> {
        Ok(match self.parsed()? {
            PolicyFile::Recurrent(_) => true,
            PolicyFile::Seeing(policy) => policy.units() > 0,
            PolicyFile::Blind(_) => false,
        })
    }

    /// Actions `[rows][action_len]` for `observations [rows][observation_len]`, and for
    /// `images [rows][image rows][columns][channels]` where the policy looks at some. One that remembers takes and changes the
    /// `memory` of as many rows.
    #[pyo3(signature = (observations, images=None, memory=None))]
    fn act<'py>(
        &self,
        py: Python<'py>,
        observations: PyReadonlyArray2<'py, f32>,
        images: Option<PyReadonlyArray4<'py, u8>>,
        mut memory: Option<PyRefMut<'py, Memory>>,
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
        let memory = memory.as_deref_mut().map(|memory| &mut memory.rows);
        let actions = match (&policy, images) {
            (PolicyFile::Recurrent(policy), None) => {
                let memory = checked_memory(memory, shape[0])?;
                py.detach(|| Ok(act_recurrent(policy, rows, memory)))
            }
            (PolicyFile::Blind(policy), None) => py.detach(|| {
                let mut scratch = PolicyScratch::new();
                Ok(rows.flat_map(|row| policy.act(row, &mut scratch).into_iter().take(width)).collect())
            }),
            (PolicyFile::Seeing(policy), Some(images)) => {
                let memory = if policy.units() > 0 { checked_memory(memory, shape[0])? } else { &mut [] };
                py.detach(|| act_seeing(policy, rows, &images, memory))
            }
            (PolicyFile::Blind(_) | PolicyFile::Recurrent(_), Some(_)) => {
                return Err(expected("images", "some", "None: this policy sees none"));
            }
            (PolicyFile::Seeing(_), None) => return Err(expected("images", "None", "one for each observation")),
        };
        let actions: Vec<f32> = actions.map_err(refused)?;
        PyArray1::from_vec(py, actions).reshape([shape[0], width])
    }
}

impl Policy {
    /// Of a whole file that was written just now.
    pub(crate) fn of(bytes: Vec<u8>) -> Self {
        Self { bytes }
    }

    pub(crate) fn parsed(&self) -> PyResult<PolicyFile<'_>> {
        PolicyFile::parse(&self.bytes).map_err(refused)
    }
}

/// What so many rows remember.
fn checked_memory(memory: Option<&mut Vec<HiddenState>>, rows: usize) -> PyResult<&mut [HiddenState]> {
    match memory {
        None => Err(expected("memory", "None", "what `Policy.memory` returned")),
        Some(memory) if memory.len() != rows => Err(expected("memory", memory.len(), format_args!("{rows} rows"))),
        Some(memory) => Ok(memory),
    }
}

/// Takes each observation into the memory of its row, and acts.
fn act_recurrent<'a>(
    policy: &RecurrentPolicy<'_>,
    rows: impl Iterator<Item = &'a [f32]>,
    memory: &mut [HiddenState],
) -> Vec<f32> {
    let mut scratch = PolicyScratch::new();
    let actions = rows.zip(memory).map(|(row, memory)| policy.act(row, memory, &mut scratch));
    actions.flat_map(|action| action.into_iter().take(policy.metadata().action.len())).collect()
}

/// Encodes each image, takes it with the observation into the memory of its row where the policy remembers, and acts.
fn act_seeing<'a>(
    policy: &VisionPolicy<'_>,
    rows: impl ExactSizeIterator<Item = &'a [f32]>,
    images: &[u8],
    hidden: &mut [HiddenState],
) -> Result<Vec<f32>, PolicyError> {
    let (mut memory, mut scratch) = (EncoderMemory::of(policy), PolicyScratch::new());
    let mut hidden = hidden.iter_mut();
    let image_len = images.len() / rows.len().max(1);
    let mut actions = Vec::new();
    for (row, observation) in rows.enumerate() {
        let mut memory = memory.borrowed();
        policy.encode(&images[row * image_len..][..image_len], &mut memory)?;
        let hidden = hidden.next();
        if let Some(hidden) = &hidden {
            policy.remember(hidden, &mut memory)?;
        }
        let action = policy.act(observation, &mut memory, &mut scratch)?;
        if let Some(hidden) = hidden {
            *hidden = policy.hidden(&memory)?;
        }
        actions.extend_from_slice(&action[..policy.metadata().action.len()]);
    }
    Ok(actions)
}
