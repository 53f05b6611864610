//! The observation in the drone's own axes, which a drone needs that is late and has to hold its heading.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::ObservationInput;
use super::pilot::PilotLayout;
use crate::real::Real;
use crate::vehicle::State;

/// Values of the `body` layout before the past actions.
pub const BODY_MOTION_LEN: usize = 18;

/// Values after the past actions.
const INTEGRAL_LEN: usize = 3;

/// Past actions that are seen: with a late state the last one is not enough to know what is coming.
pub(crate) const PAST_ACTIONS: usize = 2;

/// How fast the integral forgets \[1/s\].
const LEAK_PER_SEC: f64 = 0.5;

/// How fast it follows the position error \[1/s\].
const GAIN_PER_SEC: f64 = 3.0;

/// The `body` layout, 29 values beside an action of four and without sensors:
///
/// | value | axes | unit of one |
/// |---|---|---|
/// | position minus goal (3); its length is limited to 1 | body | `position_scale_m` |
/// | rotation matrix from the body to world axes turned to the wanted heading (9), row by row | – | – |
/// | velocity (3) | body | `velocity_scale` |
/// | body rates (3) | body | `body_rates_scale` |
/// | the last two actions, the newest first, limited to \[-1, 1\] | – | – |
/// | leaky integral of the position error (3) | body | six times the error that lasts |
/// | what the sensors deliver | – | – |
///
/// Nothing in it tells where in the world the drone is, or where north is: what is learned at one place and heading holds
/// at all. The integral takes out what a constant wind, a wrong mass or unequal motors leave.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BodyLayout {
    /// What reads as one.
    pub scales: PilotLayout,
    /// Values of the action.
    pub action_len: u8,
    /// How many values the sensors deliver.
    pub measured_len: u8,
}

