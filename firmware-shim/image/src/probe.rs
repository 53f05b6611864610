//! What a measurement needs of a microcontroller: a place that a counter of instructions knows, and a painted stack.

#![expect(unsafe_code, reason = "the counter finds a symbol, and the stack belongs to no variable")]

use core::arch::asm;

/// Bytes painted below the stack pointer.
const PAINTED: usize = 16 << 10;

/// Not painted: what the painting function itself may push.
const KEPT: usize = 32;

const PAINT: u32 = 0x5ca1_ab1e;

/// Closes a window of the counter of instructions, which knows this symbol.
#[inline(never)]
#[unsafe(no_mangle)]
pub extern "C" fn kestrel_mark() {
    // SAFETY: does nothing; it is there so that the function is not empty, and is not merged with another.
    unsafe { asm!("nop", options(nomem, nostack)) }
}

/// See [`kestrel_mark`].
pub fn mark() {
    kestrel_mark();
}

/// Bytes of stack that `work` and what it calls wrote to.
#[inline(never)]
pub fn stack_below(work: &mut dyn FnMut()) -> u32 {
    let top = stack_pointer();
    let lowest = top - PAINTED;
    for address in (lowest..top - KEPT).step_by(4) {
        // SAFETY: memory between the stack and the statics, which nothing uses before `work` runs.
        unsafe { core::ptr::with_exposed_provenance_mut::<u32>(address).write_volatile(PAINT) }
    }
    work();
    // SAFETY: as above.
    let painted =
        |address: usize| unsafe { core::ptr::with_exposed_provenance::<u32>(address).read_volatile() } == PAINT;
    let touched = (lowest..top).step_by(4).find(|address| !painted(*address)).unwrap_or(top);
    (top - touched) as u32
}

fn stack_pointer() -> usize {
    let pointer;
    // SAFETY: reads a register.
    #[cfg(target_arch = "arm")]
    unsafe {
        asm!("mov {}, sp", out(reg) pointer, options(nomem, nostack, preserves_flags));
    }
    // SAFETY: reads a register.
    #[cfg(target_arch = "riscv32")]
    unsafe {
        asm!("mv {}, sp", out(reg) pointer, options(nomem, nostack, preserves_flags));
    }
    pointer
}
