//! The world around the drones: floor, walls, goals, trails and shadows.

use std::borrow::Cow;

use kestrel_sim::outline::Outline;
use kestrel_sim::world::{Cuboid, Floor};
use nalgebra::Vector3;

use super::camera::Camera;
use super::canvas::{Canvas, Depth, Paint};
use super::playback::{DroneMoment, Moment};
use super::view::{Circle, View};
use super::{FlightRecording, drone, palette, tracking};

/// Distance between lines on the floor \[m\].
const GRID_SPACING: f32 = 0.5;

/// Floor shown around the flight \[m\].
const FLOOR_MARGIN: f32 = 2.0;

/// Depth below the flight of the plane that gives orientation where there is no floor \[m\].
const PLANE_DEPTH: f32 = 0.4;

/// Height of shadows over what they fall on \[m\], so that they are seen.
const SHADOW_HEIGHT: f32 = 0.003;

/// Radius of the goal's ball \[m\].
const GOAL_RADIUS: f32 = 0.05;

/// Radius around a drone that no solid may hide \[m\].
const CLEAR_RADIUS: f32 = 0.3;

/// Distance from which the goal may not be hidden either \[m\].
const GOAL_IN_SIGHT: f32 = 1.0;

/// Opacity of solids beside the drones and of solids in front of one.
const OPACITY: [f32; 2] = [1.0, 0.1];

/// How often opaque faces are painted: where two of them meet, one coat lets a thin line shine through.
const COATS: usize = 2;

/// Share of the way to its new opacity that a solid goes from picture to picture.
const FADING: f32 = 0.15;

/// Pictures before it must be glass at which a solid begins to fade.
const FADE_AHEAD: usize = 14;

/// How long the trail takes to fade \[s\], and the share of its colour that stays.
const TRAIL_FADING: (f32, f32) = (2.5, 0.4);

/// Drones that are smaller in the picture get a spot of their trail's colour, where there are several \[px\].
const SPOT: f32 = 3.5;

/// What stays the same through the film.
pub(super) struct Scene<'a> {
    pub(super) recording: &'a FlightRecording,
    /// Positions of each drone, one per picture.
    trails: Vec<Vec<Vector3<f32>>>,
    /// Different goals.
    goals: Vec<Vector3<f32>>,
    /// The part of the floor that is shown.
    floor: Cuboid,
}

/// What changes from picture to picture.
pub(super) struct Shot<'a> {
    pub(super) moment: &'a Moment,
    index: usize,
    camera: Camera,
    /// Everything that stands or moves, with its opacity.
    pub(super) solids: Vec<Placed<'a>>,
}

/// A solid in one picture.
pub(super) struct Placed<'a> {
    outline: Cow<'a, Outline>,
    bounds: Cuboid,
    pub(super) opacity: f32,
}

impl<'a> Scene<'a> {
    pub(super) fn of(recording: &'a FlightRecording, moments: &[Moment]) -> Self {
        let position = |drone: usize| move |moment: &Moment| moment.drones[drone].frame.placement.position;
        let trail = |drone| moments.iter().map(position(drone)).collect();
        let trails: Vec<Vec<_>> = (0..recording.drones.len()).map(trail).collect();
        let mut goals: Vec<Vector3<f32>> = Vec::new();
        for flight in &recording.drones {
            if !goals.contains(&flight.goal) {
                goals.push(flight.goal);
            }
        }
        Self { recording, floor: shown_floor(recording, &trails), trails, goals }
    }

