//! The observation of the IROS 2021 paper, which the thesis kept.

use serde::{Deserialize, Serialize};

use super::euler::EulerAngles;
use crate::observation::input::ObservationInput;
use crate::policy_error::{PolicyError, positive};
use crate::real::Real;
use crate::reference::vector::length;
use crate::vehicle::State;

/// Values in the `paper` layout.
pub const REFERENCE_LEN: usize = 12;

/// Greatest velocity along x and y, and what all three components are divided by \[m/s\].
const PLANAR_SPEED_LIMIT: f64 = 3.0;

/// Greatest velocity along z \[m/s\]; the reference still divides it by the one along x and y.
const VERTICAL_SPEED_LIMIT: f64 = 1.0;

/// Twelve values without goal or previous action, world frame throughout (section 5.1 of the fact sheet):
///
/// | index | value | limited to | divided by |
/// |---|---|---|---|
/// | 0–1 | position x, y | ±`planar_limit_m` | `planar_limit_m` |
/// | 2 | position z | 0 to `height_limit_m` | `height_limit_m` |
/// | 3–4 | roll, pitch | ±π | π |
/// | 5 | yaw | – | π |
/// | 6–7 | velocity x, y | ±3 m/s | 3 m/s |
/// | 8 | velocity z | ±1 m/s | 3 m/s |
/// | 9–11 | angular velocity | – | its magnitude, so that only the axis is observed; zero stays zero |
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ReferenceLayout {
    /// Distance along x and y that reads as one: three metres per second of the longest episode \[m\].
    pub planar_limit_m: f32,
    /// Height that reads as one: a metre per second of the longest episode \[m\].
    pub height_limit_m: f32,
}

impl ReferenceLayout {
    /// The layout of an environment whose longest episode is so long \[s\].
    pub const fn of_episode(secs: f32) -> Self {
        Self { planar_limit_m: 3.0 * secs, height_limit_m: secs }
    }

    /// Number of values.
    #[expect(clippy::unused_self, reason = "without the feature `reference` a layout is a type without a value")]
    pub(crate) const fn len(&self) -> usize {
        REFERENCE_LEN
    }

    #[expect(clippy::unused_self, reason = "without the feature `reference` a layout is a type without a value")]
    pub(crate) const fn history_len(&self) -> usize {
        0
    }

    pub(crate) fn check(&self, _action_len: usize) -> Result<(), PolicyError> {
        positive("planar_limit_m", self.planar_limit_m)?;
        positive("height_limit_m", self.height_limit_m)
    }

    /// The observation; it reads state and angular velocity.
    #[inline(always)]
    pub fn encode<R: Real>(&self, input: &ObservationInput<'_, R>) -> [R; REFERENCE_LEN] {
        let State { position, velocity, .. } = input.state;
        let [planar, height] = [self.planar_limit_m, self.height_limit_m].map(R::from_f32);
        let half_turn = R::from_f64(core::f64::consts::PI);
        let [fast, slow] = [PLANAR_SPEED_LIMIT, VERTICAL_SPEED_LIMIT].map(R::from_f64);
        let share = |value: R, limit: R| value.limited(-limit, limit) / limit;
        let [roll, pitch, yaw] = EulerAngles::of(&input.state.world_from_body).to_array();
        let turning = input.angular_velocity_in_world;
        let rate = length(&turning);
        let axis = |value: R| R::zero().where_less(rate, value / rate, value);
        [
            share(position.x, planar),
            share(position.y, planar),
            position.z.limited(R::zero(), height) / height,
            share(roll, half_turn),
            share(pitch, half_turn),
            yaw / half_turn,
            share(velocity.x, fast),
            share(velocity.y, fast),
            velocity.z.limited(-slow, slow) / fast,
            axis(turning.x),
            axis(turning.y),
            axis(turning.z),
        ]
    }
}
