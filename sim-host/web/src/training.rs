//! Training in the page.

use std::io::{Cursor, Write};

use kestrel_experiments::evaluation::{Flyer, evaluate};
use kestrel_experiments::experiment_config;
use kestrel_experiments::results::{exported, starts};
use kestrel_experiments::run_config::Subject;
use kestrel_experiments::training_run::Training;
use kestrel_export::policy::Policy;
use kestrel_export::source::crazyflie_app;
use wasm_bindgen::prelude::*;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// A training, update by update, as `kestrel train` trains.
#[wasm_bindgen]
#[derive(Debug)]
pub struct WebTraining {
    training: Training,
}

/// What an update came to.
#[wasm_bindgen]
#[derive(Clone, Copy, Debug)]
pub struct WebUpdate {
    /// Environment steps so far.
    pub steps: f64,
    /// Those after which the training ends.
    pub total_steps: f64,
    /// Share of successes in the best test so far; NaN before the first.
    pub success_rate: f64,
}

#[wasm_bindgen]
impl WebTraining {
    /// Begins to train on a task, YAML with resolved imports.
    ///
    /// # Errors
    /// When the task is wrong or cannot be trained on.
    #[wasm_bindgen(constructor)]
    pub fn new(task: &str, seed: u32) -> Result<Self, JsError> {
        let overrides = [format!("training.seed={seed}")];
        let experiment = experiment_config::parse_to_train("task.yaml", task, &overrides)?;
        Ok(Self { training: Training::begin(experiment)? })
    }

    /// One update; now and then a test.
    pub fn update(&mut self) -> WebUpdate {
        self.training.update();
        WebUpdate {
            steps: self.training.steps() as f64,
            total_steps: self.training.experiment().total_steps() as f64,
            success_rate: self.training.tested().map_or(f64::NAN, |test| test.success_rate),
        }
    }

    /// Whether it is at its end.
    #[wasm_bindgen(getter)]
    pub fn is_finished(&self) -> bool {
        self.training.is_finished()
    }

    /// The best policy so far as a policy file, in fixed point: the bytes of `policy.kestrel` in a run directory.
    ///
    /// # Errors
    /// When it does not fit a policy file.
    pub fn policy(&self) -> Result<Vec<u8>, JsError> {
        let (actor, steps) = self.training.best();
        Ok(exported(&Subject::of(self.training.experiment()), actor, steps)?.fixed_policy)
    }

    /// Share of successes of a policy file in the flights that judge the task.
    ///
    /// # Errors
    /// When the file is damaged.
    pub fn judge(&self, policy: &[u8]) -> Result<f64, JsError> {
        let experiment = self.training.experiment();
        let policy = Policy::parse(policy)?;
        Ok(evaluate(&experiment.evaluation.scenario, Flyer::Policy(&policy), starts(experiment)).success_rate)
    }
}

/// The app for crazyflie-firmware around a policy file, as a ZIP archive: what `kestrel export --target crazyflie` writes.
///
/// # Errors
/// When a Crazyflie cannot show the policy what it sees, or do what it commands.
#[wasm_bindgen]
pub fn crazyflie_zip(policy: &[u8]) -> Result<Vec<u8>, JsError> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, contents) in crazyflie_app(policy, &[])? {
        archive.start_file(format!("crazyflie/{name}"), options)?;
        archive.write_all(contents.as_bytes())?;
    }
    Ok(archive.finish()?.into_inner())
}