    /// All pictures of the film.
    pub(super) fn shots<'m>(&self, moments: &'m [Moment]) -> Vec<Shot<'m>>
    where
        'a: 'm,
    {
        let cameras = tracking::cameras(self.recording, moments);
        let mut solids: Vec<_> = moments.iter().map(|moment| self.solids(moment)).collect();
        let pictures = cameras.iter().zip(moments).zip(&solids);
        let wanted: Vec<_> = pictures.map(|((at, now), solids)| self.wanted_opacities(at, now, solids)).collect();
        for (solids, opacities) in solids.iter_mut().zip(faded(&wanted)) {
            solids.iter_mut().zip(opacities).for_each(|(solid, opacity)| solid.opacity = opacity);
        }
        let shots = moments.iter().zip(cameras).zip(solids).enumerate();
        shots.map(|(index, ((moment, camera), solids))| Shot { moment, index, camera, solids }).collect()
    }

    /// Everything that stands, then everything that moves, where it is at the moment.
    fn solids(&self, moment: &Moment) -> Vec<Placed<'a>> {
        let standing = self.recording.solids.iter().map(Cow::Borrowed);
        let moving = self.recording.movables.iter().zip(&moment.movables);
        let moving = moving.map(|(solid, at)| Cow::Owned(solid.outline.moved(at.position, &at.attitude)));
        let placed = |outline: Cow<'a, Outline>| {
            let (low, high) = outline.bounds();
            Placed { outline, bounds: Cuboid { low, high }, opacity: OPACITY[0] }
        };
        standing.chain(moving).map(placed).collect()
    }

    /// Draws everything but the captions: first what hides other things, then what lets them shine through.
    pub(super) fn draw(&self, shot: &Shot<'_>, canvas: &mut Canvas) {
        let mut view = View { camera: &shot.camera, canvas };
        self.draw_floor(&mut view);
        draw_solids(&shot.solids, &mut view, |opacity| opacity > 0.95);
        for drone in &shot.moment.drones {
            self.draw_shadow(shot, drone, &mut view);
        }
        for &goal in &self.goals {
            self.draw_goal(shot, goal, &mut view);
        }
        for (index, trail) in self.trails.iter().enumerate() {
            draw_trail(&trail[..=shot.index], palette::trail(index), &mut view);
        }
        self.draw_drones(shot, &mut view);
        draw_solids(&shot.solids, &mut view, |opacity| opacity <= 0.95);
    }

    /// Draws the farthest drone first: rotors are glass.
    fn draw_drones(&self, shot: &Shot<'_>, view: &mut View<'_>) {
        let eye = shot.camera.position;
        let distance = |drone: &DroneMoment| (drone.frame.placement.position - eye).norm();
        let mut drones: Vec<_> = shot.moment.drones.iter().enumerate().collect();
        drones.sort_by(|(_, a), (_, b)| distance(b).total_cmp(&distance(a)));
        let airframe = &self.recording.airframe;
        for (index, now) in drones {
            drone::draw(&now.frame, airframe, now.flown, view);
            let position = now.frame.placement.position;
            let per_metre = shot.camera.pixels_per_metre(position);
            if self.trails.len() > 1 && airframe.arm as f32 * per_metre < 2.0 * SPOT {
                view.ball(position, SPOT / per_metre, Paint::opaque(palette::trail(index)), Depth::Tested);
            }
        }
    }

    fn draw_floor(&self, view: &mut View<'_>) {
        let Cuboid { low, high } = self.floor;
        let corner = |x, y| Vector3::new(x, y, low.z);
        let corners = [corner(low.x, low.y), corner(high.x, low.y), corner(high.x, high.y), corner(low.x, high.y)];
        view.fill(&corners, Paint::opaque(palette::FLOOR), Depth::Above);
        let line = Paint::opaque(palette::GRID);
        for x in grid_lines(low.x, high.x) {
            view.line([corner(x, low.y), corner(x, high.y)], 1.0, line, Depth::Above);
        }
        for y in grid_lines(low.y, high.y) {
            view.line([corner(low.x, y), corner(high.x, y)], 1.0, line, Depth::Above);
        }
    }

    fn draw_shadow(&self, shot: &Shot<'_>, drone: &DroneMoment, view: &mut View<'_>) {
        let position = drone.frame.placement.position;
        let ground = self.ground_below(shot, position) + SHADOW_HEIGHT;
        drone::draw_shadow(&drone.frame, &self.recording.airframe, ground, view);
        let foot = Vector3::new(position.x, position.y, ground);
        view.line([position, foot], 1.0, Paint { colour: palette::MUTED, opacity: 0.35 }, Depth::Tested);
    }

    fn draw_goal(&self, shot: &Shot<'_>, goal: Vector3<f32>, view: &mut View<'_>) {
        let foot = Vector3::new(goal.x, goal.y, self.ground_below(shot, goal) + SHADOW_HEIGHT);
        let pale = Paint { colour: palette::GOAL, opacity: 0.5 };
        view.ring(&Circle::level(foot, GOAL_RADIUS), 1.2, pale, Depth::Tested);
        view.line([goal, foot], 1.0, pale, Depth::Tested);
        view.ball(goal, GOAL_RADIUS, Paint { colour: palette::GOAL, opacity: 0.25 }, Depth::Tested);
        let ring = Circle::level(goal, GOAL_RADIUS);
        view.ring(&ring, 1.5, Paint::opaque(palette::GOAL), Depth::Tested);
        view.ball(goal, 0.2 * GOAL_RADIUS, Paint::opaque(palette::GOAL), Depth::Tested);
    }

    /// Height of the floor, or of the highest solid under a point \[m\].
    fn ground_below(&self, shot: &Shot<'_>, point: Vector3<f32>) -> f32 {
        let under = |solid: &&Cuboid| {
            let inside = |axis: usize| (solid.low[axis]..=solid.high[axis]).contains(&point[axis]);
            inside(0) && inside(1) && solid.high.z <= point.z
        };
        let bounds = shot.solids.iter().map(|solid| &solid.bounds);
        bounds.filter(under).map(|solid| solid.high.z).fold(self.floor.low.z, f32::max)
    }

    /// Solids between the camera and a drone or its goal become glass.
    fn wanted_opacities(&self, camera: &Camera, moment: &Moment, solids: &[Placed<'_>]) -> Vec<f32> {
        let seen: Vec<_> = moment
            .drones
            .iter()
            .zip(&self.recording.drones)
            .map(|(now, flight)| seen(camera, now, flight.goal))
            .collect();
        let hides = |solid: &Cuboid| seen.iter().any(|seen| seen.is_hidden_by(solid, camera));
        solids.iter().map(|solid| OPACITY[usize::from(hides(&solid.bounds))]).collect()
    }
}

