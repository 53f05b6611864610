//! The instruction set of this machine, chosen at run time.

#[cfg(not(target_family = "wasm"))]
pub(crate) use pulp::Arch;

/// The only instruction set that a page was compiled for: choosing among several would make it three times as large.
#[cfg(target_family = "wasm")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arch(pulp::wasm::Simd128);

#[cfg(target_family = "wasm")]
impl Arch {
    pub(crate) fn new() -> Self {
        Self(pulp::wasm::Simd128::try_new().expect("a page is compiled for 128 bits"))
    }

    #[inline(always)]
    pub(crate) fn dispatch<K: pulp::WithSimd>(self, kernel: K) -> K::Output {
        pulp::Simd::vectorize(self.0, kernel)
    }
}
