use std::fs;
use std::path::Path;

use tempfile::TempDir;

use super::*;
use crate::study::config::claim::{Claim, Expected, Measure};
use crate::study::data::{MethodKind, StudyManifest, Task, synthetic};

/// The report of a synthetic study, after `change` of its directory.
fn report_of(manifest: &StudyManifest, change: impl Fn(&Path)) -> (TempDir, String) {
    let directory = tempfile::tempdir().unwrap();
    synthetic::write(directory.path(), manifest);
    change(directory.path());
    let data = StudyData::load(directory.path()).unwrap();
    write(directory.path(), &data).unwrap();
    let text = fs::read_to_string(directory.path().join("report.md")).unwrap();
    assert_sane(directory.path(), &text);
    (directory, text)
}

/// No number that is none, every picture there, whole and named.
fn assert_sane(directory: &Path, text: &str) {
    assert!(!text.contains("NaN") && !text.contains("inf ") && !text.contains("inf]"), "{text}");
    for file in text.split("](report/").skip(1).map(|rest| rest.split(')').next().unwrap()) {
        let svg = fs::read_to_string(directory.join("report").join(file)).unwrap();
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"), "{file}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{file}");
    }
}

/// The row of a table in a section, without its bars.
fn row(text: &str, section: &str, method: &str) -> Vec<String> {
    let section = text.split(&format!("## {section}\n")).nth(1).unwrap_or_else(|| panic!("no section {section}"));
    let section = section.split("\n## ").next().unwrap();
    let line = section.lines().find(|line| line.starts_with(&format!("| {method}")));
    let line = line.unwrap_or_else(|| panic!("no row {method} in {section}"));
    line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()
}

/// The value of a cell without its interval.
fn value(cell: &str) -> &str {
    cell.split(" [").next().unwrap()
}

#[test]
fn the_numbers_of_a_study_whose_answers_are_known() {
    let (_directory, text) = report_of(&synthetic::manifest(4), |_| ());
    // Seeds add 0 to 3 points, 1.5 on average. `none` ends with 60, 60 and 90, `anchor` with 83, 83 and 88.
    let none = row(&text, "After the last task", "fine-tuning");
    let values: Vec<&str> = none.iter().map(|cell| value(cell)).collect();
    // Interquartile mean: of the 24 values the middle 12, two of 61, four of 62 and of 63, two of 90, sum to 802.
    // Shortfall: 18.5 points in two of three tasks. Return: 20 + 100 · success. Experts' mean success is 97.5 %.
    assert_eq!(values, ["fine-tuning", "8", "4", "71.5 %", "66.8 %", "61.5 %", "12.3", "91.5", "0.73"]);
    let anchor = row(&text, "After the last task", "diagonal anchor");
    assert_eq!(value(&anchor[3]), "86.2 %");
    let retention = row(&text, "Retention and transfer", "fine-tuning");
    assert_eq!(retention[1], "30.0 [30.0, 30.0]");
    assert_eq!(retention[2], "−30.0 [−30.0, −30.0]");
    assert_eq!(retention[3..5].iter().map(|cell| value(cell)).collect::<Vec<_>>(), ["91.5 %", "11.5"]);
    assert_eq!(row(&text, "Retention and transfer", "diagonal anchor")[1], "5.0 [5.0, 5.0]");
    // 1 − 71.5/96.5 and 71.5/97.5.
    assert_eq!([value(&retention[6]), value(&retention[7])], ["25.9 %", "73.3 %"]);
    assert_eq!(row(&text, "Retention and transfer", "joint training")[1], "–");
}

#[test]
fn forward_transfer_is_the_area_above_the_experts_curve() {
    let (_directory, text) = report_of(&synthetic::manifest(4), |_| ());
    // A straight line to r has the area 0.505 r (flat before its first point), twice as fast 0.76 r. In two orders, tasks
    // 0 and 2 come first once, task 1 never.
    let experts = 0.505 * 0.975;
    let transfer = |area: f64| (0.915 * area - experts) / (1.0 - experts);
    let expected = (2.0 * transfer(f64::midpoint(0.505, 0.76)) + transfer(0.76)) / 3.0;
    let found = row(&text, "Retention and transfer", "fine-tuning")[5].clone();
    assert_eq!(value(&found), format!("{expected:.2}"));
}

