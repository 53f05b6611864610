#![no_std]
#![no_main]
//! What a firmware links to fly a policy, and nothing else: its flash is the price of a pilot.

use core::hint::black_box;

use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::PolicyFile;
use kestrel_image::input::Inputs;
use kestrel_image::machine::{self, Verdict};
use kestrel_image::policy::FLOWN;

/// Where the start-up code of the microcontroller goes.
#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let Ok(policy) = PolicyFile::parse(FLOWN.bytes) else { machine::end(Verdict::Failed) };
    let mut pilot = Pilot::new(policy);
    if pilot.self_test().is_err() {
        machine::end(Verdict::Failed)
    }
    let mut inputs = Inputs::new(5);
    black_box(pilot.tick(&inputs.state(), &inputs.vector()));
    machine::end(Verdict::Passed)
}
