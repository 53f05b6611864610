//! Returns of the reference's environments under constant actions: facts of PyBullet, to every printed digit.
//!
//! They were measured in double precision with the thesis's fork (commit 40d017e) on PyBullet 3.2.7; upstream's hover is
//! a closed form.

use std::fs;
use std::path::PathBuf;

use kestrel_experiments::experiment_config::{Experiment, load};
use kestrel_sim::outcome::{Ending, Outcome};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::{Purpose, Seed, Stream};
use kestrel_sim::simulation::Simulation;

/// An episode of an aviary under one action.
struct Golden {
    aviary: &'static str,
    overrides: &'static [&'static str],
    action: [f64; 4],
    steps: u32,
    /// As printed, which says how many digits count.
    total: &'static str,
    ending: Ending,
}

const HOVER: [f64; 4] = [0.0; 4];
const DROP_ON_TABLE: &[&str] = &["scenario.start.position={exactly: [{position_m: [6.5, 0.0, 0.7]}]}"];

/// An episode of doing nothing that the clock ends.
const fn nothing(aviary: &'static str, steps: u32, total: &'static str) -> Golden {
    Golden { aviary, overrides: &[], action: HOVER, steps, total, ending: Ending::TimeLimit }
}

/// An episode that something else ends.
const fn ended(
    aviary: &'static str,
    action: [f64; 4],
    (steps, total): (u32, &'static str),
    ending: Ending,
) -> Golden {
    Golden { aviary, overrides: &[], action, steps, total, ending }
}

const SINGLE: [Golden; 17] = [
    nothing("hover", 242, "-190.61"),
    Golden {
        overrides: &["scenario.physics.substeps=1", "scenario.physics.control_rate_hz=240"],
        ..nothing("hover", 1202, "-946.76")
    },
    nothing("takeoff", 242, "-215.11"),
    nothing("fly-through-gate", 242, "-4243.86"),
    nothing("land", 482, "50.63"),
    nothing("land-with-obstacles", 482, "484.43"),
    ended("field", HOVER, (960, "97.0"), Ending::OutOfFuel),
    ended("incremental-cross-0", [1.0; 4], (49, "-9.41"), Ending::OutOfBounds),
    ended("incremental-cross-0", [-1.0; 4], (45, "-9.45"), Ending::OutOfBounds),
    ended("incremental-cross-0", [0.02, -0.02, -0.02, 0.02], (49, "-9.41"), Ending::Collision),
    ended("incremental-cross-0", [-0.02, 0.02, 0.02, -0.02], (67, "1.35"), Ending::Tilt),
    ended("room-0", [1.0; 4], (69, "7.58"), Ending::OutOfBounds),
    ended("room-1", [1.0; 4], (69, "7.58"), Ending::OutOfBounds),
    ended("room-2", [1.0; 4], (69, "7.58"), Ending::OutOfBounds),
    Golden { overrides: DROP_ON_TABLE, ..ended("room-0", [-0.1; 4], (47, "121.638"), Ending::Success) },
    Golden { overrides: DROP_ON_TABLE, ..ended("room-2", [-0.1; 4], (47, "121.636"), Ending::Success) },
    // 242 (2 - 0.8875⁴): the drone hovers where it starts.
    nothing("upstream-hover", 242, "333.86"),
];

/// Aviaries in which doing nothing earns the same, whatever stands there.
const FAMILIES: [(&str, u32, &str); 6] = [
    ("cross-", 482, "4.92"),
    ("incremental-cross-", 482, "4.92"),
    ("harder-cross-", 482, "4.92"),
    ("norm", 482, "5.82"),
    ("long-cross-", 962, "10.62"),
    ("room-", 482, "87.902"),
];

fn aviaries() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../configs/aviaries")
}

