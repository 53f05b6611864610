//! A microcontroller whose debugger, or emulator, prints for it (ARM's semihosting, version 2; RISC-V has the same).

#![expect(unsafe_code, reason = "a call of the debugger is an instruction")]

use core::arch::asm;

use super::Verdict;

const SYS_WRITEC: usize = 0x03;
const SYS_EXIT_EXTENDED: usize = 0x20;
const APPLICATION_EXIT: usize = 0x2_0026;

/// Prints `text`, byte by byte: a call takes strings that end with zero only.
pub(super) fn print(text: &str) {
    for byte in text.as_bytes() {
        call(SYS_WRITEC, (&raw const *byte).addr());
    }
}

/// Stops the machine; the emulator's exit status says how.
pub fn end(verdict: Verdict) -> ! {
    let arguments = [APPLICATION_EXIT, usize::from(verdict == Verdict::Failed)];
    call(SYS_EXIT_EXTENDED, (&raw const arguments).addr());
    loop {
        core::hint::spin_loop();
    }
}

/// `argument` is the address of what the operation reads.
fn call(operation: usize, argument: usize) {
    // SAFETY: the debugger reads one byte or two words at `argument`, which are borrowed by the caller, and changes
    // nothing but the register of the result.
    #[cfg(target_arch = "arm")]
    unsafe {
        asm!("bkpt 0xab", inout("r0") operation => _, in("r1") argument, options(nostack));
    }
    // SAFETY: as above. The three instructions must not be compressed: they are what the debugger looks for.
    #[cfg(target_arch = "riscv32")]
    unsafe {
        asm!(
            ".option push", ".option norvc", ".balign 16",
            "slli x0, x0, 0x1f", "ebreak", "srai x0, x0, 7",
            ".option pop",
            inout("a0") operation => _, in("a1") argument, options(nostack)
        );
    }
}
