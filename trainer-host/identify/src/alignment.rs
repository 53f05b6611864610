//! Clocks of one log: motion capture and radio each have a delay, and turning shows by how much they differ.

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use crate::flight::{Clocks, Recording};
use crate::track::Track;

/// Greatest difference that is looked for \[s\].
const REACH_SECS: f64 = 0.2;

/// Step of the search \[s\], between which a parabola interpolates.
const STEP_SECS: f64 = 0.005;

/// Correlation of two gyroscopes that is certain enough to move a clock.
const CERTAIN: f64 = 0.5;

/// The recording with its motion moved onto the gyroscope's clock, where turning shows the difference.
pub(crate) fn aligned(recording: Recording) -> Recording {
    let late = match recording.clocks {
        Clocks::Several => lateness_secs(&recording),
        Clocks::One => None,
    };
    match late {
        None => recording,
        Some(late) => Recording {
            positions: recording.positions.delayed(-late),
            velocities: recording.velocities.delayed(-late),
            attitudes: recording.attitudes.delayed(-late),
            ..recording
        },
    }
}

/// How much later the attitude shows a turn than the gyroscope \[s\].
fn lateness_secs(recording: &Recording) -> Option<f64> {
    let [start, end] = recording.attitudes.span_secs()?;
    let rows = ((end - start) / STEP_SECS) as usize;
    let times: Vec<f64> = (1..rows).map(|row| start + row as f64 * STEP_SECS).collect();
    let turned = times.iter().map(|time| turning(&recording.attitudes, *time)).collect::<Vec<_>>();
    let reach = (REACH_SECS / STEP_SECS) as i32;
    let scores: Vec<f64> = (-reach..=reach)
        .map(|shift| correlation(&recording.body_rates, &times, &turned, f64::from(shift) * STEP_SECS))
        .collect();
    if scores.iter().all(|score| *score < CERTAIN) {
        return None;
    }
    Some((peak(&scores)? - f64::from(reach)) * STEP_SECS)
}

/// Where a parabola through the greatest score and those beside it has its peak, in scores from the first; nowhere if the
/// greatest is at an end.
pub(crate) fn peak(scores: &[f64]) -> Option<f64> {
    let best = (0..scores.len()).max_by(|a, b| scores[*a].total_cmp(&scores[*b]))?;
    if best == 0 || best + 1 == scores.len() {
        return None;
    }
    let [before, peak, after] = [scores[best - 1], scores[best], scores[best + 1]];
    Some(best as f64 + 0.5 * (before - after) / (before - 2.0 * peak + after))
}

/// Body rates \[rad/s\] by the attitudes half a step to either side.
fn turning(attitudes: &Track<4>, time: f64) -> Option<Vector3<f64>> {
    let at = |time| {
        let [w, x, y, z] = attitudes.interpolated(time, 3.0 * STEP_SECS)?;
        Some(Attitude { w, x, y, z })
    };
    let (before, after) = (at(time - 0.5 * STEP_SECS)?, at(time + 0.5 * STEP_SECS)?);
    Some(rotation_vector(&before, &after) / STEP_SECS)
}

/// The small rotation from one attitude to the next, body \[rad\].
pub(crate) fn rotation_vector(before: &Attitude<f64>, after: &Attitude<f64>) -> Vector3<f64> {
    let (a, b) = (before, after);
    let scalar = a.w * b.w + a.x * b.x + a.y * b.y + a.z * b.z;
    let vector = Vector3::new(
        a.w * b.x - a.x * b.w - a.y * b.z + a.z * b.y,
        a.w * b.y - a.y * b.w - a.z * b.x + a.x * b.z,
        a.w * b.z - a.z * b.w - a.x * b.y + a.y * b.x,
    );
    vector * (2.0 * scalar.signum())
}

/// Of what the attitude shows at `times` with what the gyroscope showed `late` earlier.
fn correlation(rates: &Track<3>, times: &[f64], turned: &[Option<Vector3<f64>>], late: f64) -> f64 {
    let (mut product, mut own, mut other) = (0.0, 0.0, 0.0);
    for (time, turned) in times.iter().zip(turned) {
        let Some((turned, rate)) = turned.zip(rates.interpolated(time - late, 0.03)) else { continue };
        let rate = Vector3::from(rate);
        product += turned.dot(&rate);
        own += turned.norm_squared();
        other += rate.norm_squared();
    }
    product / (own * other).sqrt().max(1e-12)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flight::CommandRecord;

    /// A drone that rolls to and fro, its attitude told `late` seconds too late.
    fn rolling(late: f64) -> Recording {
        let mut recording = Recording::new("rolling", CommandRecord::Complete);
        for row in 0..1000 {
            let time = f64::from(row) * 0.01;
            let angle = |time: f64| 0.4 * (7.0 * time).sin() + 0.2 * (17.0 * time).sin();
            let rate = 2.8 * (7.0 * time).cos() + 3.4 * (17.0 * time).cos();
            recording.body_rates.push(time, [rate, 0.0, 0.0]);
            let half = 0.5 * angle(time - late);
            recording.attitudes.push(time, [half.cos(), half.sin(), 0.0, 0.0]);
        }
        recording
    }

    #[test]
    fn turning_tells_how_late_the_attitude_is() {
        for late in [-0.031, 0.0, 0.012, 0.08] {
            let found = lateness_secs(&rolling(late)).unwrap();
            assert!((found - late).abs() < 0.001, "{late}: {found}");
            let again = lateness_secs(&aligned(rolling(late))).unwrap();
            assert!(again.abs() < 0.001, "{again}");
        }
    }

    #[test]
    fn a_drone_that_does_not_turn_keeps_its_clocks() {
        let mut recording = rolling(0.0);
        recording.attitudes = Track::new();
        assert_eq!(lateness_secs(&recording), None);
        for row in 0..1000 {
            recording.attitudes.push(f64::from(row) * 0.01, [1.0, 0.0, 0.0, 0.0]);
        }
        assert_eq!(lateness_secs(&recording), None);
    }
}
