//! A way through what is known so far: an occupancy map that a drone makes of what its beams meet, and the shortest path in it.
//!
//! The map is optimistic: where no beam has met anything, one can fly. So the path leads on until something is found to be in
//! its way, and then around that. A node of the map's grid knows how far the nearest thing is that was met so far, which makes
//! a metre near things longer than one in the open, and one through them much longer than any way around.
//!
//! The search is A* (Hart, Nilsson and Raphael 1968) from the goal to the drone, in whole numbers: the same path on every
//! machine, and the shortest but for a fifth of a spacing. What a beam meets only makes paths longer, so the rest of a path that
//! has not become longer is as good as it was, and a drone that is on it follows it without another search. A map can know as well
//! through which nodes beams have passed, and paths through the others count more then; one that has not become longer is followed
//! all the same, though what was seen since may have made another shorter. Memory is the caller's, of a constant size: a byte per node
//! for the map, a [`Path`], and a [`SearchNode`] per node for any number of maps.

mod queue;

use serde::{Deserialize, Serialize};

pub use self::queue::SearchNode;

use self::queue::Queue;

/// Most nodes of a grid: their numbers have sixteen bits, a few of which are not nodes in a search.
pub const NODE_LIMIT: usize = queue::NODE_LIMIT;

/// Clearances are kept as whole numbers of this \[m²\], up to 255: their squares, up to that of 38 cm, within 5 mm where a hull is.
const STEP_M2: f32 = 0.38 * 0.38 / 255.0;

/// So far clearances reach \[m\].
const REACH_M: f32 = 0.38;

/// What is met this near to the border of the map is the border \[m\].
const BORDER_M: f32 = 0.02;

/// Kept between the hull and everything \[m\].
const MARGIN_M: f32 = 0.01;

/// A metre at this distance of the hull from everything, or farther, is a metre \[m\].
const COMFORT_M: f32 = 0.3;

/// What a spacing counts in the open, and through something.
const OPEN: u16 = 8;
const BLOCKED: u16 = 40 * OPEN;

/// Tenths of a spacing to a neighbour along one, two or three axes.
const LENGTHS: [u32; 4] = [0, 10, 14, 17];

/// The estimate of a neighbour is less than this above that of a node.
const ESTIMATES: u32 = LENGTHS[3] * (2 * BLOCKED as u32 + LEAST);
const _: () = assert!(ESTIMATES < queue::RANGE);

/// Twice the count of a tenth of a spacing in the open: what no path undercuts.
const LEAST: u32 = 2 * OPEN as u32;

/// Of nodes to which no path was found.
const UNKNOWN: u32 = u32::MAX;

/// Most nodes of a path that is followed; to the end of a longer one every step takes a search.
pub const PATH_LIMIT: usize = 512;

/// The nodes of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeGrid {
    low: [f32; 3],
    high: [f32; 3],
    spacing: f32,
    counts: [u16; 3],
    /// Of the numbers of the 26 neighbours of a node from its own.
    offsets: [i32; 26],
}

impl NodeGrid {
    /// Nodes `spacing` \[m\] apart in a box \[m, world\], the first on its lowest corner. `None` where these are no numbers, an
    /// edge is shorter than the spacing, or there are more than [`NODE_LIMIT`] nodes.
    pub fn new(low: [f32; 3], high: [f32; 3], spacing: f32) -> Option<Self> {
        let mut counts = [0; 3];
        let mut nodes = 1.0;
        for (count, (low, high)) in counts.iter_mut().zip(low.iter().zip(&high)) {
            let spaces = (high - low) / spacing;
            // What is no number is no such number.
            if !(spacing > 0.0 && (1.0..65_535.0).contains(&spaces)) {
                return None;
            }
            *count = (spaces + 0.5) as u16 + 1;
            nodes *= f32::from(*count);
        }
        let [nx, ny, _] = counts.map(i32::from);
        let offset = |step: Step| {
            let [x, y, z] = step.by.map(i32::from);
            x + nx * (y + ny * z)
        };
        let grid = Self { low, high, spacing, counts, offsets: NEIGHBOURS.map(offset) };
        (nodes <= NODE_LIMIT as f32).then_some(grid)
    }