/// Names of the configurations, without `.yaml`, in order.
fn names() -> Vec<String> {
    let entries = fs::read_dir(aviaries()).unwrap().map(|entry| entry.unwrap().path());
    let files = entries.filter(|path| path.extension().is_some_and(|extension| extension == "yaml"));
    let mut names: Vec<String> =
        files.map(|path| path.file_stem().unwrap().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn experiment(name: &str, overrides: &[&str]) -> Experiment {
    let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
    load(&aviaries().join(format!("{name}.yaml")), &overrides).unwrap_or_else(|error| panic!("{error}"))
}

/// Steps, return in double precision and ending of one episode.
fn fly(scenario: &Scenario, action: &[f64]) -> (u32, f64, Ending) {
    let mut simulation = Simulation::<1, f64>::new(scenario, Seed(0), 0, 1);
    let mut total = 0.0;
    loop {
        simulation.step(action);
        total += simulation.rewards()[0];
        if let Some(episode) = simulation.take_episodes().pop() {
            return (episode.steps, total, episode.ending);
        }
    }
}

/// What differs from the golden, in words.
fn difference(golden: &Golden) -> Option<String> {
    let name = format!("{}-as-published", golden.aviary);
    let scenario = experiment(&name, golden.overrides).scenario;
    let (steps, total, ending) = fly(&scenario, &golden.action[..scenario.action.len()]);
    let digits = golden.total.split_once('.').map_or(0, |(_, digits)| digits.len());
    let found = format!("{total:.digits$}");
    let same = (steps, found.as_str(), ending) == (golden.steps, golden.total, golden.ending);
    (!same).then(|| {
        format!(
            "{name} {:?}: found {steps} steps, return {total}, {}; expected {}, {}, {}",
            golden.action,
            ending.name(),
            golden.steps,
            golden.total,
            golden.ending.name()
        )
    })
}

#[test]
fn the_returns_of_the_reference() {
    let differences: Vec<String> = SINGLE.iter().filter_map(difference).collect();
    assert!(differences.is_empty(), "\n{}", differences.join("\n"));
}

#[test]
fn doing_nothing_earns_the_same_whatever_stands_there() {
    let mut differences = Vec::new();
    let mut flown = 0;
    for name in names() {
        let Some(aviary) = name.strip_suffix("-as-published") else { continue };
        let family = match aviary.strip_suffix("-norm") {
            Some(_) => FAMILIES.iter().find(|(prefix, ..)| *prefix == "norm"),
            None => FAMILIES.iter().find(|(prefix, ..)| aviary.starts_with(prefix)),
        };
        let Some((_, steps, total)) = family else { continue };
        let scenario = experiment(&name, &[]).scenario;
        let (found_steps, found, ending) = fly(&scenario, &HOVER);
        let digits = total.split_once('.').map_or(0, |(_, digits)| digits.len());
        if (found_steps, format!("{found:.digits$}").as_str(), ending) != (*steps, *total, Ending::TimeLimit) {
            differences.push(format!("{name}: found {found_steps} steps, return {found}, {}", ending.name()));
        }
        flown += 1;
    }
    assert!(differences.is_empty(), "\n{}", differences.join("\n"));
    assert_eq!(flown, 4 + 7 + 6 + 7 + 4 + 3, "aviaries with a known return");
}

/// A clock that says that it ended an episode truncates it; one that does not, terminates it.
#[test]
fn running_out_of_time_means_what_the_reference_reports() {
    let last = |name: &str| {
        let scenario = experiment(name, &[]).scenario;
        let mut simulation = Simulation::<1, f64>::new(&scenario, Seed(0), 0, 1);
        for _ in 0..scenario.episode_steps() {
            assert_eq!(simulation.outcomes()[0], Outcome::Running);
            simulation.step(&HOVER);
        }
        simulation.outcomes()[0]
    };
    assert_eq!(last("hover-as-published"), Outcome::Terminated);
    assert_eq!(last("cross-0-as-published"), Outcome::Truncated);
    assert_eq!(last("upstream-hover-as-published"), Outcome::Truncated);
}

#[test]
fn every_aviary_loads_and_flies() {
    let names = names();
    assert!(names.len() >= 70, "{} aviaries", names.len());
    for name in names {
        let scenario = experiment(&name, &[]).scenario;
        let mut simulation = Simulation::<64>::new(&scenario, Seed(3), 0, 6);
        let mut stream = Stream::new(Seed(3), 0, Purpose::Actions);
        let mut actions = vec![0.0; scenario.action.len() * simulation.rows()];
        for step in 0..50 {
            actions.fill_with(|| stream.between(-1.0, 1.0));
            simulation.step(&actions);
            let numbers = [simulation.observations(), simulation.rewards(), simulation.privileged()].concat();
            assert!(numbers.iter().all(|number| number.is_finite()), "{name}, step {step}");
        }
    }
}
