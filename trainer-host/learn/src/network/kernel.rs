//! The loops over numbers, compiled for every instruction set and chosen at run time.
//!
//! Each sum has an order that is fixed by its source, so the bits do not depend on the instruction set.

mod patch_product;
mod product;
mod sum;

use pulp::{Simd, WithSimd};

pub(crate) use patch_product::{LANES, MOST_ROWS, PatchProduct, Place, STRIPE};
pub(crate) use product::{Finish, Left, Product, Start};
pub(crate) use sum::{Accumulate, AddRowSums, Head, Square, dot};

/// Runs `kernel` with the widest instruction set of this machine.
#[cfg(not(target_family = "wasm"))]
pub(crate) fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    pulp::Arch::new().dispatch(kernel)
}

/// Runs `kernel` with the only instruction set that a page was compiled for.
#[cfg(target_family = "wasm")]
pub(crate) fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    let simd = pulp::wasm::Simd128::try_new().expect("a page is compiled for 128 bits");
    Simd::vectorize(simd, kernel)
}

/// `a * b + c`, rounded once.
///
/// WebAssembly has no such instruction but the relaxed one, which Chromium rounds once on x86-64 with FMA; where a browser does
/// not, a page comes to other bits than a program.
#[inline(always)]
pub(super) fn fused<S: Simd>(simd: S, a: S::f32s, b: S::f32s, c: S::f32s) -> S::f32s {
    #[cfg(all(target_family = "wasm", target_feature = "relaxed-simd"))]
    if S::F32_LANES == 4 {
        use core::arch::wasm32::{f32x4, f32x4_relaxed_madd, v128};
        let [a, b, c] = [a, b, c].map(|vector| -> v128 {
            let [x, y, z, w] = bytemuck::cast::<_, [f32; 4]>(vector);
            f32x4(x, y, z, w)
        });
        let sum = f32x4_relaxed_madd(a, b, c);
        use core::arch::wasm32::f32x4_extract_lane as lane;
        return bytemuck::cast([lane::<0>(sum), lane::<1>(sum), lane::<2>(sum), lane::<3>(sum)]);
    }
    simd.mul_add_f32s(a, b, c)
}

/// Sum of squares, in the order of [`dot`].
pub(crate) fn square(row: &[f32]) -> f32 {
    dispatch(Square { row })
}

#[cfg(test)]
mod tests;
