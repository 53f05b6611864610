//! A group's substep in `clean` where nothing can be pushed but drones.
//!
//! Where a side of a box or the floor is all that a drone can meet, its points of contact have a closed form; parry finds
//! them everywhere else. Nothing is remembered: a drone that rests is held anew in every substep.

use nalgebra::Vector3;
use rapier3d::parry::query::{ContactManifold, DefaultQueryDispatcher, PersistentQueryDispatcher as _};
use rapier3d::parry::shape::Shape;

use super::frame::{compose, from_vector, relative, to_pose};
use super::group::{DRONE_FRICTION, End, FLOOR_FRICTION, Group, HullSize, Member, Start};
use super::impulses::{self, Constraint, Mobile};
use super::outline::{MARGIN, Outline, Plane};
use crate::world::Pose;

/// Sine of the tilt below which no point of a rim is the lowest.
const LEVEL: f64 = 1e-6;

/// What a drone may meet.
struct Other<'a> {
    /// Index among the members, if it can move.
    member: Option<usize>,
    friction: f64,
    /// Thickness of its skin \[m\].
    skin: f64,
    surface: Surface<'a>,
}

enum Surface<'a> {
    /// One side is all that can be met.
    Plane(Plane),
    Shape(&'a dyn Shape, Pose),
}

/// A drone among what it may meet, by its index among the members.
struct Encounter<'a> {
    group: &'a Group<'a>,
    index: usize,
    pose: Pose,
    /// Gap from which on a point is prepared for \[m\].
    prediction: f64,
}

/// Steps the group.
pub(super) fn step(group: &Group<'_>, starts: &[Start]) -> Vec<End> {
    let mobile = |(member, start): (&Member, &Start)| {
        let inertia = group.inertia(*member);
        Mobile::new(inertia, &start.motion.pose, start.free.velocity, start.free.angular_velocity())
    };
    let mut mobiles: Vec<Mobile> = group.members.iter().zip(starts).map(mobile).collect();
    let pushed = impulses::resolve(&mut mobiles, &constraints(group, starts), group.secs);
    let ends = mobiles.iter().zip(starts).zip(pushed);
    ends.map(|((mobile, start), pushed)| End { motion: mobile.moved(&start.motion.pose, group.secs), pushed })
        .collect()
}

/// All points at which a drone touches anything, or may by the end of the substep.
fn constraints(group: &Group<'_>, starts: &[Start]) -> Vec<Constraint> {
    let speed = |start: &Start| start.motion.velocity.norm().max(start.free.velocity.norm());
    let fastest = starts.iter().map(speed).fold(0.0, f64::max);
    let prediction = 2.0 * MARGIN + 2.0 * fastest * group.secs;
    let mut found = Vec::new();
    for (index, (member, start)) in group.members.iter().zip(starts).enumerate() {
        if let Member::Drone(_) = member {
            Encounter { group, index, pose: start.motion.pose, prediction }.find(starts, &mut found);
        }
    }
    found
}

impl<'a> Encounter<'a> {
    /// All points of the drone; those of two drones belong to the first.
    fn find(&self, starts: &[Start], found: &mut Vec<Constraint>) {
        let floor = || Other {
            member: None,
            friction: FLOOR_FRICTION,
            skin: 0.0,
            surface: Surface::Plane(Plane::floor()),
        };
        let members = self.group.members.iter().zip(starts).enumerate();
        let met =
            members.filter(|(index, (member, _))| *index > self.index || matches!(member, Member::Movable(_)));
        let others = self.group.floor.then(floor).into_iter();
        let others = others.chain(self.group.solids.iter().map(|index| self.solid(*index)));
        let others = others.chain(met.map(|(index, (member, start))| self.member(index, *member, start)));
        others.for_each(|other| self.meet(&other, found));
    }

