//! The thrust of each rotor as an action.

use serde::{Deserialize, Serialize};

use crate::airframe::Airframe;
use crate::limits::ACTION_LEN;
use crate::policy_error::{PolicyError, positive};
use crate::real::Real;

/// One action per rotor, linear in its thrust: from the lowest thrust at -1 to the greatest at 1.
///
/// The lowest is above the thrust at which an idling motor turns: no action, limited or not, stops a rotor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RotorThrusts {
    /// Speed at which the nominal drone hovers \[rad/s\].
    pub hover_rotor_speed: f32,
    /// Rotor speed of an action of 1, the greatest \[rad/s\].
    pub rotor_speed_limit: f32,
    /// Rotor speed of an action of -1 \[rad/s\].
    pub lowest_rotor_speed: f32,
    /// Speed of a rotor whose motor is armed and commanded zero \[rad/s\].
    pub idle_rotor_speed: f32,
}

impl RotorThrusts {
    /// From a share of the greatest thrust of `airframe` up to all of it, with motors that idle at a speed \[rad/s\].
    pub fn new(airframe: &Airframe, lowest_thrust_share: f64, idle_rotor_speed: f64) -> Self {
        Self {
            hover_rotor_speed: airframe.hover_rotor_speed() as f32,
            rotor_speed_limit: airframe.rotor_speed_limit as f32,
            lowest_rotor_speed: (airframe.rotor_speed_limit * libm::sqrt(lowest_thrust_share)) as f32,
            idle_rotor_speed: idle_rotor_speed as f32,
        }
    }

    /// Rotor targets \[rad/s\], within the lowest and the greatest rotor speed, whatever the action (limited to
    /// \[-1, 1\], NaN to -1).
    #[inline(always)]
    pub fn rotor_targets<R: Real>(&self, action: &[R; ACTION_LEN]) -> [R; 4] {
        let (lowest, greatest) = (R::from_f32(self.lowest_rotor_speed), R::from_f32(self.rotor_speed_limit));
        let half = R::from_f32(0.5);
        let (lowest_squared, span) = (lowest * lowest, greatest * greatest - lowest * lowest);
        action.map(|value| {
            let share = half + half * value.limited(-R::one(), R::one());
            (lowest_squared + span * share).sqrt().limited(lowest, greatest)
        })
    }

    /// The action at which a rotor turns at `rotor_speed` \[rad/s\], not limited.
    pub fn action_of(&self, rotor_speed: f32) -> f32 {
        let lowest_squared = self.lowest_rotor_speed * self.lowest_rotor_speed;
        let span = self.rotor_speed_limit * self.rotor_speed_limit - lowest_squared;
        2.0 * (rotor_speed * rotor_speed - lowest_squared) / span - 1.0
    }

    pub(crate) const fn rotor_speed_limit(&self) -> f32 {
        self.rotor_speed_limit
    }

    pub(crate) const fn hover_speed_squared(&self) -> f32 {
        self.hover_rotor_speed * self.hover_rotor_speed
    }

    pub(crate) fn check(&self) -> Result<(), PolicyError> {
        positive("hover_rotor_speed", self.hover_rotor_speed)?;
        positive("rotor_speed_limit", self.rotor_speed_limit)?;
        positive("idle_rotor_speed", self.idle_rotor_speed)?;
        let ordered = self.idle_rotor_speed < self.lowest_rotor_speed
            && self.lowest_rotor_speed < self.hover_rotor_speed
            && self.hover_rotor_speed < self.rotor_speed_limit;
        let (field, found) = ("lowest_rotor_speed", self.lowest_rotor_speed);
        let expected = "above the idle speed and below the hover speed, which is below the greatest";
        ordered.then_some(()).ok_or(PolicyError::MetadataValue { field, found, expected })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::CF2X;
    use proptest::prelude::*;

    #[test]
    fn thrust_is_linear_in_the_action() {
        let space = RotorThrusts::new(&CF2X, 0.04, 100.0);
        let targets = space.rotor_targets(&[-1.0_f64, 0.0, 1.0, f64::NAN]);
        let shares = targets.map(|target| (target / CF2X.rotor_speed_limit).powi(2));
        for (share, expected) in shares.into_iter().zip([0.04, 0.52, 1.0, 0.04]) {
            assert!((share - expected).abs() < 1e-6, "{share}");
        }
    }

    #[test]
    fn the_action_of_a_speed_commands_it() {
        let space = RotorThrusts::new(&CF2X, 0.04, 100.0);
        let hover = space.action_of(space.hover_rotor_speed);
        for target in space.rotor_targets(&[hover; 4]) {
            assert!((target / space.hover_rotor_speed - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_lowest_thrust_below_that_of_idling_is_refused() {
        let space = RotorThrusts::new(&CF2X, 0.04, 100.0);
        assert_eq!(space.check(), Ok(()));
        let idling = RotorThrusts { idle_rotor_speed: space.lowest_rotor_speed, ..space };
        let error = idling.check().unwrap_err().to_string();
        assert!(error.contains("lowest_rotor_speed"), "{error}");
    }

    proptest! {
        #[test]
        fn no_action_stops_a_rotor(bits in any::<[u32; 4]>()) {
            let space = RotorThrusts::new(&CF2X, 0.04, 100.0);
            for target in space.rotor_targets(&bits.map(f32::from_bits)) {
                prop_assert!((space.lowest_rotor_speed..=space.rotor_speed_limit).contains(&target));
            }
        }
    }
}
