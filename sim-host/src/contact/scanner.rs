//! A [`ScanMap`] as a simulation reads it: sixteen beams at once, in lanes, and only the bodies that they may reach.

use kestrel_core::scan::{PARALLEL, ScanMap, Slab};
use nalgebra::Vector3;

use super::scan_maps::ScanMaps;
use crate::sensor::{BEAM_LIMIT, Scan};
use crate::world::{Solid, World};

/// Edge of the cells that know what can be seen from inside them \[m\].
const CELL: f32 = 0.25;

/// Rounding of `f32`, generously \[m\].
const ROUNDING: f32 = 1e-4;

/// Beams that are clipped at once: two vectors of AVX2.
const BANK: usize = 16;

/// A world prepared for one scan.
#[derive(Clone, Debug)]
pub(super) struct Scanner {
    limit: f32,
    near_scale: Option<f32>,
    triples: Vec<Triple>,
    /// First triple and one past the last of each body.
    bodies: Vec<[u32; 2]>,
    /// For each position of the beams, of each sixteen of them in their order.
    positions: Vec<Vec<Bank>>,
    cells: Cells,
}

/// Up to sixteen beams.
#[derive(Clone, Debug)]
struct Bank {
    /// `-1 / direction.z` of beams that descend onto a floor, else zero.
    per_descent: [f32; BANK],
    /// Metres along each beam for a metre along each normal; most bodies of a room stand as another does.
    per_metre: Vec<[f32; BANK]>,
}

/// Three slabs of a body, all of a box: clipped at once, a beam keeps where it enters and leaves in registers.
#[derive(Clone, Copy, Debug)]
struct Triple {
    slabs: [Slab; 3],
    normals: [[f32; 3]; 3],
}

/// Where the three slabs begin and end along their normals, from a point \[m\].
type Spans = [[f32; 2]; 3];

/// Which bodies a beam can reach from where.
#[derive(Clone, Debug)]
struct Cells {
    low: [f32; 3],
    counts: [usize; 3],
    /// First entry of `visible` of each cell, and the end of the last; a world has 1,024 bodies at most.
    starts: Vec<u32>,
    visible: Vec<Visible>,
    /// Every body, for points outside of all cells.
    all: Vec<Visible>,
}

/// A body, and a bit for each bank with a beam that can reach it.
#[derive(Clone, Copy, Debug)]
struct Visible {
    body: u16,
    banks: u16,
}

/// Lowest and highest coordinates \[m, world\].
type Extent = (Vector3<f32>, Vector3<f32>);

impl Scanner {
    pub(super) fn new(world: &World, scan: &Scan) -> Self {
        let maps: Vec<_> = (0..scan.positions()).map(|position| ScanMaps::at(position, [world], scan)).collect();
        let extents: Vec<Extent> = world.solids.iter().map(extent).collect();
        let directions: Vec<_> = (0..scan.positions()).map(|position| scan.directions(position)).collect();
        let of_bank = |first: usize| {
            let beams = |of: &Vec<Vector3<f64>>| of[first..of.len().min(first + BANK)].to_vec();
            Reach::of(&directions.iter().flat_map(beams).collect::<Vec<_>>(), scan.limit)
        };
        let reaches: Vec<_> = (0..scan.len()).step_by(BANK).map(of_bank).collect();
        let banks = |maps: &ScanMaps| {
            (0..reaches.len()).map(|bank| Bank::new(&maps.map(0), bank * BANK)).collect::<Vec<_>>()
        };
        let map = maps[0].map(0);
        let (mut rest, mut triples) = (map.slabs, Vec::new());
        let mut body = |len: &u32| {
            let (slabs, others) = rest.split_at(*len as usize);
            rest = others;
            let first = triples.len() as u32;
            triples.extend(slabs.chunks(3).map(|slabs| Triple::new(slabs, map.normals)));
            [first, triples.len() as u32]
        };
        let bodies = map.bodies.iter().map(&mut body).collect();
        Self {
            limit: scan.limit,
            near_scale: scan.near_scale,
            positions: maps.iter().map(banks).collect(),
            bodies,
            triples,
            cells: Cells::new(&extents, &reaches),
        }
    }

    /// How near the nearest thing along each beam is: one at the drone, zero at the limit and beyond. Beams that sweep are
    /// elsewhere in every `reading`.
    #[inline(always)]
    pub(super) fn nearness(&self, point: [f32; 3], reading: usize) -> [f32; BEAM_LIMIT] {
        let banks = &self.positions[reading % self.positions.len()];
        let visible = self.cells.visible_from(point);
        let mut values = [0.0; BEAM_LIMIT];
        for (number, (values, bank)) in values.as_chunks_mut::<BANK>().0.iter_mut().zip(banks).enumerate() {
            let mut nearest = [self.limit; BANK];
            bank.meet_floor(point[2].max(0.0), &mut nearest);
            for visible in visible {
                if visible.banks >> number & 1 == 1 {
                    let [first, end] = self.bodies[usize::from(visible.body)];
                    bank.meet_body(&self.triples[first as usize..end as usize], point, self.limit, &mut nearest);
                }
            }
            self.read(&nearest, values);
        }
        values
    }

