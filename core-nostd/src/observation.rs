//! What a policy observes: layouts that turn a state into a vector of numbers of order one.

mod body;
pub(crate) mod input;
mod pilot;
#[cfg(feature = "px4")]
mod px4_neural;

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

pub(crate) use body::PAST_ACTIONS;
pub use body::{BODY_MOTION_LEN, BodyLayout};
pub use input::ObservationInput;
pub use pilot::{PILOT_LEN, PilotForLayout, PilotLayout, PilotMeasuredLayout};
#[cfg(feature = "px4")]
pub use px4_neural::{PX4_NEURAL_LEN, Px4NeuralLayout};

use crate::limits::ACTION_LEN;
pub use crate::limits::{HISTORY_LIMIT, OBSERVATION_LIMIT};
use crate::real::Real;
#[cfg(feature = "reference")]
pub use crate::reference::{KinematicLayout, REFERENCE_LEN, ReferenceLayout};
use crate::vehicle::State;
#[cfg(not(feature = "px4"))]
pub use crate::without_px4::Px4NeuralLayout;
#[cfg(not(feature = "reference"))]
pub use crate::without_reference::{KinematicLayout, ReferenceLayout};

/// The layouts a policy can be trained on; the identifier and its numbers travel in the policy file.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ObservationLayout {
    /// [`PilotLayout`], version 1.
    Pilot(PilotLayout),
    /// [`ReferenceLayout`] of the reference.
    Reference(ReferenceLayout),
    /// [`KinematicLayout`] of the reference.
    Kinematic(KinematicLayout),
    /// [`MeasuredLayout`]: sensors.
    Measured(MeasuredLayout),
    /// [`PilotForLayout`]: the `pilot` layout for an action that has not four values.
    PilotFor(PilotForLayout),
    /// [`PilotMeasuredLayout`]: the `pilot` layout, then sensors.
    PilotMeasured(PilotMeasuredLayout),
    /// [`BodyLayout`]: in the drone's own axes, then sensors.
    Body(BodyLayout),
    /// [`Px4NeuralLayout`]: what PX4's neural control shows.
    Px4Neural(Px4NeuralLayout),
}

/// What sensors deliver, in the scenario's order and scales.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeasuredLayout {
    /// How many values they deliver.
    pub len: u8,
}

