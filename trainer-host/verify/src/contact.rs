//! How recorded falls and collisions end: how the drone rebounds, on which side of a wall, where and when it rests.
//!
//! Step by step a solver's iterations decide what happens in contact; what comes of it can be compared.

use std::collections::BTreeMap;

use kestrel_core::attitude::Attitude;
use kestrel_core::reference::bullet::{Bullet, BulletState, Quirks};
use kestrel_core::vehicle::State;
use kestrel_sim::contact::{Arena, ContactMemory, ContactReport, ContactSolver, Motion};
use kestrel_sim::world::{Pose, Shape, Solid, World};
use nalgebra::Vector3;

use super::model::Physics;
use super::open_loop::{Run, StaticBox, advance};
use super::report::{Kind, Ledger, Worst};

/// A drone is at rest once it has been slower than this \[m/s\] for [`QUIET_STEPS`].
const REST: f64 = 0.01;

/// Physics steps, a tenth of a second, in which a drone that nothing carries becomes faster than 1 m/s. What it does after
/// them does not count: Bullet exchanges the contact points of a resting body now and then, which kicks it to some
/// 2 cm/s for one to three steps. When that happens is decided by rounding; 3 of 60 drones do it that lie flat.
const QUIET_STEPS: usize = 24;

/// Physics steps after the first contact in which the drone rebounds.
const REBOUND_STEPS: usize = 60;

/// Physics steps, a second, after the first contact. A drone that still rattles then does so from one corner to the next
/// until chance ends it: of eight falls whose starts were turned by 1e-13 rad, Bullet itself let half come to rest after
/// 451 to 491 steps, and half never.
const RATTLE_STEPS: usize = 240;

/// The way of one drone at the recorded physics steps.
type Track = BTreeMap<usize, Passing>;

/// Where a drone is and how it moves.
#[derive(Clone, Copy, Debug)]
struct Passing {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
}

/// What comes of a contact.
#[derive(Clone, Copy, Debug)]
struct Outcome {
    /// Greatest speed against the direction of arrival \[m/s\].
    rebound: f64,
    /// Physics step from which on the drone is at rest.
    rest: Option<usize>,
    /// At the end of the record \[m, world\].
    end: Vector3<f64>,
}

/// Compares the outcome of a run that was recorded because it touches something.
pub(super) fn compare(run: &Run, ledger: &mut Ledger) {
    let meant = matches!(run.category.as_str(), "drop" | "wall") && run.physics != Physics::Dyn;
    let Some(contact) = run.first_contact().filter(|contact| meant && *contact > 0) else { return };
    let world = world(&run.boxes);
    let computed = flown(run, &world);
    let recorded =
        run.record.iter().map(|(step, samples)| (*step, samples.iter().map(super::open_loop::Sample::placed)));
    let recorded = tracks(recorded.map(|(step, drones)| (step, drones.collect())));
    for (drone, (recorded, computed)) in recorded.iter().zip(&computed).enumerate() {
        let (Some(expected), Some(found)) = (outcome(recorded, contact), outcome(computed, contact)) else {
            continue;
        };
        let row = format!("drone {drone}");
        let mut add = |kind, error| {
            let mut worst = Worst::default();
            worst.add(error, &row);
            ledger.add(kind, &run.id, &worst);
        };
        add(Kind::ContactRebound, relative(found.rebound, expected.rebound));
        if !world.solids.is_empty() {
            add(Kind::ContactSide, wrong_sides(&world, &found.end, &expected.end));
        }
        if let Some(rest) = expected.rest.filter(|rest| *rest < contact + RATTLE_STEPS) {
            add(Kind::ContactRest, (found.end - expected.end).norm());
            let time = |step: usize| (step - contact) as f64;
            let error = found.rest.map_or(f64::INFINITY, |found| relative(time(found), time(rest)));
            add(Kind::ContactTimeToRest, error);
        }
    }
}

/// Difference as a share of what was expected.
fn relative(found: f64, expected: f64) -> f64 {
    let share = (found - expected).abs() / expected.abs();
    if share.is_nan() { f64::INFINITY } else { share }
}

/// How many faces of the boxes the two points have on different sides; a NaN differs from everything.
fn wrong_sides(world: &World, found: &Vector3<f64>, expected: &Vector3<f64>) -> f64 {
    if found.iter().any(|coordinate| coordinate.is_nan()) {
        return f64::INFINITY;
    }
    let side = |solid: &Solid, point: &Vector3<f64>| {
        let local = solid.pose.world_from_body.rotate_inverse(point - solid.pose.position);
        let Shape::Cuboid(half) = &solid.shape else { return [false; 6] };
        [0, 1, 2, 3, 4, 5]
            .map(|face| if face < 3 { local[face] < -half[face] } else { local[face - 3] > half[face - 3] })
    };
    let differing = |solid: &Solid| {
        let pairs = side(solid, found).into_iter().zip(side(solid, expected));
        pairs.filter(|(one, other)| one != other).count()
    };
    world.solids.iter().map(differing).sum::<usize>() as f64
}

