//! The proof that no panic can be reached: its handler needs a function that is not defined anywhere.

#![expect(unsafe_code, reason = "a function that does not exist cannot be called safely")]

use core::panic::PanicInfo;

unsafe extern "C" {
    /// Defined nowhere: a linker error that names it, or on a web page an import, means that some code can panic.
    fn a_panic_can_be_reached() -> !;
}

#[panic_handler]
fn panicked(_: &PanicInfo<'_>) -> ! {
    // SAFETY: an image that links does not contain this call.
    unsafe { a_panic_can_be_reached() }
}