    /// How many there are.
    #[expect(clippy::len_without_is_empty, reason = "there are eight at least")]
    pub fn len(&self) -> usize {
        self.counts.iter().map(|count| usize::from(*count)).product()
    }

    /// Where a node is \[m, world\].
    pub fn point(&self, node: u16) -> [f32; 3] {
        let place = self.place(node);
        core::array::from_fn(|axis| self.coordinate(axis, place[axis]))
    }

    /// The node nearest to a point \[m, world\].
    pub fn nearest(&self, point: &[f32; 3]) -> u16 {
        self.node(core::array::from_fn(|axis| {
            let spaces = (point[axis] - self.low[axis]) / self.spacing + 0.5;
            // Numbers below zero, and what is no number, are cast to zero.
            (spaces as u16).min(self.counts[axis] - 1)
        }))
    }

    fn coordinate(&self, axis: usize, count: u16) -> f32 {
        self.low[axis] + f32::from(count) * self.spacing
    }

    #[inline(always)]
    fn node(&self, [x, y, z]: [u16; 3]) -> u16 {
        let [nx, ny, _] = self.counts.map(u32::from);
        (u32::from(x) + nx * (u32::from(y) + ny * u32::from(z))) as u16
    }

    #[inline(always)]
    fn place(&self, node: u16) -> [u16; 3] {
        let [nx, ny, _] = self.counts;
        let row = node / nx;
        [node % nx, row % ny, row / ny]
    }

    /// Along how many axes one node is from another.
    fn axes_between(&self, one: u16, other: u16) -> usize {
        let (one, other) = (self.place(one), self.place(other));
        (0..3).filter(|axis| one[*axis] != other[*axis]).count()
    }

    /// Numbers along an axis from the first at or above one coordinate to the last at or below another \[m\].
    fn between(&self, axis: usize, low: f32, high: f32) -> core::ops::Range<u16> {
        let first = (low - self.low[axis]) / self.spacing;
        let last = (high - self.low[axis]) / self.spacing;
        let first = if first > 0.0 { libm::ceilf(first) as u16 } else { 0 };
        let end = if last >= 0.0 { (last as u16).saturating_add(1) } else { 0 };
        first..end.min(self.counts[axis])
    }

    /// The nodes around one at a place, those that there are of 26, each with the step to it.
    #[inline(always)]
    fn around(&self, node: u16, place: [u16; 3]) -> impl Iterator<Item = (u16, &Step)> {
        let is_inside = (0..3).all(|axis| place[axis] > 0 && place[axis] + 1 < self.counts[axis]);
        NEIGHBOURS.iter().zip(&self.offsets).filter_map(move |(step, offset)| {
            let is_there = is_inside || {
                let place = beside(place, step);
                (0..3).all(|axis| place[axis] < self.counts[axis])
            };
            is_there.then_some(((i32::from(node) + offset) as u16, step))
        })
    }
}

/// From a node to a neighbour.
#[derive(Clone, Copy, Debug)]
struct Step {
    /// Along x, y and z.
    by: [i8; 3],
    /// Along how many of them.
    axes: u8,
}

/// The place one step from another. What is below zero wraps to beyond the last.
#[inline(always)]
fn beside(place: [u16; 3], step: &Step) -> [u16; 3] {
    core::array::from_fn(|axis| place[axis].wrapping_add_signed(step.by[axis].into()))
}

/// Steps to the 26 neighbours of a node.
const NEIGHBOURS: [Step; 26] = neighbours();

const fn neighbours() -> [Step; 26] {
    let (mut steps, mut number) = ([Step { by: [0; 3], axes: 0 }; 26], 0);
    while number < 27 {
        let [x, y, z] = [number % 3 - 1, number / 3 % 3 - 1, number / 9 - 1];
        // The thirteenth is no step at all.
        if number != 13 {
            let axes = (x * x + y * y + z * z) as u8;
            steps[if number < 13 { number } else { number - 1 } as usize] = Step { by: [x, y, z], axes };
        }
        number += 1;
    }
    steps
}

