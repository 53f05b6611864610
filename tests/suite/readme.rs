//! README's library code runs, and is what stands there; so is the task of `docs/your-task.md`.

use std::error::Error;

use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{Aligned, PolicyFile};
use kestrel_sim::config::Document;
use kestrel_sim::scenario::Scenario;
use kestrel_sim::seed::Seed;
use kestrel_sim::simulation::Simulation;

const TASK: &str = "
aviary: { goal_m: [0, 0, 1] }
start: { position: { around_goal: { farthest_m: 0.3 } } }
rewards:
  - proximity: { weight: 1, scale_m: 0.5 }
terminations:
  - distance: { limit_m: 2 }
success: { settle: { radius_m: 0.1, within_secs: 4 } }
";

static POLICY: Aligned<{ include_bytes!("../../assets/pilots/hover.kestrel").len() }> =
    Aligned(*include_bytes!("../../assets/pilots/hover.kestrel"));

#[rustfmt::skip]
fn library() -> Result<[f32; 4], Box<dyn Error>> {
    let bytes = POLICY.0;
    // From README.
    let document = Document::parse("task.yaml", TASK)?;
    let scenario = Scenario::of("task", &document)?;
    let mut simulation = Simulation::<64>::new(&scenario, Seed(1), 0, 4096);
    let actions = vec![0.0; scenario.action.len() * 4096];
    for _ in 0..100 {
        simulation.step(&actions);
    }
    let mut pilot = Pilot::new(PolicyFile::parse(&bytes)?);
    pilot.self_test()?;
    let rotor_targets = pilot.tick(&simulation.state(0), &simulation.goal(0));
    Ok(rotor_targets)
}

#[test]
fn the_library_code_of_the_readme_runs() {
    let rotor_targets = library().unwrap();
    assert!(rotor_targets.iter().all(|target| target.is_finite() && *target > 0.0), "{rotor_targets:?}");
}

#[test]
fn the_library_code_of_the_readme_is_this() {
    let readme = include_str!("../../README.md");
    let (_, block) = readme.split_once("```rust\n").unwrap();
    let (block, _) = block.split_once("```").unwrap();
    let code = |line: &str| line.split("//").next().unwrap().trim().to_owned();
    let shown: Vec<String> = block.lines().map(code).collect();
    let here: Vec<String> = include_str!("readme.rs").lines().map(|line| line.trim().to_owned()).collect();
    assert!(shown.len() > 5 && here.windows(shown.len()).any(|lines| lines == shown), "{shown:#?}");
}

#[test]
fn the_task_of_the_page_about_tasks_is_the_file() {
    let page = include_str!("../../docs/your-task.md");
    let (_, block) = page.split_once("```yaml\n").unwrap();
    let (shown, _) = block.split_once("```").unwrap();
    let file = include_str!("../../configs/examples/two-gates.yaml");
    let (_, task) = file.split_once("\n\n").unwrap();
    assert_eq!(shown, task);
}
