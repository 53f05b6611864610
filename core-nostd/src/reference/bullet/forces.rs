//! What pushes and turns a drone in the multibody modes.

use nalgebra::Vector3;

use super::{Bullet, BulletState, DownwashAxis, DragFrame, DragRotors, GroundQuery, LinkAttitude, RotorPrecision};
use crate::airframe::RADIANS_PER_SECOND_PER_RPM;
use crate::attitude::Attitude;
use crate::real::Real;
use crate::reference::vector::{cross, square};

/// Force \[N\] and torque \[N m\] on the centre of mass, body.
pub(super) struct BodyWrench<R> {
    pub(super) force: Vector3<R>,
    pub(super) torque: Vector3<R>,
}

impl<R: Real> Bullet<R> {
    /// Everything but gravity and damping, in the reference's order.
    #[inline(always)]
    pub(super) fn wrench(&self, drone: &BulletState<R>, rotor_speeds: &[R; 4], downwash: R) -> BodyWrench<R> {
        let current = &drone.motion.world_from_body;
        let stale = match self.quirks.link_attitude {
            LinkAttitude::Previous => &drone.link_attitude,
            LinkAttitude::Current => current,
        };
        let mut wrench = self.rotors(current, stale, rotor_speeds);
        if self.mode.has_ground_effect() {
            let cushion = self.ground_effect(drone, rotor_speeds);
            wrench = BodyWrench { force: wrench.force + cushion.force, torque: wrench.torque + cushion.torque };
        }
        let links = if self.mode.has_ground_effect() && self.quirks.ground_query == GroundQuery::RefreshesLinks {
            current
        } else {
            stale
        };
        if self.mode.has_drag() {
            wrench.force += current.rotate_inverse(self.drag(drone, links, rotor_speeds));
        }
        if self.mode.has_downwash() {
            wrench.force -= self.downwash_direction(current, links) * downwash;
        }
        wrench
    }

    /// Thrusts and reaction torques, along the z axis of the links.
    #[inline(always)]
    fn rotors(&self, current: &Attitude<R>, links: &Attitude<R>, rotor_speeds: &[R; 4]) -> BodyWrench<R> {
        let direction = current.rotate_inverse(links.body_z());
        let (thrusts, reaction) = self.loads(rotor_speeds);
        let lever = self.lever(&thrusts);
        BodyWrench { force: direction * sum(&thrusts), torque: cross(&lever, &direction) + direction * reaction }
    }

    /// Thrusts \[N\] and summed reaction torque about body z \[N m\].
    #[inline(always)]
    pub(super) fn loads(&self, rotor_speeds: &[R; 4]) -> ([R; 4], R) {
        match self.quirks.rotor_precision {
            RotorPrecision::Full => {
                let [a, b, c, d] = rotor_speeds.map(|speed| speed * speed);
                let thrusts = [a, b, c, d].map(|square| square * self.thrust_coefficient);
                (thrusts, self.torque_coefficient * (b - a + (d - c)))
            }
            RotorPrecision::Single => self.single_loads(rotor_speeds),
        }
    }

    /// The same as numpy computes them from `float32` speeds in RPM.
    #[inline(always)]
    fn single_loads(&self, rotor_speeds: &[R; 4]) -> ([R; 4], R) {
        let per_rpm = R::from_f64(RADIANS_PER_SECOND_PER_RPM);
        let squares = rotor_speeds.map(|speed| (speed / per_rpm).in_single().squared().in_single());
        let thrust = (self.thrust_coefficient * per_rpm * per_rpm).in_single();
        let torque = (self.torque_coefficient * per_rpm * per_rpm).in_single();
        let [a, b, c, d] = squares.map(|square| (square * torque).in_single());
        let reaction = (((b - a).in_single() - c).in_single() + d).in_single();
        (squares.map(|square| (square * thrust).in_single()), reaction)
    }