/// What the beams of a drone have met so far: for each node how far the nearest of it is, or the border; and, if it is to, which
/// nodes they have passed through.
#[derive(Debug)]
pub struct OccupancyMap<'m> {
    grid: &'m NodeGrid,
    /// Squared, in steps.
    clearances: &'m mut [u8],
    /// A bit for each node; none where every one counts as seen.
    seen: &'m mut [u8],
}

impl<'m> OccupancyMap<'m> {
    /// A map in `memory`, which has a byte for each node, or [`Self::seeing_len`] bytes to know as well what was seen, and holds
    /// what was met so far; before the first use [`Self::clear`] it. `None` if the memory has another length.
    pub fn new(grid: &'m NodeGrid, memory: &'m mut [u8]) -> Option<Self> {
        let has_room = memory.len() == grid.len() || memory.len() == Self::seeing_len(grid);
        let (clearances, seen) = has_room.then(|| memory.split_at_mut_checked(grid.len())).flatten()?;
        Some(Self { grid, clearances, seen })
    }

    /// Bytes of a map that knows what was seen: a byte and a bit for each node.
    pub fn seeing_len(grid: &NodeGrid) -> usize {
        grid.len() + grid.len().div_ceil(8)
    }

    /// Takes in that nothing is between two points \[m, world\], but for the last spacing before the second.
    pub fn see_through(&mut self, from: &[f32; 3], to: &[f32; 3]) {
        if self.seen.is_empty() {
            return;
        }
        let leg: [f32; 3] = core::array::from_fn(|axis| to[axis] - from[axis]);
        let length = libm::sqrtf(leg[0] * leg[0] + leg[1] * leg[1] + leg[2] * leg[2]);
        // As many as there are: what is no number is none.
        let steps = (length / self.grid.spacing) as u16;
        for step in 0..steps {
            let share = f32::from(step) * self.grid.spacing / length;
            let node = self.grid.nearest(&core::array::from_fn(|axis| from[axis] + leg[axis] * share));
            if let Some(bits) = self.seen.get_mut(usize::from(node / 8)) {
                *bits |= 1 << (node % 8);
            }
        }
    }

    /// Whether no beam has passed through a node.
    #[inline(always)]
    fn is_unseen(&self, node: u16) -> bool {
        self.seen.get(usize::from(node / 8)).is_some_and(|bits| bits & (1 << (node % 8)) == 0)
    }

    /// Forgets everything but the border of the grid.
    pub fn clear(&mut self) {
        self.seen.fill(0);
        for (node, clearance) in self.clearances.iter_mut().enumerate() {
            let point = self.grid.point(node as u16);
            let mut least = f32::INFINITY;
            for (axis, value) in point.iter().enumerate() {
                least = least.min(value - self.grid.low[axis]).min(self.grid.high[axis] - value);
            }
            *clearance = if least > 0.0 { steps(least * least) } else { 0 };
        }
    }

    /// Takes in that something was met at a point \[m, world\]; the border of the map is known.
    pub fn mark(&mut self, point: &[f32; 3]) {
        let [px, py, pz] = *point;
        let grid = self.grid;
        let is_inside =
            |axis: usize| (grid.low[axis] + BORDER_M..grid.high[axis] - BORDER_M).contains(&point[axis]);
        if !(is_inside(0) && is_inside(1) && is_inside(2)) {
            return;
        }
        let [xs, ys, zs] =
            core::array::from_fn(|axis| grid.between(axis, point[axis] - REACH_M, point[axis] + REACH_M));
        for z in zs {
            let dz = grid.coordinate(2, z) - pz;
            for y in ys.clone() {
                let dy = grid.coordinate(1, y) - py;
                let aside = dy * dy + dz * dz;
                let row = usize::from(grid.node([xs.start, y, z]));
                let row = self.clearances.get_mut(row..row + xs.len()).unwrap_or_default();
                for (x, clearance) in xs.clone().zip(row) {
                    let dx = grid.coordinate(0, x) - px;
                    *clearance = (*clearance).min(steps(dx * dx + aside));
                }
            }
        }
    }

