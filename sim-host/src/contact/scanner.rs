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
    /// Of the slabs, each once: most bodies of a room stand as another does.
    normals: Vec<[f32; 3]>,
    slabs: Vec<Slab>,
    /// First slab and one past the last of each body.
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
    /// Metres along each beam for a metre along each normal.
    per_metre: Vec<[f32; BANK]>,
}

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
        let mut ends = 0;
        let body = |len: &u32| {
            let first = ends;
            ends += len;
            [first, ends]
        };
        Self {
            limit: scan.limit,
            near_scale: scan.near_scale,
            positions: maps.iter().map(banks).collect(),
            normals: map.normals.to_vec(),
            slabs: map.slabs.to_vec(),
            bodies: map.bodies.iter().map(body).collect(),
            cells: Cells::new(&extents, &reaches),
        }
    }

    /// How near the nearest thing along each beam is: one at the drone, zero at the limit and beyond. Beams that sweep are
    /// elsewhere in every `reading`.
    #[inline(always)]
    pub(super) fn nearness(&self, point: [f32; 3], reading: usize) -> [f32; BEAM_LIMIT] {
        let limit = self.limit;
        let banks = &self.positions[reading % self.positions.len()];
        let mut nearest = [limit; BEAM_LIMIT];
        let height = point[2].max(0.0);
        for (nearest, bank) in nearest.as_chunks_mut::<BANK>().0.iter_mut().zip(banks) {
            bank.meet_floor(height, nearest);
        }
        for visible in self.cells.visible_from(point) {
            let [first, end] = self.bodies[usize::from(visible.body)];
            let slabs = &self.slabs[first as usize..end as usize];
            for (number, nearest) in nearest.as_chunks_mut::<BANK>().0.iter_mut().enumerate() {
                if visible.banks >> number & 1 == 1 {
                    self.meet_body(&banks[number], slabs, point, nearest);
                }
            }
        }
        match self.near_scale {
            None => nearest.map(|distance| 1.0 - distance / limit),
            Some(scale) => nearest.map(|distance| (1.0 - distance / limit) * (scale / (scale + distance))),
        }
    }

    /// Shortens the beams of a bank that meet a body.
    #[inline(always)]
    fn meet_body(&self, bank: &Bank, slabs: &[Slab], point: [f32; 3], nearest: &mut [f32; BANK]) {
        let mut enter = [0.0_f32; BANK];
        let mut leave = [self.limit; BANK];
        for slab in slabs {
            let [x, y, z] = self.normals[slab.normal as usize];
            let along = (x * point[0] + y * point[1]) + z * point[2];
            let per_metre = &bank.per_metre[slab.normal as usize];
            clip([slab.low - along, slab.high - along], per_metre, &mut enter, &mut leave);
        }
        for beam in 0..BANK {
            let meets = (enter[beam] <= leave[beam]) & (enter[beam] < nearest[beam]);
            nearest[beam] = if meets { enter[beam] } else { nearest[beam] };
        }
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

/// Leaves of each beam what is between two planes, so far away along their normal.
#[inline(always)]
fn clip([low, high]: [f32; 2], per_metre: &[f32; BANK], enter: &mut [f32; BANK], leave: &mut [f32; BANK]) {
    for beam in 0..BANK {
        let (one, other) = (low * per_metre[beam], high * per_metre[beam]);
        let (near, far) = if one < other { (one, other) } else { (other, one) };
        enter[beam] = if near > enter[beam] { near } else { enter[beam] };
        leave[beam] = if far < leave[beam] { far } else { leave[beam] };
    }
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
        let mut rings = Vec::new();
        for beam in directions {
            let end = (beam * limit).map(|value| value as f32);
            (low, high) = (low.inf(&end), high.sup(&end));
            let across = (limit * (1.0 - beam.z * beam.z).max(0.0).sqrt()) as f32;
            rings.push(Ring { rise: end.z, across });
        }
        rings.dedup();
        Self { extent: (low, high), rings }
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
        self.rings.iter().any(may_meet)
    }
}

fn extent(solid: &Solid) -> Extent {
    let (low, high) = solid.extent();
    (low.cast(), high.cast())
}
