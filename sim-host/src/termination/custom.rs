//! Terminations of a user's own crate.

use core::fmt;
use std::sync::Arc;

use kestrel_core::real::Real;

use crate::outcome::Ending;
use crate::swarm::Column;
use crate::term::{DroneView, FlightView, Memory};

/// A termination that a user's crate adds to a [`Scenario`](crate::scenario::Scenario), in code; it is asked for every drone
/// in every control period. `examples/own_reward.rs` has one.
pub trait TerminationFunction: fmt::Debug + Send + Sync {
    /// Name in messages.
    fn name(&self) -> &str;

    /// How its ends are reported; a failure, unless it says otherwise.
    fn ending(&self) -> Ending {
        Ending::Limit
    }

    /// What it remembers of a drone's episode; nothing, unless it says otherwise. Saved and restored with the simulation.
    fn memory(&self) -> Memory {
        Memory::NONE
    }

    /// Whether it ends the drone's episode; `memory` has as many numbers as [`Self::memory`] says.
    fn ends(&self, drone: &DroneView<'_>, memory: &mut [f64]) -> bool;
}

/// A [`TerminationFunction`]. Two are equal if they share it.
#[derive(Clone, Debug)]
pub struct Custom {
    /// What ends the episode.
    pub function: Arc<dyn TerminationFunction>,
    /// Whether its ends are cut-offs from which the future is still estimated, rather than terminal states.
    pub truncates: bool,
}

impl Custom {
    /// A termination whose ends are terminal.
    pub fn new(function: impl TerminationFunction + 'static) -> Self {
        Self { function: Arc::new(function), truncates: false }
    }

    /// A failure that remembers nothing, called `name` in messages.
    pub fn from_fn<F>(name: &str, ends: F) -> Self
    where
        F: Fn(&DroneView<'_>) -> bool + Send + Sync + 'static,
    {
        Self::new(Stateless { name: name.to_owned(), ends })
    }

    #[inline(never)]
    pub(super) fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        view.each_drone(memory, |lane, drone, memory| {
            codes[lane] = if self.function.ends(drone, memory) { code } else { codes[lane] };
        });
    }
}

impl PartialEq for Custom {
    fn eq(&self, other: &Self) -> bool {
        self.truncates == other.truncates && Arc::ptr_eq(&self.function, &other.function)
    }
}

/// A closure as a termination.
struct Stateless<F> {
    name: String,
    ends: F,
}

impl<F> fmt::Debug for Stateless<F> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_tuple("Stateless").field(&self.name).finish()
    }
}

impl<F: Fn(&DroneView<'_>) -> bool + Send + Sync> TerminationFunction for Stateless<F> {
    fn name(&self) -> &str {
        &self.name
    }

    fn ends(&self, drone: &DroneView<'_>, _memory: &mut [f64]) -> bool {
        (self.ends)(drone)
    }
}
