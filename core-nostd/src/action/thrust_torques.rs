//! Collective thrust and torques as shares of what the rotors have: actions for any drone.

use serde::{Deserialize, Serialize};

use crate::airframe::{Airframe, Layout};
use crate::limits::ACTION_LEN;
use crate::policy_error::{PolicyError, finite, positive};
use crate::real::Real;

/// Share of its greatest thrust that a full torque about x or y adds to each rotor of a cross, and one about z to every rotor.
const TORQUE_SHARE: f32 = 0.5;

/// Collective thrust, from none at -1 to all at 1, and torques about x, y, z, as shares of a rotor's greatest thrust.
///
/// Of a drone it needs to know where its rotors are, which way they turn and how fast they may. What mass, inertia and thrust
/// make of that is for the policy to find out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ThrustTorques {
    /// Squared rotor speed at which the nominal drone hovers \[rad²/s²\].
    pub hover_speed_squared: f32,
    /// Squared greatest rotor speed \[rad²/s²\].
    pub speed_squared_limit: f32,
    /// Least share of its greatest thrust that a rotor is told.
    pub lowest_share: f32,
    /// Share of its greatest thrust that full torques about x, y, z add to each rotor.
    pub mixer: [[f32; 3]; 4],
}

impl ThrustTorques {
    /// For the rotors of `airframe`, none of which is told less than a share of its greatest thrust.
    pub fn new(airframe: &Airframe, lowest_share: f32) -> Self {
        let hover = airframe.hover_rotor_speed();
        let limit = airframe.rotor_speed_limit;
        Self {
            hover_speed_squared: (hover * hover) as f32,
            speed_squared_limit: (limit * limit) as f32,
            lowest_share,
            mixer: mixer(airframe),
        }
    }

    /// The same actions on another drone.
    #[must_use]
    pub fn on(&self, airframe: &Airframe) -> Self {
        Self::new(airframe, self.lowest_share)
    }

    /// Rotor targets \[rad/s\], from the lowest share to the greatest rotor speed, whatever the action (limited to
    /// \[-1, 1\], NaN to -1).
    #[inline(always)]
    pub fn rotor_targets<R: Real>(&self, action: &[R; ACTION_LEN]) -> [R; 4] {
        let real = R::from_f32;
        let [thrust, roll, pitch, yaw] = action.map(|value| value.limited(-R::one(), R::one()));
        let collective = real(0.5) + real(0.5) * thrust;
        self.mixer.map(|[x, y, z]| {
            let turning = (real(x) * roll + real(y) * pitch) + real(z) * yaw;
            let share = (collective + turning).limited(real(self.lowest_share), R::one());
            (share * real(self.speed_squared_limit)).sqrt()
        })
    }

    /// The action at which rotors turn at these speeds \[rad/s\], as far as one makes them; not limited.
    pub fn action_of(&self, rotor_speeds: [f32; 4]) -> [f32; ACTION_LEN] {
        let shares = rotor_speeds.map(|speed| speed * speed / self.speed_squared_limit);
        let torque = |axis: usize| {
            let column = self.mixer.map(|row| row[axis]);
            let dot = |other: [f32; 4]| column.iter().zip(other).map(|(one, other)| one * other).sum::<f32>();
            dot(shares) / dot(column)
        };
        let mean = shares.iter().sum::<f32>() / shares.len() as f32;
        [2.0 * mean - 1.0, torque(0), torque(1), torque(2)]
    }

    pub(crate) fn check(&self) -> Result<(), PolicyError> {
        positive("hover_speed_squared", self.hover_speed_squared)?;
        positive("speed_squared_limit", self.speed_squared_limit)?;
        positive("lowest_share", self.lowest_share)?;
        self.mixer.as_flattened().iter().try_for_each(|number| finite("mixer", *number))
    }
}

