//! A group's substep in a rapier world of its own, which is forgotten afterwards.

use kestrel_core::airframe::GRAVITY;
use nalgebra::Vector3;
use rapier3d::dynamics::{
    CoefficientCombineRule, FrictionModel, IntegrationParameters, MassProperties, RigidBodyBuilder,
    RigidBodyHandle, SpringCoefficients,
};
use rapier3d::geometry::{ColliderBuilder, ColliderHandle, SharedShape};
use rapier3d::math::{Pose as SmallPose, Rotation, Vector};
use rapier3d::pipeline::PhysicsWorld;

use super::Motion;
use super::frame::{from_rotation, from_vector, to_matrix, to_pose, to_vector};
use super::group::{DRONE_FRICTION, End, FLOOR_FRICTION, Group, Member, Start};
use super::outline::MARGIN;
use crate::world::Pose;

/// Solver iterations of a substep for drones alone: with four, one that rests creeps by 60 µm in 10 s.
const DRONE_ITERATIONS: usize = 8;

/// Solver iterations with movables. Nothing is remembered between substeps, so there is no warm start; with these a
/// gate of two columns of ten blocks comes to rest within a few steps, with half as many it sways.
const STACK_ITERATIONS: usize = 16;

/// Stiffness of contacts: natural frequency times substep. rapier's softer default relies on its warm start.
const STIFFNESS: f64 = 2.5;

/// Damping ratio of contacts.
const DAMPING_RATIO: f32 = 5.0;

/// A body in rapier's world, and what it was before the step.
struct Placed {
    body: RigidBodyHandle,
    collider: ColliderHandle,
    pose: SmallPose,
    velocity: Vector,
    angular_velocity: Vector,
}

/// Steps the group.
pub(super) fn step(group: &Group<'_>, starts: &[Start]) -> Vec<End> {
    let origin = starts[0].motion.pose.position;
    let mut world = group.world(&origin, starts);
    let members = group.members.iter().zip(starts);
    let placed: Vec<Placed> =
        members.map(|(member, start)| group.place(&mut world, *member, start, &origin)).collect();
    world.step();
    let ends = placed.iter().zip(starts);
    ends.map(|(body, start)| End { motion: body.moved(&world, &start.motion), pushed: body.is_pushed(&world) })
        .collect()
}

