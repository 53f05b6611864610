//! A number that remembers how it was computed.
//!
//! The physics is generic in [`Real`], and every choice in it is a select. Run once with [`Traced`] numbers it leaves
//! behind the list of its operations, which `program` runs forwards and backwards for many lanes at a time: no equation
//! is written a second time for its derivative.

use core::cell::RefCell;
use core::cmp::Ordering;
use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};
use std::collections::HashMap;

use kestrel_core::real::Real;

/// An operation on earlier operations, which it names by their places in the trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Operation {
    /// A value from outside.
    Input(u32),
    /// The bits of a number.
    Constant(u32),
    Unary(Unary, u32),
    Binary(Binary, [u32; 2]),
    /// The sum of two, or the first minus the second.
    Sum {
        of: [u32; 2],
        is_difference: bool,
    },
    /// `then` where `less[0] < less[1]`, `otherwise` elsewhere.
    Select {
        less: [u32; 2],
        then: u32,
        otherwise: u32,
    },
}

/// Functions of one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Unary {
    Negative,
    Root,
    Magnitude,
    Sine,
    Cosine,
    ArcSine,
    Exponential,
    Logarithm,
    Floor,
}

/// Functions of two numbers, sums apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Binary {
    Product,
    Quotient,
    /// Of the ordinate, then the abscissa.
    ArcTangent,
}

impl Unary {
    #[inline(always)]
    pub(super) fn of(self, value: f32) -> f32 {
        match self {
            Self::Negative => -value,
            Self::Root => Real::sqrt(value),
            Self::Magnitude => Real::abs(value),
            Self::Sine => Real::sin(value),
            Self::Cosine => Real::cos(value),
            Self::ArcSine => Real::asin(value),
            Self::Exponential => Real::exp(value),
            Self::Logarithm => Real::ln(value),
            Self::Floor => Real::floor(value),
        }
    }
}

impl Binary {
    #[inline(always)]
    pub(super) fn of(self, one: f32, other: f32) -> f32 {
        match self {
            Self::Product => one * other,
            Self::Quotient => one / other,
            Self::ArcTangent => Real::atan2(one, other),
        }
    }
}

/// The operations of a computation in their order; an operation that was done before is not done again.
#[derive(Default)]
struct Recorder {
    operations: Vec<Operation>,
    places: HashMap<Operation, u32>,
}

impl Recorder {
    fn place_of(&mut self, operation: Operation) -> u32 {
        let Self { operations, places } = self;
        *places.entry(operation).or_insert_with(|| {
            operations.push(operation);
            operations.len() as u32 - 1
        })
    }

    fn constant(&self, place: u32) -> Option<f32> {
        match self.operations[place as usize] {
            Operation::Constant(bits) => Some(f32::from_bits(bits)),
            Operation::Input(_)
            | Operation::Unary(..)
            | Operation::Binary(..)
            | Operation::Sum { .. }
            | Operation::Select { .. } => None,
        }
    }
}

thread_local! {
    static RECORDER: RefCell<Recorder> = RefCell::default();
}

/// Everything that `compute` does with [`Traced`] numbers, and what it returns.
pub(super) fn record<T>(compute: impl FnOnce() -> T) -> (Vec<Operation>, T) {
    RECORDER.take();
    let result = compute();
    (RECORDER.take().operations, result)
}

/// A single-precision number in a trace.
///
/// Whatever looks at its value (a comparison, a conversion) sees NaN, unless the value is a constant: what follows from
/// there is not differentiable, and taken for a constant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Traced {
    pub(super) place: u32,
}

// Never inlined: a control period has thousands of operations, recorded once, and their copies would cost the compiler a
// sixth of its time for this crate.
impl Traced {
    /// The input with this index.
    pub(super) fn input(index: usize) -> Self {
        Self::done(Operation::Input(index as u32))
    }

    #[inline(never)]
    fn constant(value: f32) -> Self {
        Self::done(Operation::Constant(value.to_bits()))
    }

    #[inline(never)]
    fn done(operation: Operation) -> Self {
        Self { place: RECORDER.with_borrow_mut(|recorder| recorder.place_of(operation)) }
    }

