//! The two views of an aviary and what is written beside them.

use kestrel_sim::world::{Floor, Role, Solid};
use nalgebra::Vector3;

use super::outline::{Direction, outline};
use super::subject::{Subject, short};
use super::{INK, MUTED};
use crate::drawing::{Anchor, Colour, Drawing, Pen, Text};

/// Greatest scale \[px/m\]: an empty aviary needs no more.
const SCALE_LIMIT: f64 = 240.0;

/// Between the two views \[px\]: numbers of the upper one's axis, then the lower one's dimension.
const GAP: f64 = 78.0;

/// A solid that covers this share of the side view is a wall in front of everything: only its edge is drawn.
const CURTAIN: f64 = 0.56;

const START: Colour = Colour([0x2f, 0x6f, 0xde]);
const GOAL: Colour = Colour([0xc4, 0x2a, 0x8b]);
const LANDING: Colour = Colour([0x12, 0x9a, 0x74]);
const GRID: Colour = Colour([0xe4, 0xe8, 0xee]);
const PAPER: Colour = Colour([0xff, 0xff, 0xff]);

/// How much is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Detail {
    /// Axes, dimensions and names.
    Full,
    /// Nothing: a small picture among many.
    Sheet,
}

/// Both views at one scale.
#[derive(Clone, Copy, Debug)]
pub(super) struct Views {
    low: Vector3<f64>,
    high: Vector3<f64>,
    /// \[px/m\].
    scale: f64,
}

/// One view at its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    direction: Direction,
    /// Lowest and highest coordinates in the view \[m\].
    low: [f64; 2],
    high: [f64; 2],
    /// Its upper left corner \[px\].
    corner: [f64; 2],
    /// \[px/m\].
    scale: f64,
}

impl Views {
    /// As large as `[width, height]` \[px\] allow for the view from above.
    pub(super) fn fitting(subject: &Subject, [width, height]: [f64; 2]) -> Self {
        let (low, high) = subject.extent();
        let size = high - low;
        Self { low, high, scale: (width / size.x).min(height / size.y).min(SCALE_LIMIT) }
    }

    pub(super) fn scale(&self) -> f64 {
        self.scale
    }

    /// Width \[px\].
    pub(super) fn width(&self) -> f64 {
        self.scale * (self.high.x - self.low.x)
    }

    /// From the front to the back of the view from above \[px\].
    pub(super) fn depth(&self) -> f64 {
        self.scale * (self.high.y - self.low.y)
    }

    /// Draws both views, one below the other; returns where they end \[px\].
    pub(super) fn draw(&self, drawing: &mut Drawing, subject: &Subject, corner: [f64; 2], detail: Detail) -> f64 {
        let gap = if detail == Detail::Full { GAP } else { 8.0 };
        let above = self.frame(Direction::Above, corner);
        let side = self.frame(Direction::Side, [corner[0], above.bottom() + gap]);
        for frame in [above, side] {
            frame.draw(drawing, subject, detail);
        }
        side.bottom() + if detail == Detail::Full { 24.0 } else { 0.0 }
    }

    pub(super) fn frame(&self, direction: Direction, corner: [f64; 2]) -> Frame {
        let (low, high) = (direction.project(self.low), direction.project(self.high));
        Frame { direction, low, high, corner, scale: self.scale }
    }
}

