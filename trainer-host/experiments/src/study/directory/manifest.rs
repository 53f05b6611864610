//! What reports read of a study: `study.json`, from the study and from what earlier runs have measured.

use kestrel_sim::seed::Purpose;

use crate::evaluation::{Flyer, Starts, evaluate};
use crate::experiment_config::Experiment;
use crate::study::config::PublishedTable;
use crate::study::data::{Baseline, Method, Published, PublishedRow, PublishedValue, StudyManifest, Task};
use crate::study::{Study, procedure};

/// Success rate from which a task counts as learned, where the study does not stop there.
const SUCCESS_THRESHOLD: f64 = 0.9;

/// Flights of each trivial pilot in each task.
const BASELINE_EPISODES: usize = 256;

/// Whether trivial pilots fly the tasks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Baselines {
    /// They do, unless an earlier run had them fly.
    Flown,
    /// They do not.
    LeftOut,
}

/// The study for whoever reads its directory; what an earlier run has measured is taken over.
pub(super) fn of(study: &Study, known: Option<StudyManifest>, baselines: Baselines) -> StudyManifest {
    StudyManifest {
        name: study.name.clone(),
        about: study.about.clone(),
        tasks: study.tasks.iter().map(task).collect(),
        orders: study.orders.clone(),
        methods: study.methods.iter().map(|each| method(each, known.as_ref())).collect(),
        seeds: study.seeds.iter().map(|seed| seed.0).collect(),
        steps_per_stage: study.most_steps(),
        success_threshold: study.evaluation.stop_at_success.unwrap_or(SUCCESS_THRESHOLD),
        published: study.published.as_ref().map(published),
        claims: study.claims.clone(),
        baselines: match (known, baselines) {
            (Some(known), _) => known.baselines,
            (None, Baselines::Flown) => study.tasks.iter().flat_map(|task| flown(study, task)).collect(),
            (None, Baselines::LeftOut) => Vec::new(),
        },
    }
}

fn task(task: &Experiment) -> Task {
    Task { name: task.name.clone(), episode_secs: f64::from(task.evaluation.scenario.episode_secs) }
}

fn method(method: &procedure::Method, known: Option<&StudyManifest>) -> Method {
    let earlier = known.and_then(|known| known.method(&method.name));
    Method {
        name: method.name.clone(),
        label: method.name.clone(),
        kind: method.procedure.kind(),
        training_bytes: earlier.map_or(0, |earlier| earlier.training_bytes),
        stored_bytes: earlier.map_or(0, |earlier| earlier.stored_bytes),
        parameters: earlier.map_or(0, |earlier| earlier.parameters),
        description: method.about.clone(),
    }
}

fn published(table: &PublishedTable) -> Published {
    let value = |text: &String| text.parse().map_or(PublishedValue::NeverReached, PublishedValue::Number);
    Published {
        title: table.title.clone(),
        columns: table.columns.clone(),
        rows: table
            .rows
            .iter()
            .map(|row| PublishedRow { label: row.name.clone(), values: row.cells.iter().map(value).collect() })
            .collect(),
        notes: if table.notes.is_empty() { Vec::new() } else { vec![table.notes.clone()] },
    }
}

/// What trivial pilots achieve in a task.
fn flown(study: &Study, task: &Experiment) -> [Baseline; 3] {
    let starts = Starts { seed: study.evaluation.seed, purpose: Purpose::Evaluation, episodes: BASELINE_EPISODES };
    [Flyer::Nothing, Flyer::Random, Flyer::Scripted].map(|flyer| {
        let found = evaluate(&task.evaluation.scenario, flyer, starts);
        Baseline {
            task: task.name.clone(),
            pilot: found.pilot,
            success_rate: found.success_rate,
            episode_return: found.episode_return,
            episodes: found.episodes,
        }
    })
}
