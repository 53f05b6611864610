//! The anchor in integers, for on-board learning: three bytes per parameter, the same bits on every machine.
//!
//! | state | type | format |
//! |---|---|---|
//! | center | `i16` | that of the parameters: 2⁻ʷ, where `w` is the layer's fraction bits ([`FixedFormat`]) |
//! | importance | `u8` | logarithm in steps of ⅛ octave: 0 is none, `code` is `2^((code − 129) / 8)`, 2⁻¹⁶ to 2^15¾ |
//!
//! Everything else (rate, decay, gains, shares) is in 2⁻²⁴, as a [`Fraction`]. Nothing here depends on `w`: a center
//! only meets parameters of its own layer. (A policy file has biases in 2⁻⁽ʷ⁺ˣ⁾; who learns keeps them in 2⁻ʷ beside
//! the weights, and shifts them by `x` for inference.) Importances are of the order of one where the curvature of each
//! task is divided by its mean; the nearest code is within 4.4 %, half a step (4.6 % below 2⁻¹⁵, where a unit counts).
//!
//! A parameter moves by whole units 2⁻ʷ, and most proximal steps are less than one. Rounded to the nearest, those would all be
//! lost (a parameter 10,000 units from its center stays up to 8,800 units behind), and importance would stop to grow
//! at the 23rd equal task, 1/23 being less than half a step of the code. So both are rounded down after a dither in
//! \[0, 1) was added that goes around by the golden ratio from call to call. Measured over 10⁵ calls: the way of a
//! parameter stays within about ten units of the exact one and within one at its end (rms), where random dither errs
//! by 140 and 14. A move never passes its center, so no result leaves 16 bits.
//!
//! Over 300 steps of an optimiser against the anchor, 5,640 weights in 2⁻¹⁵ end within 3e-4 (rms 6e-5) of floating
//! point; returning freely from 0.05 away within 8e-4 (rms 1.6e-4), which is the rounding of the importance. After
//! 1,000 tasks of which each has other curvatures, the importance is right within a quarter of an octave (rms, and 3 %
//! on average), the center within 5e-4 (rms) where the tasks' ends are 0.03 (rms) apart.
//!
//! [`FixedFormat`]: crate::fixed::FixedFormat

mod importance;

pub use importance::importance_code;

use super::Anchor;
use crate::fixed::WEIGHT_FRACTION_BITS_LIMIT;
use importance::{dithered_code, importance_of, is_beyond, scaled};

/// Fraction bits of rates, decays, gains, shares, dithers and importances outside the state.
const FRACTION_BITS: u32 = 24;

/// 2³² divided by the golden ratio, odd: multiples of it fill the circle as evenly as any sequence can.
const GOLDEN_STRIDE: u32 = 0x9E37_79B9;

/// 2³² divided by the square of the plastic number, odd: apart from [`GOLDEN_STRIDE`], so that neighbouring parameters
/// do not move in the same calls.
const PARAMETER_STRIDE: u32 = 0x91E1_0DA5;

/// Half a turn: the dither of an importance beside that of the center.
const IMPORTANCE_OFFSET: u32 = 1 << 31;

/// A number from 0 to just below 256, in 2⁻²⁴.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Fraction(u32);

/// The anchor of some parameters, a layer's or a network's.
#[derive(Debug)]
pub struct FixedAnchor<'a> {
    /// What each parameter is regularised towards, in the parameters' own format, `[parameters]`.
    pub center: &'a mut [i16],
    /// The regularisation strength, in ⅛ octaves, `[parameters]`; all zero before the first task.
    pub importance: &'a mut [u8],
}

/// κ = `rate · S / (1 + rate · S)` of every importance code at one rate, in \[0, 1): 1 KiB, computed once per rate.
#[derive(Clone, Debug)]
pub struct ProximalShares([u32; 256]);

