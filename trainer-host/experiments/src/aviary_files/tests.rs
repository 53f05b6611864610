use kestrel_draw::plan::{Drawing, plan, seen_sheet, sheet};

use super::*;
use crate::golden::in_repository;

fn worlds() -> Vec<Subject> {
    let paths = in_folders(&[in_repository("configs"), in_repository("assets/worlds")]);
    paths.iter().map(|path| read(path, &[]).unwrap()).collect()
}

fn subject(name: &str, overrides: &[&str]) -> Subject {
    let overrides: Vec<String> = overrides.iter().map(|&assignment| assignment.to_owned()).collect();
    read(&in_repository(name), &overrides).unwrap()
}

#[test]
fn every_aviary_becomes_a_picture() {
    for subject in worlds() {
        let drawing = plan(&subject);
        let svg = drawing.svg();
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"), "{}", subject.name);
        assert!(!svg.contains("NaN") && !svg.contains("inf\""), "{}", subject.name);
        assert!(svg.contains(&format!(">{}</text>", subject.name)));
        assert!(drawing.width <= 1200.0 && drawing.height < 1800.0, "{}: {}", subject.name, drawing.height);
    }
}

#[test]
fn a_plan_is_a_png_too() {
    let drawing = plan(&subject("assets/worlds/room-0.yaml", &[]));
    let png = drawing.png().unwrap();
    assert_eq!(&png[..8], b"\x89PNG\r\n\x1a\n");
    assert_eq!(png, drawing.png().unwrap());
    assert!(Drawing::new(10.0, 0.0).png().is_err());
}

#[test]
fn metres_are_to_scale() {
    let subject = subject("assets/worlds/cross-0.yaml", &[]);
    let svg = plan(&subject).svg();
    // 6.4 m of walls and 0.25 m of air on both sides share 1028 px.
    let scale = 1028.0 / 6.9;
    let [left, right] = [0.25, 6.65].map(|metres| format!("{:.1}", 76.0 + scale * metres));
    assert!(svg.contains(&format!("x1=\"{left}\"")) && svg.contains(&format!("x2=\"{right}\"")), "{left} {right}");
    for label in ["6.4 m", "2.4 m", "1 m", "6.4 m x 2.4 m x 1 m, 5 solids"] {
        assert!(svg.contains(&format!(">{label}</text>")), "{label}");
    }
}

#[test]
fn each_piece_of_furniture_is_named_once() {
    let svg = plan(&subject("assets/worlds/room-2.yaml", &[])).svg();
    let count = |name: &str| svg.matches(&format!(">{name}</text>")).count();
    assert_eq!((count("dresser"), count("cupboard"), count("goal table")), (3, 3, 1));
    let svg = plan(&subject("assets/worlds/room-1.yaml", &[])).svg();
    let count = |name: &str| svg.matches(&format!(">{name}</text>")).count();
    assert_eq!((count("lamp"), count("tv stand"), count("dresser")), (4, 2, 2));
}

#[test]
fn experiments_show_where_they_start() {
    let hover = subject("configs/hover.yaml", &[]);
    assert!(hover.start_region.is_some() && plan(&hover).svg().contains(">random starts</text>"));
    let moved = subject("configs/cross.yaml", &["scenario.aviary.goal_m.0=4.4"]);
    assert!((moved.goals[0].x - 4.4).abs() < 1e-6);
    let maze = subject("assets/worlds/maze.yaml", &["goal_m=[0.2, 1, 1]"]);
    assert_eq!(maze.goals[0].y, 1.0);
}

#[test]
fn the_sheet_of_the_documentation_is_up_to_date() {
    let path = in_repository("docs/pictures/aviaries.svg");
    let worlds: Vec<Subject> = worlds().into_iter().filter(|subject| subject.start_region.is_none()).collect();
    let svg = sheet(&worlds).svg();
    if std::env::var_os("BLESS").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, &svg).unwrap();
    }
    assert!(svg.len() < 1 << 20, "{} bytes", svg.len());
    let expected = std::fs::read_to_string(&path).unwrap();
    assert!(expected == svg, "{}: run the test with BLESS=1 and look at the change", path.display());
}

#[test]
fn the_views_of_the_documentation_are_up_to_date() {
    let path = in_repository("docs/pictures/aviaries-seen.png");
    let paths = in_folders(&[in_repository("assets/worlds")]);
    let subjects: Vec<Subject> = paths.iter().map(|path| read(path, &[]).unwrap()).collect();
    let png = seen_sheet(&subjects).png().unwrap();
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, &png).unwrap();
    }
    assert!(png.len() < 1 << 19, "{} bytes", png.len());
    let expected = std::fs::read(&path).unwrap();
    assert!(expected == png, "{}: run the test with BLESS=1 and look at the change", path.display());
}

#[test]
fn markup_in_names_is_only_text() {
    let mut subject = subject("assets/worlds/empty.yaml", &[]);
    subject.about = "</text><script> & \u{7}".to_owned();
    assert!(plan(&subject).svg().contains(">&lt;/text&gt;&lt;script&gt; &amp; </text>"));
}

#[test]
fn a_name_that_is_nothing_lists_those_that_are() {
    let message = find("no-such-aviary").unwrap_err().to_string();
    assert!(message.starts_with("no-such-aviary: found no such file or aviary, expected a YAML file or one of: "));
}
