//! Worlds that are drawn, made before training begins.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU32, Ordering};

use kestrel_sim::scenario::Scenario;
use rayon::prelude::*;

use crate::progress::Progress;

/// Fewer are there at once; nobody wants to read about them.
const SHOWN_FROM: u32 = 256;

/// Makes the worlds in which so many environments begin, and shows how far that is; later episodes make the others when
/// they draw them.
pub(crate) fn prepare(scenario: &Scenario, environments: usize) {
    let worlds = scenario.rooms().min(u32::try_from(environments).unwrap_or(u32::MAX));
    let progress = (worlds >= SHOWN_FROM).then(|| Mutex::new(Progress::counting("worlds", u64::from(worlds), 0)));
    let done = AtomicU32::new(0);
    (0..worlds).into_par_iter().for_each(|world| {
        scenario.prepare_room(world);
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        // Whoever finds it in use leaves showing to the next.
        if let Some(Ok(mut progress)) = progress.as_ref().map(Mutex::try_lock) {
            progress.show_steps(u64::from(done), String::new);
        }
    });
    if let Some(Ok(progress)) = progress.as_ref().map(Mutex::try_lock) {
        progress.finish();
    }
}
