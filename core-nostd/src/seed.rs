//! Randomness that does not depend on threads: counter-based streams keyed by seed, environment and purpose.

pub use crate::philox::philox;
use crate::real::Real;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The number a user gives; everything random follows from it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seed(pub u64);

/// What a stream is for; streams of different purposes are independent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[repr(u32)]
pub enum Purpose {
    /// Start states and randomised parameters of episodes.
    Reset = 1,
    /// Exploration noise.
    Actions = 2,
    /// Order of minibatches.
    Shuffle = 3,
    /// Initial weights.
    Weights = 4,
    /// Start states of evaluation episodes.
    Evaluation = 5,
    /// Actions of the random baseline.
    Baseline = 6,
    /// Start states of the episodes by which training selects its best policy.
    Selection = 7,
    /// States of a task that are kept when it is over.
    Coreset = 8,
    /// What stands where in a generated room.
    Furnishing = 9,
    /// States like those of earlier tasks, and the model that they are drawn from.
    Rehearsal = 10,
    /// Exposure and noise of cameras.
    Camera = 11,
}

/// The words of one (seed, environment, purpose), in order.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stream {
    key: [u32; 2],
    environment: u32,
    purpose: u32,
    block: u64,
    words: [u32; 4],
    used: u8,
}

impl Stream {
    /// The stream from its beginning.
    pub fn new(seed: Seed, environment: u32, purpose: Purpose) -> Self {
        let key = [seed.0 as u32, (seed.0 >> 32) as u32];
        Self { key, environment, purpose: purpose as u32, block: 0, words: [0; 4], used: 4 }
    }

    /// The stream of one drone of an environment; the first drone's is the environment's.
    pub fn of_agent(seed: Seed, environment: u32, agent: u32, purpose: Purpose) -> Self {
        let mut stream = Self::new(seed, environment, purpose);
        // Purposes are few: their word has room for the drone.
        stream.purpose |= agent << 8;
        stream
    }

    /// The stream of the camera of a drone whose other randomness is for `purpose`.
    pub fn of_camera(seed: Seed, environment: u32, agent: u32, purpose: Purpose) -> Self {
        let mut stream = Self::of_agent(seed, environment, agent, Purpose::Camera);
        stream.purpose |= (purpose as u32) << 24;
        stream
    }

    /// The next word.
    pub fn next_u32(&mut self) -> u32 {
        if self.used == 4 {
            let [low, high] = [self.block as u32, (self.block >> 32) as u32];
            // Purposes are few: the upper bits of their word extend the block counter.
            self.words = philox([low, self.environment, self.purpose, high], self.key);
            self.block += 1;
            self.used = 0;
        }
        let word = self.words[usize::from(self.used)];
        self.used += 1;
        word
    }

    /// Uniform in \[0, 1), a multiple of 2⁻²⁴.
    pub fn uniform(&mut self) -> f32 {
        (self.next_u32() >> 8) as f32 * (1.0 / 16_777_216.0)
    }

    /// Uniform in \[low, high).
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.uniform()
    }

    /// Uniform among `0..count`.
    ///
    /// # Panics
    /// When `count` is zero.
    pub fn below(&mut self, count: u32) -> u32 {
        assert!(count > 0, "a choice needs at least one option");
        ((u64::from(self.next_u32()) * u64::from(count)) >> 32) as u32
    }

    /// Standard normal (Box–Muller, cosine branch).
    pub fn normal(&mut self) -> f32 {
        let [radius, angle] = self.normal_in_polar();
        radius * libm::cosf(angle)
    }

    /// Two independent standard normals (Box–Muller), the first of them what [`Self::normal`] would be.
    pub fn normals(&mut self) -> [f32; 2] {
        let [radius, angle] = self.normal_in_polar();
        [radius * libm::cosf(angle), radius * libm::sinf(angle)]
    }

    /// Radius and angle of a point that is standard normal in two dimensions.
    fn normal_in_polar(&mut self) -> [f32; 2] {
        let radius = (-2.0 * libm::logf(1.0 - self.uniform())).sqrt();
        [radius, core::f32::consts::TAU * self.uniform()]
    }

    /// Uniform on the unit sphere (Archimedes: height and azimuth are uniform).
    pub fn direction(&mut self) -> Vector3<f32> {
        let height = self.between(-1.0, 1.0);
        let azimuth = self.between(0.0, core::f32::consts::TAU);
        let radius = (1.0 - height.squared()).sqrt();
        Vector3::new(radius * libm::cosf(azimuth), radius * libm::sinf(azimuth), height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_of_normals_has_no_mean_unit_variance_and_no_correlation() {
        let mut stream = Stream::new(Seed(8), 0, Purpose::Reset);
        assert_eq!(stream.clone().normal(), stream.clone().normals()[0]);
        let pairs: [[f32; 2]; 10_000] = core::array::from_fn(|_| stream.normals());
        let mean = |of: &dyn Fn(&[f32; 2]) -> f32| pairs.iter().map(of).sum::<f32>() / pairs.len() as f32;
        for side in 0..2 {
            assert!(mean(&|pair| pair[side]).abs() < 0.03);
            assert!((mean(&|pair| pair[side] * pair[side]) - 1.0).abs() < 0.05);
        }
        assert!(mean(&|pair| pair[0] * pair[1]).abs() < 0.03);
    }

    #[test]
    fn streams_of_other_seeds_environments_and_purposes_differ() {
        let first = |seed, environment, purpose| Stream::new(Seed(seed), environment, purpose).next_u32();
        let reference = first(1, 2, Purpose::Reset);
        assert_eq!(reference, first(1, 2, Purpose::Reset));
        assert_ne!(reference, first(2, 2, Purpose::Reset));
        assert_ne!(reference, first(1, 3, Purpose::Reset));
        assert_ne!(reference, first(1, 2, Purpose::Actions));
    }

    #[test]
    fn uniform_and_normal_have_their_moments() {
        let mut stream = Stream::new(Seed(7), 0, Purpose::Reset);
        let count = 100_000;
        let uniform: Vec<f64> = (0..count).map(|_| f64::from(stream.uniform())).collect();
        let normal: Vec<f64> = (0..count).map(|_| f64::from(stream.normal())).collect();
        let mean = |values: &[f64]| values.iter().sum::<f64>() / f64::from(count);
        let square = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>() / f64::from(count);
        assert!((mean(&uniform) - 0.5).abs() < 5e-3 && (square(&uniform) - 1.0 / 3.0).abs() < 5e-3);
        assert!(mean(&normal).abs() < 0.015 && (square(&normal) - 1.0).abs() < 0.02);
        assert!(uniform.iter().all(|value| (0.0..1.0).contains(value)));
    }

    #[test]
    fn directions_have_unit_length_and_no_preference() {
        let mut stream = Stream::new(Seed(3), 1, Purpose::Evaluation);
        let directions: Vec<_> = (0..10_000).map(|_| stream.direction()).collect();
        assert!(directions.iter().all(|direction| (direction.norm() - 1.0).abs() < 1e-5));
        let mean = directions.iter().sum::<Vector3<f32>>() / 10_000.0;
        assert!(mean.norm() < 0.03);
    }
}
