//! What a real drone measures: true states made late, noisy, biased, coarse and rare.
//!
//! A [`SensorSuite`] is the drone's equipment, checked; a [`SensorMemory`] is what one drone's instruments remember
//! (bias, the sample that is held, samples on their way). Every control period one [`SensorSuite::read`] turns the
//! [`Truth`] into the values a policy sees, all of order one. [`signal`] says what each instrument would deliver if
//! it was perfect, [`instrument`] how it falls short.

mod coverage;
pub mod instrument;
mod mates;
mod scan;
pub mod signal;
#[cfg(test)]
mod tests;
mod tof;
mod way;

use kestrel_core::vehicle::State;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::course::GatesAhead;
use crate::seed::Stream;
use crate::trajectory::PathAhead;
use instrument::{Instrument, InstrumentMemory};

pub use coverage::Coverage;
pub(crate) use mates::{Course, MatesMemory};
pub use mates::{Mates, Radio};
pub use scan::{BEAM_LIMIT, Scan, ScanRing};
pub(crate) use tof::{TOF_BANK_LIMIT, TofMemory};
pub use tof::{Tof, TofParts};
pub use way::Way;
pub(crate) use way::{Chart, WayMemory};

/// Distance \[m\] from an origin along a unit direction (both world) to the nearest thing within a limit \[m\].
pub type Raycast<'a> = &'a dyn Fn(Vector3<f64>, Vector3<f64>, f64) -> Option<f64>;

/// A drone and its surroundings as they are.
#[derive(Clone, Copy)]
pub struct Truth<'a> {
    /// Where the drone is and how it moves.
    pub state: &'a State<f64>,
    /// What an accelerometer at the centre of mass feels \[m/s²\], body: acceleration without gravity.
    pub specific_force_in_body: Vector3<f64>,
    /// What rays hit; without it there is only a floor at z = 0.
    pub raycast: Option<Raycast<'a>>,
}

/// The instruments of a drone, in the order of their values.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorSuite {
    instruments: Vec<Instrument>,
    tof: Option<Tof>,
    scan: Option<Scan>,
    told: Option<Told>,
    /// Time between two readings \[s\].
    control_secs: f64,
}

/// What a drone is told rather than measures, or finds out; a simulation knows it. Its values are the last.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Told {
    /// Where its team mates are.
    Mates(Mates),
    /// Where its goal will be.
    Path(PathAhead),
    /// Which cells of a field it has visited.
    Coverage(Coverage),
    /// Where the next gates are.
    Gates(GatesAhead),
    /// Where its way leads, by its own map.
    Way(Way),
}

impl Told {
    fn len(&self) -> usize {
        match self {
            Self::Mates(mates) => mates.len(),
            Self::Path(path) => path.len(),
            Self::Coverage(coverage) => coverage.len(),
            Self::Gates(gates) => gates.len(),
            Self::Way(way) => way.len(),
        }
    }
}

/// What the instruments of one drone remember from reading to reading, within an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SensorMemory {
    /// Readings so far.
    readings: u64,
    instruments: Vec<InstrumentMemory>,
}

impl SensorSuite {
    /// These instruments, read every `control_secs` \[s\].
    pub fn new(instruments: Vec<Instrument>, control_secs: f64) -> Self {
        Self { instruments, tof: None, scan: None, told: None, control_secs }
    }

    /// The same with a ranger of many zones, whose values follow those of the instruments.
    #[must_use]
    pub fn with_tof(self, tof: Option<Tof>) -> Self {
        Self { tof, ..self }
    }

    /// The same with a scan, whose values follow those of the instruments and of the zones.
    #[must_use]
    pub fn with_scan(self, scan: Option<Scan>) -> Self {
        Self { scan, ..self }
    }

    /// The same with something that the drone is told, whose values are the last.
    #[must_use]
    pub fn with_told(self, told: Option<Told>) -> Self {
        Self { told, ..self }
    }

    /// No instruments.
    pub fn none() -> Self {
        Self::new(Vec::new(), 1.0)
    }

    /// The instruments, in the order of their values.
    pub fn instruments(&self) -> &[Instrument] {
        &self.instruments
    }

    /// The ranger of many zones, whose rays a simulation casts all at once.
    pub fn tof(&self) -> Option<&Tof> {
        self.tof.as_ref()
    }

    /// The scan, whose beams a simulation casts all at once.
    pub fn scan(&self) -> Option<&Scan> {
        self.scan.as_ref()
    }

    /// What the drone is told.
    pub fn told(&self) -> Option<&Told> {
        self.told.as_ref()
    }

    /// Whether the drone looks for its way by itself.
    pub fn finds_way(&self) -> bool {
        matches!(self.told, Some(Told::Way(_)))
    }

    /// Whether nothing is measured.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of values of a reading, those of zones, of the scan and of what it is told included.
    pub fn len(&self) -> usize {
        self.scan_start() + self.scan.as_ref().map_or(0, Scan::len) + self.told.as_ref().map_or(0, Told::len)
    }

    /// Number of values before those of the scan.
    pub fn scan_start(&self) -> usize {
        self.instruments_len() + self.tof.as_ref().map_or(0, Tof::len)
    }

    /// Number of values that [`Self::read`] writes.
    pub fn instruments_len(&self) -> usize {
        self.instruments.iter().map(|instrument| instrument.signal.width()).sum()
    }

    /// Instruments as an episode finds them: biases and the instants of their samples are drawn from `stream`.
    pub fn begin(&self, stream: &mut Stream) -> SensorMemory {
        let begin = |instrument: &Instrument| InstrumentMemory::begin(instrument, stream);
        SensorMemory { readings: 0, instruments: self.instruments.iter().map(begin).collect() }
    }

    /// Reads all instruments once, one control period after the last time; `out` has [`Self::instruments_len`]
    /// values.
    ///
    /// The first reading of an episode finds instruments that have been running: their first sample is already there.
    ///
    /// # Panics
    /// When `out` has another length or `memory` is of another suite.
    pub fn read(&self, memory: &mut SensorMemory, truth: &Truth<'_>, stream: &mut Stream, out: &mut [f32]) {
        assert_eq!(out.len(), self.instruments_len(), "a reading has as many values as its suite");
        assert_eq!(memory.instruments.len(), self.instruments.len(), "a memory belongs to its suite");
        let mut values = out.iter_mut();
        for (instrument, memory_of_it) in self.instruments.iter().zip(&mut memory.instruments) {
            memory_of_it.advance(instrument, memory.readings, self.control_secs, truth, stream);
            for (held, value) in memory_of_it.held().iter().zip(values.by_ref().take(instrument.signal.width())) {
                *value = (held / instrument.unit) as f32;
            }
        }
        memory.readings += 1;
    }
}