    /// Away from what was met nearest to a point \[m, world\], or from the border: a vector, world, of length 1 at the thing itself
    /// and 0 from 38 cm on. Between nodes their clearances are interpolated. Zero outside of the grid.
    pub fn away_from_nearest(&self, point: &[f32; 3]) -> [f32; 3] {
        let grid = self.grid;
        let spaces: [f32; 3] = core::array::from_fn(|axis| (point[axis] - grid.low[axis]) / grid.spacing);
        let is_inside = |axis: usize| spaces[axis] >= 0.0 && spaces[axis] <= f32::from(grid.counts[axis] - 1);
        if !(is_inside(0) && is_inside(1) && is_inside(2)) {
            return [0.0; 3];
        }
        let first: [u16; 3] = core::array::from_fn(|axis| (spaces[axis] as u16).min(grid.counts[axis] - 2));
        let share: [f32; 3] = core::array::from_fn(|axis| spaces[axis] - f32::from(first[axis]));
        let (mut clearance, mut slope) = (0.0, [0.0; 3]);
        for corner in 0..8_u16 {
            let upper: [u16; 3] = core::array::from_fn(|axis| corner >> axis & 1);
            let node = grid.node(core::array::from_fn(|axis| first[axis] + upper[axis]));
            let found = libm::sqrtf(f32::from(self.clearances[usize::from(node)]) * STEP_M2);
            let part: [f32; 3] =
                core::array::from_fn(|axis| if upper[axis] == 1 { share[axis] } else { 1.0 - share[axis] });
            clearance += part[0] * part[1] * part[2] * found;
            for (axis, slope) in slope.iter_mut().enumerate() {
                let others = part[(axis + 1) % 3] * part[(axis + 2) % 3];
                *slope += if upper[axis] == 1 { others * found } else { -(others * found) };
            }
        }
        let steepness = libm::sqrtf(slope[0] * slope[0] + slope[1] * slope[1] + slope[2] * slope[2]);
        let nearness = (1.0 - clearance / REACH_M).max(0.0);
        slope.map(|slope| slope * (nearness / steepness.max(f32::MIN_POSITIVE)))
    }
}

/// The square of a length \[m²\] in steps, as far as they go.
fn steps(square: f32) -> u8 {
    // Saturates, and what is no number is zero.
    (square * (1.0 / STEP_M2)) as u8
}

/// A path that was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Path {
    /// From the end to where the drone is.
    nodes: heapless::Vec<u16, PATH_LIMIT>,
    /// What it counted when it was found.
    length: u32,
}

/// How a drone goes about it.
#[derive(Clone, Debug, PartialEq)]
pub struct Planner {
    /// What a spacing counts at each clearance.
    counts: [u16; 256],
    /// The same where nothing was seen.
    unseen_counts: [u16; 256],
    lookahead_m: f32,
}

impl Planner {
    /// For a drone with a hull of this radius \[m\], which heads for the point `lookahead_m` ahead on its path. Right beside
    /// something a metre counts `1 + nearness_cost` metres, in the open one, and between the square of the distance decides.
    pub fn new(hull_radius_m: f32, nearness_cost: f32, lookahead_m: f32) -> Self {
        let count = |clearance: usize| {
            let room = libm::sqrtf(clearance as f32 * STEP_M2) - (hull_radius_m + MARGIN_M);
            if room < 0.0 {
                return BLOCKED;
            }
            let near = (1.0 - room / COMFORT_M).max(0.0);
            ((f32::from(OPEN) * (1.0 + nearness_cost * near * near)) as u16).min(BLOCKED)
        };
        let counts = core::array::from_fn(count);
        Self { counts, unseen_counts: counts, lookahead_m }
    }

    /// The same, but a metre where no beam has passed counts so many times as much, at most as much as one through something. A
    /// factor below one is one.
    #[must_use]
    pub fn with_unseen_cost(self, factor: f32) -> Self {
        let count = |count: u16| ((f32::from(count) * factor) as u16).clamp(count, BLOCKED);
        Self { unseen_counts: self.counts.map(count), ..self }
    }

