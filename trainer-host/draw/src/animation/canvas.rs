//! Anti-aliased convex polygons with depth: all that the pictures are made of.

use super::palette::{self, Colour};

/// A corner in the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertex {
    /// From the left \[px\].
    pub(super) x: f32,
    /// From the top \[px\].
    pub(super) y: f32,
    /// One over the distance in front of the camera \[1/m\]: it changes evenly across the picture.
    pub(super) nearness: f32,
}

/// Colour and how much of it covers what is below, \[0, 1\].
#[derive(Clone, Copy, Debug)]
pub(super) struct Paint {
    pub(super) colour: Colour,
    pub(super) opacity: f32,
}

impl Paint {
    /// Covers all that is below.
    pub(super) const fn opaque(colour: Colour) -> Self {
        Self { colour, opacity: 1.0 }
    }
}

/// How a shape meets what was drawn before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Depth {
    /// Over everything.
    Above,
    /// Only where nothing nearer is; hides nothing itself.
    Tested,
    /// Only where nothing nearer is; hides what is farther.
    Solid,
}

/// A picture in the making.
pub(super) struct Canvas {
    size: [usize; 2],
    /// Row by row.
    pub(super) colours: Vec<Colour>,
    nearness: Vec<f32>,
}

/// A line `inside[0] x + inside[1] y + inside[2]`: distance from an edge \[px\], positive inside.
type Edge = [f32; 3];

impl Canvas {
    pub(super) fn new(size: [usize; 2], background: Colour) -> Self {
        let pixels = size[0] * size[1];
        Self { size, colours: vec![background; pixels], nearness: vec![0.0; pixels] }
    }

    /// The picture in colours of the palette, row by row.
    pub(super) fn quantised(&self) -> Vec<u8> {
        self.colours.iter().map(|&colour| palette::nearest(colour)).collect()
    }

    /// Fills a convex polygon.
    pub(super) fn polygon(&mut self, corners: &[Vertex], paint: Paint, depth: Depth) {
        let (Some(edges), Some(plane)) = (edges(corners), plane(corners)) else { return };
        let ys = || corners.iter().map(|corner| corner.y);
        let top = (ys().fold(f32::INFINITY, f32::min) - 1.0).max(0.0) as usize;
        let bottom = (ys().fold(f32::NEG_INFINITY, f32::max) + 1.0).min(self.size[1] as f32).max(0.0) as usize;
        for row in top..bottom {
            let y = row as f32 + 0.5;
            for column in span(&edges, y, self.size[0]) {
                let x = column as f32 + 0.5;
                let distance = |[a, b, c]: &Edge| a * x + b * y + c;
                let coverage = edges.iter().map(distance).fold(f32::INFINITY, f32::min) + 0.5;
                let nearness = plane[0] * x + plane[1] * y + plane[2];
                self.cover([column, row], coverage.min(1.0), nearness, (paint, depth));
            }
        }
    }

    /// Draws a straight line, `width` \[px\] wide; thinner than a pixel, it is as much paler.
    pub(super) fn line(&mut self, ends: [Vertex; 2], width: f32, paint: Paint, depth: Depth) {
        let [from, to] = ends;
        let length = length(to.x - from.x, to.y - from.y).max(1e-3);
        let half = 0.5 * width.max(1.0);
        let (along_x, along_y) = (half * (to.x - from.x) / length, half * (to.y - from.y) / length);
        let corner = |end: Vertex, along: f32, across: f32| Vertex {
            x: end.x + 0.5 * along * along_x - across * along_y,
            y: end.y + 0.5 * along * along_y + across * along_x,
            nearness: end.nearness,
        };
        let corners =
            [corner(from, -1.0, -1.0), corner(from, -1.0, 1.0), corner(to, 1.0, 1.0), corner(to, 1.0, -1.0)];
        self.polygon(&corners, Paint { opacity: paint.opacity * width.min(1.0), ..paint }, depth);
    }

