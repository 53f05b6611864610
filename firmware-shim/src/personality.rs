//! Which autopilot the vehicle says it is, and how that one numbers its modes: clients offer what they know of it.
//!
//! By default it says that it is PX4, whose modes, parameters and commands it has: so QGroundControl offers its guided actions,
//! and MAVSDK knows its modes.

use mavlink::dialects::common::MavAutopilot;

use crate::flight_mode::FlightMode;

/// Which autopilot the vehicle says it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Personality {
    /// PX4: modes have its numbers; who holds in the air is told to hold, whoever flies
    #[default]
    Px4,
    /// `ArduPilot`'s copter: modes have its numbers, and in GUIDED velocities are followed at once
    Ardupilot,
    /// None that clients know: modes have PX4's numbers, and the policy's own is told
    Generic,
}

/// Numbers of `ArduCopter`'s modes, of those that are like ours.
const ARDUCOPTER: [(u32, FlightMode); 7] = [
    (4, FlightMode::Policy),   // GUIDED
    (16, FlightMode::Cascade), // POSHOLD
    (5, FlightMode::Position), // LOITER
    (17, FlightMode::Hold),    // BRAKE
    (9, FlightMode::Land),
    (6, FlightMode::Return),  // RTL
    (3, FlightMode::Mission), // AUTO
];

impl Personality {
    /// `MAV_AUTOPILOT` of its heartbeats.
    pub const fn autopilot(self) -> MavAutopilot {
        match self {
            Self::Px4 => MavAutopilot::MAV_AUTOPILOT_PX4,
            Self::Ardupilot => MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
            Self::Generic => MavAutopilot::MAV_AUTOPILOT_GENERIC,
        }
    }

    /// The modes that it lists, each with a number of its own.
    pub fn listed(self) -> Vec<FlightMode> {
        match self {
            Self::Px4 | Self::Generic => FlightMode::ALL.to_vec(),
            Self::Ardupilot => ARDUCOPTER.iter().map(|(_, mode)| *mode).collect(),
        }
    }

    /// `custom_mode` of a mode.
    pub fn custom_mode(self, mode: FlightMode) -> u32 {
        match self {
            Self::Px4 | Self::Generic => mode.custom_mode(),
            Self::Ardupilot => {
                let guided = [FlightMode::Offboard, FlightMode::TakeOff].contains(&mode);
                let listed = if guided { FlightMode::Policy } else { mode };
                ARDUCOPTER.iter().find(|(_, mode)| *mode == listed).map_or(0, |(number, _)| *number)
            }
        }
    }

    /// The mode that is told of one that is flown: PX4's own clients know none of a policy.
    pub fn told(self, mode: FlightMode) -> FlightMode {
        if self == Self::Px4 && mode == FlightMode::Policy { FlightMode::Hold } else { mode }
    }

    /// The mode of a `custom_mode`.
    pub fn of_custom_mode(self, custom_mode: u32) -> Option<FlightMode> {
        match self {
            Self::Px4 | Self::Generic => FlightMode::of_custom_mode(custom_mode),
            // PX4's whole numbers are greater than any of `ArduCopter`'s: they are understood, too.
            Self::Ardupilot => {
                let listed = ARDUCOPTER.iter().find(|(number, _)| *number == custom_mode);
                listed.map(|(_, mode)| *mode).or_else(|| FlightMode::of_custom_mode(custom_mode))
            }
        }
    }

    /// The mode of the second and third parameter of `MAV_CMD_DO_SET_MODE`.
    pub fn of_numbers(self, second: f32, third: f32) -> Option<FlightMode> {
        match self {
            Self::Px4 | Self::Generic => FlightMode::of_numbers(second, third),
            // What is no whole number becomes another one.
            Self::Ardupilot => self.of_custom_mode(second as u32).filter(|_| second == libm::truncf(second)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Personality; 3] = [Personality::Px4, Personality::Ardupilot, Personality::Generic];

    #[test]
    fn listed_modes_are_chosen_by_their_numbers() {
        for personality in ALL {
            for mode in personality.listed() {
                let custom_mode = personality.custom_mode(mode);
                assert_eq!(personality.of_custom_mode(custom_mode), Some(mode), "{personality:?}");
                assert_eq!(personality.of_numbers(custom_mode as f32, 0.0), Some(mode), "{personality:?}");
            }
            assert_eq!(personality.of_custom_mode(0), None);
            assert_eq!(personality.of_numbers(f32::NAN, 0.0), None);
        }
    }

    /// What pymavlink's `mode_mapping_acm` has.
    #[test]
    fn guided_is_arducopters_mode_of_whatever_clients_steer() {
        for mode in [FlightMode::Policy, FlightMode::Offboard, FlightMode::TakeOff] {
            assert_eq!(Personality::Ardupilot.custom_mode(mode), 4);
        }
        assert_eq!(Personality::Ardupilot.of_numbers(6.0, 0.0), Some(FlightMode::Return));
        let whole = FlightMode::Offboard.custom_mode();
        assert_eq!(Personality::Ardupilot.of_custom_mode(whole), Some(FlightMode::Offboard));
        assert_eq!(Personality::Px4.of_numbers(6.0, 0.0), Some(FlightMode::Offboard));
    }

    #[test]
    fn clients_of_px4_are_told_that_a_policy_holds() {
        assert_eq!(Personality::Px4.told(FlightMode::Policy), FlightMode::Hold);
        assert_eq!(Personality::Px4.told(FlightMode::Cascade), FlightMode::Cascade);
        assert_eq!(Personality::Generic.told(FlightMode::Policy), FlightMode::Policy);
    }
}
