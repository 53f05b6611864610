//! Motions as the reference logs them, and how far a simulated drone is from them.

use kestrel_core::airframe::{Airframe, RADIANS_PER_SECOND_PER_RPM};
use kestrel_core::attitude::Attitude;
use kestrel_core::reference::bullet::{Bullet, BulletState};
use kestrel_core::vehicle::State;
use nalgebra::Vector3;

/// Free space that a flight needs around the collision cylinder \[m\]: Bullet reports contacts at less than 4 mm.
const CLEARANCE: f64 = 0.005;

/// Position, quaternion x y z w, velocity and angular velocity, all world, SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Logged(pub [f64; 13]);

impl Logged {
    /// Level and at rest \[m, world\].
    pub(super) fn at_rest([x, y, z]: [f64; 3]) -> Self {
        Self([x, y, z, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    }

    /// A drone put there, its rotors forgotten.
    pub fn placed(&self) -> BulletState<f64> {
        let [px, py, pz, x, y, z, w, vx, vy, vz, wx, wy, wz] = self.0;
        let world_from_body = Attitude { w, x, y, z };
        BulletState::placed(State {
            position: Vector3::new(px, py, pz),
            world_from_body,
            velocity: Vector3::new(vx, vy, vz),
            body_rates: world_from_body.rotate_inverse(Vector3::new(wx, wy, wz)),
            rotor_speeds: [0.0; 4],
        })
    }

    /// One, unless the recording is broken.
    pub(super) fn quaternion_norm(&self) -> f64 {
        self.0[3..7].iter().map(|part| part * part).sum::<f64>().sqrt()
    }

    /// Greatest absolute difference of any logged number; a quaternion counts as its opposite.
    pub fn deviation(&self, drone: &BulletState<f64>) -> f64 {
        let logged = &self.0;
        let Attitude { w, x, y, z } = drone.motion.world_from_body;
        let same_side = x * logged[3] + y * logged[4] + z * logged[5] + w * logged[6];
        let sign = if same_side < 0.0 { -1.0 } else { 1.0 };
        let attitude = [x, y, z, w].map(|part| sign * part);
        let spin = drone.reported_angular_velocity;
        let (position, velocity) = (drone.motion.position, drone.motion.velocity);
        largest(&[position.as_slice(), &attitude, velocity.as_slice(), spin.as_slice()].concat(), logged)
    }
}

/// Greatest absolute difference of two lists of the same length: absent recorded numbers (NaN) do not count, a
/// computed NaN is infinitely far from anything.
pub(super) fn largest(computed: &[f64], recorded: &[f64]) -> f64 {
    assert_eq!(computed.len(), recorded.len(), "both lists name the same quantities");
    let far = |(a, b): (&f64, &f64)| match (a - b).abs() {
        _ if b.is_nan() => 0.0,
        difference if difference.is_nan() => f64::INFINITY,
        difference => difference,
    };
    computed.iter().zip(recorded).map(far).fold(0.0, f64::max)
}

/// \[rad/s\] of \[RPM\].
pub(super) fn rotor_speeds(rpm: [f64; 4]) -> [f64; 4] {
    rpm.map(|rpm| rpm * RADIANS_PER_SECOND_PER_RPM)
}

/// \[RPM\] of \[rad/s\].
pub(super) fn rpm(rotor_speeds: [f64; 4]) -> [f64; 4] {
    rotor_speeds.map(|speed| speed / RADIANS_PER_SECOND_PER_RPM)
}

/// The reference's two rates: physics steps of `step_secs`, of which a control period has `substeps`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// \[s\].
    pub step_secs: f64,
    /// At least one.
    pub substeps: usize,
}

impl Clock {
    /// \[s\].
    pub fn control_secs(&self) -> f64 {
        self.substeps as f64 * self.step_secs
    }
}

/// Free flight of one control period; none if the drone comes near the floor.
pub(super) fn flown(
    bullet: &Bullet<f64>,
    airframe: &Airframe,
    clock: &Clock,
    start: BulletState<f64>,
    rotor_speeds: &[f64; 4],
) -> Option<BulletState<f64>> {
    (0..clock.substeps).try_fold(start, |drone, _| {
        let after = bullet.step(&drone, rotor_speeds, &[], clock.step_secs);
        free_of_floor(airframe, &after.motion).then_some(after)
    })
}

/// Whether the collision cylinder is well above a floor at z = 0; a NaN is, because it is no contact.
pub(super) fn free_of_floor(airframe: &Airframe, drone: &State<f64>) -> bool {
    let up = drone.world_from_body.body_z().z;
    let across = (1.0 - up * up).max(0.0).sqrt();
    let reach = airframe.collision_radius * across + 0.5 * airframe.collision_height * up.abs();
    let lowest = drone.position.z + airframe.collision_offset * up - reach;
    lowest.is_nan() || lowest > CLEARANCE
}

/// Whether two drones are too far apart to touch.
pub(super) fn apart(airframe: &Airframe, one: &Vector3<f64>, other: &Vector3<f64>) -> bool {
    let half_height = 0.5 * airframe.collision_height + airframe.collision_offset.abs();
    let reach = airframe.collision_radius.hypot(half_height);
    (one - other).norm() > 2.0 * reach + CLEARANCE
}
