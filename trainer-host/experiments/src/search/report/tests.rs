use super::*;
use crate::search::config::tests::search;

fn trials(search: &Search) -> Vec<Trial> {
    let trial = |number: usize| {
        let place = (number as f64 + 0.5) / 12.0;
        let point = search.space.iter().map(|dimension| dimension.settled(place)).collect();
        let rungs = 1 + number % 2;
        Trial { number, point, rungs, seeds: rungs as u64, objective: 0.9 - (place - 0.6).abs() }
    };
    (0..12).map(trial).collect()
}

#[test]
fn the_expected_best_is_that_of_all_draws() {
    assert_eq!(expected_best(&[1.0, 3.0], 2), [2.0, 0.25 * 1.0 + 0.75 * 3.0]);
    assert_eq!(expected_best(&[5.0], 3), [5.0; 3]);
    let rising = expected_best(&[0.1, 0.9, 0.4], 50);
    assert!(rising.is_sorted() && (rising[49] - 0.9).abs() < 1e-6);
}

#[test]
fn a_report_names_the_best_settings_and_draws_every_one() {
    let place = tempfile::tempdir().unwrap();
    let search = search(&["trials=12"]);
    let trials = trials(&search);
    write(place.path(), &search, &trials).unwrap();
    let text = fs::read_to_string(place.path().join("report.md")).unwrap();
    assert!(
        text.contains("Trial 7 has the best success rate after the last stage: 0.8750 on 2 seeds from 8."),
        "{text}"
    );
    assert!(text.contains("  --set 'training.epochs=2'"), "{text}");
    assert_eq!(text.matches("\n| ").count(), 2 + SHOWN, "{text}");
    let svg = fs::read_to_string(place.path().join("report/settings.svg")).unwrap();
    assert!(search.space.iter().all(|dimension| svg.contains(&dimension.key)));
    assert_eq!(svg.matches("<circle").count(), 12 * search.space.len());
    let svg = fs::read_to_string(place.path().join("report/progress.svg")).unwrap();
    assert!(svg.contains("random search"));
}

#[test]
fn the_settings_of_the_headline_are_a_study_that_loads() {
    let search = search(&["trials=12"]);
    let trials = trials(&search);
    let headline = headline(&search, &trials);
    let values: Vec<&str> = headline.lines().filter_map(|line| line.trim().strip_prefix("--set '")).collect();
    assert_eq!(values.len(), search.space.len(), "{headline}");
    assert!(values.iter().all(|value| value.contains('=') && value.trim_end_matches(" \\").ends_with('\'')));
}

#[test]
fn without_trials_there_is_a_report_too() {
    let place = tempfile::tempdir().unwrap();
    write(place.path(), &search(&[]), &[]).unwrap();
    let text = fs::read_to_string(place.path().join("report.md")).unwrap();
    assert!(text.contains("No trial has finished yet."));
}