    /// The point to head for on the shortest path from one point to another \[m, world\], the end itself once it is nearer.
    /// So it is where `memory` has fewer nodes than the map. A `path` that an earlier call left is followed as long as the
    /// drone is on it and nothing was met that makes it longer; where the map was cleared, it has to be forgotten.
    pub fn ahead(
        &self,
        map: &OccupancyMap<'_>,
        [from, goal]: [&[f32; 3]; 2],
        path: &mut Path,
        memory: &mut [SearchNode],
    ) -> [f32; 3] {
        let grid = map.grid;
        let (start, end) = (grid.nearest(from), grid.nearest(goal));
        if !self.follow(map, start, end, path) {
            path.nodes.clear();
            if let Some(nodes) = memory.get_mut(..grid.len()) {
                self.find(map, start, end, nodes);
                self.trace(map, start, end, nodes, path);
            }
        }
        // In tenths of a spacing.
        let enough = (self.lookahead_m / grid.spacing * 10.0) as u32;
        let mut flown = 0;
        for step in path.nodes.windows(2).rev() {
            flown += LENGTHS[grid.axes_between(step[1], step[0])];
            if flown >= enough && step[0] != end {
                return grid.point(step[0]);
            }
        }
        *goal
    }

    /// Shortens a path to what is left of it for a drone at a node; whether that is one of its nodes, and it leads to `end`
    /// and has not become longer.
    fn follow(&self, map: &OccupancyMap<'_>, start: u16, end: u16, path: &mut Path) -> bool {
        if path.nodes.first() != Some(&end) || self.length(map, &path.nodes) > path.length {
            return false;
        }
        let Some(place) = path.nodes.iter().position(|node| *node == start) else { return false };
        path.nodes.truncate(place + 1);
        path.length = self.length(map, &path.nodes);
        true
    }

    /// What a path counts.
    fn length(&self, map: &OccupancyMap<'_>, nodes: &[u16]) -> u32 {
        let step = |ends: &[u16]| self.step(map, [ends[0], ends[1]], map.grid.axes_between(ends[0], ends[1]));
        nodes.windows(2).map(step).sum()
    }

    /// Writes down the path that a search has found, nothing where it is too long.
    fn trace(&self, map: &OccupancyMap<'_>, start: u16, end: u16, nodes: &[SearchNode], path: &mut Path) {
        let mut node = start;
        while path.nodes.push(node).is_ok() && node != end {
            let Some(next) = self.next(map, node, nodes) else { break };
            node = next;
        }
        if node != end {
            path.nodes.clear();
        }
        path.nodes.reverse();
        path.length = self.length(map, &path.nodes);
    }

    /// Lengths of the shortest paths to `end` from there up to `start`.
    fn find(&self, map: &OccupancyMap<'_>, start: u16, end: u16, nodes: &mut [SearchNode]) {
        let grid = map.grid;
        let target = grid.place(start);
        let estimate = |place: [u16; 3], length: u32| length + LEAST * least_length(place, target);
        let mut open = Queue::new(nodes, UNKNOWN, estimate(grid.place(end), 0));
        open.nodes[usize::from(end)].length = 0;
        open.push(end, 0);
        while let Some(node) = open.pop()
            && node != start
        {
            let (length, own) = (open.nodes[usize::from(node)].length, self.count(map, node));
            let place = grid.place(node);
            for (other, step) in grid.around(node, place) {
                let known = &mut open.nodes[usize::from(other)].length;
                let spacing = LENGTHS[usize::from(step.axes)];
                // Most are behind, or known by a way that none from here undercuts.
                if *known <= length + spacing * (own + u32::from(OPEN)) {
                    continue;
                }
                let found = length + spacing * (own + self.count(map, other));
                if found < *known {
                    let before = core::mem::replace(known, found);
                    if before != UNKNOWN {
                        open.remove(other);
                    }
                    open.push(other, estimate(beside(place, step), found));
                }
            }
        }
    }

    /// The neighbour by way of which the path found from a node leads.
    fn next(&self, map: &OccupancyMap<'_>, node: u16, nodes: &[SearchNode]) -> Option<u16> {
        let whole = |(other, step): &(u16, &Step)| {
            let step = self.step(map, [node, *other], usize::from(step.axes));
            nodes[usize::from(*other)].length.saturating_add(step)
        };
        let found = map.grid.around(node, map.grid.place(node)).min_by_key(whole);
        found.map(|(other, _)| other)
    }

