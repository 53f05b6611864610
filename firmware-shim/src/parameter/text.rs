//! Parameters as text: the `.params` files of QGroundControl.
//!
//! One line per parameter, in columns that tabs part: system, component, name, value, type. Lines that are empty or
//! begin with `#` say nothing.

use core::fmt::{self, Write};

use super::table::{Access, PARAMETERS, Parameter, ParameterType};
use super::{ParameterRefusal, ParameterValue, Parameters};
use kestrel_onboard::excerpt::Excerpt;

/// Columns of a line.
const COLUMNS: usize = 5;

/// Component that the parameters belong to (`MAV_COMP_ID_AUTOPILOT1`).
const COMPONENT: u8 = 1;

/// A line that is wrong.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct TextError {
    /// Counted from 1.
    pub line: usize,
    /// What is wrong with it.
    pub reason: Reason,
}

/// What is wrong with a line.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Reason {
    /// Too few or too many columns.
    #[error("expected {COLUMNS} columns parted by tabs (system, component, name, value, type), found {found}")]
    Columns {
        /// How many there are.
        found: usize,
    },
    /// A column that holds no number of its kind.
    #[error("expected {expected} as {column}, found {found}")]
    Number {
        /// Name of the column.
        column: &'static str,
        /// What it holds.
        expected: &'static str,
        /// What stands there.
        found: Excerpt,
    },
    /// A parameter of another vehicle.
    #[error("expected the name of a parameter of this vehicle, found {found}")]
    Unknown {
        /// The name.
        found: Excerpt,
    },
    /// A parameter for the second time.
    #[error("expected every parameter once, found {0} again")]
    Repeated(Parameter),
    /// A value that the parameter does not take.
    #[error(transparent)]
    Value(#[from] ParameterRefusal),
}

impl Parameters {
    /// Writes all of them.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn to_text(&self, out: &mut dyn Write) -> fmt::Result {
        let system = self.integer(Parameter::SysId);
        writeln!(out, "# Onboard parameters for Vehicle {system}\n#")?;
        writeln!(out, "# Vehicle-Id Component-Id Name Value Type")?;
        for parameter in Parameter::ALL {
            let value = self.get(parameter);
            writeln!(out, "{system}\t{COMPONENT}\t{parameter}\t{value}\t{}", value.kind() as u8)?;
        }
        Ok(())
    }

    /// Takes over what a text says; parameters that it does not name keep their values. What is read-only may stand
    /// in it, as it does in every saved file, and changes nothing, so that one file serves several vehicles.
    ///
    /// # Errors
    /// The first wrong line; nothing has changed then.
    pub fn read_text(&mut self, text: &str) -> Result<(), TextError> {
        let mut read = self.clone();
        let mut named = [false; PARAMETERS];
        for (index, line) in text.lines().enumerate() {
            let line = line.trim_end();
            if !line.is_empty() && !line.starts_with('#') {
                read.read_line(line, &mut named).map_err(|reason| TextError { line: index + 1, reason })?;
            }
        }
        *self = read;
        Ok(())
    }

    fn read_line(&mut self, line: &str, named: &mut [bool; PARAMETERS]) -> Result<(), Reason> {
        let mut columns = line.split('\t');
        let (Some(system), Some(component), Some(name), Some(value), Some(kind), None) =
            (columns.next(), columns.next(), columns.next(), columns.next(), columns.next(), columns.next())
        else {
            return Err(Reason::Columns { found: line.split('\t').count() });
        };
        number::<u8>(system, "system", "a number from 0 to 255")?;
        number::<u8>(component, "component", "a number from 0 to 255")?;
        let parameter = Parameter::named(name).ok_or_else(|| Reason::Unknown { found: name.into() })?;
        if core::mem::replace(&mut named[parameter as usize], true) {
            return Err(Reason::Repeated(parameter));
        }
        let value = read_value(value, kind)?;
        match parameter.definition().access {
            Access::ReadWrite => Ok(self.set(parameter, value)?),
            Access::ReadOnly => Ok(()),
        }
    }
}

fn read_value(value: &str, kind: &str) -> Result<ParameterValue, Reason> {
    const KIND: &str = "6 (INT32) or 9 (REAL32)";
    match number::<u8>(kind, "type", KIND).map(ParameterType::numbered)? {
        Some(ParameterType::Real32) => number(value, "value", "a number").map(ParameterValue::Real),
        Some(ParameterType::Int32) => number(value, "value", "a whole number").map(ParameterValue::Integer),
        None => Err(Reason::Number { column: "type", expected: KIND, found: kind.into() }),
    }
}