    /// Fills a disc that faces the camera, `radius` \[px\].
    pub(super) fn dot(&mut self, centre: Vertex, radius: f32, paint: Paint, depth: Depth) {
        const CORNERS: usize = 24;
        let corner = |index: usize| {
            let (sine, cosine) = libm::sincosf(index as f32 * (std::f32::consts::TAU / CORNERS as f32));
            Vertex { x: centre.x + radius * cosine, y: centre.y + radius * sine, ..centre }
        };
        self.polygon(&std::array::from_fn::<_, CORNERS, _>(corner), paint, depth);
    }

    /// Fills whole pixels `[left, top, width, height]` over everything.
    pub(super) fn rectangle(&mut self, [left, top, width, height]: [usize; 4], paint: Paint) {
        for row in top..(top + height).min(self.size[1]) {
            for column in left..(left + width).min(self.size[0]) {
                self.cover([column, row], 1.0, 0.0, (paint, Depth::Above));
            }
        }
    }

    fn cover(&mut self, [column, row]: [usize; 2], coverage: f32, nearness: f32, how: (Paint, Depth)) {
        let (paint, depth) = how;
        let pixel = row * self.size[0] + column;
        if depth != Depth::Above && nearness < self.nearness[pixel] {
            return;
        }
        let share = coverage * paint.opacity;
        for (below, above) in self.colours[pixel].iter_mut().zip(paint.colour) {
            *below += share * (above - *below);
        }
        if depth == Depth::Solid && coverage >= 0.5 {
            self.nearness[pixel] = nearness;
        }
    }
}

/// The edges of a convex polygon, or nothing when it has no inside.
fn edges(corners: &[Vertex]) -> Option<Vec<Edge>> {
    let next = |index: usize| corners[(index + 1) % corners.len()];
    let pairs = || corners.iter().enumerate().map(|(index, corner)| (corner, next(index)));
    let twice_area: f32 = pairs().map(|(from, to)| from.x * to.y - to.x * from.y).sum();
    if corners.len() < 3 || twice_area.abs() < 1e-3 {
        return None;
    }
    let sign = twice_area.signum();
    let edge = |(from, to): (&Vertex, Vertex)| {
        let length = length(to.x - from.x, to.y - from.y);
        let (a, b) = (sign * (from.y - to.y) / length, sign * (to.x - from.x) / length);
        (length > 1e-4).then_some([a, b, -a * from.x - b * from.y])
    };
    Some(pairs().filter_map(edge).collect())
}

/// Nearness as a plane over the picture, through three corners far apart.
fn plane(corners: &[Vertex]) -> Option<[f32; 3]> {
    let [a, b, c] = [0, 1, 2].map(|third| corners.get(third * corners.len() / 3));
    let (a, b, c) = (a?, b?, c?);
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if area.abs() < 1e-3 {
        return Some([0.0, 0.0, a.nearness.max(b.nearness).max(c.nearness)]);
    }
    let (to_b, to_c) = (b.nearness - a.nearness, c.nearness - a.nearness);
    let slope_x = (to_b * (c.y - a.y) - to_c * (b.y - a.y)) / area;
    let slope_y = (to_c * (b.x - a.x) - to_b * (c.x - a.x)) / area;
    Some([slope_x, slope_y, a.nearness - slope_x * a.x - slope_y * a.y])
}

/// The columns of a row that the polygon touches: within half a pixel of every edge.
fn span(edges: &[Edge], y: f32, width: usize) -> std::ops::Range<usize> {
    let (mut from, mut to) = (0.0_f32, width as f32);
    for [a, b, c] in edges {
        let least = -0.5 - b * y - c; // inside where a x >= least
        if *a > 1e-6 {
            from = from.max(least / a);
        } else if *a < -1e-6 {
            to = to.min(least / a);
        } else if least > 0.0 {
            return 0..0;
        }
    }
    (from - 0.5).ceil().max(0.0) as usize..((to - 0.5).floor() + 1.0).clamp(0.0, width as f32) as usize
}

/// Length of a vector; the standard library's `hypot` differs between machines.
fn length(x: f32, y: f32) -> f32 {
    (x * x + y * y).sqrt()
}