impl Frame {
    fn size(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.scale * (self.high[axis] - self.low[axis]))
    }

    fn bottom(&self) -> f64 {
        self.corner[1] + self.size()[1]
    }

    /// Where a point of the view \[m\] is on paper \[px\].
    pub(super) fn place(&self, [across, up]: [f64; 2]) -> [f64; 2] {
        [self.corner[0] + self.scale * (across - self.low[0]), self.corner[1] + self.scale * (self.high[1] - up)]
    }

    pub(super) fn draw(&self, drawing: &mut Drawing, subject: &Subject, detail: Detail) {
        self.draw_grid(drawing, detail);
        self.draw_solids(drawing, subject);
        if self.direction == Direction::Side && subject.world.floor == Floor::Solid {
            let ends = [[self.low[0], 0.0], [self.high[0], 0.0]].map(|end| self.place(end));
            drawing.line(ends, Pen::solid(INK, 1.5));
        }
        if detail == Detail::Full {
            self.draw_dimensions(drawing, subject);
            if self.direction == Direction::Above {
                self.draw_names(drawing, subject);
            }
        }
        self.draw_points(drawing, subject, if detail == Detail::Full { 1.0 } else { 0.55 });
    }

    /// A line for every metre, with its number where there is room.
    fn draw_grid(&self, drawing: &mut Drawing, detail: Detail) {
        let [left, top] = self.corner;
        let [width, height] = self.size();
        let step = if self.scale < 45.0 { 2.0 } else { 1.0 };
        let values = |axis: usize| {
            let (from, to) = ((self.low[axis] / step).ceil() as i64, (self.high[axis] / step).floor() as i64);
            (from..=to).map(move |line| line as f64 * step)
        };
        let number = |at: [f64; 2], value: f64, anchor: Anchor| Text {
            at,
            words: short(value),
            size: 13.0,
            colour: MUTED,
            anchor,
        };
        for x in values(0) {
            let at = self.place([x, 0.0])[0];
            drawing.line([[at, top], [at, top + height]], Pen::solid(GRID, 1.0));
            if detail == Detail::Full {
                drawing.text(number([at, top + height + 18.0], x, Anchor::Middle));
            }
        }
        for up in values(1) {
            let at = self.place([0.0, up])[1];
            drawing.line([[left, at], [left + width, at]], Pen::solid(GRID, 1.0));
            if detail == Detail::Full {
                drawing.text(number([left - 10.0, at + 4.5], up, Anchor::End));
            }
        }
        if detail == Detail::Full {
            let vertical = if self.direction == Direction::Above { "y [m]" } else { "z [m]" };
            let label = |at: [f64; 2], words: &str, anchor| Text {
                at,
                words: words.to_owned(),
                size: 13.0,
                colour: INK,
                anchor,
            };
            drawing.text(label([left - 44.0, top + 4.5], vertical, Anchor::Middle));
            drawing.text(label([left + width + 10.0, top + height + 18.0], "x [m]", Anchor::Start));
        }
    }

    /// The farthest first.
    fn draw_solids(&self, drawing: &mut Drawing, subject: &Subject) {
        let movable = subject.world.solids.len();
        let mut solids: Vec<(usize, &Solid)> = subject.solids().enumerate().collect();
        solids.sort_by(|(_, one), (_, other)| {
            let nearest = |solid: &Solid| {
                let (low, high) = solid.extent();
                self.direction.nearness(low).max(self.direction.nearness(high))
            };
            nearest(one).total_cmp(&nearest(other))
        });
        for (index, solid) in solids {
            let corners: Vec<[f64; 2]> =
                outline(solid, self.direction).into_iter().map(|corner| self.place(corner)).collect();
            let colour = Colour(solid.colour.map(|share| (share * 255.0).round() as u8));
            let edge = match solid.role {
                _ if index >= movable => Pen::dashes(darker(colour), 1.5),
                Role::Obstacle => Pen::solid(darker(colour), 0.8),
                Role::Landing => Pen::solid(LANDING, 2.2),
                Role::Decoration => Pen::dashes(MUTED, 0.8),
            };
            let opacity = match (solid.role, self.direction) {
                (Role::Decoration, _) => 0.0,
                (_, Direction::Side) if self.covers_all(solid) => 0.0,
                (Role::Obstacle | Role::Landing, Direction::Above) => 0.85,
                (Role::Obstacle | Role::Landing, Direction::Side) => 0.55,
            };
            drawing.polygon(corners, (opacity > 0.0).then_some((colour, opacity)), Some(edge));
        }
    }

    /// Whether the solid would hide most of the view.
    fn covers_all(&self, solid: &Solid) -> bool {
        let (low, high) = solid.extent();
        let size = self.direction.project(high - low);
        let area = (self.high[0] - self.low[0]) * (self.high[1] - self.low[1]);
        size[0] * size[1] > CURTAIN * area
    }

    /// Starts, goals, the ways between them and where starts are random.
    fn draw_points(&self, drawing: &mut Drawing, subject: &Subject, size: f64) {
        if let Some(region) = subject.start_region {
            let [low, high] = [region.low, region.high].map(|corner| self.direction.project(corner.cast()));
            let corners = [low, [high[0], low[1]], high, [low[0], high[1]]].map(|corner| self.place(corner));
            drawing.polygon(corners.to_vec(), Some((START, 0.12)), Some(Pen::dashes(START, 1.5)));
        }
        self.draw_routes(drawing, subject, size);
        for goal in &subject.goals {
            draw_goal(drawing, self.place(self.direction.project(*goal)), size);
        }
        for start in &subject.starts {
            draw_start(drawing, self.place(self.direction.project(*start)), size);
        }
    }

    /// From each start along the route to the goal.
    fn draw_routes(&self, drawing: &mut Drawing, subject: &Subject, size: f64) {
        for (index, route) in subject.routes.iter().enumerate().filter(|(_, route)| !route.is_empty()) {
            let points = subject.starts.get(index).into_iter().chain(route).chain(subject.goals.get(index));
            let points: Vec<[f64; 2]> = points.map(|point| self.place(self.direction.project(*point))).collect();
            for leg in points.windows(2) {
                drawing.line([leg[0], leg[1]], Pen::dashes(GOAL, 1.6 * size));
            }
        }
    }

    /// How wide and how high all solids together are.
    fn draw_dimensions(&self, drawing: &mut Drawing, subject: &Subject) {
        let Some((low, high)) = subject.solid_extent() else { return };
        let (low, high) = (self.direction.project(low), self.direction.project(high));
        let ([left, bottom], [right, top]) = (self.place(low), self.place(high));
        let (above, beside) = (self.corner[1] - 12.0, self.corner[0] + self.size()[0] + 14.0);
        let pen = Pen::solid(MUTED, 1.0);
        drawing.line([[left, above], [right, above]], pen);
        drawing.line([[beside, bottom], [beside, top]], pen);
        for x in [left, right] {
            drawing.line([[x, above - 5.0], [x, above + 5.0]], pen);
        }
        for y in [bottom, top] {
            drawing.line([[beside - 5.0, y], [beside + 5.0, y]], pen);
        }
        let words = |axis: usize| format!("{} m", short(high[axis] - low[axis]));
        let label = |at: [f64; 2], words: String, anchor| Text { at, words, size: 14.0, colour: INK, anchor };
        drawing.text(label([f64::midpoint(left, right), above - 6.0], words(0), Anchor::Middle));
        drawing.text(label([beside + 8.0, f64::midpoint(bottom, top) + 5.0], words(1), Anchor::Start));
    }

    /// The name of each piece of furniture.
    fn draw_names(&self, drawing: &mut Drawing, subject: &Subject) {
        for (name, parts) in pieces(&subject.world.solids) {
            let extents = parts.iter().map(Solid::extent);
            let Some((low, high)) = extents.reduce(|one, other| (one.0.inf(&other.0), one.1.sup(&other.1))) else {
                continue;
            };
            let [x, y] = self.place(self.direction.project((low + high) / 2.0));
            let covered = subject.goals.iter().any(|goal| {
                let [goal_x, goal_y] = self.place(self.direction.project(*goal));
                (goal_x - x).abs() < 60.0 && (goal_y - y).abs() < 18.0
            });
            let y = if covered { y + 24.0 } else { y };
            let text =
                Text { at: [x, y + 4.5], words: name.to_owned(), size: 13.0, colour: INK, anchor: Anchor::Middle };
            let half = 0.5 * 0.58 * text.size * name.chars().count() as f64 + 3.0;
            let plate = [[-half, -8.0], [half, -8.0], [half, 8.0], [-half, 8.0]].map(|[dx, dy]| [x + dx, y + dy]);
            drawing.polygon(plate.to_vec(), Some((PAPER, 0.75)), None);
            drawing.text(text);
        }
    }
}

