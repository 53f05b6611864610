//! What the values of the parameters mean to the vehicle: SI units, and an enum for every choice.

use super::Parameters;
use super::table::Parameter;

/// All parameters, checked and typed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// MAVLink system of the vehicle.
    pub system: u8,
    /// Height of a take-off whose altitude is left open \[m\].
    pub takeoff_altitude_m: f32,
    /// Speed on the way to a point \[m/s\].
    pub cruise_speed: f32,
    /// Speed of a take-off \[m/s\].
    pub climb_speed: f32,
    /// Speed of a landing \[m/s\].
    pub landing_speed: f32,
    /// Height of the way home \[m\].
    pub return_altitude_m: f32,
    /// Time on the ground after a landing before disarming \[s\].
    pub landed_disarm_secs: f32,
    /// Time for which the drone stays armed without a take-off \[s\].
    pub idle_disarm_secs: f32,
    /// Set-points that stop.
    pub set_point_loss: SetPointLoss,
    /// A ground station that falls silent.
    pub ground_station_loss: GroundStationLoss,
    /// The fence.
    pub fence: FenceSettings,
    /// The battery.
    pub battery: BatterySettings,
    /// An attitude that fails.
    pub failure: FailureSettings,
    /// A policy that fails.
    pub policy: PolicySettings,
}

/// When the set-points of a client that steers by a stream stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetPointLoss {
    /// Silence that counts \[s\].
    pub timeout_secs: f32,
    /// What happens then.
    pub action: SetPointLossAction,
}

/// When no ground station is heard.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundStationLoss {
    /// Silence that counts \[s\].
    pub timeout_secs: f32,
    /// What happens then.
    pub action: GroundStationLossAction,
}

/// The fence that parameters make; zones are uploaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FenceSettings {
    /// What happens outside.
    pub action: FenceAction,
    /// Greatest horizontal distance from home \[m\], if any.
    pub radius_m: Option<f32>,
    /// Greatest height above home \[m\], if any.
    pub height_m: Option<f32>,
}

/// The simulated battery; charges are shares of a full one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatterySettings {
    /// What happens when it empties.
    pub action: BatteryAction,
    /// Low below this.
    pub low: f32,
    /// Critical below this.
    pub critical: f32,
    /// An emergency below this.
    pub emergency: f32,
    /// Flight time that empties it \[s\]; none if it never empties.
    pub drain_secs: Option<f32>,
    /// Charge at which it stops emptying.
    pub least: f32,
}

/// When the attitude counts as lost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FailureSettings {
    /// What happens then.
    pub action: FailureAction,
    /// Greatest tilt \[rad\].
    pub tilt_rad: f32,
    /// Time beyond it \[s\].
    pub tilt_secs: f32,
    /// Greatest body rate \[rad/s\].
    pub body_rate: f32,
    /// Time beyond it \[s\].
    pub body_rate_secs: f32,
}

/// When the policy counts as faulty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PolicySettings {
    /// What happens then.
    pub action: PolicyFaultAction,
    /// Delay of an answer \[s\].
    pub late_secs: f32,
    /// Time of saturated motors \[s\].
    pub saturation_secs: f32,
    /// Age of a set-point beyond which the policy is told to hold \[s\].
    pub set_point_age_secs: f32,
}

/// `COM_OBL_ACT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SetPointLossAction {
    /// Stay here.
    Hold = 0,
    /// Land here.
    Land = 1,
    /// Fly home and land.
    Return = 2,
}

/// `NAV_DLL_ACT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroundStationLossAction {
    /// Fly on.
    Nothing = 0,
    /// Stay here.
    Hold = 1,
    /// Fly home and land.
    Return = 2,
    /// Land here.
    Land = 3,
}

/// `GF_ACTION`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FenceAction {
    /// Fly on in silence.
    Nothing = 0,
    /// Fly on and say so.
    Warn = 1,
    /// Stay here.
    Hold = 2,
    /// Fly home and land.
    Return = 3,
    /// Land here.
    Land = 5,
}

