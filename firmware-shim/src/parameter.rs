//! The parameters of a vehicle: a closed table, their values, and MAVLink's protocol around them.
//!
//! [`table`] says what there is, [`settings`] what the values mean to the vehicle, [`received`] and [`sent`] know the
//! messages, [`protocol`] answers them, [`text`] and [`mod@file`] keep the values. Names and meanings are PX4's where
//! it has them; integers travel bytewise in the float of a message, as with PX4.

pub mod file;
pub mod protocol;
pub mod received;
pub mod sent;
pub mod settings;
pub mod table;
pub mod text;

use table::{Access, Domain, PARAMETERS, Parameter, ParameterType};

/// A value, in the type of its parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ParameterValue {
    /// `REAL32`.
    Real(f32),
    /// `INT32`.
    Integer(i32),
}

/// Why a parameter keeps its value.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ParameterRefusal {
    /// It says what the vehicle is and cannot be chosen.
    #[error("{parameter} is read-only")]
    ReadOnly {
        /// Which one.
        parameter: Parameter,
    },
    /// The value has the other type.
    #[error("{parameter}: expected a value of type {expected}, found {found}")]
    Type {
        /// Which one.
        parameter: Parameter,
        /// Its type.
        expected: ParameterType,
        /// Of the value.
        found: ParameterType,
    },
    /// The value is none of those allowed, or no number.
    #[error("{parameter}: expected {}, found {found}", parameter.definition().domain)]
    Range {
        /// Which one.
        parameter: Parameter,
        /// The value.
        found: ParameterValue,
    },
}

/// The values of all parameters, each within its domain.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    values: [ParameterValue; PARAMETERS],
}

impl ParameterValue {
    /// The type of its parameter.
    pub const fn kind(self) -> ParameterType {
        match self {
            Self::Real(_) => ParameterType::Real32,
            Self::Integer(_) => ParameterType::Int32,
        }
    }

    /// The four bytes in the float of a message.
    pub const fn to_bytes(self) -> [u8; 4] {
        match self {
            Self::Real(value) => value.to_le_bytes(),
            Self::Integer(value) => value.to_le_bytes(),
        }
    }

    /// Of the four bytes in the float of a message.
    pub const fn from_bytes(kind: ParameterType, bytes: [u8; 4]) -> Self {
        match kind {
            ParameterType::Real32 => Self::Real(f32::from_le_bytes(bytes)),
            ParameterType::Int32 => Self::Integer(i32::from_le_bytes(bytes)),
        }
    }
}

impl core::fmt::Display for ParameterValue {
    fn fmt(&self, formatter: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Real(value) => value.fmt(formatter),
            Self::Integer(value) => value.fmt(formatter),
        }
    }
}

impl Parameters {
    /// The defaults, for MAVLink system `system`.
    pub fn new(system: u8) -> Self {
        let mut values = Parameter::ALL.map(|parameter| parameter.definition().domain.default());
        values[Parameter::SysId as usize] = ParameterValue::Integer(system.into());
        Self { values }
    }

    /// The value of a parameter.
    pub fn get(&self, parameter: Parameter) -> ParameterValue {
        self.values[parameter as usize]
    }

    /// Gives a parameter a value.
    ///
    /// # Errors
    /// Why it keeps the old one.
    pub fn set(&mut self, parameter: Parameter, value: ParameterValue) -> Result<(), ParameterRefusal> {
        let definition = parameter.definition();
        if definition.access == Access::ReadOnly {
            return Err(ParameterRefusal::ReadOnly { parameter });
        }
        self.values[parameter as usize] = checked(parameter, value)?;
        Ok(())
    }

    fn real(&self, parameter: Parameter) -> f32 {
        match self.get(parameter) {
            ParameterValue::Real(value) => value,
            ParameterValue::Integer(value) => value as f32,
        }
    }

    fn integer(&self, parameter: Parameter) -> i32 {
        match self.get(parameter) {
            ParameterValue::Real(value) => value as i32,
            ParameterValue::Integer(value) => value,
        }
    }
}