#[test]
fn matrices_show_stages_and_places_in_the_order() {
    let (_directory, text) = report_of(&synthetic::manifest(4), |_| ());
    let matrix = text.split("| fine-tuning, n = 4 | task 1 | task 2 | task 3 |\n").nth(1).unwrap();
    let rows: Vec<&str> = matrix.lines().skip(1).take(4).collect();
    assert!(rows[0].starts_with("| untrained | 0.0 [0.0, 0.0] | 0.0 [0.0, 0.0]"), "{}", rows[0]);
    let values = |line: &str| {
        line.trim_matches('|').split('|').skip(1).map(|cell| value(cell.trim()).to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(values(rows[2]), ["61.5", "91.5", "11.5"]);
    assert_eq!(values(rows[3]), ["61.5", "61.5", "91.5"]);
    let mut one_order = synthetic::manifest(2);
    one_order.orders.truncate(1);
    let (_directory, text) = report_of(&one_order, |_| ());
    assert!(text.contains("| fine-tuning, n = 2 | room-0 | room-1 | room-2 |"));
    assert!(text.contains("One order: room-0 → room-1 → room-2."));
}

#[test]
fn comparisons_are_paired_by_seed() {
    let (_directory, text) = report_of(&synthetic::manifest(4), |_| ());
    let anchor = row(&text, "Comparisons", "diagonal anchor");
    // Task 0: always better. Tasks 1 and 2: better than the half that was forgotten, and 2 of 16 of a quarter.
    assert_eq!(value(&anchor[1]), "68.8 %");
    // The seeds' shares cancel: the difference has no spread. All four flips to one side: p = 2/16.
    assert_eq!(anchor[2..4], ["14.7 [14.7, 14.7]", "4"]);
    assert_eq!(anchor[4..], ["0.125", "0.375"]);
    assert!(text.contains("Against **fine-tuning**, paired by seed:"));
    assert_eq!(text.matches("paired by seed:").count(), 1);
}

#[test]
fn a_second_reference_is_the_method_that_does_nothing() {
    let mut manifest = synthetic::manifest(2);
    manifest.methods.swap(0, 1);
    let (_directory, text) = report_of(&manifest, |_| ());
    assert!(text.contains("Against **diagonal anchor**") && text.contains("Against **fine-tuning**"));
}

#[test]
fn steps_to_the_threshold_count_censored_stages() {
    let mut manifest = synthetic::manifest(4);
    let (_directory, text) = report_of(&manifest, |_| ());
    let section = "Steps until 80.0 % success";
    // First stages take 900 k steps, later ones 500 k; tasks 0 and 2 come first in one of two orders.
    let none = row(&text, section, "fine-tuning");
    assert_eq!(
        [none[1].as_str(), value(&none[2]), &none[3], value(&none[4])],
        ["24", "100.0 %", "500 k", "633.3 k"]
    );
    let experts = row(&text, section, "one expert per room");
    assert_eq!([experts[1].as_str(), &experts[3], value(&experts[4])], ["12", "900 k", "900.0 k"]);
    assert_eq!(experts[5], "&lt; 0.001");
    // Tasks 0 and 2 are first in half of the orders of fine-tuning: 700 k steps; task 1 never is: 500 k.
    let slower: Vec<&str> = text
        .lines()
        .rev()
        .find(|line| line.starts_with("| one expert per room | 1."))
        .unwrap()
        .split('|')
        .map(str::trim)
        .collect();
    assert_eq!([2, 3, 4].map(|cell| value(slower[cell])), ["1.29", "1.80", "1.29"]);
    manifest.success_threshold = 0.99;
    let (_directory, text) = report_of(&manifest, |_| ());
    let none = row(&text, "Steps until 99.0 % success", "fine-tuning");
    assert_eq!(none[1..5], ["24", "0.0 % [0.0, 0.0]", "not reached by half", "1.00 M [1.00, 1.00]"]);
    // Of the experts one seed in four gets there, with the last step.
    let experts = row(&text, "Steps until 99.0 % success", "one expert per room");
    assert_eq!(value(&experts[2]), "25.0 %");
    manifest.success_threshold = 1.0;
    let (_directory, text) = report_of(&manifest, |_| ());
    assert!(text.contains("No stage of any method gets there within its 1.00 M steps."));
    assert!(!text.contains("threshold.svg"));
}

#[test]
fn in_one_order_the_steps_are_summed() {
    let mut manifest = synthetic::manifest(4);
    manifest.orders = vec![vec![2, 0, 1]];
    let (_directory, text) = report_of(&manifest, |_| ());
    let after = |words: &str, method: &str| -> Vec<String> {
        let section = text.split(words).nth(1).unwrap_or_else(|| panic!("no {words}"));
        let line = section.lines().find(|line| line.starts_with(&format!("| {method}"))).unwrap();
        line.trim_matches('|').split('|').skip(1).map(|cell| value(cell.trim()).to_owned()).collect()
    };
    // 900 k steps for task 2, which comes first, then 500 k for each.
    let summed = "The means of **fine-tuning** summed over the tasks until then:";
    assert_eq!(after(summed, "fine-tuning"), ["1.40 M", "1.90 M", "900.0 k"]);
    // Experts take 900 k for each.
    assert_eq!(after("Who learns the task alone", "one expert per room"), ["0.64", "0.47", "1.00"]);

    let (_directory, text) = report_of(&synthetic::manifest(4), |_| ());
    assert!(!text.contains("summed over"));
}

#[test]
fn returns_are_drawn_beside_a_published_table() {
    let mut manifest = synthetic::manifest(3);
    let (directory, text) = report_of(&manifest, |_| ());
    assert!(text.contains("](report/returns.svg)"));
    let svg = fs::read_to_string(directory.path().join("report/returns.svg")).unwrap();
    // Curves end at 20 + 100 · success, between 20 and 118; doing nothing has 87.9.
    assert!(
        svg.contains("Learning curves in returns") && svg.contains("doing nothing") && svg.contains(">100</text>")
    );
    manifest.published = None;
    let (directory, _text) = report_of(&manifest, |_| ());
    assert!(!directory.path().join("report/returns.svg").exists());
}

#[test]
fn what_is_kept_is_told_by_the_number_of_tasks() {
    let (_directory, text) = report_of(&synthetic::manifest(4), |_| ());
    let section = text.split("Success in the tasks learned so far:\n").nth(1).unwrap();
    let line = section.lines().find(|line| line.starts_with("| fine-tuning |")).unwrap();
    let cells: Vec<&str> = line.split('|').skip(2).map(|cell| value(cell.trim())).collect();
    // Each task has 91.5 % when it is trained and 61.5 % later.
    assert_eq!(cells[..3], ["91.5 %", "76.5 %", "71.5 %"]);
}

#[test]
fn a_published_table_stands_beside_ours() {
    let (_directory, text) = report_of(&synthetic::manifest(4), |_| ());
    assert_eq!(row(&text, "Beside the published table", "incremental"), ["incremental", "53.8", "59.35", "DNE"]);
    let ours = row(&text, "Beside the published table", "joint training");
    let values: Vec<&str> = ours.iter().map(|cell| value(cell)).collect();
    assert_eq!(values, ["joint training", "116.5", "116.5", "116.5", "116.5", "96.5 %"]);
    assert!(text.contains("* One run each."));
}

#[test]
fn missing_jobs_are_said_and_left_out() {
    let manifest = synthetic::manifest(4);
    let gone = |directory: &Path| {
        for job in manifest.jobs().into_iter().filter(|job| job.method == "none" && job.seed > 1) {
            fs::remove_file(job.rows_path(directory)).unwrap();
        }
    };
    let (directory, text) = report_of(&manifest, gone);
    assert!(text.contains(
        "**This study is incomplete:** 4 of 24 jobs have not left their rows yet (`rows/none/0-2.csv`, "
    ));
    let none = row(&text, "After the last task", "fine-tuning");
    assert_eq!([none[1].as_str(), &none[2], value(&none[3])], ["4", "2", "70.5 %"]);
    let data = StudyData::load(directory.path()).unwrap();
    assert!(headline(&data).ends_with("4 of 24 jobs are missing\n"));
}

#[test]
fn a_study_without_any_rows_has_a_report() {
    let manifest = synthetic::manifest(2);
    let (_directory, text) = report_of(&manifest, |directory| fs::remove_dir_all(directory.join("rows")).unwrap());
    assert!(text.contains("No job has finished yet.") && text.contains("0 of 12 jobs are"));
}

#[test]
fn one_seed_has_values_and_no_intervals() {
    let (_directory, text) = report_of(&synthetic::manifest(1), |_| ());
    let none = row(&text, "After the last task", "fine-tuning");
    assert_eq!(none[..6], ["fine-tuning", "2", "1", "70.0 %", "67.5 %", "60.0 %"]);
    assert!(text.contains("This study has too few seeds"));
    assert_eq!(row(&text, "Comparisons", "diagonal anchor")[4..], ["–", "–"]);
}

#[test]
fn one_task_has_nothing_to_forget() {
    let mut manifest = synthetic::manifest(3);
    manifest.tasks.truncate(1);
    manifest.baselines.truncate(3);
    manifest.orders = vec![vec![0]];
    let (_directory, text) = report_of(&manifest, |_| ());
    let retention = row(&text, "Retention and transfer", "fine-tuning");
    assert_eq!([retention[1].as_str(), &retention[2], value(&retention[3])], ["–", "–", "91.0 %"]);
    assert_eq!(value(&row(&text, "After the last task", "fine-tuning")[3]), "91.0 %");
}

#[test]
fn a_study_without_curves_says_so() {
    let (directory, text) =
        report_of(&synthetic::manifest(2), |directory| fs::remove_dir_all(directory.join("curves")).unwrap());
    assert_eq!(text.matches("No run has left a curve.").count(), 2);
    assert!(!directory.path().join("report/curves.svg").exists());
    assert_eq!(row(&text, "Retention and transfer", "fine-tuning")[5], "–");
}

#[test]
fn a_study_without_baselines_experts_or_joint_training_is_reported() {
    let mut manifest = synthetic::manifest(2);
    manifest.baselines.clear();
    manifest.published = None;
    manifest.methods.retain(|method| method.kind == MethodKind::Sequential);
    let (_directory, text) = report_of(&manifest, |_| ());
    assert!(text.contains("Trivial pilots were not flown.") && !text.contains("Beside the published table"));
    assert_eq!(row(&text, "After the last task", "fine-tuning")[8], "–");
    assert_eq!(row(&text, "Retention and transfer", "fine-tuning")[5..], ["–", "–", "–"]);
}

#[test]
fn many_methods_and_tasks_still_make_pictures() {
    let mut manifest = synthetic::manifest(2);
    let names: Vec<String> = (0..7).map(|task| format!("harder-cross-{task}")).collect();
    manifest.tasks = names.iter().map(|name| Task { name: name.clone(), episode_secs: 10.0 }).collect();
    manifest.baselines.clear();
    manifest.orders = vec![(0..7).collect()];
    manifest.methods = (0..16)
        .map(|index| {
            synthetic::method(
                &format!("m{index}"),
                &format!("method {index} & <more>"),
                MethodKind::Sequential,
                10 << index,
            )
        })
        .collect();
    let (directory, text) = report_of(&manifest, |_| ());
    let svg = fs::read_to_string(directory.path().join("report/memory.svg")).unwrap();
    assert!((0..16).all(|index| svg.contains(&format!(">method {index} &amp; &lt;more&gt;</text>"))));
    assert!(text.contains("method 15 & &lt;more>"));
}

/// A claim about a synthetic study.
fn claim(method: &str, measure: Measure, expected: Expected) -> Claim {
    Claim { claim: format!("{method} {expected:?}"), method: method.to_owned(), measure, expected }
}

#[test]
fn claims_are_decided_by_the_numbers_of_the_study() {
    let mut manifest = synthetic::manifest(8);
    let names = |name: &str| name.to_owned();
    // With what the seeds add, `none` has 71.5 % on average, `anchor` 86.2 %, `experts` 97.5 %.
    manifest.claims = vec![
        claim("experts", Measure::EveryTask, Expected::AtLeast(0.95)),
        claim("none", Measure::MeanSuccess, Expected::AtLeast(0.9)),
        claim("none", Measure::MeanSuccess, Expected::AtLeast(0.715)),
        claim("anchor", Measure::MeanSuccess, Expected::Above(names("none"))),
        claim("none", Measure::MeanSuccess, Expected::Above(names("anchor"))),
        claim("none", Measure::MeanSuccess, Expected::NotAbove(names("anchor"))),
        claim("anchor", Measure::MeanSuccess, Expected::NotInferior { to: names("none"), margin_points: 3.0 }),
        claim("none", Measure::MeanSuccess, Expected::NotInferior { to: names("anchor"), margin_points: 3.0 }),
        claim("anchor", Measure::OfExperts, Expected::AtLeast(0.85)),
        claim("anchor", Measure::Plasticity, Expected::AtLeast(0.99)),
    ];
    let (directory, text) = report_of(&manifest, |_| ());
    let section = text.split("## Claims\n").nth(1).unwrap().split("\n## ").next().unwrap();
    let verdicts: Vec<&str> = section
        .lines()
        .filter(|line| ["At", "Above", "Inferior"].iter().any(|word| line.contains(word)))
        .map(|line| line.trim_end_matches(" |").rsplit(" | ").next().unwrap())
        .collect();
    let [holds, fails, open] = ["**holds**", "**fails**", "open"];
    assert_eq!(verdicts, [holds, fails, open, holds, fails, holds, holds, fails, holds, fails], "{section}");

    let data = StudyData::load(directory.path()).unwrap();
    let text = page(&[data.clone(), data.clone()], None).text();
    assert_eq!(text.matches("\n## rooms\n").count(), 2);
    assert_eq!(text.matches("\n### Claims\n").count(), 2);
    let listed: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("| [rooms](#rooms) ")).collect();
    let rows =
        || section.lines().filter(|line| ["At", "Above", "Inferior"].iter().any(|word| line.contains(word)));
    assert_eq!(listed, rows().chain(rows()).collect::<Vec<_>>());
    assert!(!text.contains("incomplete") && !text.contains(".svg)"), "{text}");

    let page = page(&[data], Some("docs/results"));
    let text = page.text();
    let names: Vec<&str> = page.pictures.iter().map(|(name, _)| name.as_str()).collect();
    let shown = ["final", "so-far", "curves", "returns", "memory", "threshold"];
    assert_eq!(names, shown.map(|file| format!("rooms-{file}.svg")));
    assert!(names.iter().all(|name| text.contains(&format!("](docs/results/{name})"))), "{text}");
}

#[test]
fn no_claim_is_decided_by_fewer_than_eight_seeds() {
    for (seeds, verdict) in [(1, "open"), (7, "open"), (8, "**holds**")] {
        let mut manifest = synthetic::manifest(seeds);
        let expected = [Expected::AtLeast(0.5), Expected::NotAbove("anchor".to_owned())];
        manifest.claims = expected.map(|expected| claim("none", Measure::MeanSuccess, expected)).to_vec();
        let (_directory, text) = report_of(&manifest, |_| ());
        let section = text.split("## Claims\n").nth(1).unwrap().split("\n## ").next().unwrap();
        assert_eq!(section.matches(&format!("| {verdict} |")).count(), 2, "{seeds} seeds: {section}");
    }
}

#[test]
fn a_share_is_that_of_joint_training_and_not_of_averaged_policies() {
    let mut manifest = synthetic::manifest(8);
    manifest.methods.insert(0, synthetic::method("sharing", "averaged policies", MethodKind::Averaged, 0));
    manifest.claims = vec![
        claim("anchor", Measure::OfJoint, Expected::AtLeast(0.85)),
        claim("anchor", Measure::OfJoint, Expected::AtLeast(0.95)),
    ];
    let (_directory, text) = report_of(&manifest, |_| ());
    // 86.2 of 96.5 hundredths; averaged policies have less than joint training.
    let anchor = row(&text, "Retention and transfer", "diagonal anchor");
    assert_eq!(value(&anchor[6]), "10.7 %");
    let section = text.split("## Claims\n").nth(1).unwrap().split("\n## ").next().unwrap();
    assert_eq!([section.matches("**holds**").count(), section.matches("**fails**").count()], [1, 1], "{section}");
}

#[test]
fn claims_compare_steps_and_returns_with_doing_nothing() {
    let mut manifest = synthetic::manifest(8);
    let fewer = |than: &str| Expected::FewerStepsThan(than.to_owned());
    manifest.claims = vec![
        claim("none", Measure::MeanSuccess, fewer("experts")),
        claim("experts", Measure::MeanSuccess, fewer("none")),
        claim("joint", Measure::MeanSuccess, fewer("none")),
        claim("experts", Measure::MeanSuccess, Expected::MoreThanDoingNothing),
    ];
    let verdicts = |manifest: &StudyManifest| -> Vec<[String; 3]> {
        let (_directory, text) = report_of(manifest, |_| ());
        let section = text.split("## Claims\n").nth(1).unwrap().split("\n## ").next().unwrap();
        let rows = section.lines().filter(|line| line.contains("Than"));
        rows.map(|line| {
            let cells: Vec<&str> = line.trim_matches(['|', ' ']).split(" | ").collect();
            [value(cells[1].rsplit(": ").next().unwrap()), cells[2], cells[3]].map(str::to_owned)
        })
        .collect()
    };
    // 900 k steps against 633 k on average.
    let found = verdicts(&manifest);
    assert_eq!(found[0], ["`experts` takes 1.42", "above 1", "**holds**"]);
    assert_eq!(found[1], ["`none` takes 0.70", "above 1", "**fails**"]);
    assert_eq!(found[2][1..], ["above 1", "–"]);
    assert_eq!(found[3], ["117.5", "above 87.9, doing nothing", "**holds**"]);
    for baseline in &mut manifest.baselines {
        baseline.episode_return = 120.0;
    }
    assert_eq!(verdicts(&manifest)[3][2], "**fails**");
}

#[test]
fn a_page_says_that_a_study_is_incomplete() {
    let directory = tempfile::tempdir().unwrap();
    synthetic::write(directory.path(), &synthetic::manifest(2));
    fs::remove_file(directory.path().join("rows/joint/0-1.csv")).unwrap();
    let page = page(&[StudyData::load(directory.path()).unwrap()], None).text();
    assert!(page.contains("**This study is incomplete:** 1 of ") && page.contains("rows/joint/0-1.csv"), "{page}");
}

#[test]
fn a_page_keeps_what_it_has_about_other_studies() {
    let directory = tempfile::tempdir().unwrap();
    let named = |name: &str| {
        let folder = directory.path().join(name);
        fs::create_dir(&folder).unwrap();
        let claims = vec![claim("none", Measure::MeanSuccess, Expected::AtLeast(0.5))];
        synthetic::write(&folder, &StudyManifest { name: name.to_owned(), claims, ..synthetic::manifest(2) });
        StudyData::load(&folder).unwrap()
    };
    let [first, second, third] = ["first", "second", "third"].map(named);
    let by_hand = |text: &str| text.replacen("# Results\n", "# Results\n\n## Abstract\n\nIt works.\n", 1);
    let earlier = by_hand(&page(&[first.clone(), second.clone()], None).text());
    let all = by_hand(&page(&[first, second.clone(), third.clone()], None).text());

    let mut update = page(&[third, second], None);
    assert_eq!(update.keep(&earlier), Ok(()));
    assert_eq!(update.text(), all);
    assert_eq!(update.keep("# Something else\n"), Err(NoPage));
}

#[test]
fn the_page_of_the_repository_is_kept_as_it_is() {
    let earlier = fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../RESULTS.md")).unwrap();
    let mut update = page(&[], None);
    assert_eq!(update.keep(&earlier), Ok(()));
    assert!(update.text() == earlier);
}

#[test]
fn the_same_rows_make_the_same_bytes() {
    let manifest = synthetic::manifest(3);
    let (first, text) = report_of(&manifest, |_| ());
    let (second, again) = report_of(&manifest, |_| ());
    assert_eq!(text, again);
    for entry in fs::read_dir(first.path().join("report")).unwrap() {
        let name = entry.unwrap().file_name();
        let read = |directory: &TempDir| fs::read(directory.path().join("report").join(&name)).unwrap();
        assert_eq!(read(&first), read(&second));
    }
}

#[test]
fn the_headline_has_a_line_per_method() {
    let directory = tempfile::tempdir().unwrap();
    synthetic::write(directory.path(), &synthetic::manifest(4));
    let text = headline(&StudyData::load(directory.path()).unwrap());
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines.len(), 6);
    assert!(lines[1].starts_with("method") && lines[2].starts_with("fine-tuning"), "{text}");
    let fields: Vec<&str> = lines[3].split("  ").filter(|field| !field.is_empty()).map(str::trim).collect();
    assert_eq!(fields[0], "diagonal anchor");
    assert!(fields[2].starts_with("86.2 % ["), "{text}");
    assert_eq!(fields.last(), Some(&"45.1 kB"));
}
