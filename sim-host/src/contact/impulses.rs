//! Impulses that keep bodies apart, found one after the other as Bullet does; both physics use them.
//!
//! Projected Gauss–Seidel over the contact points: a normal impulse each, which also pushes overlapping bodies apart
//! (so that a fast impact ends with a small rebound), and two of friction within Coulomb's cone. (`btMultiBodyConstraintSolver` with
//! the parameters of `PhysicsServerCommandProcessor`.)

use kestrel_core::attitude::Attitude;
use nalgebra::{Matrix3, Vector3};

use super::Motion;
use super::group::Inertia;
use crate::world::Pose;

/// Share of an overlap that is undone in a substep.
const ERROR_REDUCTION: f64 = 0.08;

/// Overlap that is left alone \[m\].
const SLOP: f64 = 1e-5;

const ITERATIONS: usize = 50;

/// Greatest rotation in one substep \[rad\].
const ROTATION_CAP: f64 = core::f64::consts::FRAC_PI_4;

/// Squared change of velocity \[m²/s²\] at which iterations end.
const RESIDUAL: f64 = 1e-7;

/// A body that impulses act on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mobile {
    pub(super) inverse_mass: f64,
    /// About the centre of mass, world.
    pub(super) inverse_inertia: Matrix3<f64>,
    /// Centre of mass \[m, world\].
    pub(super) position: Vector3<f64>,
    /// \[m/s\], world.
    pub(super) velocity: Vector3<f64>,
    /// \[rad/s\], world.
    pub(super) angular_velocity: Vector3<f64>,
}

impl Mobile {
    /// A body with this pose that moves so.
    pub(super) fn new(
        inertia: &Inertia,
        pose: &Pose,
        velocity: Vector3<f64>,
        angular_velocity: Vector3<f64>,
    ) -> Self {
        let inverse = inertia.moments.try_inverse().unwrap_or_else(Matrix3::zeros);
        let turn = pose.world_from_body.matrix();
        Self {
            inverse_mass: 1.0 / inertia.mass,
            inverse_inertia: turn * inverse * turn.transpose(),
            position: pose.position,
            velocity,
            angular_velocity,
        }
    }

    /// Where its velocities take it from its pose in some time \[s\].
    pub(super) fn moved(&self, start: &Pose, secs: f64) -> Motion {
        let angle = (self.angular_velocity.norm() * secs).min(ROTATION_CAP);
        let axis = self.angular_velocity.try_normalize(0.0).unwrap_or_else(Vector3::x);
        let turn = Attitude::from_axis_angle(axis, angle);
        let world_from_body = turn.after(&start.world_from_body).normalized();
        Motion {
            pose: Pose { position: start.position + self.velocity * secs, world_from_body },
            velocity: self.velocity,
            body_rates: world_from_body.rotate_inverse(self.angular_velocity),
        }
    }
}

/// A point at which two bodies meet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Constraint {
    /// Index of each body among the mobiles; `None` does not move.
    pub(super) bodies: [Option<usize>; 2],
    /// Where it is on each body \[m, world\].
    pub(super) places: [Vector3<f64>; 2],
    /// From the second to the first body, world.
    pub(super) normal: Vector3<f64>,
    /// Negative where the bodies overlap \[m\].
    pub(super) distance: f64,
    pub(super) friction: f64,
}

/// One direction of one constraint.
struct Row {
    sides: [Option<Side>; 2],
    /// Reciprocal of the change of relative velocity per impulse.
    mass: f64,
    /// Wanted change of relative velocity \[m/s\].
    target: f64,
    /// So far \[N s\].
    impulse: f64,
}

/// How a row acts on one body.
struct Side {
    body: usize,
    direction: Vector3<f64>,
    lever: Vector3<f64>,
    /// Change of angular velocity per impulse.
    turning: Vector3<f64>,
}

/// Changes the velocities of the bodies so that the constraints come no closer in `secs`; says whether any impulse did.
pub(super) fn resolve(mobiles: &mut [Mobile], constraints: &[Constraint], secs: f64) -> Vec<bool> {
    let mut changes = vec![[Vector3::zeros(); 2]; mobiles.len()];
    let mut pushed = vec![false; mobiles.len()];
    let mut normals: Vec<Row> =
        constraints.iter().map(|constraint| Row::normal(constraint, mobiles, secs)).collect();
    // Nothing comes closer than it may.
    if normals.iter().all(|row| row.target <= 0.0) {
        return pushed;
    }
    let mut tangents: Vec<[Row; 2]> =
        constraints.iter().map(|constraint| Row::tangents(constraint, mobiles)).collect();
    for _ in 0..ITERATIONS {
        let mut residual = 0.0_f64;
        for row in &mut normals {
            let impulse = (row.impulse + row.missing(&changes)).max(0.0);
            residual = residual.max(row.apply(impulse, mobiles, &mut changes).powi(2));
        }
        for ((rows, normal), constraint) in tangents.iter_mut().zip(&normals).zip(constraints) {
            residual =
                residual.max(slide(rows, constraint.friction * normal.impulse, mobiles, &mut changes).powi(2));
        }
        if residual <= RESIDUAL {
            break;
        }
    }
    for (mobile, [linear, angular]) in mobiles.iter_mut().zip(changes) {
        mobile.velocity += linear;
        mobile.angular_velocity += angular;
    }
    for row in &normals {
        for side in row.sides.iter().flatten() {
            pushed[side.body] |= row.impulse > 0.0;
        }
    }
    pushed
}

