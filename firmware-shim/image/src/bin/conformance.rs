#![cfg_attr(any(target_os = "none", target_arch = "wasm32"), no_std, no_main)]
#![cfg_attr(target_arch = "wasm32", expect(unsafe_code, reason = "the host calls the entry by its name"))]
//! Prints the digests that must be the same on every machine; see [`kestrel_image::conformance`].

use kestrel_image::{conformance, machine};

/// Where the start-up code of the microcontroller goes.
#[cfg(target_os = "none")]
#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    machine::end(conformance::run())
}

#[cfg(target_arch = "wasm32")]
#[unsafe(no_mangle)]
extern "C" fn run() -> i32 {
    machine::end(conformance::run())
}

#[cfg(not(any(target_os = "none", target_arch = "wasm32")))]
fn main() -> std::process::ExitCode {
    machine::end(conformance::run())
}
