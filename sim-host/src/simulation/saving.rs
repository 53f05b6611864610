//! What a simulation goes on from after it was stopped.

use kestrel_core::action::{CONTROL_MEMORY_LEN, ControlMemory};
use kestrel_core::real::Real;
use serde::{Deserialize, Serialize};

use super::Simulation;
use super::imaging::{Imaging, ImagingState};
use crate::block::{MOTION_LEN, motion_from_array, motion_to_array};
use crate::contact::ContactMemory;
use crate::outcome::Episode;
use crate::seed::Stream;
use crate::sensor::{Chart, SensorMemory};

/// Everything the next step depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SimulationState<R = f32> {
    columns: Vec<R>,
    controls: Vec<R>,
    movables: Vec<[f64; MOTION_LEN]>,
    contacts: Vec<ContactMemory>,
    sensors: Vec<SensorMemory>,
    streams: Vec<Stream>,
    charts: Vec<Chart>,
    imaging: Option<ImagingState>,
    episodes: Vec<Episode>,
}

impl<const LANES: usize, R: Real> Simulation<LANES, R> {
    /// What [`Self::restore`] needs to go on to the same bits.
    pub fn save(&self) -> SimulationState<R> {
        let mut blocks = self.blocks.clone();
        let mut state = SimulationState {
            columns: Vec::new(),
            controls: Vec::new(),
            movables: Vec::new(),
            contacts: Vec::new(),
            sensors: Vec::new(),
            streams: Vec::new(),
            charts: Vec::new(),
            imaging: self.imaging.as_ref().map(Imaging::save),
            episodes: self.episodes.clone(),
        };
        for block in &mut blocks {
            for agent in &mut block.agents {
                agent.columns_mut().for_each(|column| state.columns.extend_from_slice(column));
                agent.controls_mut().iter().for_each(|memory| state.controls.extend(memory.to_array()));
                state.sensors.extend_from_slice(agent.sensors_mut());
                state.streams.extend_from_slice(agent.streams_mut());
                state.charts.extend_from_slice(agent.charts_mut());
            }
            state.contacts.extend_from_slice(block.contacts_mut());
            state.movables.extend(block.movables_mut().map(|motion| motion_to_array(motion)));
        }
        state
    }

    /// Whether a saved state is one of this scenario and size.
    fn fits(&self, state: &SimulationState<R>) -> bool {
        let own = self.save();
        state.columns.len() == own.columns.len()
            && state.controls.len() == own.controls.len()
            && state.sensors.len() == own.sensors.len()
            && state.streams.len() == own.streams.len()
            && state.charts.iter().map(Chart::len).eq(own.charts.iter().map(Chart::len))
            && state.contacts.len() == own.contacts.len()
            && state.movables.len() == own.movables.len()
            && match (&self.imaging, &state.imaging) {
                (None, None) => true,
                (Some(imaging), Some(state)) => imaging.fits(state),
                (None, Some(_)) | (Some(_), None) => false,
            }
    }

    /// Returns to a saved state; `false`, and nothing changes, when it belongs to another scenario or size.
    #[must_use]
    pub fn restore(&mut self, state: &SimulationState<R>) -> bool {
        if !self.fits(state) {
            return false;
        }
        let mut columns = state.columns.chunks_exact(LANES);
        let mut controls = state.controls.chunks_exact(CONTROL_MEMORY_LEN);
        let mut sensors = state.sensors.iter();
        let mut streams = state.streams.iter();
        let mut charts = state.charts.iter();
        let mut movables = state.movables.iter();
        let mut contacts = state.contacts.iter();
        for block in &mut self.blocks {
            for agent in &mut block.agents {
                for (column, values) in agent.columns_mut().zip(&mut columns) {
                    column.copy_from_slice(values);
                }
                for (memory, values) in agent.controls_mut().iter_mut().zip(&mut controls) {
                    *memory = ControlMemory::from_array(&core::array::from_fn(|index| values[index]));
                }
                for (memory, saved) in agent.sensors_mut().iter_mut().zip(&mut sensors) {
                    memory.clone_from(saved);
                }
                for (stream, saved) in agent.streams_mut().iter_mut().zip(&mut streams) {
                    stream.clone_from(saved);
                }
                for (chart, saved) in agent.charts_mut().iter_mut().zip(&mut charts) {
                    chart.clone_from(saved);
                }
            }
            for (memory, saved) in block.contacts_mut().iter_mut().zip(&mut contacts) {
                memory.clone_from(saved);
            }
            for (motion, saved) in block.movables_mut().zip(&mut movables) {
                *motion = motion_from_array(saved);
            }
            block.update_positions();
            // Another process may have made the rooms in which they are.
            for lane in 0..LANES {
                let _made = self.scenario.aviary_of(block.agents[0].room(lane));
            }
        }
        if let (Some(imaging), Some(state)) = (&mut self.imaging, &state.imaging) {
            imaging.restore(state);
        }
        self.episodes.clone_from(&state.episodes);
        self.gather_outputs();
        true
    }
}
