//! The products of a row block in ARM's SMLAD, which adds two 16-bit products to a sum: six instructions for eight.
//!
//! In assembly, because the intrinsic is not stable and because the compiler loads four words by two instructions or more,
//! not by one. The integers are those of the portable code; besides, SMLAD sets the sticky flag Q when a sum wraps, which
//! nothing reads.

#![expect(unsafe_code, reason = "the instruction has no stable intrinsic")]

use core::arch::asm;

use super::ROW_BLOCK;
use super::layer::{Group, Pair};

/// Groups per round of the loop: fewer rounds for networks whose widths are multiples of sixteen.
const GROUPS: usize = 8;

/// Adds a group to the sums in r4, r5, r8, r9, from r11 and r12 on. One line for each instruction: the compiler counts
/// lines to know how far it may reach.
macro_rules! group {
    () => {
        "ldr r10, [r12], #4
        ldmia r11!, {{r0-r3}}
        smlad r4, r0, r10, r4
        smlad r5, r1, r10, r5
        smlad r8, r2, r10, r8
        smlad r9, r3, r10, r9"
    };
}

/// `bias` with the products of as many groups as fill whole rounds, and what is left to do.
#[inline(always)]
pub(super) fn with_products_of_rounds<'w, 'x>(
    bias: &[i32; ROW_BLOCK],
    groups: &'w [Group],
    inputs: &'x [Pair],
) -> ([i32; ROW_BLOCK], &'w [Group], &'x [Pair]) {
    let count = groups.len().min(inputs.len());
    let whole = count - count % GROUPS;
    let (rounds, groups_left) = groups.split_at_checked(whole).unwrap_or_default();
    let (inputs, inputs_left) = inputs.split_at_checked(whole).unwrap_or_default();
    let sums = if rounds.is_empty() { *bias } else { with_products(bias, rounds, inputs) };
    (sums, groups_left, inputs_left)
}

/// `groups` and `inputs` are of one length, a multiple of [`GROUPS`] and not zero.
#[inline(always)]
fn with_products(bias: &[i32; ROW_BLOCK], groups: &[Group], inputs: &[Pair]) -> [i32; ROW_BLOCK] {
    let (first, second, third, fourth): (i32, i32, i32, i32);
    // SAFETY: reads four words of `bias`, the words of `groups` and as many pairs of `inputs`, each as long as a word.
    // Inputs may lie on any boundary of two, which LDR takes; the others are words, as LDM wants them.
    unsafe {
        asm!(
            "ldmia r0, {{r4, r5, r8, r9}}",
            "2:",
            group!(), group!(), group!(), group!(), group!(), group!(), group!(), group!(),
            "cmp r12, lr",
            "bne 2b",
            inout("r0") bias.as_ptr() => _,
            inout("r11") groups.as_ptr() => _,
            inout("r12") inputs.as_ptr() => _,
            in("lr") inputs.as_ptr_range().end,
            out("r4") first, out("r5") second, out("r8") third, out("r9") fourth,
            out("r1") _, out("r2") _, out("r3") _, out("r10") _,
            options(readonly, nostack)
        );
    }
    [first, second, third, fourth]
}
