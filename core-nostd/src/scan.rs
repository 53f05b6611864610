//! A lidar that there is not: beams cast in a map, from where the drone is.
//!
//! A policy that learned with the simulator's `scan` sees distances that no deck of a Crazyflie measures. Where everything that
//! stands in the room is known, they follow from the position: a body is a set of slabs (pairs of parallel planes), and a beam is
//! inside it between the last slab that it enters and the first that it leaves (Kay & Kajiya 1986). The beams keep their
//! directions in the world, so that what a beam does to the planes of a body that never moves is in the map: for every
//! normal of a slab and every beam the metres along the beam for a metre along the normal.
//!
//! The simulator casts its beams with the same numbers in the same order: the values are the same to the bit.

/// Relative, of `f32`, generously: a body that is beyond the limit by no more than that is looked at.
const ROUNDING: f32 = 1e-4;

/// Metres along a beam that is parallel to a slab for a metre along its normal: beyond the limit of any scan, and finite.
pub const PARALLEL: f32 = 1e6;

/// Slabs of a body that are looked at once for all beams; of those beyond, each beam looks for itself.
const SPANS: usize = 33;

/// The space between two parallel planes.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct Slab {
    /// Which of the map's normals.
    pub normal: u32,
    /// Where it begins along the normal \[m, world\].
    pub low: f32,
    /// Where it ends \[m, world\].
    pub high: f32,
}

/// What beams of fixed directions see of a room in which nothing moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScanMap<'a> {
    /// Nothing farther is seen \[m\].
    pub limit: f32,
    /// With a scale `s` \[m\] a beam reads `(1 - d / limit) s / (s + d)` for a distance `d`, without one `1 - d / limit`.
    pub near_scale: Option<f32>,
    /// Metres along each beam for a metre of height above the floor; zero for a beam that meets no floor.
    pub per_descent: &'a [f32],
    /// Unit normals of slabs, world.
    pub normals: &'a [[f32; 3]],
    /// For each normal, for each beam: metres along the beam for a metre along the normal.
    pub per_metre: &'a [f32],
    /// For each normal, a bit for each beam that goes along it, and for each that goes against it.
    pub sides: &'a [[u64; 2]],
    /// Slabs, body by body.
    pub slabs: &'a [Slab],
    /// How many slabs each body has.
    pub bodies: &'a [u32],
}

