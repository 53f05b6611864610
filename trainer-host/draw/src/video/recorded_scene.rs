//! A recorded flight and the world in which it is looked at.

use kestrel_core::attitude::Attitude;
use kestrel_sim::camera::{Camera, Image, Mover, Scene, View};
use kestrel_sim::scenario::Scenario;
use kestrel_sim::world::{Floor, Pose, Role, Shape, Solid, World};
use nalgebra::{Matrix, Vector3};

use super::chase::on_board;
use super::{DepthScale, VideoError, camera, sampled, shadow};
use crate::recorded_flight::{DroneFlight, FlightRecording, Frame, Placement};
use crate::video::playback::{Moment, PICTURE_SECS, moment, moments};

/// A goal for the eyes of people: a ball on a pole, and how far below the goal it ends \[m\].
const BALL_RADIUS: f64 = 0.012;
const POLE_RADIUS: f64 = 0.004;
const BELOW_GOAL: f64 = 0.06;
const GOAL_COLOUR: [f32; 3] = [0.53, 0.26, 0.84];

/// Length of the pole where there is no floor \[m\].
const POLE: f64 = 0.5;

/// A recorded flight with everything that cameras and captions need.
#[derive(Clone, Debug)]
pub struct RecordedScene {
    pub(crate) flight: FlightRecording,
    /// Length of the airframe's arms \[m\].
    pub(crate) arm_m: f64,
    /// The world as the drones see it.
    seen: Scene,
    /// The world as people see it, with the goals.
    shown: Scene,
    /// 25 a second.
    moments: Vec<Moment>,
    verdicts: Vec<Verdict>,
    /// What was before, and is forgotten \[s\].
    forgotten_secs: f32,
}

/// What came of a drone's flight.
#[derive(Clone, Debug)]
struct Verdict {
    /// Sum of the rewards before each step, and of all.
    returns: Vec<f64>,
    ending: String,
    success: bool,
}

/// What is written beside a picture of a flight.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Caption {
    /// Since the start \[s\].
    pub(crate) secs: f32,
    /// Sum of the rewards so far, where there are any.
    pub(crate) episode_return: Option<f64>,
    /// To the goal \[m\], if there is one.
    pub(crate) distance: Option<f32>,
    /// \[m/s\].
    pub(crate) speed: f32,
    /// How it ended, as in reports, and whether that was a success; nothing while it flies.
    pub(crate) ending: Option<(String, bool)>,
}

impl RecordedScene {
    /// Prepares a flight through the scenario's world for cameras; `name` is what messages call it.
    ///
    /// # Errors
    /// When it holds numbers that are none.
    pub fn new(flight: FlightRecording, scenario: &Scenario, name: &str) -> Result<Self, VideoError> {
        flight.check()?;
        check(&flight, name)?;
        let Scenario { aviary, airframe, .. } = scenario;
        let world = &aviary.world;
        let scene = |world: &World| Scene::new(world).with_drones(airframe, flight.drones.len());
        let goals = flight.drones.iter().filter_map(|drone| drone.goal).map(Matrix::cast);
        Ok(Self {
            seen: scene(world),
            shown: scene(&with_goals(world, goals)),
            moments: moments(&flight, 0).collect(),
            verdicts: flight.drones.iter().map(Verdict::of).collect(),
            arm_m: airframe.arm,
            forgotten_secs: 0.0,
            flight,
        })
    }

    /// Adds a control period of a flight that goes on, and forgets its beginning when it becomes long; says how many pictures
    /// are forgotten.
    ///
    /// # Errors
    /// When a drone is where no camera can follow; `name` is what messages call the flight.
    pub fn push(&mut self, frame: Frame, name: &str) -> Result<usize, VideoError> {
        let index = self.flight.periods() + 1;
        frame
            .drones
            .iter()
            .enumerate()
            .try_for_each(|(drone, placement)| check_placed(placement, name, [drone, index]))?;
        for (verdict, reward) in self.verdicts.iter_mut().zip(&frame.rewards) {
            verdict.pay(*reward);
        }
        self.flight.push(frame);
        let forgotten = if self.moments.len() > REMEMBERED { self.forget() } else { 0 };
        self.moments.extend(moments(&self.flight, self.moments.len()));
        Ok(forgotten)
    }

