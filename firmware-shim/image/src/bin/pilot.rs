#![no_std]
#![no_main]
//! A policy behind the serial line: the processor in the loop of `kestrel fly --processor qemu`.

use kestrel_core::policy_file::Aligned;
use kestrel_core::processor_in_the_loop::serve;
use kestrel_image::machine::{self, Usart, Verdict};

/// Room for a policy file \[bytes\].
const POLICY_LIMIT: usize = 48 * 1024;

/// Where the start-up code of the microcontroller goes.
#[cortex_m_rt::entry]
fn main() -> ! {
    serve(&mut Usart::open(), &mut Aligned([0; POLICY_LIMIT]).0);
    machine::end(Verdict::Passed)
}