impl ScanMap<'_> {
    /// Writes how near the nearest thing along each beam from `point` \[m, world\] is: one at the drone, zero at the limit and
    /// beyond. Beams for which there is no room in `out` are left out.
    pub fn nearness(&self, point: &[f32; 3], out: &mut [f32]) {
        let [.., z] = *point;
        let height = if z > 0.0 { z } else { 0.0 };
        for (nearest, &per_descent) in out.iter_mut().zip(self.per_descent) {
            let floor = height * per_descent;
            *nearest = if per_descent > 0.0 && floor < self.limit { floor } else { self.limit };
        }
        let mut rest = self.slabs;
        let mut spans = [[0.0; 2]; SPANS];
        for &len in self.bodies {
            let (slabs, others) = rest.split_at_checked(len as usize).unwrap_or_default();
            rest = others;
            let mut beams = self.candidates(slabs, point, &mut spans);
            while beams != 0 {
                let beam = beams.trailing_zeros() as usize;
                beams &= beams - 1;
                if let Some(nearest) = out.get_mut(beam) {
                    *nearest = self.met(slabs, point, &spans, (beam, *nearest));
                }
            }
        }
        for nearest in out.iter_mut().take(self.per_descent.len()) {
            let nearness = 1.0 - *nearest / self.limit;
            *nearest = self.near_scale.map_or(nearness, |scale| nearness * (scale / (scale + *nearest)));
        }
    }

    /// Where the slab begins and ends along its normal, from the point \[m\].
    #[inline(always)]
    fn span(&self, slab: &Slab, [px, py, pz]: &[f32; 3]) -> [f32; 2] {
        let [x, y, z] = self.normals.get(slab.normal as usize).copied().unwrap_or_default();
        let along = (x * px + y * py) + z * pz;
        [slab.low - along, slab.high - along]
    }

    /// A bit for each beam that may meet the body: none where a slab is beyond the limit, only those toward every slab that
    /// the point is not in. Writes the first of the slabs' spans.
    fn candidates(&self, slabs: &[Slab], point: &[f32; 3], spans: &mut [[f32; 2]; SPANS]) -> u64 {
        let reach = self.limit * (1.0 + ROUNDING);
        let aside = reach / PARALLEL;
        let mut beams = (1_u64.unbounded_shl(self.per_descent.len() as u32)).wrapping_sub(1);
        for (index, slab) in slabs.iter().enumerate() {
            let [low, high] = self.span(slab, point);
            if let Some(place) = spans.get_mut(index) {
                *place = [low, high];
            }
            let [along, against] = self.sides.get(slab.normal as usize).copied().unwrap_or_default();
            beams &= if low > aside {
                along
            } else if -high > aside {
                against
            } else {
                u64::MAX
            };
            if beams == 0 || low > reach || -high > reach {
                return 0;
            }
        }
        beams
    }

    /// Distance to the body along the beam where that is less than `nearest` \[m\].
    #[inline(always)]
    fn met(
        &self,
        slabs: &[Slab],
        point: &[f32; 3],
        spans: &[[f32; 2]; SPANS],
        (beam, nearest): (usize, f32),
    ) -> f32 {
        let (mut enter, mut leave) = (0.0, self.limit);
        for (index, slab) in slabs.iter().enumerate() {
            let [low, high] = spans.get(index).copied().unwrap_or_else(|| self.span(slab, point));
            let place = slab.normal as usize * self.per_descent.len() + beam;
            let per_metre = self.per_metre.get(place).copied().unwrap_or_default();
            let (one, other) = (low * per_metre, high * per_metre);
            let (near, far) = if one < other { (one, other) } else { (other, one) };
            enter = if near > enter { near } else { enter };
            leave = if far < leave { far } else { leave };
            // The next slabs can only shorten what is inside.
            if enter > leave || enter >= nearest {
                return nearest;
            }
        }
        enter
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of a metre, three metres in front, seen along x and downwards.
    fn map(near_scale: Option<f32>) -> ScanMap<'static> {
        ScanMap {
            limit: 4.0,
            near_scale,
            per_descent: &[0.0, 1.0],
            normals: &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            per_metre: &[1.0, PARALLEL, PARALLEL, PARALLEL, PARALLEL, -1.0],
            sides: &[[1, 0], [0, 0], [0, 2]],
            slabs: &[
                Slab { normal: 0, low: 3.0, high: 4.0 },
                Slab { normal: 1, low: -0.5, high: 0.5 },
                Slab { normal: 2, low: 0.0, high: 1.0 },
            ],
            bodies: &[3],
        }
    }

    #[test]
    fn beams_end_at_bodies_and_at_the_floor() {
        let mut seen = [9.0; 3];
        map(None).nearness(&[1.0, 0.25, 0.5], &mut seen);
        assert_eq!(seen, [0.5, 0.875, 9.0]);
        map(None).nearness(&[3.5, 0.0, 2.0], &mut seen);
        assert_eq!(seen, [0.0, 0.75, 9.0], "above the box: nothing in front, its lid below");
        map(None).nearness(&[3.5, 0.0, 0.5], &mut seen);
        assert_eq!(seen, [1.0, 1.0, 9.0], "inside of the box");
        map(None).nearness(&[-2.0, 0.0, -1.0], &mut seen);
        assert_eq!(seen, [0.0, 1.0, 9.0], "out of reach, below the floor");
    }

    #[test]
    fn near_things_are_seen_finer_with_a_scale() {
        let mut seen = [9.0; 2];
        map(Some(0.5)).nearness(&[1.0, 0.0, 0.5], &mut seen);
        assert_eq!(seen, [0.5 * (0.5 / 2.5), 0.875 * (0.5 / 1.0)]);
    }

    #[test]
    fn a_map_that_is_damaged_is_no_panic() {
        let slabs = [Slab { normal: 7, low: 0.0, high: 1.0 }];
        let damaged = ScanMap { slabs: &slabs, bodies: &[1, 5], ..map(None) };
        let mut seen = [9.0; 1];
        damaged.nearness(&[f32::NAN, 0.0, 1.0], &mut seen);
        assert!((0.0..=1.0).contains(&seen[0]));
    }
}
