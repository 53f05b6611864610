//! Where a policy is computed: here, or on another processor.

use kestrel_core::observation::ObservationLayout;
use kestrel_core::pilot::{Pilot, PolicyRunner};
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;

/// What computes the ticks of a pilot.
pub trait PolicyBackend {
    /// Time between two ticks \[s\].
    fn control_secs(&self) -> f32;

    /// What the policy sees.
    fn observation(&self) -> &ObservationLayout;

    /// Whether the policy reproduces its golden vectors.
    fn healthy(&mut self) -> bool;

    /// As [`Pilot::reset`].
    fn reset(&mut self);

    /// As [`Pilot::tick_towards`]; nothing when the processor does not answer.
    fn tick(&mut self, state: &State<f32>, setpoint: &Setpoint<f32>) -> Option<[f32; 4]>;
}

impl<'a, P: PolicyRunner<'a>> PolicyBackend for Pilot<'a, P> {
    fn control_secs(&self) -> f32 {
        self.metadata().control_period_secs
    }

    fn observation(&self) -> &ObservationLayout {
        &self.metadata().observation
    }

    fn healthy(&mut self) -> bool {
        self.self_test().is_ok()
    }

    fn reset(&mut self) {
        Pilot::reset(self);
    }

    fn tick(&mut self, state: &State<f32>, setpoint: &Setpoint<f32>) -> Option<[f32; 4]> {
        Some(self.tick_towards(&[], state, setpoint))
    }
}
