//! Fixed point against its formulas to the bit, and against floating point to its resolution.

use kestrel_core::anchor::fixed::{FixedAnchor, Fraction, ProximalShares, importance_code};
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

/// One parameter in floating point and in integers, moved alike.
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
    for rate in [1e-4_f32, 1e-3, 1e-2, 0.1, 1.0] {
        let shares = ProximalShares::at(Fraction::nearest(rate));
        let mut sides = Comparison::new(FRACTION_BITS);
        for step in 0..300_u32 {
            sides.push(FRACTION_BITS, |index| if (index as u32 + step / 20) % 7 < 4 { 4 } else { -4 });
            sides.memory.anchor().proximal_step(&mut sides.float, rate);
            sides.fixed_memory.anchor().proximal_step(&mut sides.fixed, &shares, step);
        }
        let (largest, rms) = sides.errors(FRACTION_BITS);
        println!("rate {rate}: largest {largest:.1e}, rms {rms:.1e}");
        assert!(largest < 3e-4 && rms < 6e-5, "rate {rate}: {largest} {rms}");
    }
}

/// Weights a half of their rms away from the center come back: what differs is mostly the code's share of 4.4 %.
#[test]
fn three_hundred_pulls_return_as_in_floating_point() {
    for rate in [1e-4_f32, 1e-3, 1e-2, 0.1, 1.0] {
        let shares = ProximalShares::at(Fraction::nearest(rate));
        let mut sides = Comparison::new(FRACTION_BITS);
        let displaced: Vec<i16> =
            Numbers::new(3).vector(PARAMETERS, -1638.0, 1638.0).iter().map(|&x| x as i16).collect();
        sides.push(FRACTION_BITS, |index| displaced[index]);
        for step in 0..300_u32 {
            sides.memory.anchor().proximal_step(&mut sides.float, rate);
            sides.fixed_memory.anchor().proximal_step(&mut sides.fixed, &shares, step);
        }
        let (largest, rms) = sides.errors(FRACTION_BITS);
        println!("rate {rate}: largest {largest:.1e}, rms {rms:.1e}");
        assert!(largest < 1e-3 && rms < 1.7e-4, "rate {rate}: {largest} {rms}");
    }
}

/// The way of one parameter to a center at zero, at the fixed share, and how far it was from the exact way at most
/// \[units\]: dithered, and rounded to the nearest.
fn errors_on_the_way(start: i16, share: f64, calls: u32, mut step: impl FnMut(&mut i16, u32)) -> (f64, f64) {
    let (mut dithered, mut nearest, mut exact) = (start, f64::from(start), f64::from(start));
    let (mut largest, mut largest_nearest) = (0.0_f64, 0.0_f64);
    for call in 0..calls {
        step(&mut dithered, call);
        nearest -= (share * nearest).round();
        exact -= share * exact;
        largest = largest.max((f64::from(dithered) - exact).abs());
        largest_nearest = largest_nearest.max((nearest - exact).abs());
    }
    (largest, largest_nearest)
}

#[test]
fn pulls_of_less_than_a_unit_add_up() {
    let mut numbers = Numbers::new(9);
    let (mut worst, mut worst_nearest) = (0.0_f64, 0.0_f64);
    for _ in 0..200 {
        let code = 60 + (numbers.bits() % 100) as u8;
        let shares = ProximalShares::at(Fraction::nearest(numbers.octaves(1, -12.0, -2.0)[0]));
        let (start, first) = (numbers.within(-1e4, 1e4) as i16, numbers.bits() as u32);
        let share = f64::from(shares.of(code)) / 16_777_216.0;
        let anchor = FixedAnchor { center: &mut [0], importance: &mut [code] };
        let (dithered, nearest) = errors_on_the_way(start, share, 30_000, |parameter, call| {
            anchor.proximal_step(core::slice::from_mut(parameter), &shares, first.wrapping_add(call));
        });
        worst = worst.max(dithered);
        worst_nearest = worst_nearest.max(nearest);
    }
    println!("30,000 steps: dithered {worst:.1}, to the nearest {worst_nearest:.1} units from the exact way");
    assert!(worst < 12.0 && worst_nearest > 1000.0, "{worst} {worst_nearest}");
}