impl FixedAnchor<'_> {
    /// Memory of the anchor, for any number of tasks.
    pub const BYTES_PER_PARAMETER: usize = size_of::<i16>() + size_of::<u8>();

    /// As [`Anchor::consolidate`], with the curvature in importance codes. `task` counts the consolidations: 0, 1, …
    ///
    /// # Panics
    /// If a slice is not as long as the anchor.
    #[inline(always)]
    pub fn consolidate(&mut self, parameters: &[i16], curvature: &[u8], decay: Fraction, task: u32) {
        self.check(parameters.len());
        self.check(curvature.len());
        let state = self.center.iter_mut().zip(self.importance.iter_mut());
        for (index, ((center, code), (parameter, curvature))) in
            state.zip(parameters.iter().zip(curvature)).enumerate()
        {
            let dither = dither(task, index);
            let total = accumulated(*code, *curvature, decay);
            let gain = gain(importance_of(*curvature), total);
            *code = dithered_code(total, high_bits(dither.wrapping_add(IMPORTANCE_OFFSET)));
            *center = moved(*center, *parameter, gain, high_bits(dither));
        }
    }

    /// As [`Anchor::consolidate_at`], with the curvature in importance codes. `task` counts the consolidations.
    ///
    /// # Panics
    /// If a slice is not as long as the anchor.
    #[inline(always)]
    pub fn consolidate_at(&mut self, parameters: &[i16], curvature: &[u8], decay: Fraction, task: u32) {
        self.check(parameters.len());
        self.check(curvature.len());
        self.center.copy_from_slice(parameters);
        for (index, (code, curvature)) in self.importance.iter_mut().zip(curvature).enumerate() {
            let dither = dither(task, index).wrapping_add(IMPORTANCE_OFFSET);
            *code = dithered_code(accumulated(*code, *curvature, decay), high_bits(dither));
        }
    }

    /// As [`Anchor::proximal_step`]. `call` counts the steps: 0, 1, …; it may wrap.
    ///
    /// # Panics
    /// If `parameters` is not as long as the anchor.
    #[inline(always)]
    pub fn proximal_step(&self, parameters: &mut [i16], shares: &ProximalShares, call: u32) {
        self.check(parameters.len());
        let state = self.center.iter().zip(&*self.importance);
        for (index, (parameter, (center, code))) in parameters.iter_mut().zip(state).enumerate() {
            *parameter = moved(*parameter, *center, shares.of(*code), high_bits(dither(call, index)));
        }
    }

    /// Becomes `anchor`, for parameters in 2^-`fraction_bits`, rounded to the nearest; returns how many centers and
    /// importances were beyond what the formats hold and were limited.
    ///
    /// # Panics
    /// If `anchor` is not as long as this one.
    pub fn round_from(&mut self, anchor: &Anchor<'_>, fraction_bits: u8) -> usize {
        self.check(anchor.center.len());
        self.check(anchor.importance.len());
        let unit = (1_u32 << fraction_bits.min(WEIGHT_FRACTION_BITS_LIMIT)) as f32;
        let mut limited = 0;
        for (center, exact) in self.center.iter_mut().zip(&*anchor.center) {
            let rounded = libm::roundf(exact * unit);
            // `as` saturates and turns NaN into zero.
            *center = rounded as i16;
            limited += usize::from(f32::from(*center) != rounded);
        }
        for (code, exact) in self.importance.iter_mut().zip(&*anchor.importance) {
            *code = importance_code(*exact);
            limited += usize::from(is_beyond(*exact));
        }
        limited
    }

    // Without the lengths in the message, whose formatting a firmware would have to carry; inlined with its callers, so that
    // where lengths are known a firmware has no panic.
    #[inline(always)]
    fn check(&self, length: usize) {
        assert!(self.center.len() == self.importance.len(), "a center and an importance per parameter");
        assert!(self.center.len() == length, "one value per parameter of the anchor");
    }
}

/// `from`, and `share` of the way to `target` rounded to whole units: down, after the dither was added.
#[inline(always)]
fn moved(from: i16, target: i16, share: u32, dither: u32) -> i16 {
    // 18 by 26 bits with their signs: one multiplication of a Cortex-M4.
    let way = i32::from(target) - i32::from(from);
    let step = (i64::from(way) * i64::from(share as i32) + i64::from(dither)) >> FRACTION_BITS;
    (i32::from(from) + step as i32) as i16
}

/// `from`, moved by `way` in 2⁻²⁴ units, rounded to whole units as by [`moved`], as far as 16 bits go.
#[inline(always)]
pub(crate) fn dithered(from: i16, way: i64, dither: u32) -> i16 {
    let step = (way + i64::from(high_bits(dither))) >> FRACTION_BITS;
    (i64::from(from) + step).clamp(i64::from(i16::MIN), i64::from(i16::MAX)) as i16
}

/// `decay · S + H` in 2⁻²⁴, below 2⁴¹.
#[inline(always)]
fn accumulated(code: u8, curvature: u8, decay: Fraction) -> u64 {
    ((importance_of(code) * u64::from(decay.limited().0)) >> FRACTION_BITS) + importance_of(curvature)
}

/// `curvature / total` in \[0, 1\]; 0 where neither is anything.
#[inline(always)]
fn gain(curvature: u64, total: u64) -> u32 {
    (curvature << FRACTION_BITS).checked_div(total).unwrap_or_default() as u32
}

/// A turn of the circle in 2⁻³².
#[inline(always)]
pub(crate) fn dither(call: u32, index: usize) -> u32 {
    call.wrapping_mul(GOLDEN_STRIDE).wrapping_add((index as u32).wrapping_mul(PARAMETER_STRIDE))
}

/// From 2⁻³² to 2⁻²⁴.
#[inline(always)]
fn high_bits(dither: u32) -> u32 {
    dither >> (u32::BITS - FRACTION_BITS)
}

impl Fraction {
    /// 1.
    pub const ONE: Self = Self(1 << FRACTION_BITS);

    /// `bits` · 2⁻²⁴.
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// In 2⁻²⁴.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// The nearest fraction; limited to the range, zero for NaN.
    pub fn nearest(value: f32) -> Self {
        Self(libm::round(f64::from(value) * f64::from(Self::ONE.0)) as u32)
    }

    /// At most 1.
    fn limited(self) -> Self {
        self.min(Self::ONE)
    }
}

impl ProximalShares {
    /// The shares at `rate` = learning rate × strength. What is below 2⁻²⁵ is none.
    pub fn at(rate: Fraction) -> Self {
        Self(core::array::from_fn(|code| proximal_share(scaled(code as u8, rate))))
    }

    /// In 2⁻²⁴, below 1.
    #[inline(always)]
    pub fn of(&self, importance: u8) -> u32 {
        // Every code is in the table.
        self.0.get(usize::from(importance)).copied().unwrap_or_default()
    }
}

/// `odds / (1 + odds)` to the nearest 2⁻²⁴, below 1; `odds` in 2⁻²⁴, at most 2⁴⁸.
fn proximal_share(odds: u64) -> u32 {
    let one = u64::from(Fraction::ONE.0);
    let whole = one + odds;
    let rest = ((one << FRACTION_BITS) + whole / 2) / whole;
    (one - rest).min(one - 1) as u32
}
