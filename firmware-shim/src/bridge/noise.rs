//! Randomness that depends on nothing but a seed, a purpose and a place in a count: no state, no order of calls.

use std::fmt;
use std::str::FromStr;

use kestrel_core::philox::philox;

/// Whether instruments err, and how.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noise {
    /// They do not: every measurement is the truth, in the resolution of its message.
    Off,
    /// They err; equal seeds err alike.
    Seeded(u64),
}

/// What is no [`Noise`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected a seed from 0 to {greatest}, or \"off\", found \"{0}\"", greatest = u64::MAX)]
pub struct NoiseError(String);

/// What a number is for; numbers of different purposes are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Purpose {
    Accelerometer = 1,
    AccelerometerDrift = 2,
    Gyroscope = 3,
    GyroscopeDrift = 4,
    Magnetometer = 5,
    MagnetometerDrift = 6,
    Barometer = 7,
    BarometerDrift = 8,
    GpsPosition = 9,
    GpsPositionDrift = 10,
    GpsVelocity = 11,
    MotionCapturePosition = 12,
    MotionCaptureAttitude = 13,
}

impl FromStr for Noise {
    type Err = NoiseError;

    fn from_str(text: &str) -> Result<Self, NoiseError> {
        if text == "off" {
            return Ok(Self::Off);
        }
        text.parse().map(Self::Seeded).map_err(|_| NoiseError(text.to_owned()))
    }
}

impl fmt::Display for Noise {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Off => formatter.write_str("off"),
            Self::Seeded(seed) => write!(formatter, "{seed}"),
        }
    }
}

impl Noise {
    /// Three independent standard normal numbers (Box–Muller), or three zeros if it is off.
    pub(super) fn normals(self, purpose: Purpose, count: u64) -> [f32; 3] {
        let Self::Seeded(seed) = self else { return [0.0; 3] };
        let [low, high] = halves(count);
        let [a, b, c, d] = philox([low, high, purpose as u32, 0], halves(seed)).map(uniform);
        let (first, second) = (radius(a), radius(b));
        let turn = |share: f32| libm::sincosf(core::f32::consts::TAU * share);
        let ((sine, cosine), (_, other)) = (turn(c), turn(d));
        [first * cosine, first * sine, second * other]
    }
}

fn halves(number: u64) -> [u32; 2] {
    [number as u32, (number >> 32) as u32]
}

/// Uniform in \[0, 1), a multiple of 2⁻²⁴.
fn uniform(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / 16_777_216.0)
}

fn radius(share: f32) -> f32 {
    libm::sqrtf(-2.0 * libm::logf(1.0 - share))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_have_their_moments_and_do_not_know_each_other() {
        let count = 100_000_u32;
        let (mut sums, mut squares, mut product) = ([0.0; 3], [0.0; 3], 0.0);
        for place in 0..count {
            let normals = Noise::Seeded(7).normals(Purpose::Gyroscope, place.into()).map(f64::from);
            for axis in 0..3 {
                sums[axis] += normals[axis];
                squares[axis] += normals[axis] * normals[axis];
            }
            product += normals[0] * normals[1];
        }
        let mean = |sum: f64| sum / f64::from(count);
        assert!(sums.iter().all(|sum| mean(*sum).abs() < 0.015), "{sums:?}");
        assert!(squares.iter().all(|sum| (mean(*sum) - 1.0).abs() < 0.02), "{squares:?}");
        assert!(mean(product).abs() < 0.015);
    }

    #[test]
    fn seeds_purposes_and_places_differ_and_repeat_themselves() {
        let reference = Noise::Seeded(1).normals(Purpose::Barometer, 2);
        assert_eq!(Noise::Seeded(1).normals(Purpose::Barometer, 2), reference);
        assert_ne!(Noise::Seeded(2).normals(Purpose::Barometer, 2), reference);
        assert_ne!(Noise::Seeded(1).normals(Purpose::Gyroscope, 2), reference);
        assert_ne!(Noise::Seeded(1).normals(Purpose::Barometer, 3), reference);
    }

    #[test]
    fn noise_is_a_seed_or_off() {
        assert_eq!("off".parse(), Ok(Noise::Off));
        assert_eq!("7".parse(), Ok(Noise::Seeded(7)));
        for wrong in ["", "-1", "on", "1.5"] {
            assert!(wrong.parse::<Noise>().unwrap_err().to_string().contains(&format!("found \"{wrong}\"")));
        }
        assert_eq!(Noise::Off.normals(Purpose::Gyroscope, 1), [0.0; 3]);
        for noise in [Noise::Off, Noise::Seeded(12)] {
            assert_eq!(noise.to_string().parse(), Ok(noise));
        }
    }
}
