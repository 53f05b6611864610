use super::*;

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

#[test]
fn probe() {
    for line in std::fs::read_to_string("/tmp/cases.txt").unwrap().lines() {
        let (from, to) = line.split_once(" => ").unwrap();
        let text = MINIMAL.replace(from, &to.replace("\\n", "\n"));
        if text == MINIMAL { println!("NO CHANGE {line}"); }
        match parse("trial.yaml", &text, &[]) {
            Ok(_) => println!("OK?? {line}"),
            Err(error) => println!("{line}\n    {error}"),
        }
    }
    for over in std::fs::read_to_string("/tmp/sets.txt").unwrap().lines() {
        match parse("trial.yaml", MINIMAL, &[over.to_owned()]) {
            Ok(_) => println!("OK {over}"),
            Err(error) => println!("    {error}"),
        }
    }
    let experiment = load(Path::new("../configs/cross.yaml"), &[]).unwrap();
    println!("{}", experiment.resolved_yaml);
    println!("{}", schema());
}
