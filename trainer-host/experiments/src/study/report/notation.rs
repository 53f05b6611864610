//! Numbers as readers like them.

use crate::statistics::bootstrap::Estimate;

/// Where there is no number.
pub(super) const NONE: &str = "–";

/// `98.4 %`.
pub(super) fn percent(share: f64) -> String {
    format!("{} %", decimal(100.0 * share, 1))
}

/// `98.4 % [97.9, 98.8]`.
pub(super) fn percent_estimate(estimate: Option<Estimate>) -> String {
    with_interval(estimate, |share| decimal(100.0 * share, 1), " %")
}

/// `98.4 [97.9, 98.8]`: hundredths, in a table that says so.
pub(super) fn hundredths_estimate(estimate: Option<Estimate>) -> String {
    with_interval(estimate, |share| decimal(100.0 * share, 1), "")
}

/// `0.95 [0.91, 0.98]`.
pub(super) fn ratio_estimate(estimate: Option<Estimate>) -> String {
    with_interval(estimate, |ratio| decimal(ratio, 2), "")
}

/// `87.9 [85.1, 90.3]`, all with the digits that suit the largest.
pub(super) fn number_estimate(estimate: Option<Estimate>) -> String {
    let largest = estimate.map_or(0.0, |estimate| {
        let ends = estimate.interval.unwrap_or([estimate.value; 2]);
        ends.into_iter().fold(estimate.value.abs(), |largest, end| largest.max(end.abs()))
    });
    with_interval(estimate, |value| decimal(value, digits(largest)), "")
}

/// `0.312 M [0.298, 0.330]`, all with the value's unit.
pub(super) fn steps_estimate(estimate: Option<Estimate>) -> String {
    let largest = estimate.map_or(0.0, |estimate| estimate.interval.map_or(estimate.value, |[_, high]| high));
    let (scale, unit) = match largest {
        large if large >= 1e6 => (1e6, " M"),
        large if large >= 1e3 => (1e3, " k"),
        _ => (1.0, ""),
    };
    with_interval(estimate, |steps| decimal(steps / scale, digits(largest / scale)), unit)
}

/// A number with about three digits.
pub(super) fn number(value: f64) -> String {
    decimal(value, digits(value.abs()))
}

/// `< 0.001` or three digits behind the point.
pub(super) fn p_value(p: Option<f64>) -> String {
    match p {
        None => NONE.to_owned(),
        Some(p) if p < 0.001 => "< 0.001".to_owned(),
        Some(p) => decimal(p, 3),
    }
}

/// `45.1 kB`.
pub(super) fn bytes(count: u64) -> String {
    match count as f64 {
        count if count < 1e3 => format!("{count:.0} B"),
        count if count < 1e6 => format!("{} kB", decimal(count / 1e3, digits(count / 1e3))),
        count => format!("{} MB", decimal(count / 1e6, digits(count / 1e6))),
    }
}

/// `0–31`, or all of them when they are not in a row.
pub(super) fn seeds(seeds: &[u64]) -> String {
    let rising = seeds.windows(2).all(|pair| pair[0].checked_add(1) == Some(pair[1]));
    match seeds {
        [first, .., last] if rising => format!("{first}–{last}"),
        _ => seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", "),
    }
}

fn with_interval(estimate: Option<Estimate>, show: impl Fn(f64) -> String, unit: &str) -> String {
    let Some(estimate) = estimate else { return NONE.to_owned() };
    let value = show(estimate.value);
    match estimate.interval {
        None => format!("{value}{unit}"),
        Some([low, high]) => format!("{value}{unit} [{}, {}]", show(low), show(high)),
    }
}

fn digits(size: f64) -> usize {
    match size {
        size if size >= 999.5 => 0,
        size if size >= 9.995 => 1,
        size if size >= 0.9995 => 2,
        _ => 3,
    }
}

/// With a true minus, and no minus before zero.
fn decimal(value: f64, digits: usize) -> String {
    let text = format!("{value:.digits$}");
    let zero = text.chars().all(|letter| "-0.".contains(letter));
    if zero { text.replace('-', "") } else { text.replace('-', "−") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(value: f64, low: f64, high: f64) -> Estimate {
        Estimate { value, interval: Some([low, high]), units: 8 }
    }

    #[test]
    fn estimates_show_their_interval_in_the_same_unit() {
        assert_eq!(percent_estimate(Some(estimate(0.984, 0.979, 0.988))), "98.4 % [97.9, 98.8]");
        assert_eq!(hundredths_estimate(Some(estimate(-0.25, -0.3, 0.0))), "−25.0 [−30.0, 0.0]");
        assert_eq!(number_estimate(Some(estimate(87.9, -1.0, 102.34))), "87.9 [−1.0, 102.3]");
        assert_eq!(number_estimate(Some(estimate(0.5, 0.25, 0.75))), "0.500 [0.250, 0.750]");
        assert_eq!(steps_estimate(Some(estimate(312_000.0, 298_000.0, 330_000.0))), "312.0 k [298.0, 330.0]");
        assert_eq!(steps_estimate(Some(estimate(900_000.0, 8e5, 1e6))), "0.90 M [0.80, 1.00]");
        assert_eq!(ratio_estimate(Some(estimate(0.955, 0.9, 1.0))), "0.95 [0.90, 1.00]");
    }

    #[test]
    fn what_is_not_known_is_not_shown() {
        assert_eq!(percent_estimate(None), "–");
        assert_eq!(percent_estimate(Some(Estimate { value: 0.5, interval: None, units: 1 })), "50.0 %");
        assert_eq!(p_value(None), "–");
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [0.0, 0.0301, 2.34567, 87.9, 1234.5, -0.00001].map(number),
            ["0.000", "0.030", "2.35", "87.9", "1234", "0.000"]
        );
        assert_eq!([0, 999, 45_120, 5_942_600].map(bytes), ["0 B", "999 B", "45.1 kB", "5.94 MB"]);
        assert_eq!([Some(0.0004), Some(0.0341), Some(1.0)].map(p_value), ["< 0.001", "0.034", "1.000"]);
        assert_eq!([seeds(&[0, 1, 2]), seeds(&[4]), seeds(&[1, 3])], ["0–2", "4", "1, 3"]);
        assert_eq!(percent(1.0), "100.0 %");
    }
}
