//! The policy of a flight, which may fail; none where the cascade flies.

use std::cell::Cell;
use std::rc::Rc;

use kestrel_core::observation::{ObservationLayout, PilotLayout};
use kestrel_core::pilot::{Pilot, StatePolicy};
use kestrel_core::setpoint::Setpoint;
use kestrel_core::vehicle::State;
use kestrel_shim::policy_backend::PolicyBackend;

use super::fault::{Fault, FaultKind, PolicyFault};

/// What a policy that is none sees.
const UNREAD: ObservationLayout =
    ObservationLayout::Pilot(PilotLayout { position_scale_m: 1.0, velocity_scale: 1.0, body_rates_scale: 1.0 });

/// A policy that fails when the faults say so.
pub(crate) struct FailingPolicy<'a> {
    /// None where the cascade flies: then it never answers, and nobody asks.
    pub(crate) pilot: Option<Pilot<'a, StatePolicy<'a>>>,
    /// Of all kinds.
    pub(crate) faults: &'a [Fault],
    /// Simulated time \[s\].
    pub(crate) clock: Rc<Cell<f64>>,
    /// Control period \[s\].
    pub(crate) control_secs: f32,
}

impl FailingPolicy<'_> {
    /// What is wrong with it now.
    fn fault(&self) -> Option<PolicyFault> {
        let grace_secs = 0.5 * f64::from(self.control_secs);
        self.faults.iter().filter(|fault| fault.acts_at(self.clock.get(), grace_secs)).find_map(
            |fault| match fault.kind {
                FaultKind::Policy(fault) => Some(fault),
                FaultKind::LinkLoss
                | FaultKind::Estimate(_)
                | FaultKind::Motor { .. }
                | FaultKind::Thrust { .. }
                | FaultKind::Load(_)
                | FaultKind::Battery(_)
                | FaultKind::Gust(_) => None,
            },
        )
    }
}

impl PolicyBackend for FailingPolicy<'_> {
    fn control_secs(&self) -> f32 {
        self.control_secs
    }

    fn observation(&self) -> &ObservationLayout {
        self.pilot.as_ref().map_or(&UNREAD, PolicyBackend::observation)
    }

    fn healthy(&mut self) -> bool {
        let damaged = self.fault() == Some(PolicyFault::Damaged);
        !damaged && self.pilot.as_mut().is_none_or(PolicyBackend::healthy)
    }

    fn reset(&mut self) {
        if let Some(pilot) = &mut self.pilot {
            PolicyBackend::reset(pilot);
        }
    }

    fn tick(&mut self, state: &State<f32>, setpoint: &Setpoint<f32>) -> Option<[f32; 4]> {
        match self.fault() {
            None => PolicyBackend::tick(self.pilot.as_mut()?, state, setpoint),
            Some(PolicyFault::Silent | PolicyFault::Damaged) => None,
            Some(PolicyFault::Nan) => Some([f32::NAN; 4]),
            // Whatever is more than a rotor's greatest speed is that.
            Some(PolicyFault::Saturated) => Some([f32::MAX; 4]),
        }
    }
}