impl BodyLayout {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "no layout is empty")]
    pub const fn len(&self) -> usize {
        BODY_MOTION_LEN + self.past_len() + INTEGRAL_LEN + self.measured_len as usize
    }

    /// Values of the past actions.
    pub const fn past_len(&self) -> usize {
        PAST_ACTIONS * self.action_len as usize
    }

    /// How many past actions it reads.
    pub const fn history_len(&self) -> usize {
        PAST_ACTIONS
    }

    /// The integral of the position error \[world\] after a control period of `secs`, which ended in `state`.
    #[inline(always)]
    pub fn integrate<R: Real>(
        &self,
        integral: &Vector3<R>,
        state: &State<R>,
        goal: &Vector3<R>,
        secs: R,
    ) -> Vector3<R> {
        let [x, y, z] = self.scales.position_error(state, goal);
        let (kept, gain) = (R::one() - R::from_f64(LEAK_PER_SEC) * secs, R::from_f64(GAIN_PER_SEC) * secs);
        Vector3::new(integral.x * kept + x * gain, integral.y * kept + y * gain, integral.z * kept + z * gain)
    }

    /// What comes before the past actions, and the integral in body axes.
    #[inline(always)]
    pub fn motion<R: Real>(
        &self,
        state: &State<R>,
        goal: &Vector3<R>,
        [cosine, sine]: [R; 2],
        integral: &Vector3<R>,
    ) -> ([R; BODY_MOTION_LEN], [R; INTEGRAL_LEN]) {
        let per_speed = R::one() / R::from_f32(self.scales.velocity_scale);
        let per_rate = R::one() / R::from_f32(self.scales.body_rates_scale);
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = state.world_from_body.rows();
        let into_body = |[x, y, z]: [R; 3]| {
            [
                (xx * x + yx * y) + zx * z, //
                (xy * x + yy * y) + zy * z,
                (xz * x + yz * y) + zz * z,
            ]
        };
        let [px, py, pz] = into_body(self.scales.position_error(state, goal));
        let [u, v, w] = into_body(state.velocity.into()).map(|speed| speed * per_speed);
        let forward = |x: R, y: R| cosine * x + sine * y;
        let left = |x: R, y: R| cosine * y - sine * x;
        let rates = &state.body_rates;
        let motion = [
            px,
            py,
            pz, // position
            forward(xx, yx),
            forward(xy, yy),
            forward(xz, yz),
            left(xx, yx),
            left(xy, yy),
            left(xz, yz),
            zx,
            zy,
            zz, // attitude
            u,
            v,
            w, // velocity
            rates.x * per_rate,
            rates.y * per_rate,
            rates.z * per_rate,
        ];
        (motion, into_body((*integral).into()))
    }

    /// Writes the observation to the start of `out`; what is missing of history and measurements reads as zero.
    #[inline(always)]
    pub fn encode<R: Real>(&self, input: &ObservationInput<'_, R>, out: &mut [R]) {
        let (motion, integral) = self.motion(input.state, input.goal, input.heading, input.integral);
        // Loops, and no chain of iterators: this is flash on a microcontroller.
        let mut slots = out.iter_mut();
        let mut write = |value: R| {
            if let Some(slot) = slots.next() {
                *slot = value;
            }
        };
        for value in motion {
            write(value);
        }
        for age in 1..=PAST_ACTIONS {
            let past = input.history.len().checked_sub(age).and_then(|index| input.history.get(index));
            for index in 0..usize::from(self.action_len) {
                let value = past.and_then(|action| action.get(index)).copied().unwrap_or(R::zero());
                write(value.limited(-R::one(), R::one()));
            }
        }
        for value in integral {
            write(value);
        }
        for index in 0..usize::from(self.measured_len) {
            write(input.measurements.get(index).copied().unwrap_or(R::zero()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::Attitude;
    use crate::limits::ACTION_LIMIT;

    const LAYOUT: BodyLayout = BodyLayout {
        scales: PilotLayout { position_scale_m: 2.0, velocity_scale: 4.0, body_rates_scale: 10.0 },
        action_len: 4,
        measured_len: 1,
    };

    /// A drone that faces `heading` [rad].
    fn facing(heading: f64) -> State<f64> {
        State {
            position: Vector3::new(1.0, 0.0, 1.0),
            world_from_body: Attitude::from_axis_angle(Vector3::z(), heading),
            velocity: Vector3::new(0.0, 2.0, 0.0),
            body_rates: Vector3::new(0.0, 0.0, -5.0),
            rotor_speeds: [0.0; 4],
        }
    }

    fn encoded(state: &State<f64>, heading: f64, integral: &Vector3<f64>) -> [f64; 30] {
        let history: [[f64; ACTION_LIMIT]; 2] = [[0.1, 0.2, 0.3, 0.4, 9.0, 9.0], [0.5, -0.6, 3.0, 0.8, 9.0, 9.0]];
        let input = ObservationInput {
            state,
            angular_velocity_in_world: Vector3::zeros(),
            goal: &Vector3::new(0.0, 0.0, 1.0),
            heading: [libm::cos(heading), libm::sin(heading)],
            integral,
            history: &history,
            measurements: &[0.25],
        };
        let mut out = [f64::NAN; 30];
        LAYOUT.encode(&input, &mut out);
        assert_eq!(LAYOUT.len(), 30);
        out
    }

    #[test]
    fn every_value_stands_in_its_place() {
        let found = encoded(&facing(0.0), 0.0, &Vector3::new(0.1, 0.2, 0.3));
        let expected: [&[f64]; 5] = [
            &[0.5, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            &[0.0, 0.5, 0.0, 0.0, 0.0, -0.5],
            &[0.5, -0.6, 1.0, 0.8, 0.1, 0.2, 0.3, 0.4],
            &[0.1, 0.2, 0.3],
            &[0.25],
        ];
        assert_eq!(found[..], expected.concat()[..]);
    }

    #[test]
    fn what_is_seen_is_the_same_wherever_the_world_is_turned() {
        let turned = |angle: f64| {
            let turn = Attitude::from_axis_angle(Vector3::z(), angle);
            let state = facing(0.4);
            let goal = Vector3::new(0.0, 0.0, 1.0);
            let moved = State {
                position: goal + turn.rotate(state.position - goal),
                world_from_body: turn.after(&state.world_from_body),
                velocity: turn.rotate(state.velocity),
                ..state
            };
            encoded(&moved, 0.9 + angle, &turn.rotate(Vector3::new(0.1, 0.2, 0.3)))
        };
        for (here, there) in turned(0.0).into_iter().zip(turned(2.2)) {
            assert!((here - there).abs() < 1e-12, "{here} {there}");
        }
    }

    #[test]
    fn the_integral_ends_at_six_times_the_error_and_forgets_it() {
        let (state, goal) = (facing(0.0), Vector3::new(0.8, 0.0, 1.0));
        let step = |integral: Vector3<f64>, goal: &Vector3<f64>| LAYOUT.integrate(&integral, &state, goal, 0.02);
        let lasting = (0..2000).fold(Vector3::zeros(), |integral, _| step(integral, &goal));
        assert!((lasting - Vector3::new(0.6, 0.0, 0.0)).norm() < 1e-6);
        let forgotten = (0..100).fold(lasting, |integral, _| step(integral, &state.position));
        assert!((forgotten.x / lasting.x - 0.99_f64.powi(100)).abs() < 1e-9);
    }
}
