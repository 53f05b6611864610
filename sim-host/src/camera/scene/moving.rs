//! What moves in a scene: bodies that are prepared once, around the origin of what they belong to, and placed for each
//! image. Placing turns normals and corners and lights the faces anew; it allocates nothing.

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;

use super::drone::drone;
use super::{Body, BoundingSphere, CurvedSide, Scene, Shading, shaded};
use crate::camera::FIRST_SOLID;
use crate::world::{Pose, Shape, Solid, World};

/// What can be placed in a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mover {
    /// A movable body, by its index in the world.
    Movable(usize),
    /// A drone, by its index among those of [`Scene::with_drones`].
    Drone(usize),
}

/// Everything that moves, behind what does not.
#[derive(Clone, Debug, Default)]
pub(super) struct Moving {
    /// Solids of the world.
    solids: usize,
    /// How many of the groups are movables; the others are drones.
    movables: usize,
    groups: Vec<Group>,
}

/// Bodies that move together.
#[derive(Clone, Debug)]
struct Group {
    /// The first of them in the scene.
    first: usize,
    /// Each around the group's origin, with its colour.
    local: Vec<(Body, [f32; 3])>,
}

impl Scene {
    /// The world's movables behind its solids, where they start; of a mesh that moves its hull is seen.
    pub(super) fn add_movables(&mut self, world: &World) {
        let (solids, movables) = (world.solids.len(), world.movables.len());
        self.moving = Moving { solids, movables, groups: Vec::new() };
        for movable in &world.movables {
            let solid = Solid { pose: Pose::at(Vector3::zeros()), ..movable.solid.clone() };
            let (shape, pose) = solid.seen();
            let shape = match shape {
                Shape::Mesh(mesh) => Shape::Hull(mesh.hull.clone()),
                Shape::Cuboid(_) | Shape::Cylinder { .. } | Shape::Sphere(_) | Shape::Hull(_) => shape.clone(),
            };
            self.add_group(&[Solid { shape, pose, visual: None, ..solid }]);
        }
        for (index, movable) in world.movables.iter().enumerate() {
            self.place(Mover::Movable(index), &movable.solid.pose);
        }
    }

    /// Adds drones behind the movables, each with a label of its own: body, arms and the discs of the rotors, to the scale
    /// of the airframe, front arms red. None is seen before it is placed.
    ///
    /// # Panics
    /// When there are more solids, movables and drones than labels, 65,533.
    #[must_use]
    pub fn with_drones(mut self, airframe: &Airframe, count: usize) -> Self {
        for _ in 0..count {
            let index = self.drones();
            self.add_group(&drone(airframe, index));
            self.hide(Mover::Drone(index));
        }
        self
    }

    /// How many movables it has.
    pub fn movables(&self) -> usize {
        self.moving.movables
    }

    /// How many drones it has.
    pub fn drones(&self) -> usize {
        self.moving.groups.len() - self.moving.movables
    }

    /// Where something is from now on; what was hidden is seen again.
    ///
    /// # Panics
    /// When there is no such thing in the scene.
    pub fn place(&mut self, mover: Mover, pose: &Pose) {
        let Self { bodies, surfaces, moving, .. } = self;
        let Group { first, local } = moving.group(mover);
        for (body, (own, colour)) in bodies[*first..].iter_mut().zip(local) {
            body.move_to(own, pose);
            for face in &body.faces {
                surfaces[face.surface as usize].colour = shaded(*colour, &face.normal);
            }
        }
    }

    /// Leaves something out until it is placed again, such as the drone that carries the camera.
    ///
    /// # Panics
    /// When there is no such thing in the scene.
    pub fn hide(&mut self, mover: Mover) {
        let Group { first, local } = self.moving.group(mover);
        for body in &mut self.bodies[*first..][..local.len()] {
            body.ball.reach = NOWHERE;
        }
    }

    /// The first body that moves and its first surface; behind the last where nothing moves.
    pub(in crate::camera) fn first_moving(&self) -> [usize; 2] {
        let Some(group) = self.moving.groups.first() else { return [self.bodies.len(), self.surfaces.len()] };
        let Body { faces, round, .. } = &self.bodies[group.first];
        let surfaces = faces.iter().map(|face| face.surface).chain(round.iter().map(|round| round.surface));
        let first = surfaces.min().map_or(self.surfaces.len(), |surface| surface as usize);
        [group.first, first]
    }

    fn add_group(&mut self, solids: &[Solid]) {
        let label = usize::from(FIRST_SOLID) + self.moving.solids + self.moving.groups.len();
        let label = u16::try_from(label).ok().filter(|label| *label < u16::MAX);
        let label = label.expect("a scene has at most 65,533 labels");
        let first = self.bodies.len();
        for solid in solids {
            self.add(solid, label);
        }
        let colours = solids.iter().map(|solid| solid.colour);
        let local = self.bodies[first..].iter().cloned().zip(colours).collect();
        self.moving.groups.push(Group { first, local });
    }
}

/// Radius of the ball around a body that is hidden: no camera sees any of it.
const NOWHERE: f64 = f64::NEG_INFINITY;

impl Moving {
    fn group(&self, mover: Mover) -> &Group {
        let (movables, drones) = self.groups.split_at(self.movables);
        match mover {
            Mover::Movable(index) => &movables[index],
            Mover::Drone(index) => &drones[index],
        }
    }
}

impl Body {
    /// Whether cameras can see it at all.
    pub(in crate::camera) fn is_placed(&self) -> bool {
        self.ball.reach != NOWHERE
    }

    /// Becomes `own`, turned and moved.
    fn move_to(&mut self, own: &Self, pose: &Pose) {
        let turned = |vector: Vector3<f64>| pose.world_from_body.rotate(vector);
        let placed = |point: Vector3<f64>| pose.position + turned(point);
        self.ball = BoundingSphere { centre: placed(own.ball.centre), ..own.ball };
        for (face, own) in self.faces.iter_mut().zip(&own.faces) {
            face.normal = turned(own.normal);
            face.offset = own.offset + face.normal.dot(&pose.position);
        }
        for (corner, own) in self.corners.iter_mut().zip(&own.corners) {
            *corner = placed(*own);
        }
        if let (Some(round), Some(own)) = (&mut self.round, &own.round) {
            let CurvedSide { surface, shading: Shading { colour, .. }, .. } = *round;
            *round = CurvedSide::new(placed(own.centre), turned(own.axis), own.radius, colour, surface);
        }
    }
}
