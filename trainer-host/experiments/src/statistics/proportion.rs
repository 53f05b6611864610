//! Intervals of shares.

/// Two-sided 95 % quantile of the normal distribution.
pub const Z_95: f64 = 1.959_964;

/// Score interval of a proportion at 95 % (Wilson 1927), sound also at 0 and 1.
pub fn wilson(successes: f64, count: f64) -> [f64; 2] {
    let square = Z_95 * Z_95;
    let share = successes / count;
    let middle = share + square / (2.0 * count);
    let reach = Z_95 * (share * (1.0 - share) / count + square / (4.0 * count * count)).sqrt();
    let scale = 1.0 + square / count;
    [((middle - reach) / scale).max(0.0), ((middle + reach) / scale).min(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_matches_its_published_example() {
        // Newcombe 1998, table I: 81 of 263 gives 0.2553 to 0.3662.
        let [low, high] = wilson(81.0, 263.0);
        assert!((low - 0.2553).abs() < 1e-4 && (high - 0.3662).abs() < 1e-4);
        assert!(wilson(0.0, 20.0)[0] == 0.0 && (wilson(0.0, 20.0)[1] - 0.1611).abs() < 1e-4);
    }
}
