//! Filters without delay.

use nalgebra::Vector3;

/// Convolution with a Gaussian of `deviation` rows, cut off at three of them.
pub(crate) fn gaussian(column: &[f64], deviation: f64) -> Vec<f64> {
    let reach = (3.0 * deviation).ceil() as usize;
    let weight = |distance: usize| (-0.5 * (distance as f64 / deviation).powi(2)).exp();
    let weights: Vec<f64> = (0..=reach).map(weight).collect();
    let smooth = |row: usize| {
        let (low, high) = (row.saturating_sub(reach), (row + reach).min(column.len() - 1));
        let (mut sum, mut total) = (0.0, 0.0);
        for other in low..=high {
            let weight = weights[row.abs_diff(other)];
            sum += weight * column[other];
            total += weight;
        }
        sum / total
    };
    (0..column.len()).map(smooth).collect()
}

/// [`gaussian`] of each component.
pub(crate) fn gaussian_of_vectors(column: &[Vector3<f64>], deviation: f64) -> Vec<Vector3<f64>> {
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let part: Vec<f64> = column.iter().map(|vector| vector[axis]).collect();
        gaussian(&part, deviation)
    });
    (0..column.len()).map(|row| Vector3::new(x[row], y[row], z[row])).collect()
}

/// Central differences \[1/s\].
pub(crate) fn derivative(column: &[Vector3<f64>], period_secs: f64) -> Vec<Vector3<f64>> {
    let last = column.len() - 1;
    let slope = |row: usize| {
        let (before, after) = (row.saturating_sub(1), (row + 1).min(last));
        (column[after] - column[before]) / ((after - before) as f64 * period_secs)
    };
    (0..column.len()).map(slope).collect()
}

/// The value at each row of the parabola through the two rows on either side (Savitzky & Golay 1964).
pub(crate) fn parabola(column: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let smooth = |row: usize| match row.checked_sub(2).and_then(|low| column.get(low..=row + 2)) {
        Some([a, b, c, d, e]) => (12.0 * (b + d) + 17.0 * c - 3.0 * (a + e)) / 35.0,
        _ => column[row],
    };
    (0..column.len()).map(smooth).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_keep_a_parabola_and_a_line() {
        let column: Vec<Vector3<f64>> =
            (0..50).map(|row| Vector3::new(f64::from(row), f64::from(row * row), 1.0)).collect();
        assert!((parabola(&column)[20] - column[20]).norm() < 1e-9);
        assert!((gaussian_of_vectors(&column, 2.0)[25].x - 25.0).abs() < 1e-9);
        assert!((derivative(&column, 0.5)[20] - Vector3::new(2.0, 80.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn a_gaussian_takes_away_what_is_fast() {
        let column: Vec<f64> = (0..200).map(|row| if row % 2 == 0 { 1.0 } else { -1.0 }).collect();
        assert!(gaussian(&column, 4.0)[100].abs() < 1e-3);
    }
}