/// What comes of the first contact; none if nothing is recorded before or after it.
fn outcome(track: &Track, contact: usize) -> Option<Outcome> {
    let (_, arriving) = track.range(..contact).next_back()?;
    let (_, end) = track.range(contact..).next_back()?;
    let direction = arriving.velocity.normalize();
    let rebounding = track.range(contact..contact + REBOUND_STEPS);
    let rebound = rebounding.map(|(_, passing)| -passing.velocity.dot(&direction)).fold(f64::MIN, f64::max);
    Some(Outcome { rebound, rest: rest(track, contact), end: end.position })
}

/// The step from which on the drone is at rest for the first time.
fn rest(track: &Track, contact: usize) -> Option<usize> {
    let mut since = None;
    for (&step, passing) in track.range(contact..) {
        if passing.velocity.norm() >= REST {
            since = None;
        } else if step - *since.get_or_insert(step) >= QUIET_STEPS {
            return since;
        }
    }
    None
}

/// The tracks of all drones from what they did step by step.
fn tracks(states: impl Iterator<Item = (usize, Vec<BulletState<f64>>)>) -> Vec<Track> {
    let mut tracks = Vec::new();
    for (step, drones) in states {
        tracks.resize(drones.len(), Track::new());
        for (track, BulletState { motion, .. }) in tracks.iter_mut().zip(drones) {
            track.insert(step, Passing { position: motion.position, velocity: motion.velocity });
        }
    }
    tracks
}

/// Flies the recorded rotor speeds among the boxes and above the floor.
fn flown(run: &Run, world: &World) -> Vec<Track> {
    let bullet = Bullet::new(&run.airframe, run.physics.mode(), Quirks::upstream());
    let arena = Arena::new(world, &run.airframe, ContactReport::Bullet);
    let solver = ContactSolver::new(&arena, world, &run.airframe);
    let (mut memory, mut drones, mut commands) = (ContactMemory::default(), run.start(), run.commands());
    let mut states = vec![(0, drones.clone())];
    for step in 0..run.last_step().min(run.steps) {
        let before: Vec<Motion> = drones.iter().map(|drone| motion(&drone.motion)).collect();
        advance(&bullet, &mut drones, commands.at(step), run.clock.step_secs);
        let free: Vec<Motion> = drones.iter().map(|drone| motion(&drone.motion)).collect();
        let mut after = free.clone();
        solver.resolve(&before, &mut after, &mut Vec::new(), &mut memory, run.clock.step_secs);
        for (drone, (after, free)) in drones.iter_mut().zip(after.iter().zip(&free)) {
            if after != free {
                move_to(&mut drone.motion, after);
            }
        }
        if run.record.contains_key(&(step + 1)) {
            states.push((step + 1, drones.clone()));
        }
    }
    tracks(states.into_iter())
}

fn motion(state: &State<f64>) -> Motion {
    let pose = Pose { position: state.position, world_from_body: state.world_from_body };
    Motion { velocity: state.velocity, body_rates: state.body_rates, ..Motion::at_rest(pose) }
}

fn move_to(state: &mut State<f64>, motion: &Motion) {
    state.position = motion.pose.position;
    state.world_from_body = motion.pose.world_from_body;
    state.velocity = motion.velocity;
    state.body_rates = motion.body_rates;
}

fn world(boxes: &[StaticBox]) -> World {
    let about = Attitude::from_axis_angle;
    let turned = |[roll, pitch, yaw]: [f64; 3]| {
        about(Vector3::z(), yaw).after(&about(Vector3::y(), pitch).after(&about(Vector3::x(), roll)))
    };
    let solid = |each: &StaticBox| Solid {
        shape: Shape::Cuboid(each.half_extents.into()),
        pose: Pose { position: each.position.into(), world_from_body: turned(each.rpy) },
        ..Solid::block("box", Vector3::zeros(), Vector3::zeros())
    };
    World { solids: boxes.iter().map(solid).collect(), ..World::empty() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Falls, is slower than [`REST`] for a moment, settles at step 40, and is kicked at the steps of `kicks`.
    fn settling(kicks: &[usize]) -> Track {
        let speed = |step: usize| match step {
            _ if kicks.contains(&step) => 0.02,
            0..10 => step as f64,
            10..40 if step == 30 => 0.009,
            10..40 => 0.5 * 0.88_f64.powi(step as i32 - 10),
            _ => 0.005,
        };
        let passing =
            |step| Passing { position: Vector3::zeros(), velocity: Vector3::new(0.0, 0.0, -speed(step)) };
        (0..200).map(|step| (step, passing(step))).collect()
    }

    #[test]
    fn a_kick_of_the_solver_does_not_wake_a_drone_that_rests() {
        let rest = |track: &Track| outcome(track, 10).unwrap().rest;
        assert_eq!(rest(&settling(&[])), Some(40));
        assert_eq!(rest(&settling(&[90, 91, 150, 198])), Some(40));
        assert_eq!(rest(&settling(&[60])), Some(61), "it was not at rest yet");
        let restless: Vec<usize> = (10..200).step_by(20).collect();
        assert_eq!(rest(&settling(&restless)), None);
    }
}