impl ObservationLayout {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "no layout is empty")]
    pub const fn len(&self) -> usize {
        match self {
            Self::Pilot(_) => PILOT_LEN,
            Self::Reference(layout) => layout.len(),
            Self::Kinematic(layout) => layout.len(),
            Self::Measured(layout) => layout.len as usize,
            Self::PilotFor(layout) => layout.len(),
            Self::PilotMeasured(layout) => layout.len(),
            Self::Body(layout) => layout.len(),
            Self::Px4Neural(layout) => layout.len(),
        }
    }

    /// As written in configurations.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Pilot(_) | Self::PilotFor(_) => "pilot",
            Self::Reference(_) => "paper",
            Self::Kinematic(_) => "kinematic",
            Self::Measured(_) => "measured",
            Self::PilotMeasured(_) => "pilot_measured",
            Self::Body(_) => "body",
            Self::Px4Neural(_) => "px4_neural",
        }
    }

    /// Whether it shows where the drone should be: only such a policy can be told where to fly.
    pub const fn shows_goal(&self) -> bool {
        match self {
            Self::Pilot(_) | Self::PilotFor(_) | Self::PilotMeasured(_) | Self::Body(_) | Self::Px4Neural(_) => {
                true
            }
            Self::Reference(_) | Self::Kinematic(_) | Self::Measured(_) => false,
        }
    }

    /// How many values of sensors it shows.
    pub const fn measured_len(&self) -> usize {
        match self {
            Self::Measured(layout) => layout.len as usize,
            Self::PilotMeasured(layout) => layout.measured_len as usize,
            Self::Body(layout) => layout.measured_len as usize,
            Self::Pilot(_) | Self::PilotFor(_) | Self::Reference(_) | Self::Kinematic(_) | Self::Px4Neural(_) => 0,
        }
    }

    /// How many past actions it reads.
    pub const fn history_len(&self) -> usize {
        match self {
            Self::Pilot(_) | Self::PilotFor(_) | Self::PilotMeasured(_) => 1,
            Self::Measured(_) | Self::Px4Neural(_) => 0,
            Self::Reference(layout) => layout.history_len(),
            Self::Kinematic(layout) => layout.history_len(),
            Self::Body(layout) => layout.history_len(),
        }
    }

    /// Whether it shows where the drone should face: only such a policy can be told a heading.
    pub const fn shows_heading(&self) -> bool {
        match self {
            Self::Body(_) => true,
            Self::Pilot(_)
            | Self::PilotFor(_)
            | Self::PilotMeasured(_)
            | Self::Reference(_)
            | Self::Kinematic(_)
            | Self::Measured(_)
            | Self::Px4Neural(_) => false,
        }
    }

    /// The integral of the position error, world, after a control period of `secs` that ended in `state`; layouts that
    /// do not show it leave it.
    #[inline(always)]
    pub fn integrate<R: Real>(
        &self,
        integral: &Vector3<R>,
        state: &State<R>,
        goal: &Vector3<R>,
        secs: R,
    ) -> Vector3<R> {
        match self {
            Self::Body(layout) => layout.integrate(integral, state, goal, secs),
            Self::Pilot(_)
            | Self::PilotFor(_)
            | Self::PilotMeasured(_)
            | Self::Reference(_)
            | Self::Kinematic(_)
            | Self::Measured(_)
            | Self::Px4Neural(_) => *integral,
        }
    }

    /// Writes the observation to the start of `out`, as much as there is room for; what is missing of history and
    /// measurements reads as zero.
    #[inline(always)]
    pub fn encode<R: Real>(&self, input: &ObservationInput<'_, R>, out: &mut [R]) {
        let write = |values: &[R], out: &mut [R]| {
            for (slot, value) in out.iter_mut().zip(values) {
                *slot = *value;
            }
        };
        match self {
            // One copy for all three: this is flash on a microcontroller.
            Self::Pilot(_) | Self::PilotFor(_) | Self::PilotMeasured(_) => {
                if let Some((scales, [action_len, measured_len])) = self.as_pilot() {
                    scales.encode_all(input, [action_len, measured_len], out);
                }
            }
            Self::Reference(layout) => write(&layout.encode(input), out),
            Self::Kinematic(layout) => layout.encode(input, out),
            Self::Measured(layout) => {
                let values = input.measurements.iter().copied().chain(core::iter::repeat(R::zero()));
                for (slot, value) in out.iter_mut().zip(values.take(usize::from(layout.len))) {
                    *slot = value;
                }
            }
            Self::Body(layout) => layout.encode(input, out),
            Self::Px4Neural(layout) => write(&layout.encode(input.state, input.goal), out),
        }
    }

    /// The scales of the `pilot` layouts, and how many values of action and sensors follow.
    const fn as_pilot(&self) -> Option<(PilotLayout, [u8; 2])> {
        match self {
            Self::Pilot(scales) => Some((*scales, [ACTION_LEN as u8, 0])),
            Self::PilotFor(layout) => Some((layout.scales, [layout.action_len, 0])),
            Self::PilotMeasured(layout) => Some((layout.scales, [ACTION_LEN as u8, layout.measured_len])),
            Self::Reference(_) | Self::Kinematic(_) | Self::Measured(_) | Self::Body(_) | Self::Px4Neural(_) => {
                None
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Attitude;
    use crate::limits::ACTION_LIMIT;

    const PILOT: PilotLayout = PilotLayout { position_scale_m: 2.0, velocity_scale: 4.0, body_rates_scale: 10.0 };

    fn state() -> State<f64> {
        State {
            position: Vector3::new(1.0, 0.0, 1.0),
            world_from_body: Attitude::level(),
            velocity: Vector3::new(0.0, 2.0, 0.0),
            body_rates: Vector3::new(0.0, 0.0, -5.0),
            rotor_speeds: [0.0; 4],
        }
    }

    /// Past actions, told apart by their values.
    const HISTORY: [[f64; ACTION_LIMIT]; 3] =
        [[0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [-0.1, -0.2, -0.3, -0.4, -0.5, -0.6], [0.7, -2.0, 0.9, 1.0, 1.5, 0.0]];

    fn encoded<const N: usize>(layout: &ObservationLayout, history: &[[f64; ACTION_LIMIT]]) -> [f64; N] {
        let state = state();
        let input = ObservationInput {
            state: &state,
            angular_velocity_in_world: Vector3::new(0.0, 3.0, -4.0),
            goal: &Vector3::new(0.0, 0.0, 1.0),
            heading: [1.0, 0.0],
            integral: &Vector3::zeros(),
            history,
            measurements: &[0.25, -0.5],
        };
        let mut out = [f64::NAN; OBSERVATION_LIMIT];
        layout.encode(&input, &mut out);
        assert!(out[..layout.len()].iter().all(|value| !value.is_nan()), "every value is written");
        assert!(out[layout.len()..].iter().all(|value| value.is_nan()), "nothing is written beyond");
        assert_eq!(layout.len(), N);
        core::array::from_fn(|index| out[index])
    }

    #[test]
    fn the_pilot_layout_is_its_own_encoding() {
        let expected = PILOT.encode(&state(), &Vector3::new(0.0, 0.0, 1.0), &[0.7, -2.0, 0.9, 1.0]);
        assert_eq!(encoded(&ObservationLayout::Pilot(PILOT), &HISTORY), expected);
        let rested = PILOT.encode(&state(), &Vector3::new(0.0, 0.0, 1.0), &[0.0; 4]);
        assert_eq!(encoded(&ObservationLayout::Pilot(PILOT), &[]), rested);
    }

    #[test]
    fn the_pilot_layout_takes_actions_of_other_lengths() {
        let motion = &PILOT.encode(&state(), &Vector3::new(0.0, 0.0, 1.0), &[0.0; 4])[..18];
        let layout = |action_len| ObservationLayout::PilotFor(PilotForLayout { scales: PILOT, action_len });
        assert_eq!(encoded::<19>(&layout(1), &HISTORY)[..18], *motion);
        assert_eq!(encoded::<19>(&layout(1), &HISTORY)[18..], [0.7]);
        assert_eq!(encoded::<24>(&layout(6), &HISTORY)[18..], [0.7, -1.0, 0.9, 1.0, 1.0, 0.0]);
    }

    #[test]
    fn the_paper_layout_divides_by_the_references_constants() {
        let layout = ObservationLayout::Reference(ReferenceLayout::of_episode(10.0));
        let shares: [f64; REFERENCE_LEN] = encoded(&layout, &HISTORY);
        let expected = [1.0 / 30.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 2.0 / 3.0, 0.0, 0.0, 0.6, -0.8];
        for (share, expected) in shares.into_iter().zip(expected) {
            assert!((share - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn the_paper_layout_limits_what_the_reference_limits() {
        let mut state = state();
        state.position = Vector3::new(-100.0, 100.0, -0.1);
        state.velocity = Vector3::new(5.0, -7.0, -2.0);
        let input = ObservationInput {
            state: &state,
            angular_velocity_in_world: Vector3::zeros(),
            goal: &Vector3::zeros(),
            heading: [1.0, 0.0],
            integral: &Vector3::zeros(),
            history: &[],
            measurements: &[],
        };
        let shares = ReferenceLayout::of_episode(5.0).encode(&input);
        assert_eq!(shares, [-1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, -1.0, -1.0 / 3.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn the_kinematic_layout_shows_the_newest_actions_oldest_first() {
        let layout = |past_actions| ObservationLayout::Kinematic(KinematicLayout { past_actions, action_len: 3 });
        let motion = [1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 3.0, -4.0];
        assert_eq!(encoded(&layout(0), &HISTORY), motion);
        let two: [f64; 18] = encoded(&layout(2), &HISTORY);
        assert_eq!(two[..12], motion);
        assert_eq!(two[12..], [-0.1, -0.2, -0.3, 0.7, -2.0, 0.9]);
        let four: [f64; 24] = encoded(&layout(4), &HISTORY);
        assert_eq!(four[12..18], [0.0, 0.0, 0.0, 0.1, 0.2, 0.3]);
        assert_eq!(layout(4).history_len(), 4);
    }

    #[test]
    fn the_pilot_measured_layout_is_the_pilots_and_then_the_sensors() {
        let pilot: [f64; PILOT_LEN] = encoded(&ObservationLayout::Pilot(PILOT), &HISTORY);
        let layout =
            |measured_len| ObservationLayout::PilotMeasured(PilotMeasuredLayout { scales: PILOT, measured_len });
        let both: [f64; PILOT_LEN + 3] = encoded(&layout(3), &HISTORY);
        assert_eq!(both[..PILOT_LEN], pilot);
        assert_eq!(both[PILOT_LEN..], [0.25, -0.5, 0.0]);
        let one: [f64; PILOT_LEN + 1] = encoded(&layout(1), &HISTORY);
        assert_eq!(one[PILOT_LEN..], [0.25]);
    }

    #[test]
    fn the_px4_neural_layout_is_what_px4_shows() {
        let layout = ObservationLayout::Px4Neural(Px4NeuralLayout);
        let level = [-1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, -5.0];
        assert_eq!(encoded::<PX4_NEURAL_LEN>(&layout, &HISTORY), level);
    }

    #[test]
    fn the_measured_layout_passes_measurements_on() {
        let layout = |len| ObservationLayout::Measured(MeasuredLayout { len });
        assert_eq!(encoded(&layout(2), &HISTORY), [0.25, -0.5]);
        assert_eq!(encoded(&layout(3), &HISTORY), [0.25, -0.5, 0.0]);
    }
}
