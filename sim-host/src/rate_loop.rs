//! The rate loops of a block: each runs at every substep, on what a filtered gyroscope says.

use kestrel_core::rate_loop::{LowPass, RateLoop};
use kestrel_core::real::Real;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

use crate::scenario::Scenario;
use crate::swarm::{Column, row, set_row, vector};

/// Cut-off frequency of the gyroscope's filter in Bitcraze's firmware \[Hz\].
pub(crate) const GYRO_CUTOFF_HZ: f64 = 80.0;

/// The rate loops of the drones of a block, and what their filters remember.
#[derive(Clone, Debug)]
pub(crate) struct RateLoops<const LANES: usize, R> {
    controller: RateLoop<R>,
    filter: LowPass<R>,
    /// Of each axis: the last value inside the filter, and the one before.
    memory: [[Column<LANES, R>; 2]; 3],
}

impl<const LANES: usize, R: Real> RateLoops<LANES, R> {
    /// Nothing where the action space has no rate loop.
    pub(crate) fn new(scenario: &Scenario) -> Option<Box<Self>> {
        let controller = RateLoop::of(&scenario.action)?;
        let filter = LowPass::new(scenario.gyro_cutoff_hz, 1.0 / scenario.physics.substep_secs());
        let memory = [[[R::zero(); LANES]; 2]; 3];
        Some(Box::new(Self { controller, filter, memory }))
    }

    /// A lane begins an episode: the gyroscope has settled, and what is held keeps the rotors as they turn.
    pub(crate) fn begin(&mut self, lane: usize, state: &State<R>) -> [R; 4] {
        self.settle(lane, &state.body_rates);
        self.controller.held(&state.rotor_speeds, &state.body_rates)
    }

    /// The gyroscope of a lane has always measured these body rates.
    pub(crate) fn settle(&mut self, lane: usize, body_rates: &Vector3<R>) {
        for (memory, rate) in self.memory.iter_mut().zip(body_rates.iter()) {
            set_row(memory, lane, self.filter.settled(*rate));
        }
    }

    /// Turns rotor targets, commanded at these body rates, into what is held over the control period.
    #[inline(always)]
    pub(crate) fn hold(&self, targets: &mut [Column<LANES, R>; 4], known_rates: &[Column<LANES, R>; 3]) {
        for lane in 0..LANES {
            set_row(targets, lane, self.controller.held(&row(targets, lane), &vector(known_rates, lane)));
        }
    }

    /// Rotor targets of what is held, after one more sample of the true body rates.
    #[inline(always)]
    pub(crate) fn rotor_targets(
        &mut self,
        held: &[Column<LANES, R>; 4],
        body_rates: &[Column<LANES, R>; 3],
    ) -> [Column<LANES, R>; 4] {
        let (controller, filter) = (self.controller, self.filter);
        let mut targets = *held;
        for lane in 0..LANES {
            let mut rates = vector(body_rates, lane);
            for (memory, rate) in self.memory.iter_mut().zip(rates.iter_mut()) {
                let mut values = row(memory, lane);
                *rate = filter.filter(&mut values, *rate);
                set_row(memory, lane, values);
            }
            set_row(&mut targets, lane, controller.rotor_targets(&row(held, lane), &rates));
        }
        targets
    }

    /// That of one lane by itself.
    pub(crate) fn alone(&self, lane: usize) -> RateLoops<1, R> {
        let memory = self.memory.map(|columns| columns.map(|column| [column[lane]]));
        RateLoops { controller: self.controller, filter: self.filter, memory }
    }

    /// Takes over what the loop of a lane remembers.
    pub(crate) fn replace(&mut self, lane: usize, other: &RateLoops<1, R>) {
        for (memory, other) in self.memory.iter_mut().zip(&other.memory) {
            set_row(memory, lane, row(other, 0));
        }
    }

    /// Every column, for saving and restoring.
    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        self.memory.iter_mut().flatten()
    }
}
