//! A multizone time-of-flight ranger: distances in a square of zones ahead, all at once.

use kestrel_core::real::Real;
use nalgebra::Vector3;

use super::instrument::Sampling;
use crate::contact::{BANK, Cone, Rays};
use crate::seed::Stream;
use crate::swarm::Column;

/// Most zones along a side.
pub(crate) const TOF_SIDE_LIMIT: usize = 8;

/// Rays along each side of a zone: a post is met that covers half of it.
const RAYS_PER_SIDE: usize = 2;

/// Most banks of rays.
pub(crate) const TOF_BANK_LIMIT: usize = (TOF_SIDE_LIMIT * RAYS_PER_SIDE).pow(2) / BANK;

/// No sample is on its way.
const NEVER: f64 = -1.0;

/// A square of zones that a body carries before it, each of which measures the distance to the nearest thing in it. It sees what
/// never moves, and people.
#[derive(Clone, Debug, PartialEq)]
pub struct Tof {
    /// Zones along each side.
    side: usize,
    /// Nothing farther is seen \[m\].
    limit: f32,
    /// Standard deviation of the noise right at the sensor \[m\], and what each metre adds.
    noise: [f32; 2],
    sampling: Sampling,
    /// Unit vectors, body: one of each zone, then the next of each.
    rays: Vec<Rays>,
    /// Those of the middles of the zones.
    middles: Vec<Vector3<f32>>,
    /// Of the middle, body.
    axis: [f32; 3],
    /// Sine and cosine of the angle to a corner.
    half_angle: [f32; 2],
}

/// What a [`Tof`] is made from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TofParts {
    /// Zones along each side: 4 or 8.
    pub side: usize,
    /// Across a side \[rad\].
    pub field_of_view: f64,
    /// Of the middle below the body's nose \[rad\].
    pub pitch: f64,
    /// Nothing farther is seen \[m\].
    pub limit: f32,
    /// Standard deviation of the noise right at the sensor \[m\], and what each metre adds.
    pub noise: [f32; 2],
    /// When all zones measure, and when that arrives: before they measure again. Zones are lost one by one.
    pub sampling: Sampling,
}

/// What the rangers of a block remember, by lane.
#[derive(Clone, Debug)]
pub(crate) struct TofMemory<const LANES: usize, R> {
    /// Share of a sampling period that had passed when the episode began.
    phase: Column<LANES, R>,
    /// Reading at which what is on its way arrives.
    arrival: Column<LANES, R>,
    underway: Vec<Column<LANES, R>>,
}

impl Tof {
    /// The ranger of these parts.
    pub fn new(parts: &TofParts) -> Self {
        let TofParts { side, field_of_view, pitch, limit, noise, sampling } = *parts;
        let (dip, level) = libm::sincos(pitch);
        let fine = side * RAYS_PER_SIDE;
        // Equal angles, rows from the top and columns from the left.
        let angle = |place: usize| field_of_view * (0.5 - (place as f64 + 0.5) / fine as f64);
        let direction = |row: usize, column: usize| {
            let ((up, across), (left, ahead)) = (libm::sincos(angle(row)), libm::sincos(angle(column)));
            let (x, y, z) = (across * ahead, across * left, up);
            [x * level + z * dip, y, z * level - x * dip]
        };
        let mut directions = Vec::with_capacity(fine * fine);
        for part in 0..RAYS_PER_SIDE * RAYS_PER_SIDE {
            for zone in 0..side * side {
                let row = zone / side * RAYS_PER_SIDE + part / RAYS_PER_SIDE;
                directions.push(direction(row, zone % side * RAYS_PER_SIDE + part % RAYS_PER_SIDE));
            }
        }
        // Between its first ray and its last.
        let middle = |zone: usize| {
            let [first, last] =
                [zone, directions.len() - side * side + zone].map(|ray| Vector3::from(directions[ray]));
            (first + last).normalize().cast()
        };
        let bank = |directions: &[[f64; 3]; BANK]| -> Rays {
            core::array::from_fn(|axis| directions.map(|direction| direction[axis] as f32))
        };
        let axis = [level, 0.0, -dip];
        let corner = direction(0, 0);
        let cosine = corner.iter().zip(&axis).map(|(one, other)| one * other).sum::<f64>();
        Self {
            side,
            limit,
            noise,
            sampling,
            rays: directions.as_chunks().0.iter().map(bank).collect(),
            middles: (0..side * side).map(middle).collect(),
            axis: axis.map(|value| value as f32),
            half_angle: [(1.0 - cosine * cosine).sqrt() as f32, cosine as f32],
        }
    }