fn number<T: core::str::FromStr>(text: &str, column: &'static str, expected: &'static str) -> Result<T, Reason> {
    text.trim().parse().map_err(|_| Reason::Number { column, expected, found: text.into() })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::table::Domain;
    use super::*;

    fn text(parameters: &Parameters) -> String {
        let mut text = String::new();
        parameters.to_text(&mut text).unwrap();
        text
    }

    fn changed() -> Parameters {
        let mut parameters = Parameters::new(1);
        parameters.set(Parameter::MpcXyCruise, ParameterValue::Real(0.1 + 0.2)).unwrap();
        parameters.set(Parameter::GfAction, ParameterValue::Integer(5)).unwrap();
        parameters
    }

    #[test]
    fn a_line_is_written_as_qgroundcontrol_does() {
        let text = text(&changed());
        assert!(text.starts_with("# Onboard parameters for Vehicle 1\n"));
        assert!(text.contains("\n1\t1\tGF_ACTION\t5\t6\n"), "{text}");
        assert_eq!(text.lines().filter(|line| !line.starts_with('#')).count(), PARAMETERS);
    }

    #[test]
    fn a_file_of_qgroundcontrol_is_read() {
        let mut parameters = Parameters::new(1);
        let file = "# Onboard parameters for Vehicle 1\r\n#\r\n# Stack: PX4 Pro\r\n\r\n\
                    1\t1\tBAT_CRIT_THR\t0.070000000298023224\t9\r\n1\t1\tNAV_DLL_ACT\t2\t6\r\n";
        assert_eq!(parameters.read_text(file), Ok(()));
        assert_eq!(parameters.get(Parameter::BatCritThr), ParameterValue::Real(0.07));
        assert_eq!(parameters.get(Parameter::NavDllAct), ParameterValue::Integer(2));
    }

    #[test]
    fn one_file_serves_several_vehicles() {
        let mut other = Parameters::new(2);
        assert_eq!(other.read_text(&text(&changed())), Ok(()));
        assert_eq!(other.get(Parameter::SysId), ParameterValue::Integer(2));
        assert_eq!(other.settings().cruise_speed, changed().settings().cruise_speed);
    }

    #[test]
    fn a_wrong_line_is_named_with_what_was_expected_and_found_and_changes_nothing() {
        let cases = [
            (
                "1 1 GF_ACTION 5 6",
                "expected 5 columns parted by tabs (system, component, name, value, type), found 1",
            ),
            (
                "1\t1\tGF_ACTION\t5\t6\t7",
                "expected 5 columns parted by tabs (system, component, name, value, type), found 6",
            ),
            ("x\t1\tGF_ACTION\t5\t6", "expected a number from 0 to 255 as system, found \"x\""),
            ("1\t256\tGF_ACTION\t5\t6", "expected a number from 0 to 255 as component, found \"256\""),
            (
                "1\t1\tSYS_AUTOSTART\t5\t6",
                "expected the name of a parameter of this vehicle, found \"SYS_AUTOSTART\"",
            ),
            ("1\t1\tGF_ACTION\t5\t2", "expected 6 (INT32) or 9 (REAL32) as type, found \"2\""),
            ("1\t1\tGF_ACTION\t5\tINT", "expected 6 (INT32) or 9 (REAL32) as type, found \"INT\""),
            ("1\t1\tGF_ACTION\t5.5\t6", "expected a whole number as value, found \"5.5\""),
            ("1\t1\tGF_ACTION\t5\t9", "GF_ACTION: expected a value of type INT32, found REAL32"),
            ("1\t1\tGF_ACTION\t4\t6", "GF_ACTION: expected one of [0, 1, 2, 3, 5], found 4"),
            ("1\t1\tMPC_XY_CRUISE\tfast\t9", "expected a number as value, found \"fast\""),
            ("1\t1\tMPC_XY_CRUISE\tnan\t9", "MPC_XY_CRUISE: expected 0.05 to 3, found NaN"),
            ("1\t1\tCOM_DL_LOSS_T\t10\t9", "expected every parameter once, found COM_DL_LOSS_T again"),
        ];
        for (line, expected) in cases {
            let mut parameters = changed();
            let text = format!("# comment\n1\t1\tCOM_DL_LOSS_T\t20\t9\n{line}\n");
            let error = parameters.read_text(&text).unwrap_err();
            assert_eq!(error.to_string(), format!("line 3: {expected}"));
            assert_eq!(parameters, changed());
        }
    }

    proptest! {
        #[test]
        fn every_value_is_read_as_it_was_written(shares in proptest::collection::vec(0.0_f32..=1.0, PARAMETERS)) {
            let mut written = Parameters::new(1);
            for (parameter, share) in Parameter::ALL.into_iter().zip(shares) {
                let value = match parameter.definition().domain {
                    Domain::Real { least, greatest, .. } => {
                        ParameterValue::Real((least + share * (greatest - least)).clamp(least, greatest))
                    }
                    Domain::Choice { choices, .. } => {
                        ParameterValue::Integer(choices[(share * (choices.len() - 1) as f32) as usize])
                    }
                    Domain::Integer { .. } => continue,
                };
                prop_assert_eq!(written.set(parameter, value), Ok(()));
            }
            let mut read = Parameters::new(1);
            prop_assert_eq!(read.read_text(&text(&written)), Ok(()));
            prop_assert_eq!(read, written);
        }

        #[test]
        fn no_text_panics(text in "[\\PC\t\n]{0,200}") {
            let _ = Parameters::new(1).read_text(&text);
        }
    }
}
