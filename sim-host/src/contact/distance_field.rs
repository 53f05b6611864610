//! The geodesic distance field (cost-to-go): how long the shortest free path to the goal is, from everywhere.

use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};

use nalgebra::Vector3;

use super::ContactReport;
use super::body::Body;
use crate::world::{Cuboid, Role, Solid, World};

/// Least distance between two nodes \[m\]: a third of the narrowest passage that a Crazyflie gets through.
const SPACING: f64 = 0.05;

/// The same in rooms that are drawn, of which there are many: what stands there keeps four times as far apart on the
/// ways that prove them, and a field takes an eighth of the memory and of the time \[m\].
const COARSE_SPACING: f64 = 0.1;

/// Most nodes; farther apart in greater worlds.
const NODE_LIMIT: f64 = 600_000.0;

/// Kept between the hull and everything \[m\].
const MARGIN: f64 = 0.01;

/// A metre at this distance from everything, or farther, is a metre \[m\].
const COMFORT: f64 = 0.3;

/// What a metre right beside something adds to itself. A path that keeps half a COMFORT away is worth a detour of half
/// its length, as a learner that still wobbles would find.
const CLEARANCE_COST: f64 = 2.0;

/// What a metre through something counts: more than any path around it.
const BLOCKED: f64 = 40.0;

/// Rounding of what a metre counts, generously.
const ROUNDING: f32 = 0.1;

/// Offsets to the 26 neighbours of a node.
const NEIGHBOURS: [[isize; 3]; 26] = neighbours();

/// Lengths of the shortest paths to a goal, computed when they are first asked for.
///
/// A metre counts more near walls, so that paths keep to the middle, and very much more through them, so that there is
/// a path from everywhere. What is there to land on does not count as being in the way.
#[derive(Clone, Debug)]
pub struct DistanceField {
    site: Site,
    lengths: OnceLock<Lengths>,
}

/// What paths depend on.
#[derive(Clone, Debug, PartialEq)]
struct Site {
    solids: Vec<Solid>,
    goal: Vector3<f64>,
    bounds: Cuboid,
    /// Of the drone's hull \[m\].
    radius: f64,
    /// Least distance between two nodes \[m\].
    spacing: f64,
}

/// A length at every node of a grid of which the goal is one.
#[derive(Clone, Debug)]
struct Lengths {
    grid: Grid,
    first: [f32; 3],
    per_spacing: f32,
    /// Index of the last cell, the space between two nodes, along x, y, z.
    last: [f32; 3],
    metres: Vec<f32>,
    /// For each node its neighbour with the shortest path, as an index of [`NEIGHBOURS`], or [`LOWEST`]; found when somebody
    /// first asks for a path.
    downhill: OnceLock<Vec<u8>>,
}

/// In place of a neighbour: none has a shorter path.
const LOWEST: u8 = NEIGHBOURS.len() as u8;

/// The fields that are in use.
static MADE: Mutex<Vec<Weak<DistanceField>>> = Mutex::new(Vec::new());

impl PartialEq for DistanceField {
    fn eq(&self, other: &Self) -> bool {
        self.site == other.site
    }
}

impl DistanceField {
    /// Paths of a drone with a hull of this radius \[m\] within `bounds`, in which the goal \[m, world\] is.
    pub fn new(world: &World, goal: &Vector3<f32>, bounds: Cuboid, radius: f64) -> Self {
        let solids = world.tangible().filter(|solid| solid.role == Role::Obstacle).cloned().collect();
        let site = Site { solids, goal: goal.cast(), bounds, radius, spacing: SPACING };
        Self { site, lengths: OnceLock::new() }
    }

    /// The same, with nodes 10 cm apart instead of 5.
    #[must_use]
    pub fn coarse(self) -> Self {
        Self { site: Site { spacing: COARSE_SPACING, ..self.site }, lengths: OnceLock::new() }
    }

    /// As [`Self::new`]; the same field for everybody who asks while it is in use.
    pub fn shared(world: &World, goal: &Vector3<f32>, bounds: Cuboid, radius: f64) -> Arc<Self> {
        let wanted = Self::new(world, goal, bounds, radius);
        // A panic elsewhere leaves the list as it was: it is only ever changed as a whole.
        let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
        made.retain(|field| field.strong_count() > 0);
        let known = made.iter().filter_map(Weak::upgrade).find(|field| **field == wanted);
        known.unwrap_or_else(|| {
            let field = Arc::new(wanted);
            made.push(Arc::downgrade(&field));
            field
        })
    }

    /// Points along the shortest path from a point to the goal \[m, world\], one for each node on it.
    pub fn path_from(&self, point: [f32; 3]) -> Vec<Vector3<f32>> {
        self.lengths.get_or_init(|| Lengths::new(&self.site)).path_from(point)
    }

