//! What PX4's neural control module shows a policy.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::real::Real;
use crate::vehicle::State;

/// Values of the `px4_neural` layout.
pub const PX4_NEURAL_LEN: usize = 15;

/// The `px4_neural` layout, the 15 inputs of PX4's module `mc_nn_control`, in SI units and not divided by anything:
///
/// | value | axes |
/// |---|---|
/// | goal minus position (3) \[m\] | world |
/// | first and second row of the rotation matrix from body to world axes (6) | – |
/// | velocity (3) \[m/s\] | world |
/// | body rates (3) \[rad/s\] | body |
///
/// PX4 gives world axes that point east, north and up, and body axes that point forward, left and up. So the world's x
/// axis is east here: a drone whose yaw is zero faces east. No past action is seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Px4NeuralLayout;

impl Px4NeuralLayout {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "no layout is empty")]
    pub const fn len(&self) -> usize {
        PX4_NEURAL_LEN
    }

    /// The observation.
    #[inline(always)]
    pub fn encode<R: Real>(&self, state: &State<R>, goal: &Vector3<R>) -> [R; PX4_NEURAL_LEN] {
        let [[xx, xy, xz], [yx, yy, yz], _] = state.world_from_body.rows();
        [
            goal.x - state.position.x,
            goal.y - state.position.y,
            goal.z - state.position.z,
            xx,
            xy,
            xz,
            yx,
            yy,
            yz,
            state.velocity.x,
            state.velocity.y,
            state.velocity.z,
            state.body_rates.x,
            state.body_rates.y,
            state.body_rates.z,
        ]
    }
}