impl Group<'_> {
    /// A rapier world with what cannot move, around an origin near the bodies, where `f32` is fine enough.
    fn world(&self, origin: &Vector3<f64>, starts: &[Start]) -> PhysicsWorld {
        let fastest = starts
            .iter()
            .map(|start| start.motion.velocity.norm().max(start.free.velocity.norm()))
            .fold(0.0, f64::max);
        let softness =
            SpringCoefficients { natural_frequency: (STIFFNESS / self.secs) as f32, damping_ratio: DAMPING_RATIO };
        let mut world = PhysicsWorld {
            gravity: Vector::new(0.0, 0.0, -GRAVITY as f32),
            integration_parameters: IntegrationParameters {
                dt: self.secs as f32,
                // Whatever can be met within the substep is prepared for.
                normalized_prediction_distance: (2.0 * MARGIN + 2.0 * fastest * self.secs) as f32,
                num_solver_iterations: self.iterations(),
                contact_softness: softness,
                static_contact_softness: softness,
                max_ccd_substeps: 0,
                contact_clustering: false,
                contact_recycling: false,
                friction_model: FrictionModel::Coulomb,
                ..IntegrationParameters::default()
            },
            ..PhysicsWorld::default()
        };
        let local = |pose: &Pose| to_pose(&Pose { position: pose.position - origin, ..*pose });
        for index in &self.solids {
            let body = &self.bodies.arena.solids[*index];
            let collider = surface(body.outline.shape.clone(), body.friction);
            world.colliders.insert(collider.position(local(&body.shape_pose)));
        }
        if self.floor {
            let collider = surface(SharedShape::halfspace(Vector::Z), FLOOR_FRICTION);
            world.colliders.insert(collider.translation(Vector::new(0.0, 0.0, -origin.z as f32)));
        }
        world
    }

    fn iterations(&self) -> usize {
        let stacked = self.members.iter().any(|member| matches!(member, Member::Movable(_)));
        if stacked { STACK_ITERATIONS } else { DRONE_ITERATIONS }
    }

    fn place(&self, world: &mut PhysicsWorld, member: Member, start: &Start, origin: &Vector3<f64>) -> Placed {
        let place = &start.motion.pose;
        let pose = to_pose(&Pose { position: place.position - origin, ..*place });
        let velocity = to_vector(&start.motion.velocity);
        let angular_velocity = to_vector(&start.motion.angular_velocity());
        let body = RigidBodyBuilder::dynamic()
            .pose(pose)
            .linvel(velocity)
            .angvel(angular_velocity)
            .can_sleep(false)
            .gyroscopic_forces_enabled(false);
        let bodies = self.bodies;
        let (body, inertia, collider) = match member {
            Member::Drone(_) => {
                let collider = surface(bodies.hull.clone(), DRONE_FRICTION).contact_skin(MARGIN as f32);
                (body.gravity_scale(0.0), bodies.drone, collider.position(to_pose(&bodies.hull_pose)))
            }
            Member::Movable(index) => {
                let movable = &bodies.arena.movables[index];
                let collider = surface(movable.outline.shape.clone(), movable.friction);
                (body, bodies.movables[index], collider.position(to_pose(&movable.outline.pose)))
            }
        };
        if inertia.is_immense() {
            let carried = RigidBodyBuilder::kinematic_velocity_based().pose(pose).linvel(velocity);
            let body = world.bodies.insert(carried.can_sleep(false));
            let collider = world.colliders.insert_with_parent(collider.density(0.0), body, &mut world.bodies);
            return Placed { body, collider, pose, velocity, angular_velocity };
        }
        let moments = to_matrix(&inertia.moments);
        let mass = MassProperties::with_inertia_matrix(Vector::ZERO, inertia.mass as f32, moments);
        let body = world.bodies.insert(body.additional_mass_properties(mass));
        // What free flight does comes bit by bit, as gravity does: rapier's solver has substeps of its own.
        let turn = place.world_from_body.matrix();
        let spin = start.free.angular_velocity() - start.motion.angular_velocity();
        let force = (start.free.velocity - start.motion.velocity) * (inertia.mass / self.secs);
        world.bodies[body].add_force(to_vector(&force), false);
        let torque = turn * inertia.moments * turn.transpose() * spin / self.secs;
        world.bodies[body].add_torque(to_vector(&torque), false);
        let collider = world.colliders.insert_with_parent(collider.density(0.0), body, &mut world.bodies);
        Placed { body, collider, pose, velocity, angular_velocity }
    }
}

impl Placed {
    /// Whether any contact did anything to it.
    fn is_pushed(&self, world: &PhysicsWorld) -> bool {
        world.narrow_phase.contact_pairs_with(self.collider).any(|pair| pair.total_impulse_magnitude() > 0.0)
    }

    /// Its motion after the step, put together in `f64` from what rapier changed.
    fn moved(&self, world: &PhysicsWorld, start: &Motion) -> Motion {
        let body = &world.bodies[self.body];
        let turn: Rotation = *body.rotation() * self.pose.rotation.inverse();
        let world_from_body = from_rotation(turn).after(&start.pose.world_from_body).normalized();
        let angular_velocity = start.angular_velocity() + from_vector(body.angvel() - self.angular_velocity);
        Motion {
            pose: Pose {
                position: start.pose.position + from_vector(body.translation() - self.pose.translation),
                world_from_body,
            },
            velocity: start.velocity + from_vector(body.linvel() - self.velocity),
            body_rates: world_from_body.rotate_inverse(angular_velocity),
        }
    }
}

/// A surface without bounce whose friction multiplies with the other's.
fn surface(shape: SharedShape, friction: f64) -> ColliderBuilder {
    ColliderBuilder::new(shape)
        .friction(friction as f32)
        .friction_combine_rule(CoefficientCombineRule::Multiply)
        .restitution(0.0)
        .restitution_combine_rule(CoefficientCombineRule::Multiply)
}