    /// Says how a drone's flight ended, and whether that was a success.
    pub fn end(&mut self, drone: usize, ending: &str, success: bool) {
        if let Some(verdict) = self.verdicts.get_mut(drone) {
            (verdict.ending, verdict.success) = (ending.to_owned(), success);
        }
    }

    /// Forgets half of what is remembered, as far as control periods and pictures begin together.
    fn forget(&mut self) -> usize {
        let secs = (0.5 * REMEMBERED as f32 * PICTURE_SECS).floor();
        let [periods, pictures] =
            [self.flight.control_secs, PICTURE_SECS].map(|length| (secs / length).round() as usize);
        self.flight.forget(periods);
        self.moments.drain(..pictures);
        for moment in &mut self.moments {
            moment.elapsed_secs -= secs;
        }
        self.forgotten_secs += secs;
        pictures
    }

    /// How many drones fly.
    pub fn drones(&self) -> usize {
        self.flight.drones.len()
    }

    /// How long the flight is \[s\].
    pub fn secs(&self) -> f32 {
        self.flight.periods() as f32 * self.flight.control_secs
    }

    /// The flight 25 times a second.
    pub(crate) fn moments(&self) -> &[Moment] {
        &self.moments
    }

    /// The flight at any time since its start \[s\].
    pub(crate) fn moment(&self, secs: f32) -> Moment {
        moment(&self.flight, secs)
    }

    /// What people see at a moment: everything, and the goals.
    pub(crate) fn shown(&self, moment: &Moment) -> Scene {
        placed(&self.shown, moment)
    }

    /// The image of what people see at a moment, with shadows under the drones.
    pub(crate) fn shaded(&self, mut image: Image, camera: &Camera, view: &View, moment: &Moment) -> Image {
        let drones = moment.drones.iter().map(|drone| drone.placement.position.cast());
        shadow::cast(&mut image, camera, view, drones, self.arm_m);
        image
    }

    /// What the camera of a drone sees at a moment: everything but that drone.
    pub(crate) fn seen(&self, moment: &Moment, drone: usize) -> Scene {
        let mut scene = placed(&self.seen, moment);
        scene.hide(Mover::Drone(drone));
        scene
    }

    /// What the camera of a drone sees at a time since the start \[s\], and from where, in an image of so many columns and rows
    /// with an angle of view across \[rad\].
    ///
    /// # Panics
    /// When there is no such drone.
    pub fn on_board(&self, drone: usize, secs: f32, size: [usize; 2], view_angle: f64) -> (View, Image) {
        let moment = self.moment(secs.clamp(0.0, self.secs()));
        let view = on_board(self, &moment.drones[drone].placement);
        let image = self.seen(&moment, drone).render(&camera(size, view_angle), &view);
        (view, image)
    }

    /// The world without drones, where movables start.
    pub(crate) fn still(&self) -> &Scene {
        &self.seen
    }

    /// A scale for all that a drone's camera sees during the flight.
    pub(crate) fn depth_scale(&self, drone: usize, view_angle: f64) -> DepthScale {
        let images: Vec<Image> = sampled(self.moments.len())
            .map(|index| {
                let secs = self.moments[index].elapsed_secs;
                self.on_board(drone, secs, [64, 48], view_angle).1
            })
            .collect();
        DepthScale::of(&images)
    }