/// `COM_LOW_BAT_ACT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BatteryAction {
    /// Only say so.
    Warn = 0,
    /// Land when critical.
    Land = 2,
    /// Fly home when critical, land in an emergency.
    ReturnOrLand = 3,
}

/// `FD_ACTION`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FailureAction {
    /// Only say so.
    Warn = 0,
    /// Fly on with the PID instead of the policy.
    FlyOn = 1,
    /// Land with the PID.
    Land = 2,
    /// Fall.
    StopMotors = 3,
}

/// `RL_FAULT_ACT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PolicyFaultAction {
    /// Hold with the PID.
    Hold = 1,
    /// Land with the PID.
    Land = 2,
}

impl SetPointLossAction {
    /// Their numbers.
    pub const NUMBERS: &'static [i32] = &[0, 1, 2];

    fn numbered(number: i32) -> Self {
        match number {
            1 => Self::Land,
            2 => Self::Return,
            _ => Self::Hold,
        }
    }
}

impl GroundStationLossAction {
    /// Their numbers.
    pub const NUMBERS: &'static [i32] = &[0, 1, 2, 3];

    fn numbered(number: i32) -> Self {
        match number {
            0 => Self::Nothing,
            1 => Self::Hold,
            2 => Self::Return,
            _ => Self::Land,
        }
    }
}

impl FenceAction {
    /// Their numbers; PX4's 4 ends the flight, which is not offered.
    pub const NUMBERS: &'static [i32] = &[0, 1, 2, 3, 5];

    fn numbered(number: i32) -> Self {
        match number {
            0 => Self::Nothing,
            1 => Self::Warn,
            3 => Self::Return,
            5 => Self::Land,
            _ => Self::Hold,
        }
    }
}

impl BatteryAction {
    /// Their numbers; PX4 has no 1 any more.
    pub const NUMBERS: &'static [i32] = &[0, 2, 3];

    fn numbered(number: i32) -> Self {
        match number {
            0 => Self::Warn,
            2 => Self::Land,
            _ => Self::ReturnOrLand,
        }
    }
}

impl FailureAction {
    /// Their numbers.
    pub const NUMBERS: &'static [i32] = &[0, 1, 2, 3];

    fn numbered(number: i32) -> Self {
        match number {
            0 => Self::Warn,
            1 => Self::FlyOn,
            3 => Self::StopMotors,
            _ => Self::Land,
        }
    }
}

impl PolicyFaultAction {
    /// Their numbers.
    pub const NUMBERS: &'static [i32] = &[1, 2];

    fn numbered(number: i32) -> Self {
        match number {
            2 => Self::Land,
            _ => Self::Hold,
        }
    }
}

impl Parameters {
    /// What the values mean. The domains of the table leave no number without a meaning.
    pub fn settings(&self) -> Settings {
        Settings {
            system: self.integer(Parameter::SysId) as u8,
            takeoff_altitude_m: self.real(Parameter::MisTakeoffAlt),
            cruise_speed: self.real(Parameter::MpcXyCruise),
            climb_speed: self.real(Parameter::MpcZVAutoUp),
            landing_speed: self.real(Parameter::MpcLandSpeed),
            return_altitude_m: self.real(Parameter::RtlReturnAlt),
            landed_disarm_secs: self.real(Parameter::ComDisarmLand),
            idle_disarm_secs: self.real(Parameter::ComDisarmPrflt),
            set_point_loss: SetPointLoss {
                timeout_secs: self.real(Parameter::ComOfLossT),
                action: SetPointLossAction::numbered(self.integer(Parameter::ComOblAct)),
            },
            ground_station_loss: GroundStationLoss {
                timeout_secs: self.real(Parameter::ComDlLossT),
                action: GroundStationLossAction::numbered(self.integer(Parameter::NavDllAct)),
            },
            fence: FenceSettings {
                action: FenceAction::numbered(self.integer(Parameter::GfAction)),
                radius_m: self.unless_zero(Parameter::GfMaxHorDist),
                height_m: self.unless_zero(Parameter::GfMaxVerDist),
            },
            battery: self.battery(),
            failure: self.failure(),
            policy: PolicySettings {
                action: PolicyFaultAction::numbered(self.integer(Parameter::RlFaultAct)),
                late_secs: self.real(Parameter::RlLateT),
                saturation_secs: self.real(Parameter::RlSatT),
                set_point_age_secs: self.real(Parameter::RlSpAgeT),
            },
        }
    }