    /// Number of values, one for each zone: 1 at the sensor, 0 at the limit and where nothing was measured; row by row from
    /// the top, each from the left.
    #[expect(clippy::len_without_is_empty, reason = "no ranger has no zones")]
    pub const fn len(&self) -> usize {
        self.side * self.side
    }

    /// Where its rays go from a body here \[m\] with these axes, world; `rays` has room for them.
    #[inline(always)]
    pub(crate) fn cone<'a>(
        &self,
        apex: [f32; 3],
        world_from_body: &[[f32; 3]; 3],
        rays: &'a mut [Rays; TOF_BANK_LIMIT],
    ) -> Cone<'a> {
        for (turned, bank) in rays.iter_mut().zip(&self.rays) {
            for (turned, row) in turned.iter_mut().zip(world_from_body) {
                for (ray, turned) in turned.iter_mut().enumerate() {
                    *turned = (row[0] * bank[0][ray] + row[1] * bank[1][ray]) + row[2] * bank[2][ray];
                }
            }
        }
        let axis = world_from_body.map(|row| row[0] * self.axis[0] + row[2] * self.axis[2]);
        Cone { apex, axis, half_angle: self.half_angle, limit: self.limit, rays: &rays[..self.rays.len()] }
    }

    /// The nearest thing of each zone, of what its rays have met \[m\].
    #[inline(always)]
    fn zones(&self, distances: &[[f32; BANK]; TOF_BANK_LIMIT]) -> [[f32; BANK]; TOF_BANK_LIMIT / 4] {
        let banks = self.len() / BANK;
        let mut zones = [[self.limit; BANK]; TOF_BANK_LIMIT / 4];
        for (index, distances) in distances[..self.rays.len()].iter().enumerate() {
            for (zone, distance) in zones[index % banks].iter_mut().zip(distances) {
                *zone = if *distance < *zone { *distance } else { *zone };
            }
        }
        zones
    }

    /// What a zone reads that measured this distance \[m\].
    fn reading(&self, distance: f32, stream: &mut Stream) -> f32 {
        let (lost, normal) = (f64::from(stream.uniform()) < self.sampling.drop_out, stream.normal());
        if lost || distance >= self.limit {
            return 0.0;
        }
        let measured = distance + (self.noise[0] + self.noise[1] * distance) * normal;
        1.0 - measured.clamp(0.0, self.limit) / self.limit
    }
}

impl<const LANES: usize, R: Real> TofMemory<LANES, R> {
    pub(crate) fn new(tof: &Tof) -> Self {
        let nothing = [R::zero(); LANES];
        Self { phase: nothing, arrival: nothing, underway: vec![nothing; tof.len()] }
    }

    /// An episode begins, in which zones measure at an instant of their own.
    pub(crate) fn begin(&mut self, lane: usize, stream: &mut Stream) {
        self.phase[lane] = R::from_f32(stream.uniform());
        self.arrival[lane] = R::from_f64(NEVER);
    }

    /// Whether the zones of a lane measure at this reading of the episode, counted from zero.
    #[inline(always)]
    pub(crate) fn is_due(&self, tof: &Tof, lane: usize, reading: u32, control_secs: f64) -> bool {
        tof.sampling.due(u64::from(reading), self.phase[lane].to_f64(), control_secs)
    }

    /// Sends what the rays of a lane have met \[m\] on its way.
    pub(crate) fn send(
        &mut self,
        tof: &Tof,
        lane: usize,
        (distances, arrival): (&[[f32; BANK]; TOF_BANK_LIMIT], u32),
        stream: &mut Stream,
    ) {
        self.arrival[lane] = R::from_f64(f64::from(arrival));
        let zones = tof.zones(distances);
        for (column, distance) in self.underway.iter_mut().zip(zones.as_flattened()) {
            column[lane] = R::from_f32(tof.reading(*distance, stream));
        }
    }

    /// Where the zones of a lane, as they measured last, have met something \[m, world\], from a body here with these axes.
    pub(crate) fn met(
        &self,
        tof: &Tof,
        lane: usize,
        (place, world_from_body): (&Vector3<f32>, &[[f32; 3]; 3]),
    ) -> impl Iterator<Item = Vector3<f32>> {
        let rows = world_from_body.map(Vector3::from);
        self.underway.iter().zip(&tof.middles).filter_map(move |(column, middle)| {
            let nearness = column[lane].to_f32();
            let distance = tof.limit * (1.0 - nearness);
            (nearness > 0.0).then(|| place + Vector3::from(rows.map(|row| row.dot(middle))) * distance)
        })
    }

