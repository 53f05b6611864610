//! A page that flies and trains policies in the browser, without a server: core, simulator and trainer compiled to WebAssembly.
//!
//! [`FreeFlight`] flies a policy to wherever the mouse points, [`TaskFlight`] flies the episodes of a task, [`WebTraining`] trains;
//! the page in `page/` shows them. What they show and change are the crates that programs use: here are only bindings.
//! `sim-host/web/build` makes a folder that any static server serves.

mod free_flight;
mod furniture;
mod pixels;
mod policy;
mod stage;
mod task_flight;
#[cfg(test)]
mod testing;
mod training;

pub use free_flight::FreeFlight;
pub use policy::WebPolicy;
pub use stage::Look;
pub use task_flight::TaskFlight;
pub use training::{WebTraining, WebUpdate, crazyflie_zip};

use kestrel_experiments::experiment_config::{self, Experiment};
use kestrel_sim::config::ConfigError;
use wasm_bindgen::prelude::*;

/// Says what panics in the console of the browser.
#[cfg(target_family = "wasm")]
#[wasm_bindgen(start)]
pub fn start() {
    console_error_panic_hook::set_once();
}

/// The version of Kestrel.
#[wasm_bindgen]
pub fn version() -> String {
    env!("CARGO_PKG_VERSION").to_owned()
}

/// The experiment in YAML whose imports are resolved.
fn experiment(yaml: &str) -> Result<Experiment, ConfigError> {
    experiment_config::parse("task.yaml", yaml, &[])
}
