//! Attitude of a drone: the unit quaternion that turns body vectors into world vectors.

use nalgebra::{Matrix3, Vector3};

use crate::real::Real;

/// Unit quaternion `world_from_body` (scalar first, Hamilton product).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Attitude<R> {
    /// Scalar part.
    pub w: R,
    /// Vector part, world frame.
    pub x: R,
    /// Vector part, world frame.
    pub y: R,
    /// Vector part, world frame.
    pub z: R,
}

impl<R: Real> Attitude<R> {
    /// Body axes parallel to the world's: level, facing +x.
    #[inline(always)]
    pub fn level() -> Self {
        Self { w: R::one(), x: R::zero(), y: R::zero(), z: R::zero() }
    }

    /// The same attitude in another number type.
    #[inline(always)]
    pub fn map<S>(&self, convert: impl Fn(R) -> S) -> Attitude<S> {
        Attitude { w: convert(self.w), x: convert(self.x), y: convert(self.y), z: convert(self.z) }
    }

    /// The world vector of a body vector.
    #[inline(always)]
    pub fn rotate(&self, in_body: Vector3<R>) -> Vector3<R> {
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = self.rows();
        Vector3::new(
            xx * in_body.x + xy * in_body.y + xz * in_body.z,
            yx * in_body.x + yy * in_body.y + yz * in_body.z,
            zx * in_body.x + zy * in_body.y + zz * in_body.z,
        )
    }

    /// The body vector of a world vector.
    #[inline(always)]
    pub fn rotate_inverse(&self, in_world: Vector3<R>) -> Vector3<R> {
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = self.rows();
        Vector3::new(
            xx * in_world.x + yx * in_world.y + zx * in_world.z,
            xy * in_world.x + yy * in_world.y + zy * in_world.z,
            xz * in_world.x + yz * in_world.y + zz * in_world.z,
        )
    }

    /// Body x and y of a world vector, by two cross products, which take fewer operations than [`Self::rotate_inverse`].
    #[inline(always)]
    pub fn planar_in_body(&self, in_world: &Vector3<R>) -> [R; 2] {
        let Self { w, x, y, z } = *self;
        let (x2, y2, z2) = (x + x, y + y, z + z);
        let twist_x = z2 * in_world.y - y2 * in_world.z;
        let twist_y = x2 * in_world.z - z2 * in_world.x;
        let twist_z = y2 * in_world.x - x2 * in_world.y;
        [
            in_world.x + w * twist_x + (z * twist_y - y * twist_z), //
            in_world.y + w * twist_y + (x * twist_z - z * twist_x),
        ]
    }

    /// Body z axis (thrust direction) in the world frame.
    #[inline(always)]
    pub fn body_z(&self) -> Vector3<R> {
        let (x2, y2) = (self.x + self.x, self.y + self.y);
        Vector3::new(x2 * self.z + y2 * self.w, y2 * self.z - x2 * self.w, self.up_cosine())
    }

    /// Cosine of the tilt: the world z component of the body z axis, 1 level and -1 upside down.
    #[inline(always)]
    pub fn up_cosine(&self) -> R {
        R::one() - ((self.x + self.x) * self.x + (self.y + self.y) * self.y)
    }

    /// Rotation matrix, rows in the world frame.
    #[inline(always)]
    pub fn rows(&self) -> [[R; 3]; 3] {
        let Self { w, x, y, z } = *self;
        let (one, two) = (R::one(), R::from_f64(2.0));
        [
            [one - two * (y * y + z * z), two * (x * y - w * z), two * (x * z + w * y)],
            [two * (x * y + w * z), one - two * (x * x + z * z), two * (y * z - w * x)],
            [two * (x * z - w * y), two * (y * z + w * x), self.up_cosine()],
        ]
    }

    /// Rotation matrix `world_from_body`.
    pub fn matrix(&self) -> Matrix3<R> {
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = self.rows();
        Matrix3::new(xx, xy, xz, yx, yy, yz, zx, zy, zz)
    }

    /// Time derivative of the quaternion under body rates \[rad/s\]: half the product with the pure quaternion
    /// (Diebel 2006, eq. 141).
    #[inline(always)]
    #[must_use]
    pub fn derivative(&self, body_rates: Vector3<R>) -> Self {
        let half = R::from_f64(0.5);
        let (p, q, r) = (half * body_rates.x, half * body_rates.y, half * body_rates.z);
        Self {
            w: -(self.x * p) - self.y * q - self.z * r,
            x: self.w * p + self.y * r - self.z * q,
            y: self.w * q + self.z * p - self.x * r,
            z: self.w * r + self.x * q - self.y * p,
        }
    }