    /// What arrives at this reading goes to the measurements of the lane, the rest of which stay.
    #[inline(always)]
    pub(crate) fn deliver(&self, lane: usize, reading: u32, measurements: &mut [Column<LANES, R>]) {
        if self.arrival[lane].to_f64() == f64::from(reading) {
            for (column, values) in measurements.iter_mut().zip(&self.underway) {
                column[lane] = values[lane];
            }
        }
    }

    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        [&mut self.phase, &mut self.arrival].into_iter().chain(&mut self.underway)
    }
}

impl Tof {
    /// Control periods from a measurement to its arrival; the first of an episode is there at once.
    pub(crate) fn delay(&self, reading: u32, control_secs: f64) -> u32 {
        if reading == 0 { 0 } else { self.sampling.delay(control_secs) as u32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact::{Arena, ContactReport};
    use crate::seed::{Purpose, Seed};
    use crate::world::{Floor, Pose, Shape, Solid, World};
    use kestrel_core::airframe::CF2X;
    use kestrel_core::attitude::Attitude;

    const PARTS: TofParts = TofParts {
        side: 8,
        field_of_view: core::f64::consts::FRAC_PI_4,
        pitch: 0.0,
        limit: 4.0,
        noise: [0.0; 2],
        sampling: Sampling { rate_hz: 15.0, latency_secs: 0.04, drop_out: 0.0 },
    };

    fn seen(world: &World, place: [f32; 3], attitude: &Attitude<f64>, parts: &TofParts) -> Vec<f32> {
        let (tof, arena) = (Tof::new(parts), Arena::new(world, &CF2X, ContactReport::Touch));
        let mut rays = [[[0.0; BANK]; 3]; TOF_BANK_LIMIT];
        let mut distances = [[0.0; BANK]; TOF_BANK_LIMIT];
        let rows = attitude.rows().map(|row| row.map(|value| value as f32));
        arena.distances_in(&tof.cone(place, &rows, &mut rays), &[], &mut distances);
        tof.zones(&distances).as_flattened()[..tof.len()].to_vec()
    }

    /// Bodies of every shape, turned, around a place.
    fn crowd() -> World {
        let corners = |x: f64| {
            let signs = [(-0.2, -0.1), (0.2, -0.1), (0.0, 0.2)];
            signs.map(|(y, z)| Vector3::new(x, y, z))
        };
        let hull = [corners(-0.1), corners(0.15)].concat();
        let shapes = [
            Shape::Cuboid(Vector3::new(0.1, 0.2, 0.3)),
            Shape::Cylinder { radius: 0.2, half_height: 0.4 },
            Shape::Sphere(0.25),
            Shape::Hull(hull),
        ];
        let blank = Solid::block("body", Vector3::zeros(), Vector3::zeros());
        let solid = |(number, shape): (usize, Shape)| {
            let (sine, cosine) = libm::sincos(0.5 * number as f64 - 0.7);
            let axis = Vector3::new(0.6, 0.0, 0.8);
            let pose = Pose {
                position: Vector3::new(1.6 * cosine, 1.6 * sine, 1.0 + 0.1 * number as f64),
                world_from_body: Attitude::from_axis_angle(axis, 0.4 * number as f64),
            };
            Solid { shape, pose, ..blank.clone() }
        };
        World {
            floor: Floor::Solid,
            solids: shapes.into_iter().enumerate().map(solid).collect(),
            ..World::empty()
        }
    }

    #[test]
    fn a_ray_meets_what_parry_says_it_does() {
        let (world, mut met) = (crowd(), 0);
        let (tof, arena) = (Tof::new(&PARTS), Arena::new(&world, &CF2X, ContactReport::Touch));
        for turn in 0..24 {
            let attitude =
                Attitude::from_axis_angle(Vector3::new(0.1, 0.3, 0.9).normalize(), 0.26 * f64::from(turn));
            let rows = attitude.rows().map(|row| row.map(|value| value as f32));
            let apex = [0.1, -0.05, 0.9];
            let mut rays = [[[0.0; BANK]; 3]; TOF_BANK_LIMIT];
            let mut distances = [[0.0; BANK]; TOF_BANK_LIMIT];
            let cone = tof.cone(apex, &rows, &mut rays);
            arena.distances_in(&cone, &[], &mut distances);
            for (bank, distances) in cone.rays.iter().zip(&distances) {
                for (ray, distance) in distances.iter().enumerate() {
                    let along = Vector3::new(bank[0][ray], bank[1][ray], bank[2][ray]).cast();
                    let expected = arena.raycast(Vector3::from(apex).cast(), along, 4.0).unwrap_or(4.0);
                    let error = (f64::from(*distance) - expected).abs();
                    assert!(error < 2e-3, "turn {turn}, ray {ray}: {distance} m, {expected} m");
                    met += usize::from(expected < 4.0);
                }
            }
        }
        assert!(met > 1000, "{met}");
    }

    #[test]
    fn the_first_zone_is_at_the_top_left_and_angles_are_equal() {
        let ball = |y: f64, z: f64| {
            let blank = Solid::block("ball", Vector3::zeros(), Vector3::zeros());
            Solid { shape: Shape::Sphere(0.05), pose: Pose::at(Vector3::new(1.0, y, 2.0 + z)), ..blank }
        };
        // The outermost zones reach from 16.9 to 22.5 degrees.
        let aside = 19.7_f64.to_radians().tan();
        let world = World { solids: vec![ball(aside, aside / 19.7_f64.to_radians().cos())], ..World::empty() };
        let zones = seen(&world, [0.0, 0.0, 2.0], &Attitude::level(), &PARTS);
        let nearest = zones.iter().position(|distance| *distance < 4.0);
        assert_eq!((nearest, zones.iter().filter(|distance| **distance < 4.0).count()), (Some(0), 1));
    }

    #[test]
    fn it_looks_where_the_nose_points_and_a_pitch_looks_below() {
        let level = World { floor: Floor::Solid, ..World::empty() };
        let seen_below = |pitch_deg: f64, attitude: Attitude<f64>| {
            let zones =
                seen(&level, [0.0, 0.0, 0.5], &attitude, &TofParts { pitch: pitch_deg.to_radians(), ..PARTS });
            zones.iter().filter(|distance| **distance < 4.0).count()
        };
        let nose_down = Attitude::from_axis_angle(Vector3::y(), 30_f64.to_radians());
        assert_eq!(seen_below(30.0, Attitude::level()), seen_below(0.0, nose_down));
        assert!(seen_below(0.0, Attitude::level()) < seen_below(30.0, Attitude::level()));
        assert_eq!(seen_below(-60.0, Attitude::level()), 0);
    }

    #[test]
    fn a_measurement_is_held_and_arrives_late() {
        let tof = Tof::new(&PARTS);
        let mut stream = Stream::new(Seed(3), 0, Purpose::Reset);
        let mut memory = TofMemory::<1, f32>::new(&tof);
        memory.begin(0, &mut stream);
        let mut measurements = vec![[0.0]; tof.len()];
        let (mut readings, mut sent) = (Vec::new(), Vec::new());
        for reading in 0..60 {
            memory.deliver(0, reading, &mut measurements);
            if memory.is_due(&tof, 0, reading, 0.02) {
                // What is measured says when.
                let distances = [[4.0 - 0.01 * (reading as f32 + 1.0); BANK]; TOF_BANK_LIMIT];
                memory.send(&tof, 0, (&distances, reading + tof.delay(reading, 0.02)), &mut stream);
                sent.push(reading);
                memory.deliver(0, reading, &mut measurements);
            }
            readings.push((measurements[0][0] * 400.0).round() as i32 - 1);
        }
        // 1.2 seconds, fifteen times a second, and the one that was there at the start.
        assert!((18..=19).contains(&sent.len()), "{sent:?}");
        assert_eq!(readings[0], 0, "the ranger was running before");
        for reading in sent.iter().skip(1).take(15) {
            let arrived = readings.iter().position(|seen| *seen == *reading as i32);
            assert_eq!(arrived, Some(*reading as usize + 2), "two control periods are 40 ms");
        }
    }

    #[test]
    fn noise_grows_with_the_distance_and_zones_get_lost() {
        let sampling = Sampling { drop_out: 0.25, ..PARTS.sampling };
        let tof = Tof::new(&TofParts { noise: [0.01, 0.02], sampling, ..PARTS });
        let mut stream = Stream::new(Seed(5), 0, Purpose::Reset);
        for (distance, expected) in [(0.5_f32, 0.02_f32), (3.0, 0.07)] {
            let readings: Vec<f32> = (0..4000).map(|_| tof.reading(distance, &mut stream)).collect();
            let kept: Vec<f32> =
                readings.iter().filter(|value| **value > 0.0).map(|value| 4.0 - 4.0 * value).collect();
            assert!((kept.len() as f32 / 4000.0 - 0.75).abs() < 0.03);
            let mean = kept.iter().sum::<f32>() / kept.len() as f32;
            let variance = kept.iter().map(|value| (value - mean).powi(2)).sum::<f32>() / kept.len() as f32;
            assert!((mean - distance).abs() < 0.01 && (variance.sqrt() / expected - 1.0).abs() < 0.06);
        }
        assert_eq!(tof.reading(4.0, &mut stream), 0.0);
    }
}
