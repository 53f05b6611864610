//! Kestrel's own observation, the default.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::ObservationInput;
use crate::limits::ACTION_LEN;
use crate::real::Real;
use crate::vehicle::State;

/// Values in the `pilot` layout for an action of four values.
pub const PILOT_LEN: usize = MOTION_LEN + ACTION_LEN;

/// Values before the previous action.
pub(super) const MOTION_LEN: usize = 18;

/// The default layout, 22 values:
///
/// | index | value | unit of one |
/// |---|---|---|
/// | 0–2 | position minus goal, world; its length is limited to 1 | `position_scale_m` |
/// | 3–11 | rotation matrix `world_from_body`, row by row | – |
/// | 12–14 | velocity, world | `velocity_scale` |
/// | 15–17 | body rates | `body_rates_scale` |
/// | 18–21 | previous action, limited to \[-1, 1\] | – |
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PilotLayout {
    /// Distance from the goal that reads as one; farther goals keep their direction only \[m\].
    pub position_scale_m: f32,
    /// Speed that reads as one \[m/s\].
    pub velocity_scale: f32,
    /// Angular velocity that reads as one \[rad/s\].
    pub body_rates_scale: f32,
}

impl PilotLayout {
    /// The observation of `state` on the way to `goal` \[m, world\].
    #[inline(always)]
    pub fn encode<R: Real>(
        &self,
        state: &State<R>,
        goal: &Vector3<R>,
        previous_action: &[R; ACTION_LEN],
    ) -> [R; PILOT_LEN] {
        let motion = self.motion(state, goal);
        let action = previous_action.map(|value| value.limited(-R::one(), R::one()));
        let mut observation = [R::zero(); PILOT_LEN];
        let (front, back) = observation.split_at_mut(MOTION_LEN);
        front.copy_from_slice(&motion);
        back.copy_from_slice(&action);
        observation
    }

    /// Writes the observation with so many values of the previous action and of the sensors to the start of `out`;
    /// measurements that are missing read as zero.
    #[inline(always)]
    pub(super) fn encode_all<R: Real>(
        &self,
        input: &ObservationInput<'_, R>,
        [action_len, measured_len]: [u8; 2],
        out: &mut [R],
    ) {
        let motion = self.motion(input.state, input.goal);
        let action = input.previous_action().map(|value| value.limited(-R::one(), R::one()));
        let measured = input.measurements.iter().copied().chain(core::iter::repeat(R::zero()));
        let values = motion.into_iter().chain(action.into_iter().take(usize::from(action_len)));
        for (slot, value) in out.iter_mut().zip(values.chain(measured.take(usize::from(measured_len)))) {
            *slot = value;
        }
    }

    /// Position minus goal, world, in units of one; its length is limited to 1.
    #[inline(always)]
    pub(super) fn position_error<R: Real>(&self, state: &State<R>, goal: &Vector3<R>) -> [R; 3] {
        let per_metre = R::one() / R::from_f32(self.position_scale_m);
        direction_limited([
            (state.position.x - goal.x) * per_metre,
            (state.position.y - goal.y) * per_metre,
            (state.position.z - goal.z) * per_metre,
        ])
    }

    /// What comes before the previous action.
    #[inline(always)]
    pub(super) fn motion<R: Real>(&self, state: &State<R>, goal: &Vector3<R>) -> [R; MOTION_LEN] {
        let per_speed = R::one() / R::from_f32(self.velocity_scale);
        let per_rate = R::one() / R::from_f32(self.body_rates_scale);
        let [x, y, z] = self.position_error(state, goal);
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = state.world_from_body.rows();
        let (velocity, rates) = (&state.velocity, &state.body_rates);
        [
            x,
            y,
            z, // position
            xx,
            xy,
            xz,
            yx,
            yy,
            yz,
            zx,
            zy,
            zz, // attitude
            velocity.x * per_speed,
            velocity.y * per_speed,
            velocity.z * per_speed,
            rates.x * per_rate,
            rates.y * per_rate,
            rates.z * per_rate,
        ]
    }
}

/// The `pilot` layout for an action of any length: 18 values as there, then the previous action.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PilotForLayout {
    /// What reads as one.
    pub scales: PilotLayout,
    /// Values of the action, not four.
    pub action_len: u8,
}

impl PilotForLayout {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "no layout is empty")]
    pub const fn len(&self) -> usize {
        MOTION_LEN + self.action_len as usize
    }
}

/// The `pilot` layout, then what the sensors deliver, in the scenario's order and scales.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PilotMeasuredLayout {
    /// What reads as one.
    pub scales: PilotLayout,
    /// How many values the sensors deliver.
    pub measured_len: u8,
}

impl PilotMeasuredLayout {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "no layout is empty")]
    pub const fn len(&self) -> usize {
        PILOT_LEN + self.measured_len as usize
    }
}

/// `vector` shortened to length one where it is longer.
#[inline(always)]
fn direction_limited<R: Real>([x, y, z]: [R; 3]) -> [R; 3] {
    let square = (x * x + y * y) + z * z;
    let scale = R::one() / square.at_least(R::one()).sqrt();
    [x * scale, y * scale, z * scale]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Attitude;

    #[test]
    fn every_value_stands_in_its_place() {
        let layout = PilotLayout { position_scale_m: 2.0, velocity_scale: 4.0, body_rates_scale: 10.0 };
        let state = State {
            position: Vector3::new(1.0, 0.0, 1.0),
            world_from_body: Attitude::level(),
            velocity: Vector3::new(0.0, 2.0, 0.0),
            body_rates: Vector3::new(0.0, 0.0, -5.0),
            rotor_speeds: [0.0; 4],
        };
        let observation = layout.encode(&state, &Vector3::new(0.0, 0.0, 1.0), &[0.1, -0.2, 3.0, 0.4]);
        let expected = [
            [0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0],
            [1.0, 0.0, 0.5, 0.0, 0.0, 0.0, -0.5, 0.1, -0.2, 1.0, 0.4],
        ]
        .concat();
        assert_eq!(observation[..], expected[..]);
    }

    #[test]
    fn far_goals_keep_their_direction_only() {
        let layout = PilotLayout { position_scale_m: 0.5, velocity_scale: 1.0, body_rates_scale: 1.0 };
        let state = State {
            position: Vector3::new(30.0, 40.0, 0.0),
            world_from_body: Attitude::level(),
            velocity: Vector3::zeros(),
            body_rates: Vector3::zeros(),
            rotor_speeds: [0.0_f64; 4],
        };
        let observation = layout.encode(&state, &Vector3::zeros(), &[0.0; 4]);
        assert!((observation[0] - 0.6).abs() < 1e-12 && (observation[1] - 0.8).abs() < 1e-12);
    }
}
