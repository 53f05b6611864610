use std::fs;

use kestrel_core::action::ActionSpace;
use kestrel_sim::gradient::StepGradient;
use kestrel_sim::scenario::{StartPosition, Success};
use kestrel_sim::termination::Termination;
use proptest::prelude::*;

use super::*;
use crate::golden::{Messages, assert_golden, in_repository};
use kestrel_learn::ppo::CriticScope;
use kestrel_learn::schedule::Schedule;

/// The shortest configuration: everything else has a default.
const MINIMAL: &str = "\
version: 1
name: trial
scenario:
  aviary:
    goal_m: [0, 0, 1]
  start:
    position:
      around_goal: {farthest_m: 0.5}
    tilt_limit_deg: 10
  rewards:
    - proximity: {weight: 1, scale_m: 0.5}
  terminations:
    - collision
  success:
    settle: {radius_m: 0.05, within_secs: 4}
";

fn trial(text: &str) -> Result<Experiment, ConfigError> {
    parse("trial.yaml", text, &[])
}

fn example(name: &str) -> Experiment {
    load(&in_repository(&format!("configs/{name}.yaml")), &[]).unwrap()
}

#[test]
fn wrong_configurations_get_their_messages() {
    let check = |document, overrides: &[String]| from_document(document, overrides).map(drop);
    let messages = Messages { minimal: MINIMAL, check };
    messages.assert_golden("trainer-host/experiments/src/experiment_config/messages.txt", 200);
}

#[test]
fn the_schema_is_the_one_in_the_repository() {
    assert_golden("configs/schema.json", &schema());
}

#[test]
fn every_example_names_the_schema_for_editors() {
    for name in ["hover", "cross"] {
        let text = fs::read_to_string(in_repository(&format!("configs/{name}.yaml"))).unwrap();
        assert!(text.starts_with("# yaml-language-server: $schema=schema.json\n"), "{name}");
    }
}

#[test]
fn a_minimal_file_is_enough() {
    let experiment = trial(MINIMAL).unwrap();
    assert_eq!(experiment.name, "trial");
    assert_eq!(experiment.scenario.episode_steps(), 800);
    assert_eq!(experiment.evaluation.episodes, 1024);
    assert_eq!(experiment.evaluation.scenario, experiment.scenario);
    assert_eq!(experiment.training.ppo.check(), Ok(()));
}

#[test]
fn a_key_with_nothing_below_it_keeps_its_defaults() {
    let text =
        MINIMAL.replace("scenario:\n", "training:\nevaluation:\nscenario:\n  physics:\n  action: rotor_speeds\n");
    let (found, minimal) = (trial(&text).unwrap(), trial(MINIMAL).unwrap());
    assert_eq!((found.scenario, found.training.ppo), (minimal.scenario, minimal.training.ppo));
}

#[test]
fn hover_is_judged_by_hard_starts_on_drones_that_differ() {
    let hover = example("hover");
    let start = hover.evaluation.scenario.start;
    assert_eq!(start.position, StartPosition::AroundGoal { nearest_m: 0.5, farthest_m: 0.5 });
    assert_eq!(start.tilt_limit, std::f32::consts::FRAC_PI_2);
    assert_eq!((start.speed_limit, start.body_rates_limit), (1.0, 3.0));
    assert_eq!(hover.scenario.success, Success::Settle { radius_m: 0.05, within_secs: 4.0 });
    let randomisation = hover.scenario.randomisation;
    assert!(randomisation.mass > 0.0 && randomisation.rotor_lag[0] < 1.0 && randomisation.wind_speed > 0.0);
    assert_eq!(hover.training.ppo.check(), Ok(()));
}

#[test]
fn cross_has_four_walls_and_a_pad() {
    let cross = example("cross");
    assert_eq!(cross.scenario.aviary.world.solids.len(), 5);
    assert!(cross.scenario.terminations.contains(&Termination::Collision));
    let pad = cross.scenario.aviary.world.bounds()[4];
    assert_eq!((pad.low.as_slice(), pad.high.as_slice()), (&[4.0, -1.0, 0.0][..], &[5.0, 1.0, 0.1][..]));
    assert_eq!(cross.evaluation.episodes, 256);
    assert_eq!(cross.training.ppo.check(), Ok(()));
}

#[test]
fn a_resolved_configuration_loads_to_the_same_experiment() {
    let odd = [
        "scenario.vehicle.mass_kg=0.0271",
        "training.learning_rate={constant: 3.3e-4}",
        "training.target_kl=0.017",
    ]
    .map(str::to_owned);
    for name in ["hover", "cross"] {
        let path = in_repository(&format!("configs/{name}.yaml"));
        for overrides in [&[][..], &odd[..]] {
            let experiment = load(&path, overrides).unwrap();
            assert_eq!(parse("resolved.yaml", &experiment.resolved_yaml, &[]).unwrap(), experiment);
        }
    }
}

