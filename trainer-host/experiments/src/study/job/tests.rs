use super::*;
use crate::study::config::tests::tiny;

const JOB: JobId = JobId { seed: 0, order: 0, method: 0 };

/// Every way to learn several tasks, each with something to remember.
const PROCEDURES: [&str; 20] = [
    "sequential: {}",
    "sequential: {policy: reset}",
    "sequential: {log_std: inherited, learner: inherited}",
    "sequential: {consolidator: {anchor: {strength: {fixed: 1}}}}",
    "sequential: {consolidator: {anchor: {strength: {budget_nats: 0.1}, coupling: proximal}}}",
    "sequential: {consolidator: {anchor: {strength: {fixed: 1}, gradient: measured, curvature: sensitivity}}}",
    "sequential: {consolidator: {anchor: {strength: {fixed: 1}, gradient: absent, curvature: identity, decay: 0.5}}}",
    "sequential: {consolidator: {anchor: {strength: {fixed: 1}, curvature: kronecker}}}",
    "sequential: {consolidator: {action_anchor: {parts: 4}}}",
    "sequential: {consolidator: {published: {rule: literal, gradient_weight: 1, curvature: 1}}}",
    "sequential: {consolidator: {published: {rule: absolute, gradient_weight: 1, curvature: 1}}}",
    "sequential: {consolidator: {published: {rule: head, gradient_weight: 1, curvature: 1}}}",
    "sequential: {consolidator: {synaptic_intelligence: {strength: 1}}}",
    "sequential: {consolidator: {coreset: {bytes: 4096}}}",
    "joint: {}",
    "sharing: {every_updates: 2}",
    "sharing: {every_updates: 1, optimiser: own, log_std: own}",
    "sharing: {every_updates: 1, merge: first_row, optimiser: reset}",
    "experts: {}",
    "distil: {bytes: 4096, steps: 7}",
];

fn learning(procedure: &str, more: &[&str]) -> Study {
    let method = format!("methods.0.learn={{{procedure}}}");
    tiny(&[&[method.as_str()], more].concat())
}

fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

fn uninterrupted(study: &Study) -> JobResult {
    let mut run = JobRun::begin(study, JOB);
    while !run.is_finished() {
        run.advance();
    }
    run.into_result()
}

/// Saved, written, read and restored before every update and at the end.
fn interrupted(study: &Study) -> JobResult {
    let mut run = JobRun::begin(study, JOB);
    let mut last = 0;
    loop {
        let state = run.save();
        let read: JobState = postcard::from_bytes(&postcard::to_allocvec(&state).unwrap()).unwrap();
        assert!(read == state, "a state is read as it was written");
        run = JobRun::restore(study, JOB, read).unwrap();
        assert!(run.save() == state, "what was restored is what was saved");
        if run.is_finished() {
            return run.into_result();
        }
        run.advance();
        assert!(run.steps() > last && run.steps() <= study.steps_of(JOB), "steps only rise");
        last = run.steps();
    }
}

#[test]
fn interruptions_and_threads_leave_no_trace_in_any_procedure() {
    for procedure in PROCEDURES {
        let study = learning(procedure, &[]);
        let whole = on_threads(1, || uninterrupted(&study));
        let halves = on_threads(3, || interrupted(&study));
        assert!(halves == whole, "{procedure}");
    }
}

/// By gradients through the physics, two updates a task.
const ANALYTIC: &str = "training.analytic={environments: 128, steps_per_window: 8, total_steps: 2048}";

#[test]
fn studies_by_gradients_leave_no_trace_of_interruptions_and_threads_either() {
    for procedure in [
        "sequential: {}",
        "sequential: {consolidator: {compact_coreset: {bytes: 4096}}}",
        "sequential: {consolidator: {anchor: {strength: {fixed: 1}}}, learner: inherited}",
        "joint: {}",
        "experts: {}",
        "distil: {bytes: 4096, steps: 7}",
    ] {
        let study = learning(procedure, &[ANALYTIC]);
        let whole = on_threads(1, || uninterrupted(&study));
        let halves = on_threads(3, || interrupted(&study));
        assert!(halves == whole, "{procedure}");
        assert_eq!(whole.curve.last().unwrap().steps, if procedure == "joint: {}" { 4096 } else { 2048 });
    }
}

