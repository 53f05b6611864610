//! The loops over numbers, compiled for every instruction set and chosen at run time.
//!
//! Each sum has an order that is fixed by its source, so the bits do not depend on the instruction set.

mod patch_product;
mod product;
mod sum;

use pulp::{Arch, WithSimd};

pub(crate) use patch_product::{LANES, MOST_ROWS, PatchProduct, Place, STRIPE};
pub(crate) use product::{Finish, Left, Product, Start};
pub(crate) use sum::{Accumulate, AddRowSums, Head, Square, dot};

/// Runs `kernel` with the widest instruction set of this machine.
pub(crate) fn dispatch<K: WithSimd>(kernel: K) -> K::Output {
    Arch::new().dispatch(kernel)
}

/// Sum of squares, in the order of [`dot`].
pub(crate) fn square(row: &[f32]) -> f32 {
    dispatch(Square { row })
}

#[cfg(test)]
mod tests;