    /// What beams that meet something so far away read.
    #[inline(always)]
    fn read(&self, nearest: &[f32; BANK], values: &mut [f32; BANK]) {
        let limit = self.limit;
        match self.near_scale {
            None => *values = nearest.map(|distance| 1.0 - distance / limit),
            Some(scale) => {
                *values = nearest.map(|distance| (1.0 - distance / limit) * (scale / (scale + distance)));
            }
        }
    }
}

impl Triple {
    /// Up to three slabs, the last again where there are fewer.
    fn new(slabs: &[Slab], normals: &[[f32; 3]]) -> Self {
        let slabs = core::array::from_fn(|index| slabs[index.min(slabs.len() - 1)]);
        Self { slabs, normals: slabs.map(|slab| normals[slab.normal as usize]) }
    }

    #[inline(always)]
    fn spans(&self, [px, py, pz]: [f32; 3]) -> Spans {
        core::array::from_fn(|slab| {
            let [x, y, z] = self.normals[slab];
            let along = (x * px + y * py) + z * pz;
            [self.slabs[slab].low - along, self.slabs[slab].high - along]
        })
    }
}

impl Bank {
    /// The beams of the map from `first` on; where there are no more, what meets nothing.
    fn new(map: &ScanMap<'_>, first: usize) -> Self {
        let beams = map.per_descent.len();
        let mut per_descent = [0.0; BANK];
        for (value, of_map) in per_descent.iter_mut().zip(&map.per_descent[first..]) {
            *value = *of_map;
        }
        let per_metre =
            |of_map: &[f32]| core::array::from_fn(|beam| of_map.get(first + beam).copied().unwrap_or(PARALLEL));
        Self { per_descent, per_metre: map.per_metre.chunks(beams).map(per_metre).collect() }
    }

    /// Shortens the beams that meet a body.
    #[inline(always)]
    fn meet_body(&self, triples: &[Triple], point: [f32; 3], limit: f32, nearest: &mut [f32; BANK]) {
        let (mut enter, mut leave) = ([0.0; BANK], [limit; BANK]);
        let Some((last, before)) = triples.split_last() else { return };
        for triple in before {
            let (spans, per_metre) = (triple.spans(point), self.per_metres(triple));
            for beam in 0..BANK {
                (enter[beam], leave[beam]) = clip(&spans, per_metre, beam, (enter[beam], leave[beam]));
            }
        }
        let (spans, per_metre) = (last.spans(point), self.per_metres(last));
        for beam in 0..BANK {
            let (enter, leave) = clip(&spans, per_metre, beam, (enter[beam], leave[beam]));
            let meets = (enter <= leave) & (enter < nearest[beam]);
            nearest[beam] = if meets { enter } else { nearest[beam] };
        }
    }

    #[inline(always)]
    fn per_metres(&self, triple: &Triple) -> [&[f32; BANK]; 3] {
        triple.slabs.map(|slab| &self.per_metre[slab.normal as usize])
    }

    /// Shortens the beams that meet the floor, `height` below them.
    #[inline(always)]
    fn meet_floor(&self, height: f32, nearest: &mut [f32; BANK]) {
        for beam in 0..BANK {
            let floor = height * self.per_descent[beam];
            let meets = (self.per_descent[beam] > 0.0) & (floor < nearest[beam]);
            nearest[beam] = if meets { floor } else { nearest[beam] };
        }
    }
}

/// Leaves of a beam what is between the planes of three slabs.
#[inline(always)]
fn clip(
    spans: &Spans,
    per_metre: [&[f32; BANK]; 3],
    beam: usize,
    (mut enter, mut leave): (f32, f32),
) -> (f32, f32) {
    for slab in 0..3 {
        let [low, high] = spans[slab];
        let (one, other) = (low * per_metre[slab][beam], high * per_metre[slab][beam]);
        let (near, far) = if one < other { (one, other) } else { (other, one) };
        enter = if near > enter { near } else { enter };
        leave = if far < leave { far } else { leave };
    }
    (enter, leave)
}

