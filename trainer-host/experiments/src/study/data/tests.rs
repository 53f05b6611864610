use std::fs;
use std::path::PathBuf;

use tempfile::TempDir;

use super::*;

fn study(seeds: u64) -> (TempDir, StudyManifest) {
    let directory = tempfile::tempdir().unwrap();
    let manifest = synthetic::manifest(seeds);
    synthetic::write(directory.path(), &manifest);
    (directory, manifest)
}

fn job() -> Job {
    Job { method: "none".to_owned(), order: 1, seed: 1 }
}

/// The message after `change` of the text of a file.
fn complaint(file: impl Fn(&Path) -> PathBuf, change: impl Fn(String) -> String) -> String {
    let (directory, _) = study(2);
    let path = file(directory.path());
    fs::write(&path, change(fs::read_to_string(&path).unwrap())).unwrap();
    let message = StudyData::load(directory.path()).unwrap_err().to_string();
    message.replace(&format!("{}/", directory.path().display()), "")
}

fn row_complaint(change: impl Fn(String) -> String) -> String {
    complaint(|directory| job().rows_path(directory), change)
}

#[test]
fn a_study_is_read_as_it_was_written() {
    let (directory, manifest) = study(3);
    let data = StudyData::load(directory.path()).unwrap();
    assert_eq!(data.manifest, manifest);
    assert!(data.missing.is_empty() && data.without_curve.is_empty());
    // Two sequential methods in two orders, joint training and experts in the first alone.
    assert_eq!(data.runs.len(), 3 * (2 * 2 + 1 + 1));
    let run = data.runs_of(0).find(|run| (run.order, run.seed) == (1, 1)).unwrap();
    assert_eq!(data.order(run), [2, 0, 1]);
    let first_task = run.cell(3, 2).unwrap();
    assert_eq!((first_task.success, first_task.episodes), (0.61, 100));
    assert!((first_task.episode_return - (0.61 * 120.0 + 0.39 * 20.0)).abs() < 1e-12);
    assert!((first_task.length_secs - (0.61 * f64::from(4.1_f32) + 3.9)).abs() < 1e-12);
    assert_eq!(run.curve_of(2).count(), 10);
}

#[test]
fn rows_give_the_same_bits_again() {
    let (directory, manifest) = study(1);
    let job = Job { method: "none".to_owned(), order: 0, seed: 0 };
    let mut rows = synthetic::episodes(&manifest, &job);
    for (index, row) in rows.iter_mut().enumerate() {
        row.episode_return = f32::from_bits(0x3f00_0001 + 7919 * index as u32);
        row.length_secs = 1.0 / (1.0 + index as f32);
    }
    let mut text = Vec::new();
    crate::study::rows::write_episodes(&mut text, &manifest, &job, &rows).unwrap();
    fs::write(job.rows_path(directory.path()), text).unwrap();
    assert_eq!(read_episodes(directory.path(), &manifest, &job).unwrap(), rows);
}

#[test]
fn what_is_not_finished_is_missing() {
    let (directory, _) = study(2);
    fs::remove_file(job().rows_path(directory.path())).unwrap();
    let other = Job { method: "joint".to_owned(), order: 0, seed: 0 };
    fs::remove_file(other.curve_path(directory.path())).unwrap();
    let data = StudyData::load(directory.path()).unwrap();
    assert_eq!((data.missing, data.without_curve), (vec![job()], vec![other]));
    assert_eq!(data.runs.len(), 11);
}

#[test]
fn a_truncated_file_is_refused() {
    let cut = row_complaint(|text| text[..text.len() - 4].to_owned());
    assert_eq!(cut, "rows/none/1-1.csv:1201: line: found no end of line, expected a whole row");
    let short = row_complaint(|text| text.lines().take(1150).flat_map(|line| [line, "\n"]).collect());
    assert_eq!(
        short,
        "rows/none/1-1.csv:1150: episode: found 49 flights before this row, expected 100 as of the first task"
    );
    let whole_tasks = row_complaint(|text| text.lines().take(1101).flat_map(|line| [line, "\n"]).collect());
    assert_eq!(
        whole_tasks,
        "rows/none/1-1.csv:1101: task: found the end of the file, expected flights of `room-1` after stage 3"
    );
    assert!(
        row_complaint(|_| String::new()).starts_with("rows/none/1-1.csv:1: header: found ``, expected `method,")
    );
}