    fn battery(&self) -> BatterySettings {
        BatterySettings {
            action: BatteryAction::numbered(self.integer(Parameter::ComLowBatAct)),
            low: self.real(Parameter::BatLowThr),
            critical: self.real(Parameter::BatCritThr),
            emergency: self.real(Parameter::BatEmergenThr),
            drain_secs: self.unless_zero(Parameter::SimBatDrain),
            least: self.real(Parameter::SimBatMinPct) / 100.0,
        }
    }

    fn failure(&self) -> FailureSettings {
        FailureSettings {
            action: FailureAction::numbered(self.integer(Parameter::FdAction)),
            tilt_rad: self.real(Parameter::FdFailTilt).to_radians(),
            tilt_secs: self.real(Parameter::FdFailTiltT),
            body_rate: self.real(Parameter::FdFailRate),
            body_rate_secs: self.real(Parameter::FdFailRateT),
        }
    }

    fn unless_zero(&self, parameter: Parameter) -> Option<f32> {
        Some(self.real(parameter)).filter(|value| *value > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::super::Value;
    use super::*;

    #[test]
    fn every_number_of_a_choice_is_the_action_of_that_number() {
        let numbers = |numbers: &[i32], action: fn(i32) -> i32| {
            for number in numbers {
                assert_eq!(action(*number), *number);
            }
        };
        numbers(SetPointLossAction::NUMBERS, |number| SetPointLossAction::numbered(number) as i32);
        numbers(GroundStationLossAction::NUMBERS, |number| GroundStationLossAction::numbered(number) as i32);
        numbers(FenceAction::NUMBERS, |number| FenceAction::numbered(number) as i32);
        numbers(BatteryAction::NUMBERS, |number| BatteryAction::numbered(number) as i32);
        numbers(FailureAction::NUMBERS, |number| FailureAction::numbered(number) as i32);
        numbers(PolicyFaultAction::NUMBERS, |number| PolicyFaultAction::numbered(number) as i32);
    }

    #[test]
    fn defaults_switch_off_the_fence_and_the_drain_of_the_battery() {
        let settings = Parameters::new(7).settings();
        assert_eq!(settings.system, 7);
        assert_eq!(
            (settings.fence.radius_m, settings.fence.height_m, settings.battery.drain_secs),
            (None, None, None)
        );
        assert_eq!(settings.ground_station_loss.action, GroundStationLossAction::Land);
        assert!((settings.failure.tilt_rad - core::f32::consts::FRAC_PI_3).abs() < 1e-6);
    }

    #[test]
    fn every_parameter_but_the_system_changes_the_settings() {
        let before = Parameters::new(1);
        for parameter in Parameter::ALL {
            let mut after = before.clone();
            let other = match before.get(parameter) {
                Value::Real(value) => Value::Real(value + 0.01),
                Value::Integer(_) if parameter == Parameter::ComLowBatAct => Value::Integer(0),
                Value::Integer(value) => Value::Integer([2, 1][usize::from(value == 2)]),
            };
            if after.set(parameter, other).is_ok() {
                assert_ne!(after.settings(), before.settings(), "{parameter}");
            } else {
                assert_eq!(parameter, Parameter::SysId);
            }
        }
    }
}
