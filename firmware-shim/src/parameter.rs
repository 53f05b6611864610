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
pub enum Value {
    /// `REAL32`.
    Real(f32),
    /// `INT32`.
    Integer(i32),
}

/// Why a parameter keeps its value.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
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
        found: Value,
    },
}

/// The values of all parameters, each within its domain.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    values: [Value; PARAMETERS],
}

impl Value {
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

impl core::fmt::Display for Value {
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
        values[Parameter::SysId as usize] = Value::Integer(system.into());
        Self { values }
    }

    /// The value of a parameter.
    pub fn get(&self, parameter: Parameter) -> Value {
        self.values[parameter as usize]
    }

    /// Gives a parameter a value.
    ///
    /// # Errors
    /// Why it keeps the old one.
    pub fn set(&mut self, parameter: Parameter, value: Value) -> Result<(), Refusal> {
        let definition = parameter.definition();
        if definition.access == Access::ReadOnly {
            return Err(Refusal::ReadOnly { parameter });
        }
        self.values[parameter as usize] = checked(parameter, value)?;
        Ok(())
    }

    fn real(&self, parameter: Parameter) -> f32 {
        match self.get(parameter) {
            Value::Real(value) => value,
            Value::Integer(value) => value as f32,
        }
    }

    fn integer(&self, parameter: Parameter) -> i32 {
        match self.get(parameter) {
            Value::Real(value) => value as i32,
            Value::Integer(value) => value,
        }
    }
}

/// A value of the right type within the domain of its parameter.
fn checked(parameter: Parameter, value: Value) -> Result<Value, Refusal> {
    let allowed = match (parameter.definition().domain, value) {
        (Domain::Real { least, greatest, .. }, Value::Real(value)) => (least..=greatest).contains(&value),
        (Domain::Integer { least, greatest, .. }, Value::Integer(value)) => (least..=greatest).contains(&value),
        (Domain::Choice { choices, .. }, Value::Integer(value)) => choices.contains(&value),
        (Domain::Real { .. }, Value::Integer(_))
        | (Domain::Integer { .. } | Domain::Choice { .. }, Value::Real(_)) => {
            let expected = parameter.definition().domain.kind();
            return Err(Refusal::Type { parameter, expected, found: value.kind() });
        }
    };
    if allowed { Ok(value) } else { Err(Refusal::Range { parameter, found: value }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_out_of_range_not_finite_or_of_the_other_type_changes_nothing() {
        let mut parameters = Parameters::new(1);
        let before = parameters.clone();
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.049, 3.001, -0.0] {
            let refusal = parameters.set(Parameter::MpcXyCruise, Value::Real(value)).unwrap_err();
            assert!(matches!(refusal, Refusal::Range { .. }), "{refusal}");
        }
        for value in [4, -1, 6, i32::MAX] {
            let refusal = parameters.set(Parameter::GfAction, Value::Integer(value)).unwrap_err();
            assert!(matches!(refusal, Refusal::Range { .. }), "{refusal}");
        }
        let refusal = parameters.set(Parameter::GfAction, Value::Real(2.0)).unwrap_err();
        assert_eq!(refusal.to_string(), "GF_ACTION: expected a value of type INT32, found REAL32");
        let refusal = parameters.set(Parameter::MpcXyCruise, Value::Integer(1)).unwrap_err();
        assert_eq!(refusal.to_string(), "MPC_XY_CRUISE: expected a value of type REAL32, found INT32");
        let refusal = parameters.set(Parameter::SysId, Value::Integer(2)).unwrap_err();
        assert_eq!(refusal.to_string(), "SYS_ID is read-only");
        assert_eq!(parameters, before);
    }

    #[test]
    fn a_refusal_says_what_was_expected_and_found() {
        let mut parameters = Parameters::new(1);
        let refusal = parameters.set(Parameter::MpcXyCruise, Value::Real(5.0)).unwrap_err();
        assert_eq!(refusal.to_string(), "MPC_XY_CRUISE: expected 0.05 to 3, found 5");
        let refusal = parameters.set(Parameter::GfAction, Value::Integer(4)).unwrap_err();
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
                        assert_eq!(parameters.set(parameter, Value::Real(value)), Ok(()));
                        assert_eq!(parameters.get(parameter), Value::Real(value));
                    }
                }
                Domain::Integer { least, greatest, .. } => {
                    for value in [least, greatest] {
                        assert_eq!(parameters.set(parameter, Value::Integer(value)), Ok(()));
                    }
                }
                Domain::Choice { choices, .. } => {
                    for value in choices {
                        assert_eq!(parameters.set(parameter, Value::Integer(*value)), Ok(()));
                        assert_eq!(parameters.get(parameter), Value::Integer(*value));
                    }
                }
            }
        }
    }

    #[test]
    fn values_travel_bytewise() {
        for value in [Value::Real(0.1), Value::Real(-0.0), Value::Integer(-7), Value::Integer(i32::MAX)] {
            assert_eq!(Value::from_bytes(value.kind(), value.to_bytes()), value);
        }
    }
}
