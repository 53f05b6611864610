//! Flights as a whole: the same bits however they are flown, and defects that the flights of the repository catch.

use std::cell::Cell;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use kestrel_experiments::interrupt::Interrupt;
use kestrel_shim::parameter::ParameterValue;
use kestrel_shim::parameter::table::Parameter;
use kestrel_shim::plant::Plant;
use nalgebra::Vector3;

use super::case::Case;
use super::config::load;
use super::fault::{EstimateFault, Fault, FaultKind};
use super::film::{file_name, film};
use super::flight::fly;
use super::plant::FailingPlant;
use super::runner::{RunOptions, Verdict, failures, run};

/// The flights of a file of the repository, before anything is wrong with them.
fn shipped(name: &str) -> Vec<Case> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../configs/tests").join(name);
    load(&path, &[]).unwrap()
}

fn verdicts(cases: &[Case], threads: usize) -> Vec<Verdict> {
    run(cases, &RunOptions { threads, films: None }, &Interrupt::default()).unwrap().unwrap()
}

/// Names of the flights that fail.
fn failed(cases: &[Case]) -> Vec<String> {
    let failed = verdicts(cases, 2).into_iter().filter(|verdict| !verdict.failures.is_empty());
    failed.map(|verdict| format!("{}/{}", verdict.suite, verdict.name)).collect()
}

/// The shipped flights of a file pass, and those with a defect in them fail in all of these, at least.
fn assert_caught(file: &str, defect: impl Fn(&mut Case), catching: &[&str]) {
    let mut cases = shipped(file);
    cases.retain(|case| catching.iter().any(|name| case.full_name().starts_with(name)));
    assert_eq!(failed(&cases), Vec::<String>::new());
    cases.iter_mut().for_each(defect);
    let failed = failed(&cases);
    for name in catching {
        assert!(failed.iter().any(|failed| failed.starts_with(name)), "{name} is not among {failed:?}");
    }
}

#[test]
fn a_failsafe_that_is_switched_off_is_caught() {
    let off = |case: &mut Case| case.parameters.set(Parameter::NavDllAct, ParameterValue::Integer(0)).unwrap();
    let catching =
        ["failsafes/link-lost-lands", "failsafes/link-lost-returns", "failsafes/link-lost-on-the-way-holds"];
    assert_caught("failsafes.yaml", off, &catching);
}

#[test]
fn a_wrong_sign_in_the_autopilots_copy_of_the_mixer_is_caught() {
    // The reaction of the rotors turns the drone the other way than the autopilot believes.
    let wrong = |case: &mut Case| case.airframe.torque_coefficient *= -1.0;
    assert_caught(
        "hover.yaml",
        wrong,
        &["hover/headings [cascade]", "hover/take-off-and-land [cascade", "hover/hand-over"],
    );
}

#[test]
fn weak_rotors_that_nobody_makes_up_for_are_caught() {
    let off = |case: &mut Case| case.parameters.set(Parameter::RlCompRotors, ParameterValue::Integer(0)).unwrap();
    assert_caught("adaptation.yaml", off, &["adaptation/worn-motor"]);
    assert_eq!(failed(&shipped("adaptation.yaml")), Vec::<String>::new());
}

#[test]
fn a_load_is_carried_from_its_begin_to_its_end() {
    let mut cases = shipped("adaptation.yaml");
    let case = cases.first_mut().unwrap();
    case.faults = vec![fault([0.6, 0.8], FaultKind::Load(0.027))];
    let mut plant = FailingPlant::new(case, &Rc::new(Cell::new(0.0)));
    let hover = case.airframe.hover_rotor_speed() as f32;
    let mut speeds = Vec::new();
    for _ in 0..60 {
        plant.step(&[1.2 * hover; 4]);
        speeds.push(plant.state().velocity.z);
    }
    // With a thrust of 1.44 times its weight it climbs, with as much again as it weighs it falls back, and climbs again.
    let climbs = |from: usize, to: usize| speeds[to] - speeds[from];
    assert!(climbs(25, 29) > 0.0 && climbs(33, 38) < 0.0 && climbs(43, 59) > 0.0, "{speeds:?}");
}

#[test]
fn a_wall_that_is_gone_is_caught() {
    let gone = |case: &mut Case| {
        let mut scenario = (*case.scenario).clone();
        let solids = &mut scenario.aviary.world.solids;
        let before = solids.len();
        // The one at the drone's left: nothing else is beyond y = 1 in the middle of the room.
        solids.retain(|solid| solid.pose.position.y < 1.0);
        assert_eq!(solids.len() + 1, before);
        case.scenario = Arc::new(scenario);
    };
    assert_caught("rooms.yaml", gone, &["rooms/against-a-wall"]);
}

