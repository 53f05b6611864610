use std::sync::LazyLock;

use kestrel_sim::seed::{Purpose, Seed};
use proptest::prelude::*;

use super::*;
use crate::evaluation::{Flyer, Starts};
use kestrel_draw::video::{VideoFormat, flight_video};

const HERE: &str = "flight.recording";

fn experiment() -> Experiment {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/cross.yaml");
    experiment_config::load(&path, &[]).unwrap()
}

/// The scripted pilot, from several starts as if they were drones of one aviary.
fn recording(drones: u32) -> Recording {
    let experiment = experiment();
    let tracks = (0..drones).map(|start| track(&experiment, start));
    Recording {
        pilot: "scripted pilot".to_owned(),
        config: experiment.resolved_yaml.clone(),
        seed: 0,
        start: 0,
        components: vec!["progress".to_owned(), "tilt".to_owned()],
        drones: tracks.collect(),
        movables: Vec::new(),
    }
}

/// What the scripted pilot does from a start, with actions and rewards of our own.
fn track(experiment: &Experiment, start: u32) -> Track {
    let starts = Starts { seed: Seed(0), purpose: Purpose::Evaluation, episodes: 1 };
    let mut track = fly(experiment, Flyer::Scripted, starts, start).drones.remove(0);
    let (last, others) = track.steps.split_last_mut().expect("it flew");
    for step in others {
        *step = Step {
            action: vec![f64::from(0.1_f32), f64::from(-0.2_f32), f64::from(0.3_f32), 0.0],
            rewards: vec![0.5, -0.125],
        };
    }
    *last = Step { action: vec![0.0; 4], rewards: vec![10.0, 0.0] };
    "reached the goal".clone_into(&mut track.ending);
    track
}

fn small() -> Recording {
    let mut recording = recording(1);
    recording.drones[0].moments.truncate(3);
    recording.drones[0].steps.truncate(3);
    recording
}

fn refusal(recording: &Recording) -> String {
    recording.check(Path::new(HERE)).unwrap_err().to_string()
}

#[test]
fn what_was_recorded_is_read() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(HERE);
    let recording = recording(2);
    recording.write(&path).unwrap();
    assert_eq!(Recording::read(&path).unwrap(), recording);
}

#[test]
fn a_recording_knows_its_world_and_can_be_drawn() {
    let recording = recording(3);
    let path = Path::new(HERE);
    let experiment = recording.experiment(path).unwrap();
    let flight = recording.flight(&experiment, path).unwrap();
    assert_eq!((flight.drones.len(), flight.title.as_str()), (3, "cross: scripted pilot"));
    let film = flight_video(flight, &experiment.scenario, HERE, VideoFormat::Gif).unwrap();
    assert!(film.starts_with(b"GIF89a"));
}

#[test]
fn contradictions_are_refused() {
    let mut recording = small();
    recording.drones[0].moments.truncate(1);
    assert_eq!(
        refusal(&recording),
        "flight.recording contradicts itself: found 1 states of drone 0, expected 4 for its 3 steps"
    );
    let mut recording = small();
    recording.drones[0].steps[1].rewards.pop();
    assert!(
        refusal(&recording).ends_with("found 1 rewards of drone 0 in one step, expected 2, one per component")
    );
    let mut recording = small();
    recording.drones.clear();
    assert!(refusal(&recording).ends_with("found no drones, expected at least one"));
    let mut recording = small();
    let body = Placed { position: [0.0; 3], attitude: [1.0, 0.0, 0.0, 0.0] };
    recording.movables = vec![vec![body], vec![]];
    assert!(refusal(&recording).ends_with("found 0 movable bodies, expected 1 at all times"));
    recording.movables.pop();
    let error = recording.flight(&experiment(), Path::new(HERE)).unwrap_err().to_string();
    assert!(error.ends_with("found 1 movable bodies, expected the 0 of its world"), "{error}");
}

#[test]
fn other_files_are_refused_in_one_sentence() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join(HERE);
    let refused = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        Recording::read(&path).unwrap_err().to_string().replace(path.to_str().unwrap(), "it")
    };
    assert_eq!(
        refused(b"KESTRELC and more"),
        r#"it is no recording: it begins with "KESTRELC", expected "KESTRELR""#
    );
    assert_eq!(refused(b""), "it is truncated: found 0 bytes, expected 24");
    let mut newer = KIND.encode(&small());
    newer[8] = 9;
    assert_eq!(refused(&newer), "it has recording format 9, expected 1: use the version of kestrel that wrote it");
    let missing = Recording::read(&directory.path().join("none")).unwrap_err().to_string();
    assert!(missing.starts_with("cannot read ") && missing.contains("No such file"), "{missing}");
}

#[test]
fn a_configuration_of_another_program_is_named_with_its_line() {
    let mut recording = small();
    recording.config = recording.config.replace("airframe: cf2x", "airframe: zeppelin");
    let error = recording.experiment(Path::new(HERE)).unwrap_err();
    assert_eq!(error.to_string(), "the configuration in flight.recording");
    let cause = std::error::Error::source(&error).unwrap().to_string();
    assert!(cause.starts_with("flight.recording: config:") && cause.contains("`zeppelin`"), "{cause}");
}

#[test]
fn the_summary_adds_up_the_rewards() {
    let recording = small();
    let summary = recording.summary(&experiment());
    let [heading, drone] = summary.lines().collect::<Vec<_>>()[..] else { panic!("{summary}") };
    assert_eq!(heading, "cross: scripted pilot, start 0 of seed 0");
    assert!(drone.ends_with("return 1.125 (progress 1.500, tilt -0.375)"), "{drone}");
}

#[test]
fn the_table_reads_back_to_the_same_bits() {
    let recording = small();
    let table = recording.table(0.02).csv();
    let mut lines = table.lines();
    let names: Vec<_> = lines.next().unwrap().split(',').collect();
    assert_eq!(
        names[..9],
        [
            "drone",
            "time_secs",
            "position_x_m",
            "position_y_m",
            "position_z_m",
            "attitude_w",
            "attitude_x",
            "attitude_y",
            "attitude_z"
        ]
    );
    assert_eq!(names[19..], ["action_0", "action_1", "action_2", "action_3", "reward_progress", "reward_tilt"]);
    for (line, moment) in lines.by_ref().zip(&recording.drones[0].moments) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells.len(), names.len());
        for (cell, value) in cells[2..].iter().zip(moment.placed.position) {
            assert_eq!(cell.parse(), Ok(value));
        }
    }
    let mut ended = small();
    ended.drones[0].steps.truncate(2);
    assert!(ended.table(0.02).csv().ends_with(",,,,,,\n"), "the last state has no action");
}

static BYTES: LazyLock<Vec<u8>> = LazyLock::new(|| KIND.encode(&small()));

proptest! {
    #[test]
    fn no_flipped_bit_goes_unnoticed(bit in 0..8 * BYTES.len()) {
        let mut bytes = BYTES.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        prop_assert!(KIND.decode::<Recording>(Path::new(HERE), &bytes).is_err());
    }
}
