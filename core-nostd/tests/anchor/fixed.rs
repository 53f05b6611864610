//! Fixed point against its formulas to the bit, and against floating point to its resolution.

use kestrel_core::anchor::fixed::{FixedAnchor, Fraction, Shares, importance_code};
use proptest::prelude::*;

use crate::fixed_reference;
use crate::support::{FixedMemory, Memory, Numbers, largest_and_rms};

/// A 64-64 policy with 18 observations and 4 actions.
const PARAMETERS: usize = 5640;

/// Weights of such a policy take this format.
const FRACTION_BITS: u8 = 15;

fn unit(fraction_bits: u8) -> f32 {
    1.0 / (1_u32 << fraction_bits) as f32
}

fn real(codes: &[i16], fraction_bits: u8) -> Vec<f32> {
    codes.iter().map(|&code| f32::from(code) * unit(fraction_bits)).collect()
}

fn importance(code: u8) -> f64 {
    fixed_reference::importance(code) as f64 / 16_777_216.0
}

#[test]
fn steps_of_importance_are_eighths_of_an_octave() {
    for code in 1..=255 {
        let exact = libm::exp2((f64::from(code) - 129.0) / 8.0);
        assert!((importance(code) / exact - 1.0).abs() < 3e-3, "{code}");
        assert_eq!(importance_code(exact as f32), code);
    }
}

#[test]
fn importances_are_within_half_a_step_of_their_codes() {
    let mut numbers = Numbers::new(1);
    for exact in numbers.octaves(100_000, -15.9, 15.7) {
        let ratio = importance(importance_code(exact)) / f64::from(exact);
        assert!((ratio - 1.0).abs() < 0.0465, "{exact} {ratio}");
    }
    let codes = [0.0, -1.0, f32::NAN, 1e-9, 1e-5, f32::MAX, f32::INFINITY].map(importance_code);
    assert_eq!(codes, [0, 0, 0, 0, 1, 255, 255]);
}

#[test]
fn what_the_formats_cannot_hold_is_counted_and_limited() {
    let mut memory = Memory {
        center: vec![0.5, -0.5, 1.0, -1.5, f32::NAN, 0.25],
        importance: vec![0.0, 1.0, 1e9, 1.0, 1.0, 1e-9],
    };
    let mut fixed = FixedMemory::new(6);
    assert_eq!(fixed.anchor().round_from(&memory.anchor(), 15), 5);
    assert_eq!(fixed.center, [16_384, -16_384, i16::MAX, i16::MIN, 0, 8192]);
    assert_eq!(fixed.importance, [0, 129, 255, 129, 129, 0]);
}

/// One parameter in floating point and in integers, pulled and pushed alike.
struct Comparison {
    float: Vec<f32>,
    fixed: Vec<i16>,
    memory: Memory,
    fixed_memory: FixedMemory,
}

impl Comparison {
    /// Weights of rms 0.1 that were the end of an earlier task, importances over eight octaves below one.
    fn new(fraction_bits: u8) -> Self {
        let mut numbers = Numbers::new(7);
        let center = numbers.vector(PARAMETERS, -0.173, 0.173);
        let importance = numbers.octaves(PARAMETERS, -8.0, 0.0);
        let mut memory = Memory { center: center.clone(), importance };
        let mut fixed_memory = FixedMemory::new(PARAMETERS);
        assert_eq!(fixed_memory.anchor().round_from(&memory.anchor(), fraction_bits), 0);
        let fixed = fixed_memory.center.clone();
        Self { float: real(&fixed, fraction_bits), fixed, memory, fixed_memory }
    }

    /// A step of an optimiser: the same whole units on both sides.
    fn push(&mut self, fraction_bits: u8, step: impl Fn(usize) -> i16) {
        for index in 0..PARAMETERS {
            self.fixed[index] += step(index);
            self.float[index] += f32::from(step(index)) * unit(fraction_bits);
        }
    }

    fn errors(&self, fraction_bits: u8) -> (f64, f64) {
        let real = real(&self.fixed, fraction_bits);
        largest_and_rms(real.iter().zip(&self.float).map(|(fixed, float)| f64::from(fixed - float)))
    }
}

/// 300 steps of Adam (4 units, 1.2e-4, in a direction that each parameter changes now and then) against the anchor.
#[test]
fn three_hundred_anchored_steps_end_where_floating_point_does() {
    let rate = 1e-2_f32;
    let shares = Shares::at(Fraction::nearest(rate));
    let mut sides = Comparison::new(FRACTION_BITS);
    for step in 0..300_u32 {
        let direction = |index: usize| if (index as u32 + step / 20) % 7 < 4 { 4 } else { -4 };
        sides.push(FRACTION_BITS, direction);
        sides.memory.anchor().pull(&mut sides.float, rate);
        sides.fixed_memory.anchor().pull(&mut sides.fixed, &shares, step);
    }
    let (largest, rms) = sides.errors(FRACTION_BITS);
    println!("300 anchored steps: largest {largest:.2e}, rms {rms:.2e}");
    assert!(largest < 1.0e-3 && rms < 1.1e-4, "{largest} {rms}");
}