/// What goes wrong between two times \[s\].
fn fault([at_secs, until_secs]: [f64; 2], kind: FaultKind) -> Fault {
    Fault { at_secs, until_secs, kind }
}

#[test]
fn faults_of_the_world_act_from_their_begin_to_their_end() {
    let mut case = shipped("hover.yaml").remove(0);
    case.faults = vec![
        fault([0.1, 0.2], FaultKind::Estimate(EstimateFault::Frozen)),
        fault([0.2, 0.3], FaultKind::Estimate(EstimateFault::Lost)),
        fault([0.1, 0.3], FaultKind::Motor { rotor: 1, share: 0.25 }),
        fault([0.1, f64::INFINITY], FaultKind::Battery(0.3)),
        fault([0.1, 0.2], FaultKind::Gust(Vector3::new(0.0, 0.0, 5.0))),
    ];
    let mut plant = FailingPlant::new(&case, &Rc::new(Cell::new(0.0)));
    let targets = [0.9 * case.airframe.hover_rotor_speed() as f32; 4];
    let mut told = Vec::new();
    for _ in 0..20 {
        told.push((*plant.known_state(), *plant.state(), plant.battery()));
        plant.step(&targets);
    }
    let known = |period: usize| told[period].0;
    let rotors = |period: usize| told[period].1.rotor_speeds;
    assert!(known(4) != known(3) && (5..10).all(|period| known(period) == known(4)), "frozen from 0.1 s on");
    assert!((10..15).all(|period| known(period).position.x.is_nan()), "lost from 0.2 s on");
    assert!(known(15).position.z.is_finite() && known(15) != known(4));
    assert!(rotors(5)[1] == rotors(5)[0] && rotors(15)[1] < 0.9 * rotors(15)[0], "{:?}", rotors(15));
    assert!(rotors(19)[1] > rotors(15)[1], "it comes back");
    assert_eq!((told[4].2, told[5].2, told[19].2), (None, Some(0.3), Some(0.3)));
    let lift = |periods: [usize; 2]| told[periods[1]].1.velocity.z - told[periods[0]].1.velocity.z;
    assert!(lift([5, 10]) > lift([10, 15]), "the gust lifts it as long as it blows");
}

#[test]
fn while_the_link_is_lost_no_order_and_no_heartbeat_arrives() {
    let mut case = shipped("hover.yaml").remove(0);
    case.secs = 3.0;
    let landed = fly(&case).unwrap();
    assert!(landed.moments.iter().any(|moment| moment.mode.flies()));
    // Arming is lost, the take-off is not: it is refused.
    case.faults = vec![fault([0.4, 0.9], FaultKind::LinkLoss)];
    let flown = fly(&case).unwrap();
    assert!(flown.moments.iter().all(|moment| !moment.mode.armed()));
    let heard: Vec<&String> = flown.moments.iter().flat_map(|moment| &moment.heard).collect();
    assert_eq!(heard, ["refused: not armed"]);
}

#[test]
fn the_same_flights_are_the_same_bits_for_any_number_of_threads() {
    let cases: Vec<Case> = ["disturbances.yaml", "rooms.yaml"].into_iter().flat_map(shipped).collect();
    let one = verdicts(&cases, 1);
    assert_eq!(one, verdicts(&cases, 3));
    let mut hashes: Vec<u64> = one.iter().map(|verdict| verdict.hash).collect();
    hashes.sort_unstable();
    hashes.dedup();
    assert_eq!(hashes.len(), cases.len(), "no two are the same");
}

#[test]
fn a_user_who_stops_gets_no_verdicts() {
    let interrupt = Interrupt::default();
    interrupt.request();
    let options = RunOptions { threads: 1, films: None };
    assert_eq!(run(&shipped("rooms.yaml")[..1], &options, &interrupt).unwrap(), None);
}

#[test]
fn a_flight_that_fails_is_filmed_from_its_begin_to_its_end() {
    let mut cases = shipped("rooms.yaml");
    cases.truncate(1);
    let case = &mut cases[0];
    case.secs = 0.2;
    let flown = fly(case).unwrap();
    assert_eq!(flown.moments.len(), 11);
    let failures = failures(&case.expectations, &flown);
    assert!(!failures.is_empty());
    assert!(film(case, &flown, &failures).unwrap().starts_with(b"GIF89a"));
    assert_eq!(file_name(case), "rooms-between-the-pillars--hover--0.5-m.gif");
}