/// What must be seen of one drone.
struct Seen {
    points: Vec<Vector3<f32>>,
    /// Height of the lower of drone and goal \[m\].
    lowest: f32,
}

fn seen(camera: &Camera, now: &DroneMoment, goal: Vector3<f32>) -> Seen {
    let position = now.frame.placement.position;
    let mut points = Vec::from(camera.around(position, CLEAR_RADIUS));
    points.push(position);
    if now.distance < GOAL_IN_SIGHT {
        points.push(goal);
    }
    Seen { points, lowest: position.z.min(goal.z) }
}

impl Seen {
    fn is_hidden_by(&self, solid: &Cuboid, camera: &Camera) -> bool {
        let crossed = |&point: &Vector3<f32>| is_crossed(solid, camera.position, point);
        // The camera looks down, so what ends below drone and goal hides neither, whatever it hides of the ring.
        solid.high.z > self.lowest && self.points.iter().any(crossed)
    }
}

/// Draws where a drone has been, one point per picture, the last of them now.
fn draw_trail(trail: &[Vector3<f32>], colour: palette::Colour, view: &mut View<'_>) {
    let (secs, rest) = TRAIL_FADING;
    for (index, ends) in trail.windows(2).enumerate() {
        let age_secs = (trail.len() - 1 - index) as f32 * super::playback::PICTURE_SECS;
        let strength = (1.0 - age_secs / secs).max(rest);
        let paint = Paint::opaque(palette::mix(palette::FLOOR, colour, strength));
        view.line([ends[0], ends[1]], 2.0, paint, Depth::Tested);
    }
}

/// Opacities that change gently, and early enough: a solid is glass by the time at which it must be.
fn faded(wanted: &[Vec<f32>]) -> Vec<Vec<f32>> {
    let least = |now: usize, solid: usize| {
        let soon = wanted[now..].iter().take(FADE_AHEAD);
        soon.map(|opacities| opacities[solid]).fold(f32::INFINITY, f32::min)
    };
    let mut opacities: Vec<f32> = wanted.first().cloned().unwrap_or_default();
    let mut fade = |now: usize| {
        for (solid, opacity) in opacities.iter_mut().enumerate() {
            *opacity += FADING * (least(now, solid) - *opacity);
        }
        opacities.clone()
    };
    (0..wanted.len()).map(&mut fade).collect()
}