    /// What a spacing counts at a node; a step counts half of what it does at both of its ends, for its length.
    #[inline(always)]
    fn count(&self, map: &OccupancyMap<'_>, node: u16) -> u32 {
        let clearance = usize::from(map.clearances[usize::from(node)]);
        u32::from(if map.is_unseen(node) { self.unseen_counts[clearance] } else { self.counts[clearance] })
    }

    /// What a step from a node to another along so many axes counts.
    fn step(&self, map: &OccupancyMap<'_>, [node, other]: [u16; 2], axes: usize) -> u32 {
        LENGTHS[axes] * (self.count(map, node) + self.count(map, other))
    }
}

/// Of a path between two places of which all is open \[tenths of a spacing\].
#[inline(always)]
fn least_length(one: [u16; 3], other: [u16; 3]) -> u32 {
    let [x, y, z]: [u32; 3] = core::array::from_fn(|axis| u32::from(one[axis].abs_diff(other[axis])));
    let (least, most) = (x.min(y).min(z), x.max(y).max(z));
    let middle = x + y + z - least - most;
    LENGTHS[3] * least + LENGTHS[2] * (middle - least) + LENGTHS[1] * (most - middle)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEARCHED: usize = 41 * 21 * 11;
    const GOAL: [f32; 3] = [1.8, 0.0, 0.5];

    fn grid() -> NodeGrid {
        NodeGrid::new([-2.0, -1.0, 0.0], [2.0, 1.0, 1.0], 0.1).unwrap()
    }

    fn empty<'m>(grid: &'m NodeGrid, memory: &'m mut Vec<u8>) -> OccupancyMap<'m> {
        memory.resize(grid.len(), 0);
        let mut map = OccupancyMap::new(grid, memory).unwrap();
        map.clear();
        map
    }

    /// Where the way from point to point leads until it is at the goal.
    fn flown(map: &OccupancyMap<'_>, from: [f32; 3]) -> Vec<[f32; 3]> {
        let planner = Planner::new(0.06, 2.0, 0.3);
        let (mut path, mut search) = (Path::default(), vec![SearchNode::default(); SEARCHED]);
        let next = |at: &[f32; 3]| (*at != GOAL).then(|| planner.ahead(map, [at, &GOAL], &mut path, &mut search));
        std::iter::successors(Some(from), next).take(100).collect()
    }

    /// A wall across the middle, all heights, from y = -1 to `end`.
    fn build_wall(map: &mut OccupancyMap<'_>, end: f32) {
        let count = ((end + 1.0) / 0.05) as i32;
        for y in 0..=count {
            for z in 0..=20 {
                map.mark(&[0.0, -1.0 + 0.05 * y as f32, 0.05 * z as f32]);
            }
        }
    }

    #[test]
    fn in_the_open_the_way_is_straight() {
        let (grid, mut memory) = (grid(), Vec::new());
        let map = empty(&grid, &mut memory);
        let way = flown(&map, [-1.8, 0.0, 0.5]);
        assert_eq!(way.last(), Some(&GOAL));
        assert!(way.len() <= 13 && way.iter().all(|point| point[1].abs() < 1e-5), "{way:?}");
    }

    #[test]
    fn what_is_met_is_flown_around_on_its_free_side() {
        let (grid, mut memory) = (grid(), Vec::new());
        let mut map = empty(&grid, &mut memory);
        build_wall(&mut map, 0.4);
        let way = flown(&map, [-1.8, 0.0, 0.5]);
        assert_eq!(way.last(), Some(&GOAL));
        let aside = way.iter().map(|point| point[1]).fold(f32::MIN, f32::max);
        assert!((0.45..0.95).contains(&aside), "{way:?}");
        map.clear();
        assert!(flown(&map, [-1.8, 0.0, 0.5]).iter().all(|point| point[1].abs() < 1e-5));
    }

    #[test]
    fn through_a_wall_without_end_the_way_is_straight_again() {
        let (grid, mut memory) = (grid(), Vec::new());
        let mut map = empty(&grid, &mut memory);
        build_wall(&mut map, 1.0);
        assert_eq!(flown(&map, [-1.8, 0.0, 0.5]).last(), Some(&GOAL));
    }

    #[test]
    fn what_is_nearest_on_the_map_is_known_between_nodes_as_well() {
        let (grid, mut memory) = (grid(), Vec::new());
        let mut map = empty(&grid, &mut memory);
        assert_eq!(map.away_from_nearest(&[0.3, 0.0, 0.5]), [0.0; 3]);
        build_wall(&mut map, 1.0);
        for x in [0.1_f32, 0.16, 0.23, -0.2, -0.34] {
            let [along, across, up] = map.away_from_nearest(&[x, 0.02, 0.51]);
            let expected = x.signum() * (1.0 - x.abs() / REACH_M);
            assert!((along - expected).abs() < 0.05, "{along} at {x}, expected {expected}");
            assert!(across.abs() < 0.05 && up.abs() < 0.05, "{across}, {up}");
        }
        // The border is known, and beyond it nothing is.
        assert!(map.away_from_nearest(&[1.0, 0.9, 0.5])[1] < -0.6);
        for outside in [[0.1, 1.2, 0.5], [-2.1, 0.0, 0.5], [0.1, 0.0, f32::NAN]] {
            assert_eq!(map.away_from_nearest(&outside), [0.0; 3]);
        }
        assert!(map.away_from_nearest(&[1.95, 0.5, 0.5])[0] < -0.7);
    }

    #[test]
    fn paths_are_hardly_longer_than_the_shortest() {
        let (grid, mut memory) = (grid(), Vec::new());
        let mut map = empty(&grid, &mut memory);
        for point in 0..60_u32 {
            let part = |stride: u32| (point * stride % 101) as f32 / 100.0;
            map.mark(&[-1.5 + 3.0 * part(37), -0.9 + 1.8 * part(53), part(71)]);
        }
        let planner = Planner::new(0.06, 6.0, 0.3);
        let end = grid.nearest(&GOAL);
        let mut exact = vec![u32::MAX; grid.len()];
        exact[usize::from(end)] = 0;
        // Bellman and Ford: until nothing becomes shorter.
        while (0..grid.len() as u16).fold(false, |shorter, node| {
            let around = grid.around(node, grid.place(node));
            let by = |(other, step): (u16, &Step)| {
                exact[usize::from(other)].saturating_add(planner.step(&map, [node, other], usize::from(step.axes)))
            };
            let least = around.map(by).min().unwrap();
            let known = &mut exact[usize::from(node)];
            let is_shorter = least < *known;
            *known = least.min(*known);
            shorter | is_shorter
        }) {}
        let mut search = vec![SearchNode::default(); SEARCHED];
        for from in [[-1.8, 0.0, 0.5], [-1.0, 0.9, 0.9], [0.3, -0.8, 0.1], GOAL] {
            let start = grid.nearest(&from);
            planner.find(&map, start, end, &mut search);
            let mut path = Path::default();
            planner.trace(&map, start, end, &search, &mut path);
            let least = exact[usize::from(start)];
            assert!((least..=least + least / 100).contains(&path.length), "{from:?}: {} of {least}", path.length);
        }
    }

    #[test]
    fn a_way_that_was_seen_is_taken_before_one_that_was_not() {
        let (grid, planner) = (grid(), Planner::new(0.06, 2.0, 0.3));
        let mut memory = vec![0; OccupancyMap::seeing_len(&grid)];
        let mut map = OccupancyMap::new(&grid, &mut memory).unwrap();
        map.clear();
        // Along y = 0.5 and back to the goal.
        for (from, to) in
            [([-1.8, 0.0, 0.5], [-1.2, 0.6, 0.5]), ([-1.2, 0.5, 0.5], [1.3, 0.5, 0.5]), ([1.1, 0.6, 0.5], GOAL)]
        {
            map.see_through(&from, &to);
        }
        let aside = |planner: &Planner, map: &OccupancyMap<'_>| {
            let (mut path, mut search) = (Path::default(), vec![SearchNode::default(); SEARCHED]);
            let next =
                |at: &[f32; 3]| (*at != GOAL).then(|| planner.ahead(map, [at, &GOAL], &mut path, &mut search));
            let way = std::iter::successors(Some([-1.8, 0.0, 0.5]), next).take(100);
            way.map(|point| point[1]).fold(f32::MIN, f32::max)
        };
        assert!(aside(&planner, &map).abs() < 1e-5, "what was seen counts as what was not");
        let wary = planner.clone().with_unseen_cost(2.0);
        assert!(aside(&wary, &map) > 0.35, "{}", aside(&wary, &map));
        // Where there is no room to remember it, everything was seen.
        let mut memory = Vec::new();
        assert!(aside(&wary, &empty(&grid, &mut memory)).abs() < 1e-5);
        assert!(OccupancyMap::new(&grid, &mut vec![0; grid.len() + 1]).is_none());
        map.clear();
        assert!(aside(&wary, &map).abs() < 1e-5, "nothing was seen");
    }

    #[test]
    fn a_path_is_followed_without_a_search_while_the_drone_is_on_it_and_nothing_was_met() {
        let (grid, mut memory) = (grid(), Vec::new());
        let mut map = empty(&grid, &mut memory);
        let planner = Planner::new(0.06, 2.0, 0.3);
        let mut path = Path::default();
        let mut search = vec![SearchNode::default(); SEARCHED];
        let ahead = planner.ahead(&map, [&[-1.8, 0.0, 0.5], &GOAL], &mut path, &mut search);
        assert!((ahead[0] + 1.5).abs() < 1e-5, "{ahead:?}");
        // What cannot search heads for the goal itself.
        let mut none = [SearchNode::default(); 1];
        let mut follow = |map: &OccupancyMap<'_>, x: f32, y: f32, path: &mut Path| {
            planner.ahead(map, [&[x, y, 0.5], &GOAL], path, &mut none)
        };
        assert!((follow(&map, -1.6, 0.0, &mut path)[0] + 1.3).abs() < 1e-5);
        map.mark(&[0.0, 0.9, 0.9]);
        assert!((follow(&map, -1.4, 0.0, &mut path)[0] + 1.1).abs() < 1e-5);
        for (x, y, met) in [(-1.2, 0.1, false), (-1.2, 0.0, true)] {
            let mut path = path.clone();
            if met {
                map.mark(&[0.0, 0.1, 0.5]);
            }
            assert_eq!(follow(&map, x, y, &mut path), GOAL, "aside {y}, {met}");
            assert_eq!(path, Path { nodes: heapless::Vec::new(), length: path.length });
        }
        // Another goal is another path.
        let back = planner.ahead(&map, [&[-1.2, 0.0, 0.5], &[-1.8, 0.0, 0.5]], &mut path, &mut search);
        assert!((back[0] + 1.5).abs() < 1e-5, "{back:?}");
    }

    #[test]
    fn a_search_without_room_heads_for_the_goal() {
        let (grid, mut memory) = (grid(), Vec::new());
        let map = empty(&grid, &mut memory);
        let planner = Planner::new(0.06, 2.0, 0.3);
        let from = [-1.8, 0.9, 0.1];
        let mut path = Path::default();
        assert_eq!(planner.ahead(&map, [&from, &GOAL], &mut path, &mut [SearchNode::default(); 100]), GOAL);
    }

    #[test]
    fn a_grid_has_a_size_and_points_outside_have_a_node() {
        let grid = grid();
        assert_eq!(grid.len(), SEARCHED);
        for node in [0, 40, 41, 9470] {
            assert_eq!(grid.nearest(&grid.point(node)), node);
        }
        assert_eq!(grid.nearest(&[-9.0, -9.0, -9.0]), 0);
        assert_eq!(grid.nearest(&[9.0, 9.0, 9.0]), SEARCHED as u16 - 1);
        assert_eq!(grid.nearest(&[f32::NAN, -1.0, 0.0]), 0);
        for (high, spacing) in [(2.0, 0.0), (2.0, f32::NAN), (-3.0, 0.1), (2.0, 0.01), (f32::INFINITY, 0.1)] {
            assert_eq!(NodeGrid::new([-2.0, -1.0, 0.0], [high, 1.0, 1.0], spacing), None);
        }
    }
}
