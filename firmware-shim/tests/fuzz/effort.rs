//! How much is tried, and what it costs.

use std::env;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Memory that a test may take for itself after its beginning \[KiB\]: what the test harness needs, and far less than a byte
/// per frame.
const GROWTH_LIMIT_KIB: u64 = 4096;

/// One at a time: memory is that of the whole process.
static TURN: Mutex<()> = Mutex::new(());

/// A number from the environment.
pub(crate) fn number(variable: &str, default: u64) -> u64 {
    env::var(variable).map_or(default, |text| text.parse().expect("a whole number"))
}

pub(crate) fn seed() -> u64 {
    number("FUZZ_SEED", 1)
}

/// Time and memory since the beginning of a test.
pub(crate) struct Effort {
    start: Instant,
    resident_kib: Option<u64>,
    _turn: MutexGuard<'static, ()>,
}

impl Effort {
    pub(crate) fn begin() -> Self {
        // A test that failed takes no other one down.
        let turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
        Self { start: Instant::now(), resident_kib: memory_kib("VmRSS:"), _turn: turn }
    }

    /// Says what `count` things of a kind took, and that memory has not grown.
    pub(crate) fn end(&self, count: u64, kind: &str) {
        let secs = self.start.elapsed().as_secs_f64();
        let nanos = secs * 1e9 / count.max(1) as f64;
        print!("{count} {kind} in {secs:.1} s, {nanos:.0} ns each");
        let (before, after, peak) = (self.resident_kib, memory_kib("VmRSS:"), memory_kib("VmHWM:"));
        if let (Some(before), Some(after), Some(peak)) = (before, after, peak) {
            println!("; memory {before} KiB before, {after} KiB after, {peak} KiB at most");
            assert!(after <= before + GROWTH_LIMIT_KIB, "memory grew from {before} KiB to {after} KiB");
        } else {
            println!();
        }
    }
}

/// What Linux says of this process.
fn memory_kib(name: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}
