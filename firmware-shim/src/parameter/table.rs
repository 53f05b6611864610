//! What parameters there are.

use super::ParameterValue;

/// How many there are.
pub const PARAMETERS: usize = Parameter::ALL.len();

/// Bytes of a name in messages.
pub const NAME_LEN: usize = 16;

/// A parameter; its place in this list, which is that of its name in the alphabet, is its index in messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parameter {
    /// `BAT_CRIT_THR`.
    BatCritThr,
    /// `BAT_EMERGEN_THR`.
    BatEmergenThr,
    /// `BAT_LOW_THR`.
    BatLowThr,
    /// `COM_DISARM_LAND`.
    ComDisarmLand,
    /// `COM_DISARM_PRFLT`.
    ComDisarmPrflt,
    /// `COM_DL_LOSS_T`.
    ComDlLossT,
    /// `COM_LOW_BAT_ACT`.
    ComLowBatAct,
    /// `COM_OBL_ACT`.
    ComOblAct,
    /// `COM_OF_LOSS_T`.
    ComOfLossT,
    /// `FD_ACTION`.
    FdAction,
    /// `FD_FAIL_RATE`.
    FdFailRate,
    /// `FD_FAIL_RATE_T`.
    FdFailRateT,
    /// `FD_FAIL_TILT`.
    FdFailTilt,
    /// `FD_FAIL_TILT_T`.
    FdFailTiltT,
    /// `GF_ACTION`.
    GfAction,
    /// `GF_MAX_HOR_DIST`.
    GfMaxHorDist,
    /// `GF_MAX_VER_DIST`.
    GfMaxVerDist,
    /// `MIS_TAKEOFF_ALT`.
    MisTakeoffAlt,
    /// `MPC_LAND_SPEED`.
    MpcLandSpeed,
    /// `MPC_XY_CRUISE`.
    MpcXyCruise,
    /// `MPC_Z_V_AUTO_DN`.
    MpcZVAutoDn,
    /// `MPC_Z_V_AUTO_UP`.
    MpcZVAutoUp,
    /// `NAV_DLL_ACT`.
    NavDllAct,
    /// `RL_CLEAR_T`.
    RlClearT,
    /// `RL_COMP_ROTORS`.
    RlCompRotors,
    /// `RL_FAULT_ACT`.
    RlFaultAct,
    /// `RL_LATE_T`.
    RlLateT,
    /// `RL_ONE_OPERATOR`.
    RlOneOperator,
    /// `RL_SAT_T`.
    RlSatT,
    /// `RL_SP_AGE_T`.
    RlSpAgeT,
    /// `RTL_RETURN_ALT`.
    RtlReturnAlt,
    /// `SIM_BAT_DRAIN`.
    SimBatDrain,
    /// `SIM_BAT_MIN_PCT`.
    SimBatMinPct,
    /// `SYS_ID`.
    SysId,
}

/// What a parameter is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterDefinition {
    /// At most 16 bytes, as in messages and files.
    pub name: &'static str,
    /// Type, default and allowed values.
    pub domain: Domain,
    /// Unit, in PX4's words; empty without one.
    pub unit: &'static str,
    /// Whether peers may set it.
    pub access: Access,
    /// Meaning in one sentence.
    pub description: &'static str,
}

/// Allowed values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Domain {
    /// Any number of a range.
    Real {
        /// Before anybody sets it.
        default: f32,
        /// Smallest.
        least: f32,
        /// Greatest.
        greatest: f32,
    },
    /// Any whole number of a range.
    Integer {
        /// Before anybody sets it.
        default: i32,
        /// Smallest.
        least: i32,
        /// Greatest.
        greatest: i32,
    },
    /// One of a few whole numbers.
    Choice {
        /// Before anybody sets it.
        default: i32,
        /// All of them.
        choices: &'static [i32],
    },
}

