//! A few bodies that may touch, for one substep in a rapier world of their own.

use kestrel_core::airframe::GRAVITY;
use nalgebra::Vector3;
use rapier3d::dynamics::{
    CoefficientCombineRule, FrictionModel, IntegrationParameters, MassProperties, RigidBodyBuilder,
    RigidBodyHandle,
};
use rapier3d::geometry::{ColliderBuilder, ColliderHandle, SharedShape};
use rapier3d::math::{Pose as SmallPose, Rotation, Vector};
use rapier3d::pipeline::PhysicsWorld;

use super::Motion;
use super::frame::{from_rotation, from_vector, to_pose, to_vector};
use super::outline::MARGIN;
use super::solver::{ContactSolver, Member};
use crate::world::Pose;

/// Friction of a drone: what PyBullet gives a body that states none.
const DRONE_FRICTION: f32 = 0.5;

/// Friction of the floor, as in `plane.urdf`.
const FLOOR_FRICTION: f32 = 1.0;

/// Solver iterations of a substep. Nothing is remembered between substeps, so there is no warm start, and a column
/// of ten blocks needs this many to stand.
const ITERATIONS: usize = 12;

/// Speed \[m/s\] and angular velocity \[rad/s\] below which movables that no drone is near fall asleep.
const SLEEPY: [f64; 2] = [3e-3, 0.05];

/// Bodies that may touch, and what they may touch.
pub(super) struct Group<'a> {
    pub(super) solver: &'a ContactSolver,
    pub(super) members: Vec<Member>,
    /// Indices of the solids nearby.
    pub(super) solids: Vec<usize>,
    /// Whether the floor is nearby.
    pub(super) floor: bool,
    pub(super) secs: f64,
}

/// A body in rapier's world, and what it was before the step.
struct Placed {
    member: Member,
    body: RigidBodyHandle,
    collider: ColliderHandle,
    pose: SmallPose,
    velocity: Vector,
    angular_velocity: Vector,
}

impl Group<'_> {
    /// Steps the group; drones that nothing pushed are left alone.
    pub(super) fn resolve(&self, before: &[Motion], after: &mut [Motion], movables: &mut [Motion]) {
        let starts: Vec<Motion> =
            self.members.iter().map(|member| start(*member, before, after, movables)).collect();
        let origin = starts[0].pose.position;
        let mut world = self.world(&origin, &starts);
        let placed: Vec<Placed> = self
            .members
            .iter()
            .zip(&starts)
            .map(|(member, start)| self.place(&mut world, *member, start, &origin))
            .collect();
        world.step();
        for (body, start) in placed.iter().zip(&starts) {
            match body.member {
                Member::Drone(index) if body.is_pushed(&world) => after[index] = body.moved(&world, start),
                Member::Drone(_) => {}
                Member::Movable(index) => movables[index] = body.moved(&world, start),
            }
        }
        self.put_to_sleep(&starts, movables, &placed, &world);
    }

    /// A rapier world with what cannot move, around an origin near the bodies, where `f32` is fine enough.
    fn world(&self, origin: &Vector3<f64>, starts: &[Motion]) -> PhysicsWorld {
        let fastest = starts.iter().map(|start| start.velocity.norm()).fold(0.0, f64::max);
        let mut world = PhysicsWorld {
            gravity: Vector::new(0.0, 0.0, -GRAVITY as f32),
            integration_parameters: IntegrationParameters {
                dt: self.secs as f32,
                // Whatever can be met within the substep is prepared for.
                normalized_prediction_distance: (2.0 * MARGIN + 2.0 * fastest * self.secs) as f32,
                num_solver_iterations: ITERATIONS,
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
            let body = &self.solver.arena.solids[*index];
            let collider = surface(body.outline.shape.clone(), body.friction as f32);
            world.colliders.insert(collider.position(local(&body.shape_pose)));
        }
        if self.floor {
            let collider = surface(SharedShape::halfspace(Vector::Z), FLOOR_FRICTION);
            world.colliders.insert(collider.translation(Vector::new(0.0, 0.0, -origin.z as f32)));
        }
        world
    }

    fn place(&self, world: &mut PhysicsWorld, member: Member, start: &Motion, origin: &Vector3<f64>) -> Placed {
        let pose = to_pose(&Pose { position: start.pose.position - origin, ..start.pose });
        let velocity = to_vector(&start.velocity);
        let angular_velocity = to_vector(&start.pose.world_from_body.rotate(start.body_rates));
        let body = RigidBodyBuilder::dynamic()
            .pose(pose)
            .linvel(velocity)
            .angvel(angular_velocity)
            .can_sleep(false)
            .gyroscopic_forces_enabled(false);
        let (body, collider) = match member {
            Member::Drone(_) => {
                let drone = &self.solver.drone;
                let mass = MassProperties::new(Vector::ZERO, drone.mass as f32, to_vector(&drone.inertia));
                let collider =
                    surface(drone.hull.clone(), DRONE_FRICTION).contact_skin(MARGIN as f32).density(0.0);
                let body = body.additional_mass_properties(mass).gravity_scale(0.0);
                (body, collider.position(to_pose(&drone.hull_pose)))
            }
            Member::Movable(index) => {
                let movable = &self.solver.arena.movables[index];
                let collider = surface(movable.outline.shape.clone(), movable.friction as f32);
                let mass = self.solver.masses[index] as f32;
                (body, collider.mass(mass).position(to_pose(&movable.outline.pose)))
            }
        };
        let body = world.bodies.insert(body);
        let collider = world.colliders.insert_with_parent(collider, body, &mut world.bodies);
        Placed { member, body, collider, pose, velocity, angular_velocity }
    }

    /// Movables that no drone is near and that hardly move come to rest where they were.
    fn put_to_sleep(&self, starts: &[Motion], movables: &mut [Motion], placed: &[Placed], world: &PhysicsWorld) {
        let sleepy = |body: &Placed| match body.member {
            Member::Drone(_) => false,
            Member::Movable(index) => {
                let [slow, calm] = SLEEPY;
                let motion = &movables[index];
                motion.velocity.norm() < slow && motion.body_rates.norm() < calm && body.is_pushed(world)
            }
        };
        if !placed.iter().all(sleepy) {
            return;
        }
        for (member, start) in self.members.iter().zip(starts) {
            if let Member::Movable(index) = member {
                movables[*index] = Motion::at_rest(start.pose);
            }
        }
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
        let angular_velocity = start.pose.world_from_body.rotate(start.body_rates)
            + from_vector(body.angvel() - self.angular_velocity);
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
fn surface(shape: SharedShape, friction: f32) -> ColliderBuilder {
    ColliderBuilder::new(shape)
        .friction(friction)
        .friction_combine_rule(CoefficientCombineRule::Multiply)
        .restitution(0.0)
        .restitution_combine_rule(CoefficientCombineRule::Multiply)
}

/// Where a body is at the start of the substep, with the velocities that it would have at its end.
fn start(member: Member, before: &[Motion], after: &[Motion], movables: &[Motion]) -> Motion {
    match member {
        Member::Drone(index) => Motion { pose: before[index].pose, ..after[index] },
        Member::Movable(index) => movables[index],
    }
}
