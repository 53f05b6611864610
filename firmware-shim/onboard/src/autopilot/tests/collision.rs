//! Braking before what rangers see.

use super::*;
use crate::plant::Ranges;

/// A wall ahead \[m\], at right angles to the x axis.
const WALL_X: f32 = 1.0;

const NOTHING: Ranges = Ranges { front: None, back: None, left: None, right: None, up: None, down: Some(1.0) };

/// Sent through the wall, with rangers that see it; how far it comes within five seconds \[m\].
fn sent_through_the_wall(rig: &mut Rig) -> f32 {
    rig.accept(Command::GoTo(Vector3::new(3.0, 0.0, 1.0)));
    let mut farthest = f32::MIN;
    for _ in 0..(5.0 / rig.autopilot.control_secs()) as usize {
        let state = *rig.plant.state();
        let ranges = Ranges { front: Some(WALL_X - state.position.x), ..NOTHING };
        rig.surroundings.collision_secs = ranges.collision_secs(&state);
        rig.tick();
        farthest = farthest.max(state.position.x);
    }
    farthest
}

#[test]
fn the_cascade_brakes_before_a_wall_when_it_is_asked_to() {
    let mut rig = Rig::in_mode(Mode::Holding);
    rig.autopilot.adjust(AutopilotSettings { clearance_secs: Some(0.8), ..AutopilotSettings::default() });
    let farthest = sent_through_the_wall(&mut rig);
    assert!((0.3..WALL_X - 0.1).contains(&farthest), "{farthest} m");
    assert_eq!((rig.autopilot.mode(), rig.autopilot.active_controller()), (Mode::Holding, Controller::Cascade));
    assert!((rig.autopilot.goal().position().x - rig.plant.state().position.x).abs() < 0.3);
    // A stream does not push it on, a command does.
    let through = SetPoint::Position(Vector3::new(3.0, 0.0, 1.0));
    assert_eq!(rig.autopilot.set_point(through), Err(Refusal::Failsafe));
    rig.accept(Command::GoTo(Vector3::new(-1.0, 0.0, 1.0)));
    assert_eq!(rig.autopilot.mode(), Mode::Guided);
}

#[test]
fn nobody_brakes_unasked() {
    let mut rig = Rig::in_mode(Mode::Holding);
    assert!(sent_through_the_wall(&mut rig) > WALL_X);
    assert_eq!(rig.autopilot.active_controller(), Controller::Policy);
}

#[test]
fn time_to_a_wall_is_that_of_the_axis_on_which_it_nears() {
    let mut state = *FlatFloor::new(&CF2X, 0.01).state();
    let ranges = Ranges { front: Some(2.0), left: Some(0.3), up: Some(0.5), down: Some(0.1), ..NOTHING };
    let mut after = |velocity: [f32; 3]| {
        state.velocity = velocity.into();
        ranges.collision_secs(&state)
    };
    assert_eq!(after([1.0, 0.0, 0.0]), Some(2.0));
    assert_eq!(after([1.0, 0.5, 0.0]), Some(0.6));
    assert_eq!(after([0.0, 0.0, 2.0]), Some(0.25));
    assert_eq!(after([-1.0, -1.0, -1.0]), None, "nothing is seen there, and the floor does not count");
    assert_eq!(after([0.04, 0.0, 0.0]), None, "it hovers");
}