    fn solid(&self, index: usize) -> Other<'a> {
        let body = &self.group.bodies.arena.solids[index];
        let surface = self.surface(&body.outline, &body.shape_pose);
        Other { member: None, friction: body.friction, skin: 0.0, surface }
    }

    fn member(&self, index: usize, member: Member, start: &Start) -> Other<'a> {
        let bodies = self.group.bodies;
        let pose = &start.motion.pose;
        match member {
            Member::Drone(_) => {
                let surface = Surface::Shape(&*bodies.hull.0, compose(pose, &bodies.hull_pose));
                Other { member: Some(index), friction: DRONE_FRICTION, skin: MARGIN, surface }
            }
            Member::Movable(movable) => {
                let body = &bodies.arena.movables[movable];
                let surface = self.surface(&body.outline, &body.outline.placed(pose));
                Other { member: Some(index), friction: body.friction, skin: 0.0, surface }
            }
        }
    }

    fn surface(&self, outline: &'a Outline, pose: &Pose) -> Surface<'a> {
        let reach = self.group.bodies.arena.drone.radius + MARGIN + self.prediction;
        let side = outline.side_met(pose, &self.pose.position, reach);
        side.map_or_else(|| Surface::Shape(&*outline.shape.0, *pose), Surface::Plane)
    }

    fn meet(&self, other: &Other<'_>, found: &mut Vec<Constraint>) {
        match &other.surface {
            Surface::Plane(plane) => self.meet_plane(other, plane, found),
            Surface::Shape(shape, pose) => self.meet_shape(other, *shape, pose, found),
        }
    }

    fn meet_plane(&self, other: &Other<'_>, plane: &Plane, found: &mut Vec<Constraint>) {
        for place in self.rim_points(&plane.normal) {
            let height = (place - plane.point).dot(&plane.normal);
            if height - MARGIN <= self.prediction {
                let places = [place, place - plane.normal * height];
                found.push(self.constraint(other, places, plane.normal, height));
            }
        }
    }

    fn meet_shape(&self, other: &Other<'_>, shape: &dyn Shape, pose: &Pose, found: &mut Vec<Constraint>) {
        let bodies = self.group.bodies;
        let hull = compose(&self.pose, &bodies.hull_pose);
        let between = to_pose(&relative(&hull, pose));
        let reach = (self.prediction + MARGIN + other.skin) as f32;
        let mut manifold = ContactManifold::<(), ()>::new();
        DefaultQueryDispatcher
            .contact_manifold_convex_convex(&between, &*bodies.hull.0, shape, None, None, reach, &mut manifold)
            .expect("parry knows where any two convex shapes touch");
        let normal = -hull.world_from_body.rotate(from_vector(manifold.local_n1));
        let at = |pose: &Pose, local| compose(pose, &Pose::at(from_vector(local))).position;
        for point in &manifold.points {
            let places = [at(&hull, point.local_p1), at(pose, point.local_p2)];
            found.push(self.constraint(other, places, normal, point.dist.into()));
        }
    }

    /// `gap` is that between the shapes \[m\].
    fn constraint(
        &self,
        other: &Other<'_>,
        places: [Vector3<f64>; 2],
        normal: Vector3<f64>,
        gap: f64,
    ) -> Constraint {
        Constraint {
            bodies: [Some(self.index), other.member],
            places,
            normal,
            distance: gap - MARGIN - other.skin,
            friction: DRONE_FRICTION * other.friction,
        }
    }

    /// Four points of the rim that is lower along a normal, the lowest first, and the lowest of the other rim.
    fn rim_points(&self, normal: &Vector3<f64>) -> [Vector3<f64>; 5] {
        let HullSize { radius, half_height, offset } = self.group.bodies.hull_size;
        let turn = &self.pose.world_from_body;
        let axis = turn.rotate(Vector3::z());
        let up = axis.dot(normal);
        let slope = (axis * up - normal).try_normalize(LEVEL);
        let along = slope.unwrap_or_else(|| turn.rotate(Vector3::x()));
        let [along, across] = [along, axis.cross(&along)].map(|direction| direction * radius);
        let middle = self.pose.position + axis * offset;
        let lower = axis * half_height.copysign(-up);
        let (upper, lower) = (middle - lower, middle + lower);
        [lower + along, lower + across, lower - across, lower - along, upper + along]
    }
}