/// One round of friction at a constraint, both directions limited together; the change of relative velocity.
fn slide(rows: &mut [Row; 2], limit: f64, mobiles: &[Mobile], changes: &mut [[Vector3<f64>; 2]]) -> f64 {
    let wanted = [0, 1].map(|index| rows[index].impulse + rows[index].missing(changes));
    let length = wanted[0].hypot(wanted[1]);
    let share = if length * length >= limit * limit && length > 0.0 { limit / length } else { 1.0 };
    let [first, second] = [0, 1].map(|index| rows[index].apply(wanted[index] * share, mobiles, changes));
    first + second
}

impl Row {
    fn normal(constraint: &Constraint, mobiles: &[Mobile], secs: f64) -> Self {
        let mut row = Self::along(constraint, constraint.normal, mobiles);
        let gap = constraint.distance + SLOP;
        row.target -= if gap > 0.0 { gap / secs } else { ERROR_REDUCTION * gap / secs };
        row
    }

    fn tangents(constraint: &Constraint, mobiles: &[Mobile]) -> [Self; 2] {
        across(&constraint.normal).map(|direction| Self::along(constraint, direction, mobiles))
    }

    /// A row that stops the relative velocity along a direction.
    fn along(constraint: &Constraint, direction: Vector3<f64>, mobiles: &[Mobile]) -> Self {
        let side = |which: usize, direction: Vector3<f64>| {
            let body = constraint.bodies[which]?;
            let lever = (constraint.places[which] - mobiles[body].position).cross(&direction);
            Some(Side { body, direction, lever, turning: mobiles[body].inverse_inertia * lever })
        };
        let sides = [side(0, direction), side(1, -direction)];
        let (mut response, mut speed) = (0.0, 0.0);
        for side in sides.iter().flatten() {
            let mobile = &mobiles[side.body];
            response += mobile.inverse_mass + side.lever.dot(&side.turning);
            speed += mobile.velocity.dot(&side.direction) + mobile.angular_velocity.dot(&side.lever);
        }
        Self { sides, mass: 1.0 / response, target: -speed, impulse: 0.0 }
    }

    /// The impulse that is missing after the changes so far.
    fn missing(&self, changes: &[[Vector3<f64>; 2]]) -> f64 {
        let mut speed = 0.0;
        for side in self.sides.iter().flatten() {
            let [linear, angular] = &changes[side.body];
            speed += linear.dot(&side.direction) + angular.dot(&side.lever);
        }
        (self.target - speed) * self.mass
    }

    /// Makes the row's impulse this one; the change of relative velocity.
    fn apply(&mut self, impulse: f64, mobiles: &[Mobile], changes: &mut [[Vector3<f64>; 2]]) -> f64 {
        let added = impulse - self.impulse;
        self.impulse = impulse;
        for side in self.sides.iter().flatten() {
            changes[side.body][0] += side.direction * (mobiles[side.body].inverse_mass * added);
            changes[side.body][1] += side.turning * added;
        }
        added / self.mass
    }
}

/// Two directions across a normal, Bullet's choice.
fn across(normal: &Vector3<f64>) -> [Vector3<f64>; 2] {
    if normal.z.abs() > core::f64::consts::FRAC_1_SQRT_2 {
        let square = normal.y * normal.y + normal.z * normal.z;
        let scale = 1.0 / square.sqrt();
        let first = Vector3::new(0.0, -normal.z * scale, normal.y * scale);
        [first, Vector3::new(square * scale, -normal.x * first.z, normal.x * first.y)]
    } else {
        let square = normal.x * normal.x + normal.y * normal.y;
        let scale = 1.0 / square.sqrt();
        let first = Vector3::new(-normal.y * scale, normal.x * scale, 0.0);
        [first, Vector3::new(-normal.z * first.y, normal.z * first.x, square * scale)]
    }
}
