//! The two ways in which a policy is computed.

/// Greatest deviation from a golden action that a float policy may have; fixed point may have none.
pub const FLOAT_SELF_TEST_TOLERANCE: f32 = 1e-5;

/// What a policy is computed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Arithmetic {
    /// IEEE single precision.
    Float32,
    /// 16-bit integers with 32-bit sums.
    Fixed16,
}

impl Arithmetic {
    /// As written in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Float32 => "float32",
            Self::Fixed16 => "fixed16",
        }
    }

    pub(crate) const fn self_test_tolerance(self) -> f32 {
        match self {
            Self::Float32 => FLOAT_SELF_TEST_TOLERANCE,
            Self::Fixed16 => 0.0,
        }
    }
}
