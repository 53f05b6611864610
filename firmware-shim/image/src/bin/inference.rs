#![no_std]
#![no_main]
//! A network in fixed point, and nothing else: its flash is the price of the weights and of the code that they need.

use core::hint::black_box;

use kestrel_core::fixed::FixedScratch;
use kestrel_image::machine::{self, Verdict};
use kestrel_image::policy::NETWORK;

/// Where the start-up code of the microcontroller goes.
#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let Ok(network) = NETWORK.network() else { machine::end(Verdict::Failed) };
    let mut scratch = FixedScratch::new();
    black_box(network.act(black_box(&[0.5; 16]), &mut scratch));
    machine::end(Verdict::Passed)
}
