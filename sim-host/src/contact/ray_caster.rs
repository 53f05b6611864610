//! Rays from one point in any directions, sixteen at a time in lanes, against the exact shapes of a world.

use nalgebra::Vector3;

use super::Motion;
use super::scan_maps::local_planes;
use crate::world::{Drive, Floor, Movable, Shape, Solid, World};

/// Rays that are cast at once: two vectors of AVX2.
pub(crate) const BANK: usize = 16;

/// A ray that goes less far along a normal per metre is parallel to its plane.
const PARALLEL: f32 = 1e-9;

/// Rounding of `f32`, generously \[m\].
const ROUNDING: f32 = 1e-4;

/// Sixteen unit vectors, `[axis][ray]`.
pub(crate) type Rays = [[f32; BANK]; 3];

/// Rays that leave a point within a cone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cone<'a> {
    /// \[m, world\].
    pub(crate) apex: [f32; 3],
    /// Unit vector, world.
    pub(crate) axis: [f32; 3],
    /// Sine and cosine of its half angle, below a right one.
    pub(crate) half_angle: [f32; 2],
    /// Nothing farther is met \[m\].
    pub(crate) limit: f32,
    /// World.
    pub(crate) rays: &'a [Rays],
}

/// The bodies of a world that never move, and the people in it, as rays see them.
#[derive(Clone, Debug)]
pub(super) struct RayCaster {
    floor: Floor,
    bodies: Vec<Target>,
    /// Which of the movables they are, and where they start.
    people: Vec<(usize, Target)>,
}

/// A body in its own frame.
#[derive(Clone, Debug)]
struct Target {
    /// \[m, world\].
    origin: [f32; 3],
    /// Its axes, world.
    axes: [[f32; 3]; 3],
    /// Of the ball around it \[m\].
    radius: f32,
    surface: Surface,
}

/// What is inside lies between all slabs, and within the radius of a round one.
#[derive(Clone, Debug)]
struct Surface {
    /// Unit normal, least and greatest coordinate along it \[m\].
    slabs: Vec<([f32; 3], [f32; 2])>,
    round: Round,
}

/// \[m\].
#[derive(Clone, Copy, Debug)]
enum Round {
    Nothing,
    /// About the z axis.
    Cylinder(f32),
    Ball(f32),
}

/// From where to where each ray is inside \[m\].
struct Inside {
    enter: [f32; BANK],
    leave: [f32; BANK],
}

impl RayCaster {
    pub(super) fn new(world: &World) -> Self {
        let is_person = |(_, movable): &(usize, &Movable)| matches!(movable.drive, Drive::Walking(_));
        let people = world.movables.iter().enumerate().filter(is_person);
        Self {
            floor: world.floor,
            bodies: world.solids.iter().map(Target::new).collect(),
            people: people.map(|(index, movable)| (index, Target::new(&movable.solid))).collect(),
        }
    }

    /// How far away the nearest thing is along each ray of a cone \[m\], with the movables where they are now; the limit where
    /// there is none.
    #[inline(always)]
    pub(super) fn distances(&self, cone: &Cone<'_>, movables: &[Motion], distances: &mut [[f32; BANK]]) {
        for (distances, rays) in distances.iter_mut().zip(cone.rays) {
            *distances = [cone.limit; BANK];
            if self.floor == Floor::Solid {
                meet_floor(cone.apex[2].max(0.0), rays, distances);
            }
        }
        for body in &self.bodies {
            if body.is_in(cone) {
                for (distances, rays) in distances.iter_mut().zip(cone.rays) {
                    body.meet(&cone.apex, rays, distances);
                }
            }
        }
        for (index, person) in &self.people {
            // Whoever walks does not turn: seen from where it started, everything else has moved the other way.
            let gone = movables[*index].pose.position.map(|value| value as f32) - Vector3::from(person.origin);
            let apex = (Vector3::from(cone.apex) - gone).into();
            if person.is_in(&Cone { apex, ..*cone }) {
                for (distances, rays) in distances.iter_mut().zip(cone.rays) {
                    person.meet(&apex, rays, distances);
                }
            }
        }
    }
}

impl Target {
    fn new(solid: &Solid) -> Self {
        let rows = solid.pose.world_from_body.rows();
        let narrow = |vector: Vector3<f64>| vector.map(|value| value as f32).into();
        Self {
            origin: narrow(solid.pose.position),
            axes: core::array::from_fn(|axis| rows.map(|row| row[axis] as f32)),
            radius: solid.shape.reach() as f32,
            surface: Surface::of(&solid.shape),
        }
    }

    /// Whether a ray of the cone may meet it.
    #[inline(always)]
    fn is_in(&self, cone: &Cone<'_>) -> bool {
        let to = difference(&self.origin, &cone.apex);
        let (square, along) = (dot(&to, &to), dot(&to, &cone.axis));
        let reach = self.radius + ROUNDING;
        if square <= reach * reach {
            return true;
        }
        if square.sqrt() - reach > cone.limit {
            return false;
        }
        // How far the middle is from the cone's surface, outside of it.
        let aside = (square - along * along).max(0.0).sqrt();
        let [sine, cosine] = cone.half_angle;
        aside * cosine - along * sine <= reach
    }

