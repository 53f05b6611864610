use std::fs;
use std::path::Path;

use kestrel_sim::seed::{Purpose, Seed};
use tempfile::TempDir;

use super::files::{Former, Sequel};
use super::*;
use crate::evaluation::evaluate;
use crate::experiment_config::{self, Experiment};
use crate::golden::in_repository;

const STARTS: Starts = Starts { seed: Seed(0), purpose: Purpose::Evaluation, episodes: 16 };

fn load(path: &Path) -> Experiment {
    experiment_config::load(path, &[]).unwrap()
}

/// A pillar in the way of the scripted pilot, written into the folder; the new task's path.
fn obstruct(task: &Path, place: &TempDir, name: &str) -> (Spot, std::path::PathBuf) {
    let scenario = load(task).evaluation.scenario;
    let traffic = Traffic::observe(&scenario, Flyer::Scripted, STARTS).unwrap();
    let spot = traffic.obstruct(&scenario).unwrap();
    let (world, output) =
        (place.path().join(format!("worlds/{name}.yaml")), place.path().join(format!("{name}.yaml")));
    let sequel = Sequel { name, world: &world, task: &output, command: "kestrel aviary obstruct" };
    let former = Former::read(task).unwrap();
    fs::create_dir_all(place.path().join("worlds")).unwrap();
    fs::write(&world, sequel.world_text(&former, former.world.as_ref().unwrap(), &spot)).unwrap();
    fs::write(&output, sequel.task_text(&former)).unwrap();
    (spot, output)
}

#[test]
fn pillars_go_where_flights_pass_and_leave_a_way_again_and_again() {
    let place = tempfile::tempdir().unwrap();
    let first = in_repository("configs/aviaries/incremental-cross-0.yaml");
    let (spot, second) = obstruct(&first, &place, "second");
    // The scripted pilot flies straight to (4.5, 0) from anywhere within 0.4 m of (-0.5, 0), so that its flights converge.
    assert!(spot.passing >= 15 && spot.at[1].abs() < 0.2 && (1.0..3.2).contains(&spot.at[0]), "{spot:?}");
    let (next, third) = obstruct(&second, &place, "third");
    assert!(next.passing > 8 && next != spot, "{next:?}");
    let task = load(&third);
    let pillars: Vec<_> =
        task.scenario.aviary.world.solids.iter().filter(|solid| solid.name == "pillar").collect();
    assert_eq!(pillars.len(), 2);
    assert_eq!(task.scenario.aviary.goal, load(&first).scenario.aviary.goal);
    assert_eq!(task.name, "third");
    assert!(evaluate(&task.evaluation.scenario, Flyer::Scripted, STARTS).success_rate >= 0.9);
}

#[test]
fn pilots_that_fail_get_nothing_harder() {
    let scenario = load(&in_repository("configs/aviaries/incremental-cross-0.yaml")).evaluation.scenario;
    let error = Traffic::observe(&scenario, Flyer::Nothing, STARTS).unwrap_err();
    assert!(error.to_string().starts_with("found 0 of 16 flights successful, expected at least half"), "{error}");
}

#[test]
fn a_task_without_bounds_or_starts_is_refused() {
    let scenario = load(&in_repository("configs/aviaries/incremental-cross-0.yaml")).evaluation.scenario;
    let traffic = Traffic::observe(&scenario, Flyer::Scripted, STARTS).unwrap();
    let open = Scenario { terminations: Vec::new(), ..scenario.clone() };
    assert!(traffic.obstruct(&open).unwrap_err().to_string().contains("out_of_bounds"));
    let mut elsewhere = scenario;
    elsewhere.start.position = StartPosition::Exactly(Vec::new());
    assert!(traffic.obstruct(&elsewhere).unwrap_err().to_string().contains("evaluation.start.position.within"));
}

#[test]
fn a_full_room_takes_no_pillar() {
    let mut scenario = load(&in_repository("configs/aviaries/incremental-cross-0.yaml")).evaluation.scenario;
    let traffic = Traffic::observe(&scenario, Flyer::Scripted, STARTS).unwrap();
    let full = Solid::block("crate", Vector3::new(0.2, -1.0, 0.0), Vector3::new(3.9, 1.0, 0.9));
    scenario.aviary.world.solids.push(full);
    assert!(matches!(traffic.obstruct(&scenario), Err(ObstructionError::Full)));
}

#[test]
fn spots_are_counted_by_the_flights_that_pass_below_the_top() {
    let at = |z: f64| (0..41).map(|step| Vector3::new(f64::from(step) * 0.1, 0.0, z)).collect::<Vec<_>>();
    let traffic = Traffic { flights: vec![at(0.5), at(0.5), at(1.2)] };
    let spots = traffic.spots();
    assert_eq!(spots[0], (Vector2::new(2.0, 0.0), 2));
    assert!(spots.iter().all(|(spot, passing)| *passing <= 2 && spot.y.abs() <= PASSING_M + 1e-9));
}