#[test]
fn overrides_change_what_they_name() {
    let overrides = [
        "training.epochs=7",
        "training.total_steps=2e6",
        "training.actor_hidden=[32, 16]",
        "training.learning_rate={constant: 3e-4}",
        "scenario.rewards.0.proximity.weight=5",
        "scenario.action={thrust_body_rates: {}}",
        "scenario.critic=privileged",
        "name=other",
    ];
    let experiment = parse("trial.yaml", MINIMAL, &overrides.map(str::to_owned)).unwrap();
    assert_eq!((experiment.training.ppo.epochs, experiment.training.ppo.total_steps), (7, 2_000_000));
    assert_eq!(experiment.training.ppo.actor_hidden, [32, 16]);
    assert_eq!(experiment.training.ppo.learning_rate, Schedule::Constant(3e-4));
    assert_eq!(experiment.scenario.rewards[0].weight(), 5.0);
    assert!(matches!(experiment.scenario.action, ActionSpace::ThrustBodyRates(_)));
    assert_eq!(experiment.scenario.name, "other");
}

#[test]
fn anchors_and_merge_keys_work() {
    let text = MINIMAL.replace("{weight: 1, scale_m: 0.5}", "&one {weight: 1, scale_m: 0.5}")
        + "  randomisation: &same {mass_fraction: 0.1}\nevaluation:\n  start:\n    position: {around_goal: {farthest_m: 0.2}}\n";
    assert_eq!(trial(&text).unwrap().scenario.randomisation.mass, 0.1);
    let merged = MINIMAL.replace(
        "    - proximity: {weight: 1, scale_m: 0.5}",
        "    - proximity: &near {weight: 1, scale_m: 0.5}\n    - proximity: {<<: *near, scale_m: 0.1}",
    );
    let rewards = trial(&merged).unwrap().scenario.rewards;
    assert_eq!((rewards[1].weight(), rewards[0].weight()), (1.0, 1.0));
    assert_ne!(rewards[0], rewards[1]);
}

#[test]
fn foreign_line_ends_and_byte_order_marks_are_fine() {
    let windows = format!("\u{feff}{}", MINIMAL.replace('\n', "\r\n"));
    assert_eq!(trial(&windows).unwrap().scenario, trial(MINIMAL).unwrap().scenario);
}

#[test]
fn what_cannot_be_trained_is_refused_before_it_begins() {
    let path = in_repository("configs/aviaries/multi-hover.yaml");
    assert!(load_to_train(&path, &[]).is_ok());
    let overrides = [
        "scenario.agents.count=3",
        "scenario.goals={line: {velocity_m_per_s: [0, 0, 0.1]}}",
        "scenario.start.position={within: {low_m: [0, 0, 0.5], high_m: [1, 1, 1]}}",
        "evaluation.start.position={within: {low_m: [0, 0, 0.5], high_m: [1, 1, 1]}}",
    ]
    .map(str::to_owned);
    let flown = load(&path, &overrides).unwrap();
    assert_eq!(flown.scenario.agents.count, 3);
    assert_eq!(
        load_to_train(&path, &[&overrides[..], &["training.environments=1024".to_owned()]].concat())
            .unwrap_err()
            .to_string(),
        "--set training.environments=1024: found 1024, expected a multiple of 768: that many drones train side by \
         side in teams of 3"
    );
    let fitting = [&overrides[..], &["training.environments=768".to_owned()]].concat();
    assert_eq!(load_to_train(&path, &fitting).unwrap().training.ppo.environments, 768);
}

#[test]
fn every_task_that_ships_is_ready_to_train() {
    let files = |folder| std::fs::read_dir(in_repository(folder)).unwrap().map(|entry| entry.unwrap().path());
    let files = files("configs/aviaries").chain(files("configs/examples"));
    let tasks: Vec<_> = files.filter(|path| path.extension().is_some_and(|end| end == "yaml")).collect();
    assert!(tasks.len() > 80, "{} tasks", tasks.len());
    for path in tasks {
        load_to_train(&path, &[]).unwrap();
    }
    let gates = load_to_train(&in_repository("configs/examples/two-gates.yaml"), &[]).unwrap();
    assert_eq!(gates.scenario.observation.len(), 22 + 16, "the part `navigate` shows its beams");
    let trio = load_to_train(&in_repository("configs/aviaries/multi-cross.yaml"), &[]).unwrap();
    assert_eq!((trio.scenario.agents.count, trio.training.ppo.environments), (3, 1536));
}

