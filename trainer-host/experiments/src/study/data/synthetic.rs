//! Studies whose answers are known, for tests.

use std::fs;
use std::path::Path;

use super::{Baseline, Method, MethodKind, Published, PublishedRow, PublishedValue, StudyManifest, Task};
use crate::study::rows::{CurveRow, EpisodeRow, Job, write_curve, write_episodes};

/// Flights of a cell: a success rate in hundredths is exact.
pub(crate) const EPISODES: u32 = 100;

/// Steps between two points of a curve, and their number.
const CURVE_STEPS: u64 = 100_000;
const CURVE_POINTS: u64 = 10;

/// Three tasks in two orders by four methods and several seeds.
///
/// Success in hundredths, plus what a seed adds: `none` learns each task to 90 and keeps 60 of those learned before;
/// `anchor` learns to 88 and keeps 83; `joint` has 95 and `experts` 96 in every task.
pub(crate) fn manifest(seeds: u64) -> StudyManifest {
    let task = |name: &str| Task { name: name.to_owned(), episode_secs: 10.0 };
    StudyManifest {
        name: "rooms".to_owned(),
        about: "Which methods keep what they have learned when rooms come one after the other?".to_owned(),
        tasks: ["room-0", "room-1", "room-2"].map(task).to_vec(),
        orders: vec![vec![0, 1, 2], vec![2, 0, 1]],
        methods: vec![
            method("none", "fine-tuning", MethodKind::Sequential, 0),
            method("anchor", "diagonal anchor", MethodKind::Sequential, 45_120),
            method("joint", "joint training", MethodKind::Joint, 0),
            method("experts", "one expert per room", MethodKind::Experts, 67_680),
        ],
        seeds: (0..seeds).collect(),
        steps_per_stage: CURVE_STEPS * CURVE_POINTS,
        baselines: baselines(&["room-0", "room-1", "room-2"]),
        success_threshold: 0.8,
        published: Some(published()),
        claims: Vec::new(),
    }
}

pub(crate) fn method(name: &str, label: &str, kind: MethodKind, stored_bytes: u64) -> Method {
    Method {
        name: name.to_owned(),
        label: label.to_owned(),
        kind,
        training_bytes: 2 * stored_bytes,
        stored_bytes,
        parameters: 5640,
        description: format!("Trains {label}."),
    }
}

fn baselines(tasks: &[&str]) -> Vec<Baseline> {
    let pilots = [("do nothing", 0.0, 87.9), ("random", 0.0, 20.0), ("scripted pilot", 0.75, 110.0)];
    let rows = tasks.iter().flat_map(|task| pilots.map(|pilot| (*task, pilot)));
    rows.map(|(task, (pilot, success_rate, episode_return))| Baseline {
        task: task.to_owned(),
        pilot: pilot.to_owned(),
        success_rate,
        episode_return,
        episodes: 256,
    })
    .collect()
}

fn published() -> Published {
    let row = |label: &str, values: &[f64]| PublishedRow {
        label: label.to_owned(),
        values: values
            .iter()
            .map(|value| PublishedValue::Number(*value))
            .chain([PublishedValue::NeverReached])
            .collect(),
    };
    Published {
        title: "A published table (returns)".to_owned(),
        columns: ["room 0", "room 1", "room 2"].map(str::to_owned).to_vec(),
        rows: vec![row("incremental", &[53.8, 59.35]), row("on 0", &[104.91, 26.85])],
        notes: vec!["One run each.".to_owned()],
    }
}

/// Success in hundredths of `method` in the task at `position` of its order after `stage`, without the seed's share.
pub(crate) fn hundredths(method: &str, stage: usize, position: usize) -> u32 {
    match method {
        _ if stage == 0 => 0,
        "joint" => 95,
        "experts" => {
            if stage == position + 1 {
                96
            } else {
                10
            }
        }
        _ if position >= stage => 10,
        "anchor" => {
            if stage == position + 1 {
                88
            } else {
                83
            }
        }
        _ => {
            if stage == position + 1 {
                90
            } else {
                60
            }
        }
    }
}

/// What a seed adds to every trained cell \[hundredths\]: 0, 1, 2, 3, 0, ….
pub(crate) fn of_seed(seed: u64) -> u32 {
    (seed % 4) as u32
}

/// Writes a complete study.
pub(crate) fn write(directory: &Path, manifest: &StudyManifest) {
    manifest.save(directory).unwrap();
    for job in manifest.jobs() {
        write_job(directory, manifest, &job);
    }
}

pub(crate) fn write_job(directory: &Path, manifest: &StudyManifest, job: &Job) {
    let path = job.rows_path(directory);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut out = Vec::new();
    write_episodes(&mut out, manifest, job, &episodes(manifest, job)).unwrap();
    fs::write(path, out).unwrap();
    let path = job.curve_path(directory);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut out = Vec::new();
    write_curve(&mut out, job, &curve(manifest, job)).unwrap();
    fs::write(path, out).unwrap();
}

pub(crate) fn episodes(manifest: &StudyManifest, job: &Job) -> Vec<EpisodeRow> {
    let order = &manifest.orders[job.order];
    let stages = manifest.method(&job.method).unwrap().kind.stages(order.len());
    let mut rows = Vec::new();
    for stage in 0..=stages {
        for (position, &task) in order.iter().enumerate() {
            let base = hundredths(&job.method, stage, position);
            let successes = if base == 0 { 0 } else { base + of_seed(job.seed) };
            rows.extend((0..EPISODES).map(|episode| flight(stage, task, episode, episode < successes)));
        }
    }
    rows
}

fn flight(stage: usize, task: usize, episode: u32, success: bool) -> EpisodeRow {
    let (episode_return, length_secs) = if success { (120.0, 4.1) } else { (20.0, 10.0) };
    EpisodeRow { stage, task, episode, success, episode_return, length_secs }
}

/// Rises in a straight line and is at the end what the cell of the stage is; the later tasks of a sequence rise twice
/// as fast, and then stay.
fn curve(manifest: &StudyManifest, job: &Job) -> Vec<CurveRow> {
    let order = &manifest.orders[job.order];
    let kind = manifest.method(&job.method).unwrap().kind;
    let mut rows = Vec::new();
    for stage in 1..=kind.stages(order.len()) {
        let reached = hundredths(&job.method, stage, stage - 1) + of_seed(job.seed);
        let speed = if kind == MethodKind::Sequential && stage > 1 { 2.0 } else { 1.0 };
        for point in 1..=CURVE_POINTS {
            let share = (speed * point as f32 / CURVE_POINTS as f32).min(1.0);
            let success_rate = share * reached as f32 / 100.0;
            let steps = point * CURVE_STEPS;
            rows.push(CurveRow { stage, steps, success_rate, episode_return: 20.0 + 100.0 * success_rate });
        }
    }
    rows
}