#[test]
fn a_row_that_is_there_twice_is_refused() {
    let message = row_complaint(|text| {
        let (head, row) = text.trim_end().rsplit_once('\n').unwrap();
        format!("{head}\n{row}\n{row}\n")
    });
    assert_eq!(message, "rows/none/1-1.csv:1202: episode: found `99`, expected `100`");
    let doubled = row_complaint(|text| {
        let first: String = text.lines().skip(1).take(100).flat_map(|line| [line, "\n"]).collect();
        text.clone() + &first
    });
    assert_eq!(doubled, "rows/none/1-1.csv:1202: task: found a stage and task again, expected each once");
}

#[test]
fn a_wrong_field_is_named_with_its_line() {
    let message = |from: &str, to: &str| {
        let swapped = |line: (usize, &str)| {
            let line = if line.0 == 4 { line.1.replacen(from, to, 1) } else { line.1.to_owned() };
            line + "\n"
        };
        row_complaint(|text| text.lines().enumerate().map(swapped).collect())
    };
    // The fifth line is `none,1,1,0,room-2,3,0,20,10`.
    let cases = [
        ("none", "nome", "method: found `nome`, expected `none`"),
        (",1,1,", ",0,1,", "order: found `0`, expected `1`"),
        (",1,1,", ",1,7,", "seed: found `7`, expected `1`"),
        (",0,room", ",4,room", "stage: found `4`, expected 0 to 3"),
        ("room-2", "room-9", "task: found `room-9`, expected one of `room-0`, `room-1`, `room-2`"),
        (",3,0,", ",3.5,0,", "episode: found `3.5`, expected a number from 0"),
        (",3,0,", ",3,yes,", "success: found `yes`, expected 0 or 1"),
        (",20,", ",NaN,", "episode_return: found `NaN`, expected a finite number"),
        (",20,10", ",20,-1", "length_secs: found `-1`, expected seconds"),
        (",20,10", ",20", "length_secs: found the end of the row, expected seconds"),
        (",20,10", ",20,10,5", "row: found `5`, expected the end of the row"),
    ];
    for (from, to, expected) in cases {
        assert_eq!(message(from, to), format!("rows/none/1-1.csv:5: {expected}"));
    }
}

#[test]
fn a_curve_that_goes_back_is_refused() {
    let swap = |text: String| {
        let mut lines: Vec<&str> = text.lines().collect();
        lines.swap(3, 4);
        lines.join("\n") + "\n"
    };
    let message = complaint(|directory| job().curve_path(directory), swap);
    let expected = "curves/none/1-1.csv:5: steps: found 300000 of stage 1, expected more than 400000 of stage 1";
    assert_eq!(message, expected);
}

#[test]
fn a_study_that_contradicts_itself_is_refused() {
    let path = Path::new("s");
    let message = |change: fn(&mut StudyManifest)| {
        let mut manifest = synthetic::manifest(2);
        change(&mut manifest);
        manifest.save(path).unwrap_err().to_string()
    };
    assert_eq!(
        message(|study| study.orders[1] = vec![0, 3]),
        "s/study.json: orders[1]: found [0, 3], expected indices of tasks, at least one, each at most once"
    );
    assert_eq!(
        message(|study| study.methods[1].name = "none".to_owned()),
        "s/study.json: methods[1].name: found `none` again, expected each name once"
    );
    assert!(message(|study| study.tasks[0].name = "a,b".to_owned()).contains("tasks[0].name: found `a,b`"));
    assert!(message(|study| study.methods[0].name = "../up".to_owned()).contains("found `../up`"));
    assert!(message(|study| study.seeds = vec![1, 1]).contains("seeds: found [1, 1]"));
    assert!(
        message(|study| study.success_threshold = 1.5).contains("success_threshold: found 1.5, expected 0 to 1")
    );
    assert!(message(|study| study.baselines[0].task = "x".to_owned()).contains("baselines[0].task: found `x`"));
    assert!(
        message(|study| study.published.as_mut().unwrap().columns.clear()).contains("published.rows: incremental")
    );
}

#[test]
fn a_damaged_manifest_is_named_with_its_line() {
    let message =
        complaint(|directory| directory.join("study.json"), |text| text.replace("\"seeds\"", "\"seed\""));
    assert!(message.starts_with("study.json:") && message.contains("unknown field `seed`"), "{message}");
    let message = complaint(|directory| directory.join("study.json"), |text| text.replace("\"DNE\"", "\"dne\""));
    assert!(message.contains("found \"dne\", expected a number or \"DNE\""), "{message}");
}