#[test]
fn a_crossing_team_is_ready_to_train() {
    let path = in_repository("configs/aviaries/crossing-3.yaml");
    let crossing = load_to_train(&path, &[]).unwrap();
    assert_eq!(crossing.training.ppo.critic_scope, CriticScope::Team);
    // Pilot, and position and velocity of two mates.
    assert_eq!(crossing.scenario.observation.len(), 22 + 12);
    let ippo = ["training.critic_scope=own".to_owned()];
    assert_eq!(load_to_train(&path, &ippo).unwrap().training.ppo.critic_scope, CriticScope::Own);
}

#[test]
fn actor_critic_and_reinforce_make_one_step_of_each_rollout() {
    for part in ["a2c", "reinforce"] {
        let path = in_repository(&format!("configs/parts/{part}.yaml"));
        let import = format!("training: {{ import: {} }}\n", path.display());
        let ppo = trial(&format!("{MINIMAL}{import}")).unwrap().training.ppo;
        assert_eq!((ppo.epochs, ppo.minibatch, ppo.gae_lambda), (1, ppo.batch(), 1.0), "{part}");
        assert_eq!((ppo.entropy_weight, ppo.target_kl), (0.0, None), "{part}");
    }
}

fn refusal(bytes: &[u8]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("trial.yaml");
    fs::write(&path, bytes).unwrap();
    let message = load(&path, &[]).unwrap_err().to_string();
    message.replace(&path.display().to_string(), "trial.yaml")
}

#[test]
fn odd_files_are_refused() {
    assert_eq!(refusal(b""), "trial.yaml:1:1: found an empty file, expected keys such as `version` and `name`");
    assert_eq!(
        refusal(b"# nothing but a comment\n"),
        "trial.yaml:2:1: found an empty file, expected keys such as `version` and `name`"
    );
    assert_eq!(
        refusal(b"version: 1\nname: \xff\n"),
        "trial.yaml:2:7: found the byte 0xff, expected text in UTF-8"
    );
    assert_eq!(
        refusal("# long\n".repeat(1_300_000).as_bytes()),
        "trial.yaml: found more than 8 MiB, expected a configuration, which is a few KiB long"
    );
    assert_eq!(
        refusal(b"- 1\n"),
        "trial.yaml:1:1: found a list of 1, expected keys such as `version` and `name`\n  1 | - 1\n    | ^"
    );
}

#[test]
fn absent_files_and_directories_are_refused() {
    let message = |path: &str| load(Path::new(path), &[]).unwrap_err().to_string();
    assert_eq!(message("no/such.yaml"), "no/such.yaml: found no such file, expected a configuration (.yaml)");
    assert_eq!(message("src"), "src: found a directory, expected a configuration file (.yaml)");
}

#[test]
fn an_alias_bomb_is_defused() {
    let level =
        |level: usize| format!("bomb{level}: &x{level} [{}]\n", vec![format!("*x{}", level - 1); 10].join(", "));
    let bomb: String = (1..10).map(level).collect();
    let error =
        trial(&format!("bomb: &x0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n{bomb}{MINIMAL}")).unwrap_err().to_string();
    assert!(
        error.contains("found too many or too deeply nested values, expected a plain configuration"),
        "{error}"
    );
}

#[test]
fn deep_nesting_is_refused() {
    let error =
        trial(&format!("deep: {}{}\n{MINIMAL}", "[".repeat(200), "]".repeat(200))).unwrap_err().to_string();
    assert!(error.contains("found too many or too deeply nested values"), "{error}");
}

proptest! {
    /// Whatever happens to a file, the answer is an experiment or one message, never a panic.
    #[test]
    fn no_text_panics(position in 0_usize..MINIMAL.len(), length in 0_usize..40, put in "[ -~\n\t*&{}\\[\\]:#'\"|>%@äπ]{0,12}") {
        let end = (position + length).min(MINIMAL.len());
        let text = format!("{}{put}{}", &MINIMAL[..position], &MINIMAL[end..]);
        if let Err(error) = trial(&text) {
            prop_assert!(error.to_string().starts_with("trial.yaml:"));
        }
    }

    #[test]
    fn no_override_panics(assignment in "[ -~\n]{0,40}", key in "[a-z_.0-9]{0,20}") {
        for text in [assignment.clone(), format!("{key}={assignment}"), format!("scenario.{key}={assignment}")] {
            if let Err(error) = parse("trial.yaml", MINIMAL, &[text]) {
                prop_assert!(!error.to_string().is_empty());
            }
        }
    }
}