#[test]
fn forces_of_less_than_a_unit_find_their_balance() {
    let mut memory = FixedMemory::new(100);
    memory.importance.fill(129);
    let shares = ProximalShares::at(Fraction::from_bits(2000));
    let mut parameters = [0_i16; 100];
    for call in 0..100_000 {
        if call % 7 == 0 {
            for parameter in &mut parameters {
                *parameter += 1;
            }
        }
        memory.anchor().proximal_step(&mut parameters, &shares, call);
    }
    let balance = 16_777_216.0 / (7.0 * f64::from(shares.of(129)));
    let (largest, _) = largest_and_rms(parameters.iter().map(|&parameter| f64::from(parameter) - balance));
    assert!(largest < 6.0, "{largest} units from {balance}");
}

/// Tasks that end around the same parameters, each with curvatures over eight octaves of its own.
#[test]
fn any_number_of_tasks_leaves_what_floating_point_has_in_the_same_memory() {
    for (tasks, decay) in [(1, 1.0), (7, 1.0), (1000, 1.0), (1000, 0.95)] {
        let mut numbers = Numbers::new(11);
        let (mut float, mut fixed) = (Memory::new(PARAMETERS), FixedMemory::new(PARAMETERS));
        let around = numbers.vector(PARAMETERS, -0.2, 0.2);
        for task in 0..tasks {
            let curvature = numbers.octaves(PARAMETERS, -4.0, 4.0);
            let codes: Vec<u8> = curvature.iter().map(|&curvature| importance_code(curvature)).collect();
            let ends: Vec<i16> =
                around.iter().map(|around| ((around + numbers.within(-0.05, 0.05)) / unit(15)) as i16).collect();
            float.anchor().consolidate(&real(&ends, 15), &curvature, decay);
            fixed.anchor().consolidate(&ends, &codes, Fraction::nearest(decay), task);
        }
        let centers = real(&fixed.center, 15).into_iter().zip(&float.center);
        let (largest, rms) = largest_and_rms(centers.map(|(fixed, float)| f64::from(fixed - float)));
        let ratios = fixed.importance.iter().zip(&float.importance);
        let octaves = ratios.map(|(&code, &float)| (importance(code) / f64::from(float)).log2());
        let mean = octaves.clone().sum::<f64>() / PARAMETERS as f64;
        let (most_octaves, rms_octaves) = largest_and_rms(octaves);
        println!(
            "{tasks} tasks, decay {decay}: center {largest:.1e}, rms {rms:.1e}; importance {most_octaves:.2} octaves, rms {rms_octaves:.2}, mean {mean:.3}"
        );
        assert!(largest < 5e-3 && rms < 6e-4, "{tasks} tasks, decay {decay}: {largest} {rms}");
        assert!(most_octaves < 1.2 && rms_octaves < 0.3 && mean.abs() < 0.06, "{tasks} tasks, decay {decay}");
        assert_eq!(size_of_val(&*fixed.center) + size_of_val(&*fixed.importance), 3 * PARAMETERS);
    }
}

/// To the nearest code it would stay at 23 tasks for ever.
#[test]
fn importance_grows_with_every_task_and_fades_to_its_balance() {
    let mut grown = FixedMemory::new(PARAMETERS);
    let mut faded = FixedMemory::new(PARAMETERS);
    let (parameters, ones) = ([0; PARAMETERS], [129; PARAMETERS]);
    for task in 0..1000 {
        grown.anchor().consolidate_at(&parameters, &ones, Fraction::ONE, task);
        faded.anchor().consolidate_at(&parameters, &ones, Fraction::nearest(0.99), task);
    }
    let mean = |codes: &[u8]| codes.iter().map(|&code| importance(code)).sum::<f64>() / PARAMETERS as f64;
    let (grown, faded) = (mean(&grown.importance), mean(&faded.importance));
    assert!((grown / 1000.0 - 1.0).abs() < 0.03 && (faded / 100.0 - 1.0).abs() < 0.03, "{grown} {faded}");
}