#[test]
fn a_policy_with_a_memory_learns_in_sequence_without_a_trace_of_interruptions_and_threads() {
    for procedure in ["sequential: {}", "sequential: {consolidator: {compact_coreset: {bytes: 4096}}}"] {
        let study = learning(procedure, &[ANALYTIC, "training.memory={units: 8}"]);
        let whole = on_threads(1, || uninterrupted(&study));
        assert!(on_threads(3, || interrupted(&study)) == whole, "{procedure}");
    }
}

#[test]
fn what_is_flown_already_is_not_learned_again() {
    let skip = ["evaluation.stop_at_success=0.000001", "evaluation.skip_solved=true"];
    // Flights of one task are successes whoever flies.
    let easy = "tasks.1.scenario.success={visit: {region: {low_m: [-9, -9, -9], high_m: [9, 9, 9]}}}";
    let ends = "tasks.1.scenario.terminations=[distance: {limit_m: 1000}]";
    for procedure in ["sequential: {}", "sequential: {consolidator: {coreset: {bytes: 4096}}}", "experts: {}"] {
        let study = learning(procedure, &[&skip[..], &[easy, ends]].concat());
        let result = uninterrupted(&study);
        let steps: Vec<(usize, u64)> = result.curve.iter().map(|row| (row.stage, row.steps)).collect();
        assert_eq!(steps, [(1, 0), (1, 4096), (1, 8192), (2, 0)], "{procedure}");
        assert!(result.rows.iter().filter(|row| row.task == 1).all(|row| row.success));
        assert_eq!(result.rows.last().unwrap().stage, 2);
        let mut run = JobRun::begin(&study, JOB);
        while !run.is_finished() {
            run = JobRun::restore(&study, JOB, run.save()).unwrap();
            run.advance();
        }
        assert!(run.into_result() == result);
    }
}

#[test]
fn a_stage_that_ends_early_is_restored_too() {
    // Every flight is good enough.
    let study =
        learning("sequential: {}", &["evaluation.stop_at_success=0.000001", "evaluation.flights_per_stage=1"]);
    assert!(interrupted(&study) == uninterrupted(&study));
}

#[test]
fn a_joint_stage_ends_when_the_worst_of_its_tasks_is_good_enough() {
    let last = |more: &[String]| {
        let more: Vec<&str> = more.iter().map(String::as_str).collect();
        let stop = ["evaluation.stop_at_success=0.000001", "evaluation.flight_episodes=16"];
        let result = uninterrupted(&learning("joint: {}", &[&stop[..], &more].concat()));
        (result.curve.last().unwrap().steps, result.curve.last().unwrap().success_rate > 0.0)
    };
    // Every flight of such a task is a success.
    let easy = |task: usize| {
        let success = "visit: {region: {low_m: [-9, -9, -9], high_m: [9, 9, 9]}}";
        [
            format!("tasks.{task}.scenario.success={{{success}}}"),
            format!("tasks.{task}.scenario.terminations=[distance: {{limit_m: 1000}}]"),
        ]
    };
    let (low, high) = (easy(0), easy(1));
    assert_eq!(last(&[low.clone(), high].concat()), (8192, true));
    // The other task is never solved, and the mean of both is above the threshold.
    assert_eq!(last(&low), (16384, true));
}

#[test]
fn every_stage_leaves_flights_of_every_task_and_its_share_of_the_curve() {
    let study = learning("sequential: {}", &[]);
    let result = uninterrupted(&study);
    let episodes = study.evaluation.episodes;
    let groups: Vec<(usize, usize)> =
        result.rows.chunks(episodes).map(|rows| (rows[0].stage, rows[0].task)).collect();
    assert_eq!(groups, [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)]);
    let curve: Vec<(usize, u64)> = result.curve.iter().map(|row| (row.stage, row.steps)).collect();
    assert_eq!(curve, [(1, 4096), (1, 8192), (2, 4096), (2, 8192)]);
}

