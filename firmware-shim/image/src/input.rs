//! Random observations and states, with everything in them that a broken sensor could deliver.

use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

/// Numbers at which arithmetic may go wrong.
const EXTREMES: [f32; 16] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    1e-45,
    -1e-45,
    0.0,
    -0.0,
    1.0,
    -1.0,
    1e4,
    -1e4,
    32_767.5,
    -32_768.5,
];

/// A stream of inputs, the same on every machine: `SplitMix64` (Steele, Lea and Flood 2014).
#[derive(Clone, Debug)]
pub struct Inputs(u64);

impl Inputs {
    /// The stream of a seed.
    pub const fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Fills `values`: of 32, one is any bit pattern, one is an extreme, the others are uniform in ±2.
    pub fn fill(&mut self, values: &mut [f32]) {
        for value in values {
            *value = self.value();
        }
    }

    /// Fills `values` with numbers uniform in ±2.
    pub fn fill_usual(&mut self, values: &mut [f32]) {
        for value in values {
            *value = usual(self.next() as u32);
        }
    }

    /// A state that no flight has, and now and then no number.
    pub fn state(&mut self) -> State<f32> {
        State {
            position: self.vector(),
            world_from_body: Attitude { w: self.value(), x: self.value(), y: self.value(), z: self.value() },
            velocity: self.vector(),
            body_rates: self.vector(),
            rotor_speeds: [0.0; 4],
        }
    }

    /// A point or a velocity.
    pub fn vector(&mut self) -> Vector3<f32> {
        Vector3::new(self.value(), self.value(), self.value())
    }

    fn value(&mut self) -> f32 {
        let bits = self.next();
        let low = bits as u32;
        match bits >> 59 {
            0 => f32::from_bits(low),
            1 => EXTREMES[(low & 15) as usize],
            _ => usual(low),
        }
    }

    /// Any bits.
    pub fn bits(&mut self) -> u32 {
        self.next() as u32
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }
}

/// In ±2; 24 bits, so that every step is exact.
fn usual(bits: u32) -> f32 {
    ((bits >> 8) as i32 - (1 << 23)) as f32 / (1 << 22) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stream_has_everything() {
        let mut values = [0.0; 4_000];
        Inputs::new(1).fill(&mut values);
        let count = |has: fn(f32) -> bool| values.iter().filter(|value| has(**value)).count();
        assert!(count(f32::is_nan) > 4 && count(f32::is_infinite) > 4 && count(f32::is_subnormal) > 20);
        assert!(count(|value| value.abs() > 1e5) > 20);
        assert!((3_600..3_900).contains(&count(|value| value.abs() <= 2.0 && value != 0.0)));
    }
}