    /// Sum of rotor positions times thrusts \[N m\], body.
    #[inline(always)]
    pub(super) fn lever(&self, thrusts: &[R; 4]) -> Vector3<R> {
        let along = |axis: usize| sum(&core::array::from_fn(|i| self.rotor_positions[i][axis] * thrusts[i]));
        Vector3::new(along(0), along(1), R::zero())
    }

    /// The ground effect, rotor by rotor from its world height, none once the drone has tipped over.
    #[inline(always)]
    fn ground_effect(&self, drone: &BulletState<R>, rotor_speeds: &[R; 4]) -> BodyWrench<R> {
        let [_, _, [from_x, from_y, up]] = drone.motion.world_from_body.rows();
        // Bullet reports a pitch of exactly 90° from here on (see `EulerAngles`), which fails the reference's test.
        let pole = R::from_f64(0.99999);
        let upright = R::zero().where_less(up, from_x.abs().where_less(pole, R::one(), R::zero()), R::zero());
        let thrusts: [R; 4] = core::array::from_fn(|i| {
            let [x, y] = self.rotor_positions[i];
            let height = drone.motion.position.z + (from_x * x + from_y * y);
            let height = height.at_least(self.ground_effect_floor);
            let gain = upright * self.ground_effect / (height * height);
            rotor_speeds[i] * rotor_speeds[i] * self.thrust_coefficient * gain
        });
        let lever = self.lever(&thrusts);
        BodyWrench {
            force: Vector3::new(R::zero(), R::zero(), sum(&thrusts)),
            torque: Vector3::new(lever.y, -lever.x, R::zero()),
        }
    }

    /// Drag \[N\], world.
    #[inline(always)]
    fn drag(&self, drone: &BulletState<R>, links: &Attitude<R>, rotor_speeds: &[R; 4]) -> Vector3<R> {
        let current = &drone.motion.world_from_body;
        let velocity = drone.motion.velocity;
        let strength = -match self.quirks.drag_rotors {
            DragRotors::Previous => sum(&drone.motion.rotor_speeds),
            DragRotors::Current => sum(rotor_speeds),
        };
        let scaled = |velocity: Vector3<R>| velocity.component_mul(&self.drag_coefficients) * strength;
        links.rotate(match self.quirks.drag_frame {
            DragFrame::ScaledInWorld => current.rotate_inverse(scaled(velocity)),
            DragFrame::TurnedTwice => current.rotate(scaled(velocity)),
            DragFrame::Body => scaled(current.rotate_inverse(velocity)),
        })
    }

    /// Where "up" is for the downwash, unit, body.
    #[inline(always)]
    fn downwash_direction(&self, current: &Attitude<R>, links: &Attitude<R>) -> Vector3<R> {
        current.rotate_inverse(match self.quirks.downwash_axis {
            DownwashAxis::Body => links.body_z(),
            DownwashAxis::World => Vector3::new(R::zero(), R::zero(), R::one()),
        })
    }

    /// Downwash \[N\] at a position of a drone at another \[m, world\]: a Gaussian jet that weakens with the square of
    /// the depth; none beside or above it.
    #[inline(always)]
    pub fn downwash(&self, position: &Vector3<R>, other: &Vector3<R>) -> R {
        let reach = R::from_f64(self.quirks.downwash_reach);
        let nearest = R::from_f64(self.quirks.downwash_nearest);
        let offset = Vector3::new(other.x - position.x, other.y - position.y, R::zero());
        let above = other.z - position.z;
        let depth = above.at_least(nearest);
        let width = self.downwash_slope * depth + self.downwash_offset;
        let distance_squared = square(&offset);
        let jet = (R::from_f64(-0.5) * distance_squared / (width * width)).exp();
        let push = self.downwash_strength / (depth * depth) * jet;
        let within = distance_squared.where_less(reach * reach, push, R::zero());
        R::zero().where_less(above, within, R::zero())
    }
}

#[inline(always)]
fn sum<R: Real>(values: &[R; 4]) -> R {
    (values[0] + values[1]) + (values[2] + values[3])
}