/// Draws the solids whose opacity is `chosen`, the farthest first.
fn draw_solids(solids: &[Placed<'_>], view: &mut View<'_>, chosen: impl Fn(f32) -> bool) {
    let eye = view.camera.position;
    let distance = |solid: &Placed<'_>| (middle(&solid.bounds) - eye).norm();
    let mut solids: Vec<_> = solids.iter().filter(|solid| chosen(solid.opacity)).collect();
    solids.sort_by(|a, b| distance(b).total_cmp(&distance(a)));
    for solid in solids {
        draw_solid(solid, view);
    }
}

fn draw_solid(solid: &Placed<'_>, view: &mut View<'_>) {
    let opacity = solid.opacity;
    let (depth, coats) = if opacity > 0.95 { (Depth::Solid, COATS) } else { (Depth::Tested, 1) };
    for face in (0..coats).flat_map(|_| &solid.outline.faces) {
        let normal = (face[1] - face[0]).cross(&(face[2] - face[0]));
        if normal.dot(&(view.camera.position - face[0])) > 0.0 {
            view.fill(face, Paint { colour: palette::FACES[normal.iamax()], opacity }, depth);
        }
    }
    let edge = Paint { colour: palette::EDGE, opacity: 0.4 + 0.3 * opacity };
    for ends in &solid.outline.edges {
        view.line(*ends, 1.0, edge, Depth::Tested);
    }
}

fn middle(cuboid: &Cuboid) -> Vector3<f32> {
    cuboid.low + (cuboid.high - cuboid.low) * 0.5
}

/// Whether the straight line between two points meets the solid.
fn is_crossed(solid: &Cuboid, from: Vector3<f32>, to: Vector3<f32>) -> bool {
    let (mut enter, mut leave) = (0.0_f32, 1.0_f32);
    for axis in 0..3 {
        let way = to[axis] - from[axis];
        let bounds = [solid.low[axis], solid.high[axis]].map(|bound| (bound - from[axis]) / way);
        // A line parallel to the bounds divides by zero: infinities then say outside or between.
        enter = enter.max(bounds[0].min(bounds[1]));
        leave = leave.min(bounds[0].max(bounds[1]));
    }
    enter < leave
}

/// The floor under flights, goals and solids, to whole cells of the grid.
fn shown_floor(recording: &FlightRecording, trails: &[Vec<Vector3<f32>>]) -> Cuboid {
    let goals = recording.drones.iter().map(|flight| &flight.goal);
    let flown = trails.iter().flatten().chain(goals).copied();
    let (mut low, mut high) = bounds(flown);
    let height = match recording.floor {
        Floor::Solid => 0.0,
        Floor::Absent => low.z - PLANE_DEPTH,
    };
    low.add_scalar_mut(-FLOOR_MARGIN);
    high.add_scalar_mut(FLOOR_MARGIN);
    let corners = recording.solids.iter().flat_map(|solid| <[_; 2]>::from(solid.bounds()));
    let (low, high) = bounds(corners.chain([low, high]));
    let cells = |metres: f32| metres / GRID_SPACING;
    Cuboid {
        low: Vector3::new(cells(low.x).floor() * GRID_SPACING, cells(low.y).floor() * GRID_SPACING, height),
        high: Vector3::new(cells(high.x).ceil() * GRID_SPACING, cells(high.y).ceil() * GRID_SPACING, height),
    }
}

fn bounds(points: impl Iterator<Item = Vector3<f32>>) -> (Vector3<f32>, Vector3<f32>) {
    let none = (Vector3::repeat(f32::INFINITY), Vector3::repeat(f32::NEG_INFINITY));
    points.fold(none, |(low, high), point| (low.inf(&point), high.sup(&point)))
}

fn grid_lines(low: f32, high: f32) -> impl Iterator<Item = f32> {
    (0..=((high - low) / GRID_SPACING).round() as usize).map(move |line| low + line as f32 * GRID_SPACING)
}
