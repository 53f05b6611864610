//! The modes that ground stations see and choose, by name.
//!
//! They carry PX4's numbers where the meaning is PX4's, whatever autopilot the vehicle says it is: clients that know one set of
//! numbers know this one. The policy and the cascade of controllers have those of PX4's first two external modes.

use crate::autopilot::Mode;
use crate::controller::Controller;

/// A mode as ground stations know it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlightMode {
    /// The policy holds a point or goes to one.
    Policy,
    /// The cascade of controllers does.
    Cascade,
    /// Holding, by the active controller: can be chosen, and then is one of the two before.
    Hold,
    /// Flown by sticks, where there are some; holding where not.
    Position,
    /// Following set-points.
    Offboard,
    /// Taking off.
    TakeOff,
    /// Landing.
    Land,
    /// Flying home.
    Return,
    /// Flying a mission.
    Mission,
}

/// PX4's main mode of all automatic modes, alone.
const AUTOMATIC: [f32; 2] = [4.0, 0.0];

impl FlightMode {
    /// All of them, in the order in which they are listed.
    pub const ALL: [Self; 9] = [
        Self::Policy,
        Self::Cascade,
        Self::Hold,
        Self::Position,
        Self::Offboard,
        Self::TakeOff,
        Self::Land,
        Self::Return,
        Self::Mission,
    ];

    /// Main and sub mode.
    const fn numbers(self) -> [u8; 2] {
        match self {
            Self::Policy => [4, 11],
            Self::Cascade => [4, 12],
            Self::Hold => [4, 3],
            Self::Position => [3, 0],
            Self::Offboard => [6, 0],
            Self::TakeOff => [4, 2],
            Self::Land => [4, 6],
            Self::Return => [4, 5],
            Self::Mission => [4, 4],
        }
    }

    /// `custom_mode`.
    pub const fn custom_mode(self) -> u32 {
        let [main, sub] = self.numbers();
        u32::from_be_bytes([sub, main, 0, 0])
    }

    /// The mode of a `custom_mode`.
    pub fn of_custom_mode(custom_mode: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.custom_mode() == custom_mode)
    }

    /// The mode of the second and third parameter of `MAV_CMD_DO_SET_MODE`: a main and a sub mode, as PX4 has them (of its
    /// automatic modes a mission, where the sub mode is left out), or a `custom_mode` and zero, as clients send it that
    /// read one in `AVAILABLE_MODES`. No main mode is as great as a `custom_mode`, and all of those have zeros in their
    /// lower half, which an f32 leaves out.
    pub fn of_numbers(second: f32, third: f32) -> Option<Self> {
        if [second, third] == AUTOMATIC {
            return Some(Self::Mission);
        }
        Self::ALL.into_iter().find(|mode| {
            let whole = [mode.custom_mode() as f32, 0.0];
            [mode.numbers().map(f32::from), whole].contains(&[second, third])
        })
    }

    /// What an autopilot is doing, with an active controller; on the ground, what it is going to do.
    pub const fn of(mode: Mode, controller: Controller) -> Self {
        match (mode, controller) {
            (Mode::TakingOff, _) => Self::TakeOff,
            (Mode::Offboard, _) => Self::Offboard,
            (Mode::Returning, _) => Self::Return,
            (Mode::Landing | Mode::Landed, _) => Self::Land,
            (Mode::Disarmed | Mode::Armed | Mode::Holding | Mode::Guided, Controller::Policy) => Self::Policy,
            (Mode::Disarmed | Mode::Armed | Mode::Holding | Mode::Guided, Controller::Cascade) => Self::Cascade,
        }
    }

    /// Its name; that of the policy follows its own.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Policy => "RL:",
            Self::Cascade => "PID",
            Self::Hold => "Hold",
            Self::Position => "Position",
            Self::Offboard => "Offboard",
            Self::TakeOff => "Takeoff",
            Self::Land => "Land",
            Self::Return => "Return",
            Self::Mission => "Mission",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_tell_modes_apart() {
        for mode in FlightMode::ALL {
            assert_eq!(FlightMode::of_custom_mode(mode.custom_mode()), Some(mode));
            let [main, sub] = mode.numbers().map(f32::from);
            assert_eq!(FlightMode::of_numbers(main, sub), Some(mode));
            let custom_mode = mode.custom_mode() as f32;
            assert_eq!(custom_mode as u32, mode.custom_mode(), "nothing is lost");
            assert_eq!(FlightMode::of_numbers(custom_mode, 0.0), Some(mode));
            assert_eq!(FlightMode::of_numbers(custom_mode, 1.0), None);
        }
        assert_eq!(FlightMode::of_custom_mode(0), None);
        assert_eq!(FlightMode::of_numbers(f32::NAN, 0.0), None);
        assert_eq!(FlightMode::of_numbers(4.0, 0.0), Some(FlightMode::Mission), "as PX4 takes it");
    }

    /// PX4 1.17: the custom mode of its external mode RAPTOR, as recorded from it, and of the offboard mode.
    #[test]
    fn numbers_are_those_of_px4() {
        assert_eq!(FlightMode::Policy.custom_mode(), 0x0b04_0000);
        assert_eq!(FlightMode::Offboard.custom_mode(), 0x0006_0000);
    }
}
