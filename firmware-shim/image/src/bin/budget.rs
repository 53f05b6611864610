#![no_std]
#![no_main]
//! Runs each part of a control period where its instructions are counted; see [`kestrel_image::budget`].

use kestrel_image::{budget, machine};

/// Where the start-up code of the microcontroller goes.
#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    machine::end(budget::run())
}