/// `MAV_PARAM_TYPE`, of which two suffice here as they do for PX4.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterType {
    /// `MAV_PARAM_TYPE_INT32`.
    Int32 = 6,
    /// `MAV_PARAM_TYPE_REAL32`.
    Real32 = 9,
}

/// Whether peers may set a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// They may.
    ReadWrite,
    /// They may only ask for it.
    ReadOnly,
}

impl Parameter {
    /// All of them, by index.
    pub const ALL: [Self; 34] = [
        Self::BatCritThr,
        Self::BatEmergenThr,
        Self::BatLowThr,
        Self::ComDisarmLand,
        Self::ComDisarmPrflt,
        Self::ComDlLossT,
        Self::ComLowBatAct,
        Self::ComOblAct,
        Self::ComOfLossT,
        Self::FdAction,
        Self::FdFailRate,
        Self::FdFailRateT,
        Self::FdFailTilt,
        Self::FdFailTiltT,
        Self::GfAction,
        Self::GfMaxHorDist,
        Self::GfMaxVerDist,
        Self::MisTakeoffAlt,
        Self::MpcLandSpeed,
        Self::MpcXyCruise,
        Self::MpcZVAutoDn,
        Self::MpcZVAutoUp,
        Self::NavDllAct,
        Self::RlClearT,
        Self::RlCompRotors,
        Self::RlFaultAct,
        Self::RlLateT,
        Self::RlOneOperator,
        Self::RlSatT,
        Self::RlSpAgeT,
        Self::RtlReturnAlt,
        Self::SimBatDrain,
        Self::SimBatMinPct,
        Self::SysId,
    ];

    /// What it is.
    pub const fn definition(self) -> &'static ParameterDefinition {
        &TABLE[self as usize]
    }

    /// The parameter at an index of messages.
    pub fn at(index: usize) -> Option<Self> {
        Self::ALL.get(index).copied()
    }

    /// The parameter of a name.
    pub fn named(name: &str) -> Option<Self> {
        TABLE.binary_search_by(|definition| definition.name.cmp(name)).ok().and_then(Self::at)
    }
}

impl core::fmt::Display for Parameter {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(self.definition().name)
    }
}

impl Domain {
    /// The type of its values.
    pub const fn kind(&self) -> ParameterType {
        self.default().kind()
    }

    /// The value before anybody sets it.
    pub const fn default(&self) -> ParameterValue {
        match *self {
            Self::Real { default, .. } => ParameterValue::Real(default),
            Self::Integer { default, .. } | Self::Choice { default, .. } => ParameterValue::Integer(default),
        }
    }
}

impl core::fmt::Display for Domain {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Real { least, greatest, .. } => write!(formatter, "{least} to {greatest}"),
            Self::Integer { least, greatest, .. } => write!(formatter, "{least} to {greatest}"),
            Self::Choice { choices, .. } => write!(formatter, "one of {choices:?}"),
        }
    }
}

impl ParameterType {
    /// Of the number in messages and files; none if no parameter here has this type.
    pub const fn numbered(number: u8) -> Option<Self> {
        match number {
            6 => Some(Self::Int32),
            9 => Some(Self::Real32),
            _ => None,
        }
    }
}

impl core::fmt::Display for ParameterType {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        formatter.write_str(match self {
            Self::Int32 => "INT32",
            Self::Real32 => "REAL32",
        })
    }
}

const fn real(
    name: &'static str,
    unit: &'static str,
    [least, default, greatest]: [f32; 3],
    description: &'static str,
) -> ParameterDefinition {
    let domain = Domain::Real { default, least, greatest };
    ParameterDefinition { name, domain, unit, access: Access::ReadWrite, description }
}

const fn choice(
    name: &'static str,
    default: i32,
    choices: &'static [i32],
    description: &'static str,
) -> ParameterDefinition {
    ParameterDefinition {
        name,
        domain: Domain::Choice { default, choices },
        unit: "",
        access: Access::ReadWrite,
        description,
    }
}

