//! What a search varies: keys of the study file, each with the values that it may take.

/// Digits of a number that is tried: more cannot be told apart by results that have noise.
const DIGITS: usize = 4;

/// A key of the study file and its values.
#[derive(Clone, Debug, PartialEq)]
pub struct Dimension {
    /// Dotted path in the study file.
    pub key: String,
    /// Its values.
    pub values: Values,
}

/// What a dimension may be.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Any number from `low` to `high`.
    Uniform {
        /// Least.
        low: f64,
        /// Greatest.
        high: f64,
    },
    /// Any number from `low`, above 0, to `high`, each order of magnitude as likely.
    LogUniform {
        /// Least.
        low: f64,
        /// Greatest.
        high: f64,
    },
    /// A whole number from `low` to `high`.
    Whole {
        /// Least.
        low: u64,
        /// Greatest.
        high: u64,
    },
    /// One of these, as YAML on one line.
    Choice(Vec<String>),
}

impl Dimension {
    /// The value at a place in \[0, 1\], as YAML.
    pub fn value(&self, place: f64) -> String {
        match &self.values {
            Values::Uniform { low, high } => rounded(low + place * (high - low)).clamp(*low, *high).to_string(),
            Values::LogUniform { low, high } => {
                rounded(low * libm::pow(high / low, place)).clamp(*low, *high).to_string()
            }
            Values::Whole { low, high } => (low + nth(place, high - low + 1)).to_string(),
            Values::Choice(options) => options[nth(place, options.len() as u64) as usize].clone(),
        }
    }

    /// The place in \[0, 1\] of a value; none when it is not one of the dimension.
    pub fn place(&self, value: &str) -> Option<f64> {
        let within = |place: f64| (0.0..=1.0).contains(&place).then_some(place);
        let middle = |index: u64, count: u64| (index as f64 + 0.5) / count as f64;
        match &self.values {
            Values::Uniform { low, high } => within((value.parse::<f64>().ok()? - low) / (high - low)),
            Values::LogUniform { low, high } => {
                within(libm::log(value.parse::<f64>().ok()? / low) / libm::log(high / low))
            }
            Values::Whole { low, high } => {
                let index = value.parse::<u64>().ok()?.checked_sub(*low)?;
                (index <= high - low).then(|| middle(index, high - low + 1))
            }
            Values::Choice(options) => {
                let index = options.iter().position(|option| option == value)?;
                Some(middle(index as u64, options.len() as u64))
            }
        }
    }

    /// The place of the value that is nearest to a place: values are rounded, and some are few.
    pub fn settled(&self, place: f64) -> f64 {
        self.place(&self.value(place)).unwrap_or(place)
    }

    /// How many options a choice has.
    pub fn options(&self) -> Option<usize> {
        match &self.values {
            Values::Choice(options) => Some(options.len()),
            Values::Uniform { .. } | Values::LogUniform { .. } | Values::Whole { .. } => None,
        }
    }
}

/// Which of `count` equal parts of \[0, 1\] a place is in.
fn nth(place: f64, count: u64) -> u64 {
    ((place * count as f64) as u64).min(count - 1)
}

fn rounded(value: f64) -> f64 {
    format!("{value:.*e}", DIGITS - 1).parse().expect("a number was written")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dimension(values: Values) -> Dimension {
        Dimension { key: "training.epochs".to_owned(), values }
    }

    #[test]
    fn ends_and_middles_are_where_they_should_be() {
        let values = |values: Values| [0.0, 0.5, 1.0].map(|place| dimension(values.clone()).value(place));
        assert_eq!(values(Values::Uniform { low: 1.0, high: 2.0 }), ["1", "1.5", "2"]);
        assert_eq!(values(Values::LogUniform { low: 0.01, high: 100.0 }), ["0.01", "1", "100"]);
        assert_eq!(values(Values::Whole { low: 1, high: 3 }), ["1", "2", "3"]);
        assert_eq!(values(Values::Choice(vec!["a".to_owned(), "{b: 1}".to_owned()])), ["a", "{b: 1}", "{b: 1}"]);
    }

    #[test]
    fn whole_numbers_and_options_have_equal_parts() {
        let whole = dimension(Values::Whole { low: 2, high: 5 });
        let values: Vec<String> = (0..8).map(|index| whole.value((f64::from(index) + 0.5) / 8.0)).collect();
        assert_eq!(values, ["2", "2", "3", "3", "4", "4", "5", "5"]);
    }

    #[test]
    fn a_settled_place_gives_the_value_again() {
        let all = [
            Values::Uniform { low: -1.0, high: 3.0 },
            Values::LogUniform { low: 1e-3, high: 7.0 },
            Values::Whole { low: 0, high: 6 },
            Values::Choice(["x", "y", "z"].map(str::to_owned).to_vec()),
        ];
        for dimension in all.map(dimension) {
            for index in 0..=100 {
                let place = f64::from(index) / 100.0;
                let settled = dimension.settled(place);
                assert_eq!(dimension.value(settled), dimension.value(place), "{dimension:?} at {place}");
            }
        }
    }

    #[test]
    fn values_of_other_dimensions_have_no_place() {
        assert_eq!(dimension(Values::Whole { low: 2, high: 5 }).place("6"), None);
        assert_eq!(dimension(Values::Uniform { low: 0.0, high: 1.0 }).place("1.1"), None);
        assert_eq!(dimension(Values::LogUniform { low: 0.1, high: 1.0 }).place("nan"), None);
        assert_eq!(dimension(Values::Choice(vec!["a".to_owned()])).place("b"), None);
    }
}