    /// As [`Self::path_from`], unless that path leads through something.
    pub fn free_path_from(&self, point: [f32; 3]) -> Option<Vec<Vector3<f32>>> {
        let path = self.path_from(point);
        // A free metre counts at most this much, and a step into or out of something many times more.
        let limit = 1.0 + CLEARANCE_COST as f32 + ROUNDING;
        let drop =
            |one: &Vector3<f32>, other: &Vector3<f32>| self.length((*one).into()) - self.length((*other).into());
        let free = path.windows(2).all(|leg| drop(&leg[0], &leg[1]) <= limit * (leg[1] - leg[0]).norm());
        free.then_some(path)
    }

    /// The point on the shortest path from `point` that is `metres` farther along \[m, world\]; the goal once that is nearer.
    pub fn ahead(&self, point: [f32; 3], metres: f32) -> Vector3<f32> {
        self.lengths.get_or_init(|| Lengths::new(&self.site)).ahead(point, metres)
    }

    /// Length of the shortest path from a point \[m\]; outside the bounds that from their nearest point.
    pub fn length(&self, point: [f32; 3]) -> f32 {
        let [length] = self.lengths(&point.map(|value| [value]));
        length
    }

    /// As [`Self::length`] from the points of many lanes, `[axis][lane]`.
    #[inline(always)]
    pub(crate) fn lengths<const LANES: usize>(&self, points: &[[f32; LANES]; 3]) -> [f32; LANES] {
        self.lengths.get_or_init(|| Lengths::new(&self.site)).at(points)
    }
}

impl Lengths {
    fn new(site: &Site) -> Self {
        let low: Vector3<f64> = site.bounds.low.cast();
        let high: Vector3<f64> = site.bounds.high.cast();
        let spacing = site.spacing.max(libm::cbrt((high - low).product() / NODE_LIMIT));
        // One node beyond the bounds on every side, so that a point inside has eight around it.
        let before = (site.goal - low).map(|metres| libm::ceil(metres / spacing).max(1.0));
        let behind = (high - site.goal).map(|metres| libm::ceil(metres / spacing).max(1.0));
        let first = site.goal - before * spacing;
        let counts: [usize; 3] = (before + behind).map(|cells| cells as usize + 1).into();
        let grid = Grid { first, spacing, counts };
        let goal = grid.index(before.map(|cells| cells as usize).into());
        let metres = shortest(&grid, &costs(&grid, site), goal);
        Self {
            first: first.map(|value| value as f32).into(),
            per_spacing: (1.0 / spacing) as f32,
            last: counts.map(|count| count as f32 - 2.0),
            grid,
            metres,
            downhill: OnceLock::new(),
        }
    }

    fn path_from(&self, point: [f32; 3]) -> Vec<Vector3<f32>> {
        self.downhill(point).collect()
    }

    fn ahead(&self, point: [f32; 3], metres: f32) -> Vector3<f32> {
        let mut path = self.downhill(point);
        let mut end = path.next().unwrap_or_default();
        let mut flown = 0.0;
        for next in path {
            flown += (next - end).norm();
            end = next;
            if flown >= metres {
                break;
            }
        }
        end
    }

    /// From the node nearest to a point to its nearest neighbour, and so on.
    fn downhill(&self, point: [f32; 3]) -> impl Iterator<Item = Vector3<f32>> {
        let nearest = |axis: usize| {
            let place = ((point[axis] - self.first[axis]) * self.per_spacing).round();
            place.max(0.0).min(self.last[axis] + 1.0) as usize
        };
        let first = self.grid.index([nearest(0), nearest(1), nearest(2)]);
        let downhill =
            self.downhill.get_or_init(|| (0..self.grid.len()).map(|node| self.lowest_beside(node)).collect());
        let [nx, ny, _] = self.grid.counts.map(|count| count as isize);
        let after = move |index: &usize| {
            let [x, y, z] = NEIGHBOURS.get(usize::from(downhill[*index]))?;
            index.checked_add_signed(x + nx * (y + ny * z))
        };
        std::iter::successors(Some(first), after).map(|index| self.grid.point(self.grid.node(index)).cast())
    }

    /// Which neighbour has the shortest path, if that is shorter than the node's own.
    fn lowest_beside(&self, index: usize) -> u8 {
        let node = self.grid.node(index);
        let beside = |(number, offset): (usize, &[isize; 3])| {
            self.grid.beside(node, *offset).map(|index| (number as u8, self.metres[index]))
        };
        let neighbours = NEIGHBOURS.iter().enumerate().filter_map(beside);
        let shortest = neighbours.min_by(|one, other| one.1.total_cmp(&other.1));
        shortest.filter(|(_, metres)| *metres < self.metres[index]).map_or(LOWEST, |(number, _)| number)
    }