    /// `self + rate * secs`, component by component: not a unit quaternion until [`Self::normalized`].
    #[inline(always)]
    #[must_use]
    pub fn advanced(&self, rate: &Self, secs: R) -> Self {
        Self {
            w: self.w + rate.w * secs,
            x: self.x + rate.x * secs,
            y: self.y + rate.y * secs,
            z: self.z + rate.z * secs,
        }
    }

    /// Scaled to unit length.
    #[inline(always)]
    #[must_use]
    pub fn normalized(&self) -> Self {
        let square = self.w * self.w + self.x * self.x + (self.y * self.y + self.z * self.z);
        let scale = R::one() / square.sqrt();
        Self { w: self.w * scale, x: self.x * scale, y: self.y * scale, z: self.z * scale }
    }

    /// Hamilton product: first `other`, then `self`.
    #[inline(always)]
    #[must_use]
    pub fn after(&self, other: &Self) -> Self {
        Self {
            w: self.w * other.w - self.x * other.x - self.y * other.y - self.z * other.z,
            x: self.w * other.x + self.x * other.w + self.y * other.z - self.z * other.y,
            y: self.w * other.y - self.x * other.z + self.y * other.w + self.z * other.x,
            z: self.w * other.z + self.x * other.y - self.y * other.x + self.z * other.w,
        }
    }
}

impl Attitude<f64> {
    /// Turn by `angle_rad` about a unit `axis` (world frame).
    pub fn from_axis_angle(axis: Vector3<f64>, angle_rad: f64) -> Self {
        let (sine, cosine) = libm::sincos(0.5 * angle_rad);
        Self { w: cosine, x: axis.x * sine, y: axis.y * sine, z: axis.z * sine }
    }

    /// Roll, pitch and yaw \[rad\] of the z-y-x (aerospace) convention, in Bullet's order.
    pub fn roll_pitch_yaw(&self) -> [f64; 3] {
        let Self { w, x, y, z } = *self;
        let roll = libm::atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y));
        let pitch = libm::asin((2.0 * (w * y - x * z)).clamp(-1.0, 1.0));
        let yaw = libm::atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z));
        [roll, pitch, yaw]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_z_turns_forward_into_left() {
        let turn = Attitude::from_axis_angle(Vector3::z(), core::f64::consts::FRAC_PI_2);
        assert!((turn.rotate(Vector3::x()) - Vector3::y()).norm() < 1e-12);
        assert!((turn.rotate_inverse(Vector3::y()) - Vector3::x()).norm() < 1e-12);
    }

    #[test]
    fn rotation_then_its_inverse_is_nothing() {
        let axis = Vector3::new(1.0, 2.0, -0.5).normalize();
        let turn = Attitude::from_axis_angle(axis, 2.1);
        let vector = Vector3::new(0.3, -0.7, 1.9);
        assert!((turn.rotate_inverse(turn.rotate(vector)) - vector).norm() < 1e-12);
        let [x, y] = turn.planar_in_body(&turn.rotate(vector));
        assert!((x - vector.x).abs() < 1e-12 && (y - vector.y).abs() < 1e-12, "{x} {y}");
        assert!((turn.matrix() * vector - turn.rotate(vector)).norm() < 1e-12);
        assert!((turn.body_z() - turn.rotate(Vector3::z())).norm() < 1e-12);
    }

    #[test]
    fn the_derivative_is_the_limit_of_a_small_turn() {
        let start = Attitude::from_axis_angle(Vector3::new(0.6, 0.0, 0.8), 0.9);
        let rates = Vector3::new(0.2, -0.4, 0.7);
        let secs = 1e-6;
        let turned = start.after(&Attitude::from_axis_angle(rates.normalize(), rates.norm() * secs));
        let moved = start.advanced(&start.derivative(rates), secs);
        for (a, b) in [(turned.w, moved.w), (turned.x, moved.x), (turned.y, moved.y), (turned.z, moved.z)] {
            assert!((a - b).abs() < 1e-12);
        }
    }

    #[test]
    fn angles_come_back() {
        let yaw = Attitude::from_axis_angle(Vector3::z(), 0.5);
        let pitch = Attitude::from_axis_angle(Vector3::y(), 0.3);
        let roll = Attitude::from_axis_angle(Vector3::x(), -0.2);
        let angles = yaw.after(&pitch.after(&roll)).roll_pitch_yaw();
        for (angle, expected) in angles.into_iter().zip([-0.2, 0.3, 0.5]) {
            assert!((angle - expected).abs() < 1e-12);
        }
    }
}