impl Cells {
    fn new(extents: &[Extent], banks: &[Reach]) -> Self {
        let every_bank = ((1_u32 << banks.len()) - 1) as u16;
        let all = (0..extents.len() as u16).map(|body| Visible { body, banks: every_bank }).collect();
        let hull = extents.iter().copied().reduce(|(low, high), (a, b)| (low.inf(&a), high.sup(&b)));
        let Some((low, high)) = hull else {
            return Self { low: [0.0; 3], counts: [0; 3], starts: vec![0], visible: Vec::new(), all };
        };
        let counts: [usize; 3] = ((high - low) / CELL).map(|cells| cells.ceil().max(1.0) as usize).into();
        let (mut starts, mut visible) = (vec![0], Vec::new());
        for index in 0..counts.iter().product() {
            let (x, y, z) = (index % counts[0], index / counts[0] % counts[1], index / (counts[0] * counts[1]));
            let corner = low + Vector3::new(x as f32, y as f32, z as f32) * CELL;
            let cell = (corner, corner.add_scalar(CELL));
            for (body, extent) in extents.iter().enumerate() {
                let reaching = banks.iter().enumerate().filter(|(_, reach)| reach.may_meet(&cell, extent));
                let banks = reaching.fold(0, |bits, (bank, _)| bits | 1 << bank);
                if banks != 0 {
                    visible.push(Visible { body: body as u16, banks });
                }
            }
            starts.push(visible.len() as u32);
        }
        Self { low: low.into(), counts, starts, visible, all }
    }

    #[inline(always)]
    fn visible_from(&self, point: [f32; 3]) -> &[Visible] {
        let mut index = 0;
        for axis in [2, 1, 0] {
            // Whatever is below the first cell, or not a number, is cast to a number beyond the last.
            let place = (point[axis] - self.low[axis]) * (1.0 / CELL);
            let place = if place >= 0.0 { place as usize } else { usize::MAX };
            if place >= self.counts[axis] {
                return &self.all;
            }
            index = index * self.counts[axis] + place;
        }
        &self.visible[self.starts[index] as usize..self.starts[index + 1] as usize]
    }
}

/// How far the beams of a bank reach.
#[derive(Clone, Debug)]
struct Reach {
    /// Lowest and highest coordinates of the beams from the origin.
    extent: Extent,
    rings: Vec<Ring>,
    /// Ends of the beams from the origin \[m, world\]; none where there are more than a bank has, which sweep over what is between
    /// them.
    ends: Vec<Vector3<f32>>,
}

/// How far beams of one elevation reach \[m\].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Ring {
    /// Upwards, negative downwards.
    rise: f32,
    across: f32,
}

impl Reach {
    /// Those of some beams, ring by ring.
    fn of(directions: &[Vector3<f64>], limit: f32) -> Self {
        let limit = f64::from(limit);
        let (mut low, mut high) = (Vector3::zeros(), Vector3::zeros());
        let (mut rings, mut ends) = (Vec::new(), Vec::new());
        for beam in directions {
            let end = (beam * limit).map(|value| value as f32);
            (low, high) = (low.inf(&end), high.sup(&end));
            let across = (limit * (1.0 - beam.z * beam.z).max(0.0).sqrt()) as f32;
            rings.push(Ring { rise: end.z, across });
            ends.push(end);
        }
        rings.dedup();
        if ends.len() > BANK {
            ends.clear();
        }
        Self { extent: (low, high), rings, ends }
    }

    /// Whether such a beam from inside the cell may meet the body.
    fn may_meet(&self, (low, high): &Extent, (body_low, body_high): &Extent) -> bool {
        let (reach_low, reach_high) = self.extent;
        let beyond = (body_low - (high + reach_high)).sup(&((low + reach_low) - body_high));
        if beyond.max() > ROUNDING {
            return false;
        }
        let gaps = (body_low - high).sup(&(low - body_high)).add_scalar(-ROUNDING).sup(&Vector3::zeros());
        let may_meet = |ring: &Ring| {
            let rise = if body_low.z > high.z { ring.rise } else { -ring.rise };
            gaps.z <= rise.max(0.0) && gaps.xy().norm() <= ring.across
        };
        // From somewhere in the cell to somewhere in the body.
        let (first, last) = (body_low - high, body_high - low);
        self.rings.iter().any(may_meet)
            && (self.ends.is_empty() || self.ends.iter().any(|end| passes(end, &first, &last)))
    }
}

/// Whether the way from the origin to `end` passes through a box, or nearly.
fn passes(end: &Vector3<f32>, low: &Vector3<f32>, high: &Vector3<f32>) -> bool {
    let (mut enter, mut leave) = (0.0_f32, 1.0_f32);
    for axis in 0..3 {
        let (low, high) = (low[axis] - ROUNDING, high[axis] + ROUNDING);
        if end[axis].abs() > ROUNDING {
            let (one, other) = (low / end[axis], high / end[axis]);
            enter = enter.max(one.min(other));
            leave = leave.min(one.max(other));
        } else if low > 0.0 || high < 0.0 {
            return false;
        }
    }
    enter <= leave
}

fn extent(solid: &Solid) -> Extent {
    let (low, high) = solid.extent();
    (low.cast(), high.cast())
}