/// A value of the right type within the domain of its parameter.
fn checked(parameter: Parameter, value: ParameterValue) -> Result<ParameterValue, ParameterRefusal> {
    let allowed = match (parameter.definition().domain, value) {
        (Domain::Real { least, greatest, .. }, ParameterValue::Real(value)) => (least..=greatest).contains(&value),
        (Domain::Integer { least, greatest, .. }, ParameterValue::Integer(value)) => {
            (least..=greatest).contains(&value)
        }
        (Domain::Choice { choices, .. }, ParameterValue::Integer(value)) => choices.contains(&value),
        (Domain::Real { .. }, ParameterValue::Integer(_))
        | (Domain::Integer { .. } | Domain::Choice { .. }, ParameterValue::Real(_)) => {
            let expected = parameter.definition().domain.kind();
            return Err(ParameterRefusal::Type { parameter, expected, found: value.kind() });
        }
    };
    if allowed { Ok(value) } else { Err(ParameterRefusal::Range { parameter, found: value }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_out_of_range_not_finite_or_of_the_other_type_changes_nothing() {
        let mut parameters = Parameters::new(1);
        let before = parameters.clone();
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.049, 3.001, -0.0] {
            let refusal = parameters.set(Parameter::MpcXyCruise, ParameterValue::Real(value)).unwrap_err();
            assert!(matches!(refusal, ParameterRefusal::Range { .. }), "{refusal}");
        }
        for value in [4, -1, 6, i32::MAX] {
            let refusal = parameters.set(Parameter::GfAction, ParameterValue::Integer(value)).unwrap_err();
            assert!(matches!(refusal, ParameterRefusal::Range { .. }), "{refusal}");
        }
        let refusal = parameters.set(Parameter::GfAction, ParameterValue::Real(2.0)).unwrap_err();
        assert_eq!(refusal.to_string(), "GF_ACTION: expected a value of type INT32, found REAL32");
        let refusal = parameters.set(Parameter::MpcXyCruise, ParameterValue::Integer(1)).unwrap_err();
        assert_eq!(refusal.to_string(), "MPC_XY_CRUISE: expected a value of type REAL32, found INT32");
        let refusal = parameters.set(Parameter::SysId, ParameterValue::Integer(2)).unwrap_err();
        assert_eq!(refusal.to_string(), "SYS_ID is read-only");
        assert_eq!(parameters, before);
    }

    #[test]
    fn a_refusal_says_what_was_expected_and_found() {
        let mut parameters = Parameters::new(1);
        let refusal = parameters.set(Parameter::MpcXyCruise, ParameterValue::Real(5.0)).unwrap_err();
        assert_eq!(refusal.to_string(), "MPC_XY_CRUISE: expected 0.05 to 3, found 5");
        let refusal = parameters.set(Parameter::GfAction, ParameterValue::Integer(4)).unwrap_err();
        assert_eq!(refusal.to_string(), "GF_ACTION: expected one of [0, 1, 2, 3, 5], found 4");
    }

    #[test]
    fn the_ends_of_every_range_and_every_choice_are_allowed() {
        let mut parameters = Parameters::new(1);
        for parameter in Parameter::ALL {
            let definition = parameter.definition();
            if definition.access == Access::ReadOnly {
                continue;
            }
            match definition.domain {
                Domain::Real { least, greatest, .. } => {
                    for value in [least, greatest] {
                        assert_eq!(parameters.set(parameter, ParameterValue::Real(value)), Ok(()));
                        assert_eq!(parameters.get(parameter), ParameterValue::Real(value));
                    }
                }
                Domain::Integer { least, greatest, .. } => {
                    for value in [least, greatest] {
                        assert_eq!(parameters.set(parameter, ParameterValue::Integer(value)), Ok(()));
                    }
                }
                Domain::Choice { choices, .. } => {
                    for value in choices {
                        assert_eq!(parameters.set(parameter, ParameterValue::Integer(*value)), Ok(()));
                        assert_eq!(parameters.get(parameter), ParameterValue::Integer(*value));
                    }
                }
            }
        }
    }

    #[test]
    fn values_travel_bytewise() {
        for value in [
            ParameterValue::Real(0.1),
            ParameterValue::Real(-0.0),
            ParameterValue::Integer(-7),
            ParameterValue::Integer(i32::MAX),
        ] {
            assert_eq!(ParameterValue::from_bytes(value.kind(), value.to_bytes()), value);
        }
    }
}