#[test]
fn gradients_are_refused_where_none_go() {
    let refusal = |name: &str, sets: &[&str]| {
        let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
        load_to_train(&in_repository(&format!("configs/{name}.yaml")), &sets).unwrap_err().to_string()
    };
    let analytic = "training.analytic={}";
    let through = "expected a task through whose flight gradients go, or PPO";
    for (name, found) in [
        ("aviaries/room-0-vision", "a camera, whose images have no derivatives"),
        ("aviaries/hover-as-published", "bullet physics, which has no derivatives"),
        ("aviaries/tune", "the action space tun of the reference system, which has no derivatives"),
    ] {
        let message = refusal(name, &[analytic]);
        assert_eq!(message, format!("--set {analytic}: found {found}, {through}"));
    }
    let message = refusal("hover", &["training.analytic.environments=100"]);
    assert!(message.ends_with("found 100, expected a multiple of 64, at most 65536"), "{message}");
    let message = refusal("hover", &["training.analytic.total_steps=100"]);
    assert!(message.contains("found 100, expected at least 6144, one window"), "{message}");
}

#[test]
fn hover_learns_by_gradients_unless_told_otherwise() {
    let load = |sets: &[String]| load_to_train(&in_repository("configs/hover.yaml"), sets).unwrap();
    let by =
        |experiment: &Experiment| (experiment.training.method(), experiment.total_steps(), experiment.batch());
    let (gradients, ppo) = (load(&[]), load(&["training.analytic=null".to_owned()]));
    assert_eq!(by(&gradients), ("gradients through the physics", 3_686_400, 128 * 48));
    assert_eq!(by(&ppo), ("PPO", 4_915_200, 1024 * 32));
    let traced = StepGradient::new(&gradients.scenario).unwrap();
    assert_eq!(traced.operations(), (806, 1376), "docs/decisions.md says how many");
    assert_eq!(gradients.silent_rewards(), ["alive", "failure"]);
    assert!(ppo.silent_rewards().is_empty());
}

/// The first line of what is wrong with the task of drawn rooms after such changes.
fn refused_rooms(overrides: &[&str]) -> String {
    let overrides: Vec<String> = overrides.iter().map(|text| (*text).to_owned()).collect();
    let path = in_repository("configs/aviaries/unseen-rooms.yaml");
    let message = load_to_train(&path, &overrides).unwrap_err().to_string();
    message
        .lines()
        .next()
        .unwrap_or_default()
        .rsplit_once(".yaml")
        .map_or(message.clone(), |(_, rest)| rest.to_owned())
}

#[test]
fn policies_are_judged_in_worlds_that_training_does_not_draw() {
    let rooms = example("aviaries/unseen-rooms");
    let training = rooms.scenario.drawn.as_ref().unwrap().range();
    let judged = rooms.evaluation.scenario.drawn.as_ref().unwrap().range();
    assert!(!training.overlaps(&judged) && judged.count == 200, "{training:?}, {judged:?}");
    assert_eq!(rooms.evaluation.selection().drawn, rooms.scenario.drawn);
    assert_eq!(rooms.evaluation.selection().start, rooms.evaluation.scenario.start);
    assert_ne!(rooms.evaluation.scenario.aviary, rooms.scenario.aviary);
    // The configuration of a run needs no other file.
    assert_eq!(parse("run.yaml", &rooms.resolved_yaml, &[]).unwrap(), rooms);

    let found = refused_rooms(&["evaluation.worlds={seed: 0, first: 511, count: 5}"]);
    let expected = "found numbers 511 to 515 of seed 0, expected none of the worlds of training, numbers 0 to 511";
    assert!(found.contains(expected), "{found}");
    let path = in_repository("configs/aviaries/unseen-rooms.yaml");
    let left_out = load(&path, &["evaluation={episodes: 10}".to_owned()]).unwrap().evaluation.scenario;
    let range = left_out.drawn.as_ref().unwrap().range();
    assert_eq!((range.seed, range.first, range.count), (Seed(0), 512, 200));
    let fixed = trial(&format!("{MINIMAL}evaluation: {{ worlds: {{ count: 3 }} }}\n")).unwrap_err().to_string();
    assert!(fixed.contains("evaluation.worlds: found worlds, expected none"), "{fixed}");
}

#[test]
fn policies_are_judged_in_the_worlds_of_training_where_that_is_asked_for() {
    let path = in_repository("configs/aviaries/unseen-rooms.yaml");
    let known = load(&path, &["evaluation={trained_worlds: true}".to_owned()]).unwrap();
    assert_eq!(known.evaluation.scenario.drawn, known.scenario.drawn);
    assert_eq!(known.evaluation.selection(), &known.evaluation.scenario);
    let both = refused_rooms(&["evaluation={trained_worlds: true, worlds: {count: 3}}"]);
    assert!(
        both.contains("evaluation.worlds: found worlds beside `trained_worlds`, expected one of both"),
        "{both}"
    );
    let fixed = trial(&format!("{MINIMAL}evaluation: {{ trained_worlds: true }}\n")).unwrap_err().to_string();
    assert!(fixed.contains("found `trained_worlds`, expected none"), "{fixed}");
}