const fn fixed(
    name: &'static str,
    [least, default, greatest]: [i32; 3],
    description: &'static str,
) -> ParameterDefinition {
    let domain = Domain::Integer { default, least, greatest };
    ParameterDefinition { name, domain, unit: "", access: Access::ReadOnly, description }
}

/// By index. Each row of a number: least, default, greatest. Bounds that PX4 has are PX4's or, where a drone of 30 g
/// in a room flies lower and slower, scaled to it.
const TABLE: [ParameterDefinition; PARAMETERS] = [
    real("BAT_CRIT_THR", "norm", [0.05, 0.07, 0.5], "Charge below which the battery is critical."),
    real("BAT_EMERGEN_THR", "norm", [0.03, 0.05, 0.5], "Charge below which the battery is an emergency."),
    real("BAT_LOW_THR", "norm", [0.12, 0.15, 0.5], "Charge below which the battery is low."),
    real(
        "COM_DISARM_LAND",
        "s",
        [0.1, 2.0, 60.0],
        "Time on the ground after a landing before the drone is disarmed.",
    ),
    real("COM_DISARM_PRFLT", "s", [1.0, 10.0, 600.0], "Time for which the drone stays armed without a take-off."),
    real("COM_DL_LOSS_T", "s", [1.0, 10.0, 300.0], "Silence after which the ground station counts as lost."),
    choice(
        "COM_LOW_BAT_ACT",
        3,
        &[0, 2, 3],
        "Battery: 0 warn, 2 land when critical, 3 return when critical and land in an emergency.",
    ),
    choice(
        "COM_OBL_ACT",
        0,
        &[0, 1, 2],
        "When the set-points of a client that steers by a stream stop: 0 hold, 1 land, 2 return.",
    ),
    real("COM_OF_LOSS_T", "s", [0.1, 1.0, 60.0], "Silence after which a stream of set-points counts as stopped."),
    choice(
        "FD_ACTION",
        2,
        &[0, 1, 2, 3],
        "Attitude failure: 0 warn, 1 fly on with the PID, 2 land with the PID, 3 stop the motors.",
    ),
    real("FD_FAIL_RATE", "rad/s", [1.0, 15.0, 100.0], "Body rate beyond which the attitude has failed."),
    real("FD_FAIL_RATE_T", "s", [0.02, 0.3, 5.0], "Time for which the body rate must be beyond FD_FAIL_RATE."),
    real("FD_FAIL_TILT", "deg", [20.0, 60.0, 180.0], "Tilt beyond which the attitude has failed."),
    real("FD_FAIL_TILT_T", "s", [0.02, 0.3, 5.0], "Time for which the tilt must be beyond FD_FAIL_TILT."),
    choice("GF_ACTION", 2, &[0, 1, 2, 3, 5], "Outside the fence: 0 nothing, 1 warn, 2 hold, 3 return, 5 land."),
    real("GF_MAX_HOR_DIST", "m", [0.0, 0.0, 10000.0], "Radius of the fence around home; 0 switches it off."),
    real("GF_MAX_VER_DIST", "m", [0.0, 0.0, 10000.0], "Height of the fence above home; 0 switches it off."),
    real("MIS_TAKEOFF_ALT", "m", [0.2, 1.0, 20.0], "Height of a take-off whose altitude is left open."),
    real("MPC_LAND_SPEED", "m/s", [0.05, 0.3, 1.0], "Speed of a landing."),
    real("MPC_XY_CRUISE", "m/s", [0.05, 0.5, 3.0], "Speed on the way to a point."),
    real("MPC_Z_V_AUTO_DN", "m/s", [0.05, 1.0, 2.0], "Speed of sinking to two metres above home."),
    real("MPC_Z_V_AUTO_UP", "m/s", [0.05, 0.5, 2.0], "Speed of a take-off."),
    choice(
        "NAV_DLL_ACT",
        3,
        &[0, 1, 2, 3],
        "When the ground station is lost: 0 nothing, 1 hold, 2 return, 3 land.",
    ),
    real(
        "RL_CLEAR_T",
        "s",
        [0.0, 0.0, 5.0],
        "Time to what rangers see, at the speed of now, below which the PID brakes and holds; 0 never.",
    ),
    choice(
        "RL_COMP_ROTORS",
        0,
        &[0, 1],
        "Weak rotors: 1 learn in flight how weak, and drive them harder, 0 do not, and forget it.",
    ),
    choice(
        "RL_FAULT_ACT",
        1,
        &[1, 2],
        "When the policy fails: 1 fly on with the PID and hold, 2 land with the PID.",
    ),
    real("RL_LATE_T", "s", [0.001, 0.02, 1.0], "Delay of an answer of the policy that counts as a fault."),
    choice("RL_ONE_OPERATOR", 1, &[0, 1], "Who is obeyed: 1 one client at a time, 0 whoever commands last."),
    real("RL_SAT_T", "s", [0.05, 0.5, 10.0], "Time of saturated motors that counts as a fault of the policy."),
    real("RL_SP_AGE_T", "s", [0.02, 0.6, 60.0], "Age of a set-point beyond which the policy is told to hold."),
    real("RTL_RETURN_ALT", "m", [0.2, 1.5, 20.0], "Height of the way home."),
    real(
        "SIM_BAT_DRAIN",
        "s",
        [0.0, 0.0, 86400.0],
        "Flight time that empties the simulated battery; 0 never does.",
    ),
    real("SIM_BAT_MIN_PCT", "%", [0.0, 50.0, 100.0], "Charge at which the simulated battery stops emptying."),
    fixed("SYS_ID", [1, 1, 250], "MAVLink system of this vehicle."),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_fit_messages_and_are_in_the_order_of_the_alphabet() {
        for pair in TABLE.windows(2) {
            assert!(pair[0].name < pair[1].name, "{} {}", pair[0].name, pair[1].name);
        }
        assert!(TABLE.iter().all(|definition| (1..=NAME_LEN).contains(&definition.name.len())));
    }

    #[test]
    fn every_parameter_has_the_row_of_its_name() {
        for (index, parameter) in Parameter::ALL.into_iter().enumerate() {
            let letters = parameter.definition().name.replace('_', "").to_lowercase();
            assert_eq!(letters, format!("{parameter:?}").to_lowercase());
            assert_eq!(parameter as usize, index);
            assert_eq!(Parameter::at(index), Some(parameter));
            assert_eq!(Parameter::named(parameter.definition().name), Some(parameter));
        }
        assert_eq!(Parameter::named("NOTHING"), None);
        assert_eq!(Parameter::at(PARAMETERS), None);
    }

    #[test]
    fn the_page_about_software_in_the_loop_lists_them_all() {
        let page = include_str!("../../../docs/software-in-the-loop.md");
        for ParameterDefinition { name, description, domain, .. } in TABLE {
            let row = page.lines().find(|line| line.starts_with(&format!("| `{name}` |"))).expect(name);
            assert!(row.contains(description), "{row}");
            match domain {
                Domain::Real { .. } => {
                    assert!(row.contains(&format!("| {domain} |")), "{row} instead of {domain}");
                }
                Domain::Choice { default, .. } => assert!(row.contains(&format!("| {default} |")), "{row}"),
                Domain::Integer { .. } => assert!(row.contains("read-only"), "{row}"),
            }
        }
    }

    #[test]
    fn defaults_are_allowed_and_texts_are_sentences() {
        for ParameterDefinition { name, domain, description, .. } in TABLE {
            let allowed = match domain {
                Domain::Real { default, least, greatest } => (least..=greatest).contains(&default),
                Domain::Integer { default, least, greatest } => (least..=greatest).contains(&default),
                Domain::Choice { default, choices } => choices.contains(&default),
            };
            assert!(allowed, "{name}");
            assert!(description.ends_with('.') && !description.contains(". "), "{name}");
        }
    }
}