    /// Shortens the rays that meet it.
    #[inline(always)]
    fn meet(&self, apex: &[f32; 3], rays: &Rays, nearest: &mut [f32; BANK]) {
        let from = difference(apex, &self.origin);
        let from = self.axes.map(|axis| dot(&axis, &from));
        let mut along = [[0.0; BANK]; 3];
        for (along, axis) in along.iter_mut().zip(&self.axes) {
            *along = project(rays, axis);
        }
        let mut inside = Inside { enter: [0.0; BANK], leave: *nearest };
        match self.surface.round {
            Round::Nothing => {}
            Round::Cylinder(radius) => inside.within_round(&[from[0], from[1]], [&along[0], &along[1]], radius),
            Round::Ball(radius) => inside.within_round(&from, [&along[0], &along[1], &along[2]], radius),
        }
        for (normal, bounds) in &self.surface.slabs {
            let place = dot(normal, &from);
            inside.within_slab([bounds[0] - place, bounds[1] - place], &project(&along, normal));
        }
        for ray in 0..BANK {
            let meets = inside.enter[ray] <= inside.leave[ray];
            nearest[ray] = if meets { inside.enter[ray] } else { nearest[ray] };
        }
    }
}

impl Surface {
    fn of(shape: &Shape) -> Self {
        let slabs = |planes: Vec<(Vector3<f64>, f64, f64)>| {
            let slab = |(normal, low, high): (Vector3<f64>, f64, f64)| {
                (normal.map(|value| value as f32).into(), [low as f32, high as f32])
            };
            planes.into_iter().map(slab).collect()
        };
        match shape {
            Shape::Cuboid(_) | Shape::Hull(_) | Shape::Mesh(_) => {
                Self { slabs: slabs(local_planes(shape)), round: Round::Nothing }
            }
            Shape::Cylinder { radius, half_height } => Self {
                slabs: slabs(vec![(Vector3::z(), -half_height, *half_height)]),
                round: Round::Cylinder(*radius as f32),
            },
            Shape::Sphere(radius) => Self { slabs: Vec::new(), round: Round::Ball(*radius as f32) },
        }
    }
}

impl Inside {
    /// Leaves what is between two planes, so far away along their normal.
    #[inline(always)]
    fn within_slab(&mut self, [low, high]: [f32; 2], along: &[f32; BANK]) {
        for ray in 0..BANK {
            let rate = if along[ray].abs() < PARALLEL { PARALLEL } else { along[ray] };
            let (one, other) = (low / rate, high / rate);
            let (near, far) = if one < other { (one, other) } else { (other, one) };
            self.enter[ray] = if near > self.enter[ray] { near } else { self.enter[ray] };
            self.leave[ray] = if far < self.leave[ray] { far } else { self.leave[ray] };
        }
    }

    /// Leaves what is nearer than a radius to the origin, in as many coordinates as are given.
    #[inline(always)]
    fn within_round<const AXES: usize>(&mut self, from: &[f32; AXES], along: [&[f32; BANK]; AXES], radius: f32) {
        let beyond = from.iter().fold(0.0, |sum, place| sum + place * place) - radius * radius;
        for ray in 0..BANK {
            let (mut square, mut towards) = (PARALLEL, 0.0);
            for (along, place) in along.iter().zip(from) {
                square += along[ray] * along[ray];
                towards -= along[ray] * place;
            }
            let discriminant = towards * towards - square * beyond;
            let meets = discriminant >= 0.0;
            let root = if meets { discriminant } else { 0.0 }.sqrt();
            let (near, far) = ((towards - root) / square, (towards + root) / square);
            self.enter[ray] = if near > self.enter[ray] { near } else { self.enter[ray] };
            let far = if meets { far } else { -1.0 };
            self.leave[ray] = if far < self.leave[ray] { far } else { self.leave[ray] };
        }
    }
}

/// Shortens the rays that meet the floor, `height` below them.
#[inline(always)]
fn meet_floor(height: f32, rays: &Rays, nearest: &mut [f32; BANK]) {
    for (nearest, rise) in nearest.iter_mut().zip(&rays[2]) {
        let floor = height / -(if *rise > -PARALLEL { -PARALLEL } else { *rise });
        *nearest = if floor < *nearest { floor } else { *nearest };
    }
}

/// How far each ray goes along a normal per metre.
#[inline(always)]
fn project(rays: &Rays, normal: &[f32; 3]) -> [f32; BANK] {
    let mut along = [0.0; BANK];
    for (ray, along) in along.iter_mut().enumerate() {
        *along = (rays[0][ray] * normal[0] + rays[1][ray] * normal[1]) + rays[2][ray] * normal[2];
    }
    along
}

#[inline(always)]
fn dot(one: &[f32; 3], other: &[f32; 3]) -> f32 {
    (one[0] * other[0] + one[1] * other[1]) + one[2] * other[2]
}

#[inline(always)]
fn difference(one: &[f32; 3], other: &[f32; 3]) -> [f32; 3] {
    [one[0] - other[0], one[1] - other[1], one[2] - other[2]]
}
