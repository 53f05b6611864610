//! The world around the drone: floor, walls, goal, trail and shadow.

use kestrel_sim::scenario::Cuboid;
use kestrel_sim::world::Floor;
use nalgebra::Vector3;

use super::camera::Camera;
use super::canvas::{Canvas, Depth, Paint};
use super::playback::Moment;
use super::view::{Block, Circle, View};
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

/// Radius around the drone that no solid may hide \[m\].
const CLEAR_RADIUS: f32 = 0.3;

/// Distance from which the goal may not be hidden either \[m\].
const GOAL_IN_SIGHT: f32 = 1.0;

/// Opacity of solids beside the drone and of solids in front of it.
const OPACITY: [f32; 2] = [1.0, 0.1];

/// Share of the way to its new opacity that a solid goes from picture to picture.
const FADING: f32 = 0.15;

/// Pictures before it must be glass at which a solid begins to fade.
const FADE_AHEAD: usize = 14;

/// How long the trail takes to fade \[s\], and the share of its colour that stays.
const TRAIL_FADING: (f32, f32) = (2.5, 0.4);

/// What stays the same through the film.
pub(super) struct Scene<'a> {
    pub(super) recording: &'a FlightRecording,
    /// Positions of the drone, one per picture.
    trail: Vec<Vector3<f32>>,
    /// The part of the floor that is shown.
    floor: Cuboid,
}

/// What changes from picture to picture.
pub(super) struct Shot<'a> {
    pub(super) moment: &'a Moment,
    index: usize,
    camera: Camera,
    /// Opacity of each solid.
    pub(super) opacities: Vec<f32>,
}

impl<'a> Scene<'a> {
    pub(super) fn of(recording: &'a FlightRecording, moments: &[Moment]) -> Self {
        let trail: Vec<_> = moments.iter().map(|moment| moment.frame.position).collect();
        Self { recording, floor: shown_floor(recording, &trail), trail }
    }