/// Pieces of furniture: runs of parts called `piece: part`; a piece ends where its first part comes again.
fn pieces(solids: &[Solid]) -> Vec<(&str, &[Solid])> {
    let mut pieces = Vec::new();
    for run in solids.chunk_by(|one, other| piece(one) == piece(other)) {
        let Some(name) = piece(&run[0]) else { continue };
        let first = |index: usize| run[index].name == run[0].name;
        let begins = (0..run.len()).filter(|&index| first(index) && (index == 0 || !first(index - 1)));
        let begins: Vec<usize> = begins.chain([run.len()]).collect();
        pieces.extend(begins.windows(2).map(|ends| (name, &run[ends[0]..ends[1]])));
    }
    pieces
}

fn piece(solid: &Solid) -> Option<&str> {
    solid.name.split_once(": ").map(|(piece, _)| piece)
}

/// A ring and a point.
fn draw_goal(drawing: &mut Drawing, centre: [f64; 2], size: f64) {
    drawing.disc(centre, 9.0 * size, Some((PAPER, 0.8)), Some(Pen::solid(GOAL, 2.5 * size)));
    drawing.disc(centre, 3.0 * size, Some((GOAL, 1.0)), None);
}

/// An arrow head along +x, where drones look at the start.
fn draw_start(drawing: &mut Drawing, [x, y]: [f64; 2], size: f64) {
    let corners = [[11.0, 0.0], [-8.0, 8.0], [-4.0, 0.0], [-8.0, -8.0]];
    let corners = corners.map(|[dx, dy]| [x + size * dx, y + size * dy]);
    drawing.polygon(corners.to_vec(), Some((START, 1.0)), Some(Pen::solid(PAPER, size)));
}