/// Two tasks that no one policy flies, each with a training of its own.
const OWN: [&str; 4] = [
    "methods=[{name: own, learn: {experts: {own_training: true}}}]",
    "tasks.0.training={environments: 256, steps_per_rollout: 16, minibatch: 1024, total_steps: 12288, epochs: 1, \
     actor_hidden: [8], critic_hidden: [8]}",
    "tasks.1.training={actor_hidden: [16], memory: {units: 4}, analytic: {environments: 128, steps_per_window: 8, \
     total_steps: 2048}}",
    "tasks.1.scenario.observation={pilot: {position_scale_m: 3}}",
];

#[test]
fn tasks_of_other_layouts_are_trained_as_their_files_say() {
    let study = tiny(&OWN);
    assert_eq!((study.steps_of(JOB), study.most_steps()), (12288 + 2048, 12288));
    let whole = on_threads(1, || uninterrupted(&study));
    assert!(on_threads(3, || interrupted(&study)) == whole);
    let ends: Vec<(usize, u64)> = whole.curve.iter().map(|row| (row.stage, row.steps)).collect();
    assert_eq!(ends, [(1, 8192), (1, 12288), (2, 1024), (2, 2048)]);
    let flown: std::collections::BTreeSet<(usize, usize)> =
        whole.rows.iter().map(|row| (row.stage, row.task)).collect();
    assert_eq!(flown.into_iter().collect::<Vec<_>>(), [(0, 0), (1, 0), (2, 1)], "each flies its own task");
    let beside = whole.stored_bytes / 4;
    assert!(beside > 100 && beside != whole.parameters, "the other policy has another shape: {beside}");
}

/// A second task whose drones begin two metres away.
const ELSEWHERE: &str = "tasks.1.scenario.start.position={within: {low_m: [2, 2, 1], high_m: [3, 3, 2]}}";

#[test]
fn a_boundary_that_nobody_tells_is_found_in_the_first_rollout_behind_it() {
    const FOUND: &str = "sequential: {consolidator: {compact_coreset: {bytes: 4096, boundaries: found}}}";
    let study = learning(FOUND, &[ELSEWHERE]);
    let whole = on_threads(1, || uninterrupted(&study));
    assert!(on_threads(3, || interrupted(&study)) == whole);
    assert_eq!(whole.boundaries, [(2, 4096)]);
    assert!(whole.stored_bytes.abs_diff(4096) < 100, "one task's states fill the set: {}", whole.stored_bytes);
    let steps: Vec<(usize, u64)> = whole.curve.iter().map(|row| (row.stage, row.steps)).collect();
    assert_eq!(steps, [(1, 4096), (1, 8192), (2, 4096), (2, 8192)]);
    // The same task again is no other one.
    assert_eq!(uninterrupted(&learning(FOUND, &[])).boundaries, []);
}

#[test]
fn orders_of_different_length_train_what_they_name() {
    let study = learning("sequential: {}", &["orders={these: [[high]]}"]);
    let result = uninterrupted(&study);
    assert_eq!(result.rows.last().unwrap().stage, 1);
    assert!(interrupted(&study) == result);
}

#[test]
fn all_methods_begin_alike() {
    let first = |procedure: &str| {
        let run = JobRun::begin(&learning(procedure, &[]), JOB).save();
        run.progress.rows
    };
    assert!(first("sequential: {}") == first("experts: {}"));
    assert!(first("sequential: {}") == first("sharing: {every_updates: 1}"));
}

#[test]
fn a_state_of_another_procedure_is_refused() {
    let saved = JobRun::begin(&learning("sharing: {every_updates: 1}", &[]), JOB).save();
    assert!(JobRun::restore(&learning("sequential: {}", &[]), JOB, saved).is_err());
}

#[test]
fn memory_is_what_each_procedure_keeps() {
    let bytes = |procedure: &str| {
        let result = uninterrupted(&learning(procedure, &[]));
        (result.stored_bytes / result.parameters / 4, result.training_bytes / result.parameters / 4)
    };
    assert_eq!(bytes("sequential: {}"), (0, 0));
    assert_eq!(bytes("joint: {}"), (0, 0));
    assert_eq!(bytes("experts: {}"), (1, 1));
    assert_eq!(bytes("sharing: {every_updates: 2}"), (0, 2));
}