/// Shares that turn about x, y, z: by the side that a rotor is on, and the way that it turns.
fn mixer(airframe: &Airframe) -> [[f32; 3]; 4] {
    // Two rotors of a plus have the lever that four of a cross share.
    let reach = match airframe.layout {
        Layout::Cross { .. } => TORQUE_SHARE,
        Layout::Plus { .. } => TORQUE_SHARE * core::f32::consts::SQRT_2,
    };
    let side = |metres: f64| if metres == 0.0 { 0.0 } else { reach.copysign(metres as f32) };
    let reaction = TORQUE_SHARE.copysign(airframe.torque_coefficient as f32);
    let positions = Layout::rotor_positions(&airframe.layout, airframe.rotor_order);
    core::array::from_fn(|rotor| {
        let [x, y] = positions[rotor];
        [side(y), side(-x), reaction * Layout::TORQUE_SIGNS[rotor] as f32]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::{BOLT_5_INCH, CF2P, CF2X, CRAZYFLIE_2_1, HUMMINGBIRD, RACER, RotorOrder, X500};
    use crate::attitude::Attitude;
    use crate::vehicle::{Air, State, Vehicle};
    use nalgebra::Vector3;

    /// Angular acceleration that an action comes to.
    fn turning(airframe: &Airframe, action: [f64; 4]) -> Vector3<f64> {
        let rotor_speeds = ThrustTorques::new(airframe, 0.02).rotor_targets(&action);
        let nothing = Vector3::zeros();
        let state = State {
            position: nothing,
            world_from_body: Attitude::level(),
            velocity: nothing,
            body_rates: nothing,
            rotor_speeds,
        };
        Vehicle::new(airframe).accelerations(&state, &[0.0; 4], &Air::still()).1
    }

    #[test]
    fn a_torque_turns_every_drone_about_its_axis_alone() {
        let airframes = [CF2X, CF2P, CRAZYFLIE_2_1, HUMMINGBIRD, RACER, X500, BOLT_5_INCH];
        for airframe in airframes.into_iter().chain([CF2X.numbered(RotorOrder::CounterClockwise)]) {
            for axis in 0..3 {
                let mut action = [0.0; 4];
                action[1 + axis] = 0.4;
                let found = turning(&airframe, action);
                let others = (0..3).filter(|other| *other != axis).map(|other| found[other].abs());
                assert!(found[axis] > 0.1, "{axis}: {found}");
                assert!(others.fold(0.0, f64::max) < 1e-3 * found[axis], "{axis}: {found}");
            }
        }
    }

    #[test]
    fn the_action_of_speeds_commands_them() {
        for airframe in [CF2P, X500, RACER] {
            let space = ThrustTorques::new(&airframe, 0.02);
            let hover = airframe.hover_rotor_speed() as f32;
            let [a, b, c, d] = space.action_of([hover; 4]);
            assert!(b.abs() + c.abs() + d.abs() < 1e-6);
            let action = [a, 0.1, -0.2, 0.05];
            let found = space.action_of(space.rotor_targets(&action));
            assert!(action.iter().zip(found).all(|(one, other)| (one - other).abs() < 1e-5), "{found:?}");
        }
    }

    #[test]
    fn the_same_actions_on_another_drone_are_its_own() {
        assert_eq!(ThrustTorques::new(&CF2X, 0.02).on(&RACER), ThrustTorques::new(&RACER, 0.02));
    }

    #[test]
    fn no_action_leaves_the_range() {
        let space = ThrustTorques::new(&CF2P, 0.02);
        let limit = CF2P.rotor_speed_limit as f32;
        let least = limit * 0.02_f32.sqrt() * 0.999_999;
        for action in [[f32::NAN; 4], [9.0, 1.0, 1.0, 1.0], [-9.0, -1.0, f32::INFINITY, 0.3]] {
            for target in space.rotor_targets(&action) {
                assert!((least..=limit * 1.000_001).contains(&target), "{target}");
            }
        }
        let broken = ThrustTorques { lowest_share: f32::NAN, ..space };
        assert!(broken.check().unwrap_err().to_string().contains("lowest_share"));
    }
}