    /// Linear between the eight nodes around each point.
    #[inline(always)]
    fn at<const LANES: usize>(&self, points: &[[f32; LANES]; 3]) -> [f32; LANES] {
        let (first, per_spacing, last) = (self.first, self.per_spacing, self.last);
        let (mut cells, mut shares) = ([[0_i32; LANES]; 3], [[0.0_f32; LANES]; 3]);
        // In lanes; what is looked up is not.
        for axis in 0..3 {
            for lane in 0..LANES {
                let place = (points[axis][lane] - first[axis]) * per_spacing;
                // A coordinate that is not a number is taken for the first.
                let place = place.max(0.0).min(last[axis] + 1.0);
                let whole = (place as i32 as f32).min(last[axis]);
                cells[axis][lane] = whole as i32;
                shares[axis][lane] = place - whole;
            }
        }
        let mut lengths = [0.0; LANES];
        for (lane, length) in lengths.iter_mut().enumerate() {
            let cell = [cells[0][lane] as usize, cells[1][lane] as usize, cells[2][lane] as usize];
            *length = self.between(cell, [shares[0][lane], shares[1][lane], shares[2][lane]]);
        }
        lengths
    }

    /// Linear between the eight nodes of a cell.
    #[inline(always)]
    fn between(&self, cell: [usize; 3], share: [f32; 3]) -> f32 {
        let [nx, ny, _] = self.grid.counts;
        let base = self.grid.index(cell);
        let metres = &self.metres[base..];
        let along_x = |offset: usize| mix(metres[offset], metres[offset + 1], share[0]);
        let along_y = |offset: usize| mix(along_x(offset), along_x(offset + nx), share[1]);
        mix(along_y(0), along_y(nx * ny), share[2])
    }
}

#[inline(always)]
fn mix(one: f32, other: f32, share: f32) -> f32 {
    one + (other - one) * share
}

/// Where the nodes are.
#[derive(Clone, Copy, Debug)]
struct Grid {
    first: Vector3<f64>,
    spacing: f64,
    counts: [usize; 3],
}

impl Grid {
    fn len(&self) -> usize {
        self.counts.iter().product()
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        x + self.counts[0] * (y + self.counts[1] * z)
    }

    fn node(&self, index: usize) -> [usize; 3] {
        let [nx, ny, _] = self.counts;
        [index % nx, index / nx % ny, index / (nx * ny)]
    }

    fn point(&self, node: [usize; 3]) -> Vector3<f64> {
        self.first + Vector3::from(node.map(|number| number as f64)) * self.spacing
    }

    /// The node at an offset, unless it is beyond the border.
    fn beside(&self, node: [usize; 3], offset: [isize; 3]) -> Option<usize> {
        let mut found = node;
        for axis in 0..3 {
            found[axis] = node[axis].checked_add_signed(offset[axis]).filter(|at| *at < self.counts[axis])?;
        }
        Some(self.index(found))
    }
}

const fn neighbours() -> [[isize; 3]; 26] {
    let (mut offsets, mut number) = ([[0; 3]; 26], 0);
    while number < 27 {
        let offset = [number / 9 % 3 - 1, number / 3 % 3 - 1, number % 3 - 1];
        // The thirteenth is no step at all.
        if number != 13 {
            offsets[if number < 13 { number } else { number - 1 } as usize] = offset;
        }
        number += 1;
    }
    offsets
}

/// What a metre counts at every node.
fn costs(grid: &Grid, site: &Site) -> Vec<f64> {
    let bodies: Vec<Body> = site.solids.iter().map(|solid| Body::new(solid, ContactReport::Touch)).collect();
    let closed = site.radius + MARGIN;
    let [nx, ny, nz] = grid.counts;
    let mut costs = Vec::with_capacity(grid.len());
    for z in 0..nz {
        for y in 0..ny {
            let row = (grid.point([0, y, z]), grid.point([nx - 1, y, z]));
            let near: Vec<&Body> =
                bodies.iter().filter(|body| gap(&row, &body.extent) < closed + COMFORT).collect();
            for x in 0..nx {
                let clearance = clearance(&near, site, &grid.point([x, y, z]), closed + COMFORT);
                costs.push(cost(clearance - closed));
            }
        }
    }
    costs
}

/// Distance of a point to the nearest body or border \[m\], as far as it is less than `limit`.
fn clearance(bodies: &[&Body], site: &Site, point: &Vector3<f64>, limit: f64) -> f64 {
    let (low, high): (Vector3<f64>, Vector3<f64>) = (site.bounds.low.cast(), site.bounds.high.cast());
    let mut least = limit.min((point - low).min()).min((high - point).min());
    for body in bodies {
        if body.distance_to_extent(point) < least {
            least = least.min(body.distance_to(point));
        }
    }
    least
}

