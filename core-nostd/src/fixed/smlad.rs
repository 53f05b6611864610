//! The products of a row block in ARM's SMLAD, which adds two 16-bit products to a sum.
//!
//! Either the instruction alone, whose intrinsic is not stable, in a loop of Rust: seven instructions for eight products and
//! the loop's own. Or, with the feature `assembly`, the loop as well: six, because the compiler loads four words by two
//! instructions, not by one. The integers are those of the portable code; besides, SMLAD sets the sticky flag Q when a sum
//! wraps, which nothing reads.

#![expect(unsafe_code, reason = "the instruction has no stable intrinsic")]

use core::arch::asm;

use super::ROW_BLOCK;
use super::layer::{Group, Pair};

/// Adds the products of one column pair to the sums of a row block.
#[inline(always)]
pub(super) fn with_pair([a, b, c, d]: [i32; ROW_BLOCK], group: &Group, inputs: Pair) -> [i32; ROW_BLOCK] {
    let inputs = bytemuck::cast(inputs);
    let [a, b] = with_rows([a, b], [group[0], group[1]], inputs);
    let [c, d] = with_rows([c, d], [group[2], group[3]], inputs);
    [a, b, c, d]
}

/// Adds the products of both halves of `inputs` with those of each weight to its sum. Two rows, because two words are
/// loaded at once; and not said to be without effect, because then the compiler would load more than it has registers for.
#[inline(always)]
fn with_rows([mut first, mut second]: [i32; 2], weights: [i32; 2], inputs: i32) -> [i32; 2] {
    // SAFETY: reads and writes these registers only.
    unsafe {
        asm!(
            "smlad {first}, {of_first}, {inputs}, {first}",
            "smlad {second}, {of_second}, {inputs}, {second}",
            first = inout(reg) first, second = inout(reg) second,
            of_first = in(reg) weights[0], of_second = in(reg) weights[1], inputs = in(reg) inputs,
            options(nostack, preserves_flags)
        );
    }
    [first, second]
}

#[cfg(feature = "assembly")]
pub(super) use assembly::dense;

#[cfg(feature = "assembly")]
mod assembly {
    use core::arch::asm;

    use super::super::ROW_BLOCK;
    use super::super::layer::{Group, Pair, ROUND};
    use super::with_pair;

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

    /// `sums = bias + weights · inputs`.
    ///
    /// Wraps where a sum leaves 32 bits, which the formats of a parsed policy exclude.
    #[inline(never)]
    pub(in super::super) fn dense(
        weights: &[Group],
        bias: &[[i32; ROW_BLOCK]],
        inputs: &[Pair],
        sums: &mut [i32],
    ) {
        let blocks = weights.chunks_exact(inputs.len().max(1));
        for ((bias, groups), sums) in bias.iter().zip(blocks).zip(sums.as_chunks_mut::<ROW_BLOCK>().0) {
            *sums = with_products(bias, groups, inputs);
        }
    }

    /// `bias` with the products of a row block; `groups` and `inputs` are of one length.
    #[inline(always)]
    fn with_products(bias: &[i32; ROW_BLOCK], groups: &[Group], inputs: &[Pair]) -> [i32; ROW_BLOCK] {
        let count = groups.len().min(inputs.len());
        let whole = count - count % ROUND;
        let (rounds, groups) = groups.split_at_checked(whole).unwrap_or_default();
        let (inputs_of_rounds, inputs) = inputs.split_at_checked(whole).unwrap_or_default();
        let sums = if rounds.is_empty() { *bias } else { with_rounds(bias, rounds, inputs_of_rounds) };
        groups.iter().zip(inputs).fold(sums, |sums, (group, inputs)| with_pair(sums, group, *inputs))
    }

    /// `groups` and `inputs` are of one length, a multiple of [`ROUND`] and not zero.
    #[inline(always)]
    fn with_rounds(bias: &[i32; ROW_BLOCK], groups: &[Group], inputs: &[Pair]) -> [i32; ROW_BLOCK] {
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
}
