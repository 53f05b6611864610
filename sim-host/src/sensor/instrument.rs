//! How an instrument falls short of the truth: bias, noise, limits, resolution, rate, latency, lost samples.

use std::collections::VecDeque;

use kestrel_core::instrument::{BiasWalk, measured};
use serde::{Deserialize, Serialize};

use super::Truth;
use super::signal::Signal;
use crate::seed::Stream;

/// One instrument; everything is in the unit of its [`Signal`].
///
/// A sample is the truth plus bias and noise, limited, rounded, then scaled; it is held until the next one arrives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instrument {
    /// What it measures.
    pub signal: Signal,
    /// White noise of each sample.
    pub noise: Noise,
    /// What is wrong for longer.
    pub bias: Bias,
    /// Least and greatest value it can deliver.
    pub limits: [f64; 2],
    /// Step between two values it can deliver; zero: none.
    pub resolution: f64,
    /// When samples are taken and arrive.
    pub sampling: Sampling,
    /// What a policy sees as one.
    pub unit: f64,
}

/// White noise: samples are independent, normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Noise {
    /// Of one standard deviation.
    Constant(f64),
    /// Standard deviation `near (1 + exp(growth (d − onset)))` at the distance d: the model of the Crazyflie
    /// firmware for its laser ranger (`zranger2.c`).
    Growing {
        /// Near the sensor \[m\].
        near: f64,
        /// Distance at which it has doubled \[m\].
        onset: f64,
        /// \[1/m\].
        growth: f64,
    },
}

/// An error that stays: a constant, drawn at the beginning of each episode, and a random walk from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bias {
    /// Standard deviation of the constant.
    pub constant: f64,
    /// Standard deviation of the walk after one second; it grows with the square root of time.
    pub walk: f64,
}

/// When samples are taken and when they arrive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Samples per second; where it is more than there are readings, every reading has a new one.
    pub rate_hz: f64,
    /// Age of a sample when it arrives \[s\], rounded to whole control periods.
    pub latency_secs: f64,
    /// Share of the samples that are lost, in \[0, 1).
    pub drop_out: f64,
}

/// What one instrument of one drone remembers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct InstrumentMemory {
    bias: [f64; 3],
    /// Share of a sampling period that had passed when the episode began: instruments do not wait for it.
    phase: f64,
    /// Reading of the last sample.
    sampled: u64,
    /// Samples on their way, the oldest first, with the reading at which they arrive.
    underway: VecDeque<(u64, [f64; 3])>,
    held: [f64; 3],
}

impl Noise {
    /// Standard deviation at a true value.
    fn deviation(&self, truth: f64) -> f64 {
        match *self {
            Self::Constant(deviation) => deviation,
            Self::Growing { near, onset, growth } => near * (1.0 + libm::exp(growth * (truth - onset))),
        }
    }
}

impl Sampling {
    /// Whether a sample is taken between the reading before this one and this one.
    pub(super) fn due(&self, reading: u64, phase: f64, control_secs: f64) -> bool {
        let taken = |reading: u64| (reading as f64 * control_secs * self.rate_hz + phase).floor();
        reading == 0 || taken(reading) > taken(reading - 1)
    }

    /// Control periods after which a sample arrives.
    pub(super) fn delay(&self, control_secs: f64) -> u64 {
        (self.latency_secs / control_secs).round() as u64
    }
}

impl Instrument {
    /// A sample of the truth, or nothing.
    fn sample(&self, bias: &[f64; 3], truth: &Truth<'_>, stream: &mut Stream) -> Option<[f64; 3]> {
        let lost = f64::from(stream.uniform()) < self.sampling.drop_out;
        let mut values = self.signal.of(truth).filter(|_| !lost)?;
        for (value, bias) in values.iter_mut().zip(bias).take(self.signal.width()) {
            let normal = f64::from(stream.normal());
            // Where a ranger meets nothing there is nothing to be wrong about.
            let errors = if value.is_finite() { [*bias, self.noise.deviation(*value) * normal] } else { [0.0; 2] };
            *value = self.rounded(measured(*value, errors[0], errors[1], self.limits));
        }
        Some(values)
    }

    fn rounded(&self, value: f64) -> f64 {
        if self.resolution > 0.0 { (value / self.resolution).round() * self.resolution } else { value }
    }
}

impl InstrumentMemory {
    /// Before the first reading.
    pub(super) fn begin(instrument: &Instrument, stream: &mut Stream) -> Self {
        let phase = f64::from(stream.uniform());
        let mut bias = [0.0; 3];
        for bias in &mut bias[..instrument.signal.width()] {
            *bias = instrument.bias.constant * f64::from(stream.normal());
        }
        Self { bias, phase, sampled: 0, underway: VecDeque::new(), held: [0.0; 3] }
    }

    /// The newest sample that has arrived.
    pub(super) fn held(&self) -> &[f64; 3] {
        &self.held
    }

    /// Takes a sample if one is due, and holds what has arrived by this reading, counted from zero.
    pub(super) fn advance(
        &mut self,
        instrument: &Instrument,
        reading: u64,
        control_secs: f64,
        truth: &Truth<'_>,
        stream: &mut Stream,
    ) {
        let sampling = &instrument.sampling;
        if sampling.due(reading, self.phase, control_secs) {
            self.wander(instrument, (reading - self.sampled) as f64 * control_secs, stream);
            self.sampled = reading;
            if let Some(sample) = instrument.sample(&self.bias, truth, stream) {
                let delay = if reading == 0 { 0 } else { sampling.delay(control_secs) };
                self.underway.push_back((reading + delay, sample));
            }
        }
        while self.underway.front().is_some_and(|(arrival, _)| *arrival <= reading) {
            self.held = self.underway.pop_front().map_or(self.held, |(_, sample)| sample);
        }
    }

    /// The bias takes one step of its walk, `secs` long.
    fn wander(&mut self, instrument: &Instrument, secs: f64, stream: &mut Stream) {
        let walk = BiasWalk { density: instrument.bias.walk, correlation_secs: f64::INFINITY };
        if walk.density > 0.0 && secs > 0.0 {
            for bias in &mut self.bias[..instrument.signal.width()] {
                *bias = walk.step(*bias, f64::from(stream.normal()), secs);
            }
        }
    }
}
