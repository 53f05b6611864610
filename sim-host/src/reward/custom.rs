//! Reward terms of a user's own crate.

use core::fmt;
use std::sync::Arc;

use kestrel_core::real::Real;

use crate::swarm::Column;
use crate::term::{DroneView, Memory, Paid, StepView};

/// A reward term that a user's crate adds to a [`Scenario`](crate::scenario::Scenario), in code; it is asked for every drone
/// in every control period. `examples/own_reward.rs` has one.
pub trait RewardFunction: fmt::Debug + Send + Sync {
    /// Name in logs.
    fn name(&self) -> &str;

    /// What its unit is paid by; the second, unless it says otherwise.
    fn paid(&self) -> Paid {
        Paid::PerSecond
    }

    /// What it remembers of a drone's episode; nothing, unless it says otherwise. Saved and restored with the simulation.
    fn memory(&self) -> Memory {
        Memory::NONE
    }

    /// What the drone earns, before the weight; `memory` has as many numbers as [`Self::memory`] says.
    fn value(&self, drone: &DroneView<'_>, memory: &mut [f64]) -> f64;
}

/// A weighted [`RewardFunction`]. Two are equal if they share it.
#[derive(Clone, Debug)]
pub struct Custom {
    /// What one unit is worth.
    pub weight: f64,
    /// What is paid.
    pub function: Arc<dyn RewardFunction>,
}

impl Custom {
    /// A term with this weight.
    pub fn new(weight: f64, function: impl RewardFunction + 'static) -> Self {
        Self { weight, function: Arc::new(function) }
    }

    /// A term of so much per second that remembers nothing, called `name` in logs.
    pub fn from_fn<F>(weight: f64, name: &str, value: F) -> Self
    where
        F: Fn(&DroneView<'_>) -> f64 + Send + Sync + 'static,
    {
        Self::new(weight, Stateless { name: name.to_owned(), value })
    }

    #[inline(never)]
    pub(super) fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        view.each_drone(memory, |lane, drone, memory| {
            values[lane] = worth * R::from_f64(self.function.value(drone, memory));
        });
    }
}

impl PartialEq for Custom {
    fn eq(&self, other: &Self) -> bool {
        self.weight == other.weight && Arc::ptr_eq(&self.function, &other.function)
    }
}

/// A closure as a term.
struct Stateless<F> {
    name: String,
    value: F,
}

impl<F> fmt::Debug for Stateless<F> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_tuple("Stateless").field(&self.name).finish()
    }
}

impl<F: Fn(&DroneView<'_>) -> f64 + Send + Sync> RewardFunction for Stateless<F> {
    fn name(&self) -> &str {
        &self.name
    }

    fn value(&self, drone: &DroneView<'_>, _memory: &mut [f64]) -> f64 {
        (self.value)(drone)
    }
}
