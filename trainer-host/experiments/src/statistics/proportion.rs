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

/// As [`wilson`], of outcomes in groups that are alike inside, `(successes, count)` each: with as many independent
/// outcomes as explain the spread between the groups (the design effect of a cluster sample, Kish 1965), at least one of
/// each group.
pub fn wilson_of_groups(groups: &[(f64, f64)]) -> [f64; 2] {
    let (successes, count) = groups.iter().fold((0.0, 0.0), |(a, b), (c, d)| (a + c, b + d));
    let (share, number) = (successes / count, groups.len() as f64);
    let spread: f64 = groups.iter().map(|(hits, of)| (hits - share * of) * (hits - share * of)).sum();
    let variance_of_share = spread * number / (number - 1.0).max(1.0) / (count * count);
    let independent = share * (1.0 - share) / variance_of_share;
    // Where all groups are alike nothing is known about their spread.
    let effective = if independent.is_finite() { independent.clamp(number.min(count), count) } else { number };
    wilson(share * effective, effective)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_matches_its_published_example() {
        // Newcombe 1998, table I: 81 of 263 gives 0.2553 to 0.3662.
        let [low, high] = wilson(81.0, 263.0);
        assert!((low - 0.2553).abs() < 1e-4 && (high - 0.3662).abs() < 1e-4);
        // Groups of one outcome are no groups.
        let ones: Vec<(f64, f64)> = (0..263).map(|index| (f64::from(u8::from(index < 81)), 1.0)).collect();
        let grouped = wilson_of_groups(&ones);
        assert!((grouped[0] - low).abs() < 1e-9 && (grouped[1] - high).abs() < 1e-9);
        // Groups that are all or nothing count once each.
        let blocks: Vec<(f64, f64)> = ones.iter().map(|(hits, _)| (5.0 * hits, 5.0)).collect();
        let blocked = wilson_of_groups(&blocks);
        assert!((blocked[0] - low).abs() < 1e-3 && (blocked[1] - high).abs() < 1e-3, "{blocked:?}");
        assert!(wilson(0.0, 20.0)[0] == 0.0 && (wilson(0.0, 20.0)[1] - 0.1611).abs() < 1e-4);
    }
}
