//! Numbers as short as they can be read.

/// A number of steps with three digits and its unit, such as `1.25 M`.
pub fn amount(value: f64) -> String {
    let (scaled, unit) = match value {
        value if value < 999.5 => return format!("{value:.0}"),
        value if value < 999.5e3 => (value / 1e3, "k"),
        value if value < 999.5e6 => (value / 1e6, "M"),
        value => (value / 1e9, "G"),
    };
    let digits = if scaled < 9.995 { 2 } else { usize::from(scaled < 99.95) };
    format!("{scaled:.digits$} {unit}")
}

/// A number as short as it can be read on an axis: `0`, `-0.25`, `40`, `1.5 k`, `2 M`.
pub fn with_unit(value: f64) -> String {
    let (scaled, unit) = match value.abs() {
        size if size < 1e3 => (value, ""),
        size if size < 1e6 => (value / 1e3, " k"),
        size if size < 1e9 => (value / 1e6, " M"),
        _ => (value / 1e9, " G"),
    };
    let digits = if scaled.abs() < 1.0 { 3 } else { 2 };
    let text = format!("{scaled:.digits$}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    let short = if short == "-0" { "0" } else { short };
    format!("{short}{unit}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_keep_three_digits_across_every_unit() {
        let shown = [0.0, 999.4, 999.6, 1250.0, 99_960.0, 999_600.0, 1.25e7, 2.5e9].map(amount);
        assert_eq!(shown, ["0", "999", "1.00 k", "1.25 k", "100 k", "1.00 M", "12.5 M", "2.50 G"]);
    }

    #[test]
    fn numbers_on_axes_are_short() {
        let shown = [0.0, -0.0, 0.25, -40.0, 100.0, 1500.0, -2000.0, 250_000.0, 1e6, 2.5e7, 3e9].map(with_unit);
        let expected = ["0", "0", "0.25", "−40", "100", "1.5 k", "−2 k", "250 k", "1 M", "25 M", "3 G"];
        assert_eq!(shown, expected);
    }
}