    /// All pictures of the film.
    pub(super) fn shots<'m>(&self, moments: &'m [Moment]) -> Vec<Shot<'m>> {
        let cameras = tracking::cameras(self.recording, moments);
        let wanted: Vec<_> = cameras.iter().zip(moments).map(|(at, now)| self.wanted_opacities(at, now)).collect();
        let opacities = faded(&wanted);
        let shots = moments.iter().zip(cameras).zip(opacities).enumerate();
        shots.map(|(index, ((moment, camera), opacities))| Shot { moment, index, camera, opacities }).collect()
    }

    /// Draws everything but the captions: first what hides other things, then what lets them shine through.
    pub(super) fn draw(&self, shot: &Shot<'_>, canvas: &mut Canvas) {
        let mut view = View { camera: &shot.camera, canvas };
        self.draw_floor(&mut view);
        self.draw_solids(shot, &mut view, |opacity| opacity > 0.95);
        self.draw_shadows(shot, &mut view);
        self.draw_goal(&mut view);
        self.draw_trail(shot, &mut view);
        drone::draw(&shot.moment.frame, &self.recording.airframe, shot.index, &mut view);
        self.draw_solids(shot, &mut view, |opacity| opacity <= 0.95);
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

    /// Draws the solids whose opacity is `chosen`, the farthest first.
    fn draw_solids(&self, shot: &Shot<'_>, view: &mut View<'_>, chosen: impl Fn(f32) -> bool) {
        let distance = |block: &Block| (block.centre - shot.camera.position).norm();
        let blocks = self.recording.solids.iter().map(block_of).zip(shot.opacities.iter().copied());
        let mut blocks: Vec<_> = blocks.filter(|&(_, opacity)| chosen(opacity)).collect();
        blocks.sort_by(|(a, _), (b, _)| distance(b).total_cmp(&distance(a)));
        for (block, opacity) in blocks {
            draw_solid(&block, opacity, view);
        }
    }

    fn draw_shadows(&self, shot: &Shot<'_>, view: &mut View<'_>) {
        let frame = &shot.moment.frame;
        let ground = self.ground_below(frame.position) + SHADOW_HEIGHT;
        drone::draw_shadow(frame, &self.recording.airframe, ground, view);
        let foot = Vector3::new(frame.position.x, frame.position.y, ground);
        view.line([frame.position, foot], 1.0, Paint { colour: palette::MUTED, opacity: 0.35 }, Depth::Tested);
    }

    fn draw_goal(&self, view: &mut View<'_>) {
        let goal = self.recording.goal;
        let foot = Vector3::new(goal.x, goal.y, self.ground_below(goal) + SHADOW_HEIGHT);
        let pale = Paint { colour: palette::GOAL, opacity: 0.5 };
        view.ring(&Circle::level(foot, GOAL_RADIUS), 1.2, pale, Depth::Tested);
        view.line([goal, foot], 1.0, pale, Depth::Tested);
        view.ball(goal, GOAL_RADIUS, Paint { colour: palette::GOAL, opacity: 0.25 }, Depth::Tested);
        let ring = Circle::level(goal, GOAL_RADIUS);
        view.ring(&ring, 1.5, Paint::opaque(palette::GOAL), Depth::Tested);
        view.ball(goal, 0.2 * GOAL_RADIUS, Paint::opaque(palette::GOAL), Depth::Tested);
    }

    fn draw_trail(&self, shot: &Shot<'_>, view: &mut View<'_>) {
        let (secs, rest) = TRAIL_FADING;
        for (index, ends) in self.trail[..=shot.index].windows(2).enumerate() {
            let age_secs = (shot.index - index) as f32 * super::playback::PICTURE_SECS;
            let strength = (1.0 - age_secs / secs).max(rest);
            let paint = Paint::opaque(palette::mix(palette::FLOOR, palette::TRAIL, strength));
            view.line([ends[0], ends[1]], 2.0, paint, Depth::Tested);
        }
    }

    /// Height of the floor, or of the highest solid under a point \[m\].
    fn ground_below(&self, point: Vector3<f32>) -> f32 {
        let under = |solid: &&Cuboid| {
            let inside = |axis: usize| (solid.low[axis]..=solid.high[axis]).contains(&point[axis]);
            inside(0) && inside(1) && solid.high.z <= point.z
        };
        let heights = self.recording.solids.iter().filter(under).map(|solid| solid.high.z);
        heights.fold(self.floor.low.z, f32::max)
    }

    /// Solids between the camera and the drone or the goal become glass.
    fn wanted_opacities(&self, camera: &Camera, moment: &Moment) -> Vec<f32> {
        let position = moment.frame.position;
        let mut watched = Vec::from(camera.around(position, CLEAR_RADIUS));
        watched.push(position);
        if moment.distance < GOAL_IN_SIGHT {
            watched.push(self.recording.goal);
        }
        // The camera looks down, so what ends below drone and goal hides neither, whatever it hides of the ring.
        let lowest = position.z.min(self.recording.goal.z);
        let hides = |solid: &Cuboid| {
            let crossed = |&watched: &Vector3<f32>| is_crossed(solid, camera.position, watched);
            solid.high.z > lowest && watched.iter().any(crossed)
        };
        self.recording.solids.iter().map(|solid| OPACITY[usize::from(hides(solid))]).collect()
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

fn draw_solid(block: &Block, opacity: f32, view: &mut View<'_>) {
    let depth = if opacity > 0.95 { Depth::Solid } else { Depth::Tested };
    for (axis, face) in block.faces_towards(view.camera.position) {
        view.fill(&face, Paint { colour: palette::FACES[axis], opacity }, depth);
    }
    let edge = Paint { colour: palette::EDGE, opacity: 0.4 + 0.3 * opacity };
    for ends in block.edges() {
        view.line(ends, 1.0, edge, Depth::Tested);
    }
}

fn block_of(solid: &Cuboid) -> Block {
    let half = (solid.high - solid.low) * 0.5;
    let halves = [Vector3::x() * half.x, Vector3::y() * half.y, Vector3::z() * half.z];
    Block { centre: solid.low + half, halves }
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

/// The floor under flight, goal and solids, to whole cells of the grid.
fn shown_floor(recording: &FlightRecording, trail: &[Vector3<f32>]) -> Cuboid {
    let flown = trail.iter().chain([&recording.goal]).copied();
    let (mut low, mut high) = bounds(flown);
    let height = match recording.floor {
        Floor::Solid => 0.0,
        Floor::Absent => low.z - PLANE_DEPTH,
    };
    low.add_scalar_mut(-FLOOR_MARGIN);
    high.add_scalar_mut(FLOOR_MARGIN);
    let corners = recording.solids.iter().flat_map(|solid| [solid.low, solid.high]);
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