    pub(crate) fn caption(&self, moment: &Moment, drone: usize) -> Caption {
        let Verdict { returns, ending, success } = &self.verdicts[drone];
        let now = moment.drones[drone];
        // A hundredth of a step is the rounding of a time.
        let steps = ((moment.elapsed_secs + self.forgotten_secs) / self.flight.control_secs + 0.01) as usize;
        let last = returns.len() - 1;
        let end_secs = (self.flight.drones[drone].frames.len() - 1) as f32 * self.flight.control_secs;
        // The next picture would come after the end.
        let has_ended = moment.elapsed_secs + PICTURE_SECS > end_secs + 1e-4;
        Caption {
            secs: moment.elapsed_secs + self.forgotten_secs,
            episode_return: (last > 0).then(|| returns[if has_ended { last } else { steps.min(last) }]),
            distance: now.distance,
            speed: now.speed,
            ending: (has_ended && !ending.is_empty()).then(|| (ending.clone(), *success)),
        }
    }
}

/// Farthest that a drone may be from the origin \[m\], and how far from one the length of its quaternion.
const FARTHEST: f32 = 1e5;
const LENGTH_TOLERANCE: f32 = 0.1;

/// Pictures of a flight that goes on that are remembered at most: ten minutes.
const REMEMBERED: usize = 15_000;

/// Refuses what no camera can follow.
fn check(flight: &FlightRecording, name: &str) -> Result<(), VideoError> {
    let tracks = flight.drones.iter().enumerate();
    let mut placed = tracks.flat_map(|(drone, track)| track.frames.iter().enumerate().map(move |at| (drone, at)));
    placed.try_for_each(|(drone, (frame, placement))| check_placed(placement, name, [drone, frame]))
}

fn check_placed(placed: &Placement, name: &str, [drone, frame]: [usize; 2]) -> Result<(), VideoError> {
    let Attitude { w, x, y, z } = placed.attitude;
    let (metres, length) = (placed.position.norm(), (w * w + x * x + y * y + z * z).sqrt());
    if metres <= FARTHEST && (length - 1.0).abs() <= LENGTH_TOLERANCE {
        return Ok(());
    }
    Err(VideoError::Lost { name: name.to_owned(), drone, frame, metres, length })
}

impl Verdict {
    fn of(drone: &DroneFlight) -> Self {
        let mut verdict = Self { returns: vec![0.0], ending: drone.ending.clone(), success: drone.success };
        drone.rewards.iter().for_each(|reward| verdict.pay(*reward));
        verdict
    }

    fn pay(&mut self, reward: f64) {
        self.returns.push(self.returns.last().unwrap_or(&0.0) + reward);
    }
}

/// The same scene with everything where it is at a moment.
fn placed(scene: &Scene, moment: &Moment) -> Scene {
    let mut scene = scene.clone();
    for (index, drone) in moment.drones.iter().enumerate() {
        scene.place(Mover::Drone(index), &drone.placement.pose());
    }
    for (index, placement) in moment.movables.iter().enumerate() {
        scene.place(Mover::Movable(index), &placement.pose());
    }
    scene
}

/// The world with a ball on a pole below each goal, so that a drone at its goal can be seen.
pub(crate) fn with_goals(world: &World, goals: impl Iterator<Item = Vector3<f64>>) -> World {
    let mut world = world.clone();
    for goal in goals {
        let top = goal - BELOW_GOAL * Vector3::z();
        let foot = match world.floor {
            Floor::Solid => top.z.min(0.0),
            Floor::Absent => top.z - POLE,
        };
        let half_height = 0.5 * (top.z - foot).max(POLE_RADIUS);
        let pole = Shape::Cylinder { radius: POLE_RADIUS, half_height };
        world.solids.push(mark(pole, top - half_height * Vector3::z()));
        world.solids.push(mark(Shape::Sphere(BALL_RADIUS), top));
    }
    world
}

fn mark(shape: Shape, position: Vector3<f64>) -> Solid {
    let at = Pose::at(position);
    Solid {
        name: "goal".to_owned(),
        shape,
        pose: at,
        role: Role::Decoration,
        friction: 0.0,
        contact_gap: 0.0,
        colour: GOAL_COLOUR,
        visual: None,
    }
}
