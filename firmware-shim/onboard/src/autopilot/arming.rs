//! The arming check: what must be right before motors may turn.

use super::{Autopilot, Mode, Refusal};
use crate::policy_backend::PolicyBackend;

/// Arming wants the drone within 25° of level: beyond, a take-off would tip it over.
const LEVEL_COSINE: f32 = 0.906;

/// Arming wants the drone slower than this \[m/s\].
const ARMING_SPEED: f32 = 0.2;

impl<P: PolicyBackend> Autopilot<P> {
    pub(super) fn arm(&mut self) -> Result<(), Refusal> {
        if !self.mode.armed() {
            self.check_arming()?;
            self.enter(Mode::Armed);
        }
        Ok(())
    }

    /// The first thing that is not right.
    fn check_arming(&mut self) -> Result<(), Refusal> {
        let state = self.known_state.ok_or(Refusal::StateUnknown)?;
        if state.world_from_body.up_cosine() < LEVEL_COSINE {
            return Err(Refusal::NotLevel);
        }
        if state.velocity.norm() > ARMING_SPEED {
            return Err(Refusal::Moving);
        }
        let [_, critical, _] = self.settings.battery_levels;
        let charged = self.surroundings.battery > critical;
        if !charged {
            return Err(Refusal::Battery);
        }
        if self.margin_m(&state.position) < 0.0 {
            return Err(Refusal::Fence);
        }
        if self.healthy() { Ok(()) } else { Err(Refusal::SelfTest) }
    }
}