/// Distance between two boxes \[m\], zero where they overlap.
fn gap((low, high): &(Vector3<f64>, Vector3<f64>), (other_low, other_high): &(Vector3<f64>, Vector3<f64>)) -> f64 {
    (low - other_high).sup(&(other_low - high)).sup(&Vector3::zeros()).norm()
}

/// What a metre counts at this distance between hull and everything \[m\].
fn cost(room: f64) -> f64 {
    if room < 0.0 {
        return BLOCKED;
    }
    let near = (1.0 - room / COMFORT).max(0.0);
    1.0 + CLEARANCE_COST * near * near
}

/// Shortest paths from all nodes to one (Dijkstra 1959), each step to one of 26 neighbours; \[m\], weighted.
fn shortest(grid: &Grid, costs: &[f64], goal: usize) -> Vec<f32> {
    let mut metres = vec![f32::INFINITY; grid.len()];
    metres[goal] = 0.0;
    let steps = steps(grid);
    let mut open = RadixQueue::default();
    // Lengths are not negative, so that their bits have their order.
    open.push(0, goal as u32);
    while let Some((bits, index)) = open.pop() {
        let index = index as usize;
        if bits > metres[index].to_bits() {
            continue;
        }
        let node = grid.node(index);
        let is_inside = (0..3).all(|axis| (1..grid.counts[axis] - 1).contains(&node[axis]));
        for step in &steps {
            let next =
                if is_inside { Some(index.wrapping_add_signed(step.by)) } else { grid.beside(node, step.offset) };
            let Some(next) = next else { continue };
            let found = metres[index] + (step.half_length * (costs[index] + costs[next])) as f32;
            if found < metres[next] {
                metres[next] = found;
                open.push(found.to_bits(), next as u32);
            }
        }
    }
    metres
}

/// A queue that gives the least key first, for keys that never fall below the last one given (a radix heap, Ahuja et al. 1990):
/// bucket k holds what differs from that one in the k-th bit at most.
#[derive(Debug)]
struct RadixQueue {
    last: u32,
    buckets: [Vec<(u32, u32)>; 33],
}

impl Default for RadixQueue {
    fn default() -> Self {
        Self { last: 0, buckets: core::array::from_fn(|_| Vec::new()) }
    }
}

impl RadixQueue {
    fn push(&mut self, key: u32, value: u32) {
        self.buckets[32 - (key ^ self.last).leading_zeros() as usize].push((key, value));
    }

    fn pop(&mut self) -> Option<(u32, u32)> {
        if self.buckets[0].is_empty() {
            let first = self.buckets.iter().position(|bucket| !bucket.is_empty())?;
            let mut bucket = core::mem::take(&mut self.buckets[first]);
            self.last = bucket.iter().map(|(key, _)| *key).min()?;
            bucket.drain(..).for_each(|(key, value)| self.push(key, value));
            self.buckets[first] = bucket;
        }
        self.buckets[0].pop()
    }
}

/// A step to a neighbour.
struct Step {
    offset: [isize; 3],
    /// Between the indices of the two.
    by: isize,
    /// Half of its length \[m\].
    half_length: f64,
}

fn steps(grid: &Grid) -> Vec<Step> {
    let [nx, ny, _] = grid.counts.map(|count| count as isize);
    let step = |offset: &[isize; 3]| {
        let length = libm::sqrt(offset.iter().map(|part| (part * part) as f64).sum());
        let [x, y, z] = *offset;
        Step { offset: *offset, by: x + nx * (y + ny * z), half_length: length * grid.spacing * 0.5 }
    };
    NEIGHBOURS.iter().map(step).collect()
}

#[cfg(test)]
mod tests {
    use super::RadixQueue;

    #[test]
    fn the_least_key_comes_first() {
        let (mut queue, mut waiting, mut number) = (RadixQueue::default(), vec![(0, 0)], 1_u32);
        queue.push(0, 0);
        while let Some((key, value)) = queue.pop() {
            let least = waiting.iter().map(|(key, _)| *key).min();
            assert_eq!(least, Some(key));
            let place = waiting.iter().position(|entry| *entry == (key, value)).expect("what was put in");
            waiting.swap_remove(place);
            // Two more for each of the first, which is never nearer.
            for by in [number.wrapping_mul(2_654_435_761) >> 12, number % 3] {
                if number < 400 {
                    waiting.push((key + by, number));
                    queue.push(key + by, number);
                    number += 1;
                }
            }
        }
        assert!(waiting.is_empty() && number == 400, "{number}");
    }
}