#[test]
fn a_full_importance_stays_full_and_an_empty_one_pulls_nowhere() {
    let mut memory = FixedMemory::new(2);
    for task in 0..100 {
        memory.anchor().consolidate(&[100, 100], &[255, 0], Fraction::ONE, task);
    }
    assert_eq!((&memory.importance[..], &memory.center[..]), (&[255, 0][..], &[100, 0][..]));
    let shares = ProximalShares::at(Fraction::from_bits(u32::MAX));
    let mut parameters = [i16::MIN, i16::MIN];
    for call in 0..2 {
        memory.anchor().proximal_step(&mut parameters, &shares, call);
    }
    assert_eq!(parameters, [100, i16::MIN]);
}

#[test]
fn fractions_round_and_saturate() {
    let bits = [0.5, 1.0, 3e-8, 2e-8, -1.0, f32::NAN, f32::INFINITY].map(|value| Fraction::nearest(value).bits());
    assert_eq!(bits, [1 << 23, 1 << 24, 1, 0, 0, 0, u32::MAX]);
}

#[test]
fn every_share_is_its_formula_to_the_bit_and_less_than_one() {
    for rate in [0, 1, 255, 5033, 1 << 24, 0x1234_5678, u32::MAX] {
        let shares = ProximalShares::at(Fraction::from_bits(rate));
        for code in 0..=255 {
            let exact = fixed_reference::proximal_share(code, rate);
            assert_eq!(i128::from(shares.of(code)), exact, "{code} {rate}");
            assert!((0..1 << 24).contains(&exact));
            let importance = if code == 0 { 0.0 } else { libm::exp2((f64::from(code) - 129.0) / 8.0) };
            let odds = f64::from(rate) / 16_777_216.0 * importance;
            assert!((exact as f64 / 16_777_216.0 - odds / (1.0 + odds)).abs() < 1e-7);
        }
    }
}

const LENGTH: usize = 24;

fn any_state() -> impl Strategy<Value = (FixedMemory, Vec<i16>, Vec<u8>)> {
    let shorts = || prop::collection::vec(any::<i16>(), LENGTH);
    let bytes = || prop::collection::vec(any::<u8>(), LENGTH);
    (shorts(), bytes(), shorts(), bytes())
        .prop_map(|(center, importance, ends, curvature)| (FixedMemory { center, importance }, ends, curvature))
}

proptest! {
    #[test]
    fn any_consolidation_is_its_formula_to_the_bit(
        (mut memory, ends, curvature) in any_state(), decay in 0..=1_u32 << 25, task in any::<u32>(),
    ) {
        let mut reference = memory.clone();
        let mut at_the_end = memory.clone();
        memory.anchor().consolidate(&ends, &curvature, Fraction::from_bits(decay), task);
        at_the_end.anchor().consolidate_at(&ends, &curvature, Fraction::from_bits(decay), task);
        let state = (&mut reference.center[..], &mut reference.importance[..]);
        fixed_reference::consolidate(state, &ends, &curvature, decay, task);
        prop_assert_eq!(&memory, &reference);
        prop_assert_eq!((at_the_end.center, at_the_end.importance), (ends, reference.importance));
    }

    #[test]
    fn any_pull_is_its_formula_to_the_bit_and_ends_between_its_ends(
        (mut memory, start, _) in any_state(), rate in any::<u32>(), octaves in 0..32, call in any::<u32>(),
    ) {
        let rate = rate >> octaves;
        let (mut moved, mut reference) = (start.clone(), start.clone());
        memory.anchor().proximal_step(&mut moved, &ProximalShares::at(Fraction::from_bits(rate)), call);
        fixed_reference::proximal_step(&mut reference, &memory.center, &memory.importance, rate, call);
        prop_assert_eq!(&moved, &reference);
        for ((moved, start), center) in moved.iter().zip(&start).zip(&memory.center) {
            prop_assert!((start.min(center)..=start.max(center)).contains(&moved));
        }
    }
}