/// What the marks mean, and a bar of one metre; returns where it ends \[px\].
pub(super) fn legend(drawing: &mut Drawing, subject: &Subject, [left, top]: [f64; 2], scale: f64) -> f64 {
    let words = |drawing: &mut Drawing, x: f64, words: &str| {
        let at = [x, top + 5.0];
        drawing.text(Text { at, words: words.to_owned(), size: 14.0, colour: INK, anchor: Anchor::Start });
        x + 8.2 * words.chars().count() as f64 + 44.0
    };
    let mut x = left + 12.0;
    if !subject.starts.is_empty() {
        draw_start(drawing, [x, top], 1.0);
        x = words(drawing, x + 18.0, "start");
    }
    if subject.start_region.is_some() {
        x = swatch(drawing, [x, top], Some((START, 0.12)), Pen::dashes(START, 1.5));
        x = words(drawing, x, "random starts");
    }
    draw_goal(drawing, [x, top], 1.0);
    x = words(drawing, x + 18.0, "goal");
    if subject.routes.iter().any(|route| !route.is_empty()) {
        drawing.line([[x - 8.0, top], [x + 14.0, top]], Pen::dashes(GOAL, 1.6));
        x = words(drawing, x + 22.0, "a way around");
    }
    let roles = |role: Role| subject.world.solids.iter().any(|solid| solid.role == role);
    if roles(Role::Landing) {
        x = swatch(drawing, [x, top], None, Pen::solid(LANDING, 2.2));
        x = words(drawing, x, "landing");
    }
    if roles(Role::Decoration) {
        x = swatch(drawing, [x, top], None, Pen::dashes(MUTED, 0.8));
        x = words(drawing, x, "seen, not touched");
    }
    if !subject.world.movables.is_empty() {
        x = swatch(drawing, [x, top], None, Pen::dashes(INK, 1.5));
        x = words(drawing, x, "movable");
    }
    drawing.line([[x, top], [x + scale, top]], Pen::solid(INK, 3.0));
    words(drawing, x + scale + 10.0, "1 m");
    top + 12.0
}

fn swatch(drawing: &mut Drawing, [x, y]: [f64; 2], fill: Option<(Colour, f64)>, edge: Pen) -> f64 {
    let corners = [[-8.0, -7.0], [14.0, -7.0], [14.0, 7.0], [-8.0, 7.0]].map(|[dx, dy]| [x + dx, y + dy]);
    drawing.polygon(corners.to_vec(), fill, Some(edge));
    x + 22.0
}

fn darker(Colour(colour): Colour) -> Colour {
    Colour(colour.map(|share| (f64::from(share) * 0.45) as u8))
}
