//! What a policy file knows of the drone.

use serde::{Deserialize, Serialize};

use crate::airframe::{Airframe, Layout};
use crate::policy_error::{PolicyError, finite, positive};

/// The drone that a policy learned to fly, as far as who makes motor commands of its actions must know it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PolicyAirframe {
    /// Take-off mass \[kg\].
    pub mass: f32,
    /// Greatest thrust of one rotor \[N\].
    pub rotor_thrust_limit: f32,
    /// Rotor positions `[x, y]` in the order of the policy's rotors, body \[m\].
    pub rotor_positions: [[f32; 2]; 4],
    /// Reaction torque of each rotor about body z per thrust \[m\]: negative where it turns counter-clockwise, seen from
    /// above.
    pub torque_per_thrust: [f32; 4],
}

impl From<&Airframe> for PolicyAirframe {
    fn from(airframe: &Airframe) -> Self {
        let torque_per_thrust = airframe.torque_coefficient / airframe.thrust_coefficient;
        Self {
            mass: airframe.mass as f32,
            rotor_thrust_limit: (airframe.thrust_limit() / 4.0) as f32,
            rotor_positions: airframe.rotor_positions().map(|position| position.map(|metres| metres as f32)),
            torque_per_thrust: Layout::TORQUE_SIGNS.map(|sign| (sign * torque_per_thrust) as f32),
        }
    }
}

impl PolicyAirframe {
    /// Thrust of all rotors at full speed per weight, in a gravity \[m/s²\].
    pub fn thrust_to_weight(&self, gravity: f32) -> f32 {
        4.0 * self.rotor_thrust_limit / (self.mass * gravity)
    }

    /// Whether the rotors of these corners turn as on the Crazyflie and on every autopilot's X: counter-clockwise at the
    /// front right and rear left, clockwise at the others.
    pub fn turn_as_usual(&self, corners: [usize; 4]) -> bool {
        corners.map(|rotor| self.turns_counter_clockwise(rotor)) == [true, false, true, false]
    }

    /// The rotors in the corners of an X, clockwise from the front right, seen from above; `None` if one is empty.
    pub fn corners(&self) -> Option<[usize; 4]> {
        let at = |forward: f32, left: f32| {
            self.rotor_positions.iter().position(|[x, y]| x * forward > 0.0 && y * left > 0.0)
        };
        Some([at(1.0, -1.0)?, at(-1.0, -1.0)?, at(-1.0, 1.0)?, at(1.0, 1.0)?])
    }

    /// Whether a rotor turns counter-clockwise, seen from above.
    fn turns_counter_clockwise(&self, rotor: usize) -> bool {
        self.torque_per_thrust.get(rotor).is_some_and(|torque| *torque < 0.0)
    }

    pub(crate) fn check(&self) -> Result<(), PolicyError> {
        positive("mass", self.mass)?;
        positive("rotor_thrust_limit", self.rotor_thrust_limit)?;
        let numbers = self.rotor_positions.as_flattened().iter().chain(&self.torque_per_thrust);
        numbers.copied().try_for_each(|number| finite("a place or a torque of a rotor", number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::{CF2P, CF2X, RotorOrder};

    #[test]
    fn a_crazyflie_has_newtons_and_corners() {
        let airframe = PolicyAirframe::from(&CF2X);
        assert_eq!(airframe.mass, 0.027);
        assert!((airframe.thrust_to_weight(9.8) - 2.25).abs() < 1e-4, "{}", airframe.thrust_to_weight(9.8));
        assert_eq!(airframe.corners(), Some([0, 1, 2, 3]));
        assert!(airframe.turn_as_usual([0, 1, 2, 3]) && !airframe.turn_as_usual([3, 2, 1, 0]));
        assert!(airframe.torque_per_thrust.iter().all(|torque| (torque.abs() - 0.0251).abs() < 1e-4));
    }

    #[test]
    fn other_numberings_have_other_corners_and_a_plus_has_none() {
        let mirrored = PolicyAirframe::from(&CF2X.numbered(RotorOrder::CounterClockwise));
        assert_eq!(mirrored.corners(), Some([3, 2, 1, 0]));
        assert_eq!(PolicyAirframe::from(&CF2P).corners(), None);
    }
}
