//! What the values of the parameters mean to the vehicle.

use super::Parameters;
use super::table::Parameter;
use crate::settings::{AutopilotSettings, FailsafeAction, FailsafeReaction};

/// What a number of a choice stands for.
type Meaning<T> = &'static [(i32, T)];

/// `COM_OBL_ACT`.
const OFFBOARD_LOSS: Meaning<FailsafeAction> =
    &[(0, FailsafeAction::Hold), (1, FailsafeAction::Land), (2, FailsafeAction::Return)];

/// `NAV_DLL_ACT`.
const LINK_LOSS: Meaning<FailsafeAction> = &[
    (0, FailsafeAction::Nothing),
    (1, FailsafeAction::Hold),
    (2, FailsafeAction::Return),
    (3, FailsafeAction::Land),
];

/// `GF_ACTION`; PX4's 4 ends the flight, which is not offered.
const FENCE: Meaning<FailsafeAction> = &[
    (0, FailsafeAction::Nothing),
    (1, FailsafeAction::Warn),
    (2, FailsafeAction::Hold),
    (3, FailsafeAction::Return),
    (5, FailsafeAction::Land),
];

/// `COM_LOW_BAT_ACT`: what to do when low, critical and nearly empty; PX4 has no 1 any more.
const BATTERY: Meaning<[FailsafeAction; 3]> = &[
    (0, [FailsafeAction::Warn; 3]),
    (2, [FailsafeAction::Warn, FailsafeAction::Land, FailsafeAction::Land]),
    (3, [FailsafeAction::Warn, FailsafeAction::Return, FailsafeAction::Land]),
];

/// `FD_ACTION`.
const UPSET: Meaning<FailsafeReaction> = &[
    (0, FailsafeReaction::only(FailsafeAction::Warn)),
    (1, FailsafeReaction::with_cascade(FailsafeAction::Hold)),
    (2, FailsafeReaction::with_cascade(FailsafeAction::Land)),
    (3, FailsafeReaction::only(FailsafeAction::StopMotors)),
];

/// `RL_FAULT_ACT`.
const POLICY_FAULT: Meaning<FailsafeReaction> = &[
    (1, FailsafeReaction::with_cascade(FailsafeAction::Hold)),
    (2, FailsafeReaction::with_cascade(FailsafeAction::Land)),
];

impl Parameters {
    /// What the values mean.
    pub fn settings(&self) -> AutopilotSettings {
        AutopilotSettings {
            takeoff_altitude_m: self.real(Parameter::MisTakeoffAlt),
            cruise_speed: self.real(Parameter::MpcXyCruise),
            climb_speed: self.real(Parameter::MpcZVAutoUp),
            descent_speed: self.real(Parameter::MpcZVAutoDn),
            landing_speed: self.real(Parameter::MpcLandSpeed),
            return_altitude_m: self.real(Parameter::RtlReturnAlt),
            landed_secs: self.real(Parameter::ComDisarmLand),
            idle_secs: self.real(Parameter::ComDisarmPrflt),
            set_point_stale_secs: self.real(Parameter::RlSpAgeT),
            offboard_loss_secs: self.real(Parameter::ComOfLossT),
            offboard_loss_action: self.meaning(Parameter::ComOblAct, OFFBOARD_LOSS),
            link_loss_secs: self.real(Parameter::ComDlLossT),
            link_loss_action: self.meaning(Parameter::NavDllAct, LINK_LOSS),
            fence_action: self.meaning(Parameter::GfAction, FENCE),
            fence_radius_m: self.unless_zero(Parameter::GfMaxHorDist),
            fence_height_m: self.unless_zero(Parameter::GfMaxVerDist),
            battery_levels: [Parameter::BatLowThr, Parameter::BatCritThr, Parameter::BatEmergenThr]
                .map(|parameter| self.real(parameter)),
            battery_actions: self.meaning(Parameter::ComLowBatAct, BATTERY),
            battery_drain_secs: self.unless_zero(Parameter::SimBatDrain),
            battery_least: self.real(Parameter::SimBatMinPct) / 100.0,
            tilt_limit_rad: self.real(Parameter::FdFailTilt).to_radians(),
            tilt_secs: self.real(Parameter::FdFailTiltT),
            rate_limit: self.real(Parameter::FdFailRate),
            rate_secs: self.real(Parameter::FdFailRateT),
            upset_reaction: self.meaning(Parameter::FdAction, UPSET),
            silence_secs: self.real(Parameter::RlLateT),
            saturation_secs: self.real(Parameter::RlSatT),
            policy_reaction: self.meaning(Parameter::RlFaultAct, POLICY_FAULT),
            clearance_secs: self.unless_zero(Parameter::RlClearT),
            compensates_rotors: self.integer(Parameter::RlCompRotors) == 1,
        }
    }

    /// Whether one client at a time is obeyed.
    pub fn has_one_operator(&self) -> bool {
        self.integer(Parameter::RlOneOperator) == 1
    }

    fn meaning<T: Copy>(&self, parameter: Parameter, meaning: Meaning<T>) -> T {
        let number = self.integer(parameter);
        let (_, meant) =
            meaning.iter().find(|(known, _)| *known == number).expect("the table offers what has a meaning");
        *meant
    }

    fn unless_zero(&self, parameter: Parameter) -> Option<f32> {
        Some(self.real(parameter)).filter(|value| *value > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::ParameterValue;
    use super::super::table::Domain;
    use super::*;

    #[test]
    fn every_number_that_the_table_offers_has_a_meaning() {
        let mut parameters = Parameters::new(1);
        for parameter in Parameter::ALL {
            if let Domain::Choice { choices, .. } = parameter.definition().domain {
                for number in choices {
                    parameters.set(parameter, ParameterValue::Integer(*number)).unwrap();
                    parameters.settings();
                }
            }
        }
    }

    #[test]
    fn defaults_are_those_of_the_settings() {
        let settings = Parameters::new(7).settings();
        let expected =
            AutopilotSettings { tilt_limit_rad: settings.tilt_limit_rad, ..AutopilotSettings::default() };
        assert_eq!(settings, expected);
        assert!((settings.tilt_limit_rad - core::f32::consts::FRAC_PI_3).abs() < 1e-6);
    }

    #[test]
    fn every_parameter_but_who_it_is_and_whom_it_obeys_changes_the_settings() {
        let before = Parameters::new(1);
        for parameter in Parameter::ALL {
            let mut after = before.clone();
            let other = match before.get(parameter) {
                ParameterValue::Real(value) => ParameterValue::Real(value + 0.01),
                ParameterValue::Integer(_) if parameter == Parameter::ComLowBatAct => ParameterValue::Integer(0),
                ParameterValue::Integer(_) if parameter == Parameter::RlCompRotors => ParameterValue::Integer(1),
                ParameterValue::Integer(value) => ParameterValue::Integer([2, 1][usize::from(value == 2)]),
            };
            if parameter == Parameter::RlOneOperator {
                after.set(parameter, ParameterValue::Integer(0)).unwrap();
                assert_ne!(after.has_one_operator(), before.has_one_operator());
            } else if after.set(parameter, other).is_ok() {
                assert_ne!(after.settings(), before.settings(), "{parameter}");
            } else {
                assert_eq!(parameter, Parameter::SysId);
            }
        }
    }
}
