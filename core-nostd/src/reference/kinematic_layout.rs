//! The observation of the reference system since 2023.

use serde::{Deserialize, Serialize};

use super::euler::EulerAngles;
use crate::limits::{ACTION_LIMIT, HISTORY_LIMIT};
use crate::observation::input::ObservationInput;
use crate::policy_error::{PolicyError, holds};
use crate::real::Real;

/// Values before the past actions.
const MOTION_LEN: usize = 12;

/// Nothing divided, nothing limited, world frame throughout:
///
/// | index | value | unit |
/// |---|---|---|
/// | 0–2 | position | m |
/// | 3–5 | roll, pitch, yaw | rad |
/// | 6–8 | velocity | m/s |
/// | 9–11 | angular velocity | rad/s |
/// | 12… | the last actions, the oldest first | – |
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct KinematicLayout {
    /// How many past actions are observed; the reference shows half a second of them.
    pub past_actions: u8,
    /// Values of each.
    pub action_len: u8,
}

impl KinematicLayout {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "no layout is empty")]
    pub const fn len(&self) -> usize {
        MOTION_LEN + self.past_actions as usize * self.action_len as usize
    }

    pub(crate) const fn history_len(&self) -> usize {
        self.past_actions as usize
    }

    pub(crate) fn check(&self, action_len: usize) -> Result<(), PolicyError> {
        let (past, found) = (usize::from(self.past_actions), usize::from(self.action_len));
        holds(found == action_len, "action_len", found, "that of the action")?;
        holds(past <= HISTORY_LIMIT, "past_actions", past, "at most 32")
    }

    /// Writes the observation to the start of `out`; actions that the history lacks read as zero.
    #[inline]
    pub fn encode<R: Real>(&self, input: &ObservationInput<'_, R>, out: &mut [R]) {
        let (state, turning) = (input.state, &input.angular_velocity_in_world);
        let [roll, pitch, yaw] = EulerAngles::of(&state.world_from_body).to_array();
        let (position, velocity) = (&state.position, &state.velocity);
        let motion = [
            position.x, position.y, position.z, //
            roll, pitch, yaw, //
            velocity.x, velocity.y, velocity.z, //
            turning.x, turning.y, turning.z,
        ];
        let past_actions = usize::from(self.past_actions);
        let nothing = [R::zero(); ACTION_LIMIT];
        let missing = past_actions.saturating_sub(input.history.len());
        let recent = input.history.iter().skip(input.history.len().saturating_sub(past_actions));
        let actions = core::iter::repeat_n(&nothing, missing).chain(recent);
        let actions = actions.flat_map(|action| action.iter().take(usize::from(self.action_len)));
        for (slot, value) in out.iter_mut().zip(motion.iter().chain(actions)) {
            *slot = *value;
        }
    }
}