    /// Its value, where it follows from constants alone.
    #[inline(never)]
    fn value(self) -> Option<f32> {
        RECORDER.with_borrow(|recorder| recorder.constant(self.place))
    }

    #[inline(never)]
    fn unary(self, function: Unary) -> Self {
        match self.value() {
            Some(value) => Self::constant(function.of(value)),
            None => Self::done(Operation::Unary(function, self.place)),
        }
    }

    #[inline(never)]
    fn sum(self, other: Self, is_difference: bool) -> Self {
        match (self.value(), other.value()) {
            (Some(one), Some(other)) => Self::constant(if is_difference { one - other } else { one + other }),
            (Some(_) | None, Some(_) | None) => {
                Self::done(Operation::Sum { of: [self.place, other.place], is_difference })
            }
        }
    }

    #[inline(never)]
    fn binary(self, function: Binary, other: Self) -> Self {
        match (self.value(), other.value()) {
            (Some(one), Some(other)) => Self::constant(function.of(one, other)),
            (None, Some(other)) if function == Binary::Product && other.to_bits() == 1.0_f32.to_bits() => self,
            (Some(one), None) if function == Binary::Product && one.to_bits() == 1.0_f32.to_bits() => other,
            (Some(_) | None, Some(_) | None) => Self::done(Operation::Binary(function, [self.place, other.place])),
        }
    }
}

impl PartialEq for Traced {
    fn eq(&self, other: &Self) -> bool {
        self.to_f32() == other.to_f32()
    }
}

impl PartialOrd for Traced {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.to_f32().partial_cmp(&other.to_f32())
    }
}

macro_rules! operators {
    ($($operator:ident $method:ident $assigning:ident $assign:ident: $compute:expr;)*) => {$(
        impl $operator for Traced {
            type Output = Self;

            fn $method(self, other: Self) -> Self {
                $compute(self, other)
            }
        }

        impl $assigning for Traced {
            fn $assign(&mut self, other: Self) {
                *self = $compute(*self, other);
            }
        }
    )*};
}
operators! {
    Add add AddAssign add_assign: |one: Self, other| one.sum(other, false);
    Sub sub SubAssign sub_assign: |one: Self, other| one.sum(other, true);
    Mul mul MulAssign mul_assign: |one: Self, other| one.binary(Binary::Product, other);
    Div div DivAssign div_assign: |one: Self, other| one.binary(Binary::Quotient, other);
}

impl Neg for Traced {
    type Output = Self;

    fn neg(self) -> Self {
        self.unary(Unary::Negative)
    }
}

impl Real for Traced {
    fn from_f64(value: f64) -> Self {
        Self::constant(f32::from_f64(value))
    }

    fn from_f32(value: f32) -> Self {
        Self::constant(value)
    }

    fn to_f64(self) -> f64 {
        f64::from(self.to_f32())
    }

    fn to_f32(self) -> f32 {
        self.value().unwrap_or(f32::NAN)
    }

    fn sqrt(self) -> Self {
        self.unary(Unary::Root)
    }

    fn abs(self) -> Self {
        self.unary(Unary::Magnitude)
    }

    fn sin_cos(self) -> (Self, Self) {
        (self.unary(Unary::Sine), self.unary(Unary::Cosine))
    }

    fn asin(self) -> Self {
        self.unary(Unary::ArcSine)
    }

    fn atan2(self, abscissa: Self) -> Self {
        self.binary(Binary::ArcTangent, abscissa)
    }

    fn exp(self) -> Self {
        self.unary(Unary::Exponential)
    }

    fn ln(self) -> Self {
        self.unary(Unary::Logarithm)
    }

    fn floor(self) -> Self {
        self.unary(Unary::Floor)
    }

    fn in_single(self) -> Self {
        self
    }

    #[inline(never)]
    fn where_less(self, bound: Self, then: Self, otherwise: Self) -> Self {
        if then.place == otherwise.place {
            return then;
        }
        match (self.value(), bound.value()) {
            (Some(value), Some(bound)) => {
                if value < bound {
                    then
                } else {
                    otherwise
                }
            }
            (Some(_) | None, Some(_) | None) => Self::done(Operation::Select {
                less: [self.place, bound.place],
                then: then.place,
                otherwise: otherwise.place,
            }),
        }
    }
}
